"""Where to look closer: in which parts of both images smaller regions are likely.

A network sees each image at one size. What is small there is missed: most of all where one image shows little of the
other, and where the scene consists of many small things. Blobs (`segment.blobs`) tell where these are: places that
differ from their surroundings, and lie in no matched region of about their size.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config
from zpm2.global_match import InitialGeometry
from zpm2.model import Image, Polygon, PolygonArrays, thin
from zpm2.polygons.shapes import rings_of
from zpm2.polygons.warp import warp_by_points
from zpm2.segment.blobs import blobs, has_data
from zpm2.segment.mask_view import decoded_size

Array = NDArray[np.float64]
Box = tuple[int, int, int, int]  # x0, y0, x1, y1: px of an image, whole numbers


class WindowPair(NamedTuple):
    """The same part of the scene in both images."""

    left: Box
    right: Box


@dataclass(frozen=True, eq=False)
class SharedPart:
    """The part of the left image that the right one shows, as n square cells."""

    sizes: tuple[tuple[int, int], tuple[int, int]]  # (width, height) px of both images
    cells: NDArray[np.object_]  # (n,) shapely boxes, left image px
    warped: NDArray[np.object_]  # (n,) the same, right image px

    @property
    def zoom(self) -> float:
        """How many times as large as in the other photograph things are in the one that shows them larger, >= 1."""
        area = shapely.area(self.warped) / shapely.area(self.cells)
        if not area.any():
            return 1.0
        ratio = float(np.sqrt(np.median(area[area > 0])))
        return max(ratio, 1 / ratio)

    def covered(self, matched: NDArray[np.object_]) -> float:
        """Share of the cells whose centres lie in one of the left polygons `matched` (m,); 1 where there are none."""
        if not len(self.cells):
            return 1.0
        inside, _ = shapely.STRtree(matched).query(shapely.centroid(self.cells), predicate="intersects")
        return len(np.unique(inside)) / len(self.cells)

    def shown(self, points: Array) -> NDArray[np.bool_]:
        """(k,) which of the (k, 2) points, left image px, lie in one of the cells."""
        result = np.zeros(len(points), bool)
        result[shapely.STRtree(self.cells).query(shapely.points(points), predicate="intersects")[0]] = True
        return result

    def window(self, x0: float, y0: float, x1: float, y1: float) -> WindowPair | None:
        """The window of the left image around these bounds, and that of the right one; None where neither shows the
        other."""
        left = _whole((x0, y0, x1, y1), self.sizes[0])
        here = shapely.STRtree(self.cells).query(shapely.box(*left), predicate="intersects")
        if not len(here):
            return None
        return WindowPair(left, _whole(shapely.total_bounds(self.warped[here]), self.sizes[1]))


def shared_part(images: tuple[Image, Image], initial: InitialGeometry, config: Config) -> SharedPart:
    """The cells of the left image whose centres lie in the right one, by the homologous points around each."""
    left, right = images
    side = max(left.width, left.height) / config.segment.detail.cells
    x, y = np.meshgrid(np.arange(0, left.width, side), np.arange(0, left.height, side))
    ends = np.minimum(x + side, left.width), np.minimum(y + side, left.height)
    cells = shapely.box(x.ravel(), y.ravel(), ends[0].ravel(), ends[1].ravel())
    polygons = PolygonArrays([Polygon(k, exterior) for k, (exterior,) in enumerate(rings_of(cells))])
    warped = warp_by_points(polygons, *initial.forward(), config.local_match).shapes
    seen = shapely.intersects(shapely.centroid(warped), shapely.box(0, 0, right.width, right.height))
    return SharedPart(((left.width, left.height), (right.width, right.height)), cells[seen], warped[seen])


def open_blobs(image: Image, part: SharedPart, matched: NDArray[np.object_], config: Config) -> Array:
    """(k, 2) the blobs of the left image, px, that the right one shows and that lie in no polygon of about their size
    among `matched` (m,). They are as small as a window of the first halving can show."""
    closer = config.segment.detail.side / max(decoded_size(image)) * max(image.width, image.height)
    size = max(1, round(image.height / closer)), max(1, round(image.width / closer))
    found = blobs(image, has_data(image, size), config.segment.prompts)
    scale = np.array([image.width / size[1], image.height / size[0]])
    points, area = found.points * scale, found.area * scale.prod()
    shown = part.shown(points)
    points, area = points[shown], area[shown]
    smallest = np.full(len(points), np.inf)
    blob, polygon = shapely.STRtree(matched).query(shapely.points(points), predicate="intersects")
    np.minimum.at(smallest, blob, shapely.area(matched)[polygon])
    return points[smallest > config.segment.prompts.max_mask_to_blob * area]


def candidates(part: SharedPart, config: Config) -> list[list[WindowPair]]:
    """The windows of each halving: the shared part as a whole where it is small in either image, then 2 x 2, 4 x 4."""
    detail = config.segment.detail
    found: list[list[WindowPair]] = []
    if not len(part.cells):
        return found
    whole = part.window(*shapely.total_bounds(part.cells))
    if whole is not None and any(
        _side(box) <= detail.max_part * max(size)
        for box, size in zip((whole.left, whole.right), part.sizes, strict=True)
    ):
        found.append([whole])
    halvings = detail.high_halvings if detail.level == "high" else detail.auto_halvings
    for halving in range(1, halvings + 1):
        found.append([w for w in _divided(part, 2**halving, detail.side**halving) if _shows_more(w, config)])
    return found


def _divided(part: SharedPart, number: int, share: float) -> Iterator[WindowPair]:
    """`number` x `number` windows, evenly spread over the shared part, each `share` of its sides."""
    x0, y0, x1, y1 = shapely.total_bounds(part.cells)
    size = np.array([x1 - x0, y1 - y0])
    for row in range(number):
        for column in range(number):
            low = np.array([x0, y0]) + size * (1 - share) * np.array([column, row]) / (number - 1)
            window = part.window(*low, *(low + share * size))
            if window is not None:
                yield window


def _shows_more(window: WindowPair, config: Config) -> bool:
    sides = [(box[2] - box[0], box[3] - box[1]) for box in (window.left, window.right)]
    return all(max(size) >= config.segment.detail.min_side and not thin(*size) for size in sides)


def inside(points: Array, box: Box) -> NDArray[np.bool_]:
    """(k,) which of the (k, 2) points lie in a box."""
    return np.asarray(((points >= box[:2]) & (points < box[2:])).all(1))


def _whole(bounds: Sequence[float] | Array, size: tuple[int, int]) -> Box:
    """Bounds as whole px, within an image of `size` (width, height)."""
    low = np.clip(np.floor(bounds[:2]), 0, np.array(size) - 1).astype(int)
    high = np.clip(np.ceil(bounds[2:]), low + 1, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _side(box: Box) -> int:
    return max(box[2] - box[0], box[3] - box[1])
