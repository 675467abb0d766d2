"""The regions of overlapping tiles as the regions of one photograph: no duplicates, and no outline cut by a tile.

A region that reaches an inner border of its window may continue beyond it. So may a region of the other photograph that
was found by prompting with it. Such a piece is not used by itself. If a whole region of another tile or level agrees
with the piece inside the window, the whole region replaces it. Otherwise, pieces from neighbouring windows of one level
are united if they agree in the strip that both windows show. If a union still ends at a border, it is left out: its
outline would be the tile's, not the scene's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import Config, StitchConfig
from zpm2.model import Polygon, shapes_of
from zpm2.photos.raster import Window
from zpm2.polygons.nest import with_parents
from zpm2.polygons.overlap import iou
from zpm2.polygons.repair import largest
from zpm2.polygons.shapes import as_objects, from_shape

Array = NDArray[np.float64]
Shapes = NDArray[np.object_]


@dataclass(frozen=True, eq=False)
class RegionPieces:
    """Regions of one photograph as the tiles found them; row k of each array belongs to region k."""

    polygons: Sequence[Polygon]  # (n,) px of the photograph
    tile: NDArray[np.int64]  # (n,) index of the window that each comes from
    cut: NDArray[np.bool_]  # (n,) whether the tile's border cuts it
    guided: NDArray[np.bool_]  # (n,) whether it was found by prompting with a region of the other photograph
    windows: Sequence[Window]  # (t,) px
    levels: NDArray[np.int64]  # (t,) larger means finer


@dataclass(frozen=True, eq=False)
class StitchedRegions:
    """The regions of one photograph."""

    polygons: list[Polygon]  # ids from 0 on, with parents
    guided: NDArray[np.bool_]  # (n,)
    united: int  # number of regions united from several pieces
    incomplete: int  # number of pieces left out, because no tile or union shows the whole region


def stitch(pieces: RegionPieces, size: tuple[int, int], config: Config, min_area: float) -> StitchedRegions:
    """The regions of a photograph of `size` (width, height) px, of at least `min_area` px^2, finer levels first.

    If two overlap by more than `segment.nms_iou`, the one of the finer level stays; in one level, the one with the
    better score.
    Outlines of united pieces are simplified (`vectorize.tolerance`).
    """
    chosen, nms_iou = config.tiles.stitch, config.segment.nms_iou
    shapes = shapes_of(pieces.polygons)
    level = pieces.levels[pieces.tile] if len(pieces.polygons) else np.zeros(0, np.int64)
    score = np.array([polygon.score for polygon in pieces.polygons])
    borders = [_Borders(window, size, chosen) for window in pieces.windows]
    whole = np.flatnonzero(~pieces.cut)
    whole = whole[suppress(shapes[whole], np.lexsort((-score[whole], -level[whole])), nms_iou)]
    rest = np.flatnonzero(pieces.cut)
    rest = rest[~_replaced(shapes, rest, pieces.tile, whole, borders, chosen)]
    groups = _groups(shapes, rest, pieces.tile, level, borders, chosen)
    united, members = _unite(shapes, groups, pieces.tile, borders, config)
    candidates = np.append(shapes[whole], united)
    guided = np.append(pieces.guided[whole], [pieces.guided[group].any() for group in members]).astype(bool)
    scores = np.append(score[whole], [score[group].min() for group in members])
    levels = np.append(level[whole], [level[group[0]] for group in members])
    is_united = np.arange(len(candidates)) >= len(whole)
    kept = suppress(candidates, np.lexsort((-scores, is_united, -levels)), nms_iou)
    kept = np.sort(kept[shapely.area(candidates[kept]) >= min_area])
    polygons = [
        from_shape(candidates[row], k, float(scores[row]))
        if is_united[row]
        else replace(pieces.polygons[whole[row]], id=k)
        for k, row in enumerate(kept)
    ]
    left_out = len(rest) - sum(map(len, members))
    return StitchedRegions(with_parents(polygons, config.vectorize), guided[kept], int(is_united[kept].sum()), left_out)


def cut_by_window(
    polygons: Sequence[Polygon], window: Window, size: tuple[int, int], config: StitchConfig
) -> NDArray[np.bool_]:
    """(n,) whether a region of a window reaches a border of the window that is not the photograph's own border."""
    if not polygons:
        return np.zeros(0, bool)
    borders = _Borders(window, size, config)
    free, box = borders.shrunk(1.0), np.array([polygon.bounds for polygon in polygons])
    return np.asarray((borders.inner & np.c_[box[:, :2] < free[:2], box[:, 2:] > free[2:]]).any(1))


def suppress(shapes: Shapes, order: NDArray[np.intp], threshold: float) -> NDArray[np.intp]:
    """Non-maximum suppression: the rows of the (n,) polygons that stay.

    Each polygon, in `order`, removes the later ones that it overlaps by an IoU of more than `threshold`.
    """
    n = len(shapes)
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    i, j = shapely.STRtree(shapes).query(shapes)
    area = shapely.area(shapes)
    keep = (rank[i] < rank[j]) & (np.minimum(area[i], area[j]) > threshold * np.maximum(area[i], area[j]))
    i, j = i[keep], j[keep]
    box = shapely.bounds(shapes).reshape(-1, 4)
    shared = np.clip(np.minimum(box[i, 2:], box[j, 2:]) - np.maximum(box[i, :2], box[j, :2]), 0, None).prod(1)
    keep = shared > threshold / (1 + threshold) * (area[i] + area[j])  # the intersection is no larger
    i, j = i[keep], j[keep]
    same = iou(shapes[i], shapes[j]) > threshold
    i, j = i[same], j[same]
    by_rank = np.argsort(rank[i], kind="stable")
    alive = np.ones(n, bool)
    for a, b in zip(i[by_rank].tolist(), j[by_rank].tolist(), strict=True):
        if alive[a]:
            alive[b] = False
    return order[alive[order]]


class _Borders:
    """A window and its inner borders: those that are not the photograph's own."""

    def __init__(self, window: Window, size: tuple[int, int], config: StitchConfig) -> None:
        x0, y0, x1, y1 = window
        self.box = shapely.box(*window)
        self.tolerance = max(config.min_border, config.border * max(x1 - x0, y1 - y0))
        self.inner = np.array([x0 > 0, y0 > 0, x1 < size[0], y1 < size[1]])
        self.window = np.array(window, np.float64)

    def shrunk(self, by: float) -> Array:
        """(4,) the window with its inner borders moved inwards by that many tolerances."""
        return self.window + np.array([1, 1, -1, -1]) * self.inner * by * self.tolerance

    def strips(self) -> list[shapely.Polygon]:
        """The ground along each inner border, as wide as the tolerance."""
        x0, y0, x1, y1 = self.window
        a, b, c, d = self.shrunk(1.0)
        strips = (x0, y0, a, y1), (x0, y0, x1, b), (c, y0, x1, y1), (x0, d, x1, y1)
        return [shapely.box(*strip) for strip, inner in zip(strips, self.inner, strict=True) if inner]


def _replaced(
    shapes: Shapes,
    rest: NDArray[np.intp],
    tile: NDArray[np.int64],
    whole: NDArray[np.intp],
    borders: Sequence[_Borders],
    config: StitchConfig,
) -> NDArray[np.bool_]:
    """(r,) whether a cut piece of `rest` is a part of a `whole` region."""
    i, j = shapely.STRtree(shapes[whole]).query(shapes[rest], predicate="intersects")
    window = as_objects([border.box for border in borders])[tile[rest[i]]]
    seen = shapely.intersection(shapes[whole[j]], window)
    found = np.zeros(len(rest), bool)
    found[i[iou(shapes[rest[i]], seen) >= config.min_agreement]] = True
    return found


def _groups(
    shapes: Shapes,
    rest: NDArray[np.intp],
    tile: NDArray[np.int64],
    level: NDArray[np.int64],
    borders: Sequence[_Borders],
    config: StitchConfig,
) -> list[list[int]]:
    """Groups of two or more pieces of one region, each from a different window of the same level.

    The pieces that agree best are joined first, as long as no group gets two pieces of one window.
    """
    i, j = shapely.STRtree(shapes[rest]).query(shapes[rest], predicate="intersects")
    a, b = rest[i], rest[j]
    keep = (i < j) & (tile[a] != tile[b]) & (level[a] == level[b])
    a, b = a[keep], b[keep]
    boxes = as_objects([border.box for border in borders])
    strip = shapely.intersection(boxes[tile[a]], boxes[tile[b]])
    alike = iou(shapely.intersection(shapes[a], strip), shapely.intersection(shapes[b], strip))
    order = np.argsort(-alike, kind="stable")
    order = order[alike[order] >= config.min_agreement]
    group: dict[int, list[int]] = {}
    for first, second in zip(a[order].tolist(), b[order].tolist(), strict=True):
        one, other = group.get(first, [first]), group.get(second, [second])
        if one is not other and not {tile[k] for k in one} & {tile[k] for k in other}:
            both = one + other
            group.update((k, both) for k in both)
    distinct = {id(members): sorted(members) for members in group.values()}
    return sorted(distinct.values())


def _unite(
    shapes: Shapes, groups: list[list[int]], tile: NDArray[np.int64], borders: Sequence[_Borders], config: Config
) -> tuple[Shapes, list[list[int]]]:
    """The union of each group that is whole, and its members."""
    chosen = config.tiles.stitch
    found, members = [], []
    for group in groups:
        if any(_ends(shapes, k, group, tile, borders, chosen) for k in group):
            continue
        trimmed = [shapely.intersection(shapes[k], shapely.box(*borders[tile[k]].shrunk(chosen.trim))) for k in group]
        inner, full = (largest(shapely.union_all(parts)) for parts in (trimmed, shapes[group]))
        outline = inner if inner.area >= chosen.min_trimmed * full.area else full  # windows may hardly overlap
        simple = shapely.simplify(outline, config.vectorize.tolerance)
        found.append(simple if simple.is_valid and not simple.is_empty else outline)
        members.append(group)
    return as_objects(found), members


def _ends(
    shapes: Shapes,
    k: int,
    group: list[int],
    tile: NDArray[np.int64],
    borders: Sequence[_Borders],
    config: StitchConfig,
) -> bool:
    """Whether piece `k` touches an inner border of its window where no other piece of the group continues it.

    A piece whose window has the same border there does not continue it.
    """
    inside = [shapely.intersection(shapes[m], shapely.box(*borders[tile[m]].shrunk(1.0))) for m in group if m != k]
    others = shapely.union_all(inside)
    for strip in borders[tile[k]].strips():
        touching = shapely.intersection(shapes[k], strip)
        if touching.area > 0 and shapely.intersection(touching, others).area < config.min_continued * touching.area:
            return True
    return False
