"""Regions given by the user, in any of the formats of `formats.regions`."""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import SegmentConfig, VectorizeConfig
from zpm2.errors import InputError
from zpm2.formats import geojson
from zpm2.formats.regions.outlines import repaired
from zpm2.formats.regions.region import GivenRegion, Shape, counted, split_layer
from zpm2.formats.regions.registry import open_regions
from zpm2.model import Image, Mask, Polygon
from zpm2.polygons.nest import with_parents
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.repair import polygons_in
from zpm2.polygons.shapes import from_shape
from zpm2.polygons.trace import pieces
from zpm2.polygons.vectorize import vectorize


@dataclass(frozen=True, eq=False)
class _Piece:
    """One connected piece of a region, valid and inside of the image."""

    body: Mask | shapely.Polygon
    rank: int  # 0 for the largest piece of its region
    region: GivenRegion


class PrecomputedSegmenter:
    """Regions from a file instead of from a network; both a `Segmenter` and a `PolygonSource`.

    The file is read at once, so that a wrong one is known before long work. Pixels become polygons as those of any
    segmenter do, with the tolerance of `config`; polygons keep their vertices as they stand in the file. A polygon's id
    is that of its region (label value, annotation id, feature id) where these are whole numbers and distinct; further
    pieces of a region are numbered on from the greatest. Whatever the ids are, `source_id` keeps the region's own one,
    and `properties` what else its file says of it. Pieces under `min_area` px^2 are dropped. `notes` says what the
    latest call dropped, cut, repaired or numbered anew.

    Raises `InputError` for a file that cannot be read, is of another image size, or holds no region of the image.
    """

    name = "precomputed"

    def __init__(
        self, path: str | Path, config: VectorizeConfig | None = None, min_area: float = SegmentConfig().min_area
    ) -> None:
        self.path, _ = split_layer(path)
        self.config = config or VectorizeConfig()
        self.min_area = min_area
        self.notes: list[str] = []
        self._file = open_regions(path)

    def segment(self, image: Image) -> list[Mask]:
        """The regions as pixels, one mask per connected piece; of polygons the pixels whose centre lies inside."""
        found = []
        for piece in self._pieces(image):
            mask = piece.body if isinstance(piece.body, Mask) else rasterize(piece.body)
            found.append(replace(mask, score=piece.region.score, label=piece.region.label))
        filled = [mask for mask in found if mask.bits.any()]
        if len(filled) < len(found):
            self.notes.append(f"{counted(len(found) - len(filled), 'region')} without a pixel centre inside left out")
        return filled

    def polygons(self, image: Image) -> list[Polygon]:
        """The regions as polygons with parents, one per connected piece."""
        found = self._pieces(image)
        masks = [piece.body for piece in found if isinstance(piece.body, Mask)]
        traced = iter(vectorize(masks, self.config, self.min_area, (image.width, image.height)))
        polygons = [
            next(traced) if isinstance(piece.body, Mask) else from_shape(piece.body, 0, piece.region.score)
            for piece in found
        ]
        named = zip(polygons, self._ids(found), found, strict=True)
        return with_parents([_named(polygon, id, piece.region) for polygon, id, piece in named], self.config)

    def _pieces(self, image: Image) -> list[_Piece]:
        read = self._file.read(image)
        self.notes[:] = read.notes
        if not read.regions:
            raise InputError(f"{self.path} holds no region of the image: give a file with at least one")
        counts: Counter[str] = Counter()
        box = shapely.box(0, 0, image.width, image.height)
        found = []
        for region in read.regions:
            bodies = pieces(region.body) if isinstance(region.body, Mask) else _valid(region.body, box, counts)
            enough = [body for body in bodies if body.area >= self.min_area and body.area > 0]
            counts[f"under {self.min_area:g} px^2 left out"] += len(bodies) - len(enough)
            found += [_Piece(body, rank, region) for rank, body in enumerate(enough)]
        self.notes += [f"{counted(n, 'region')} {what}" for what, n in counts.items() if n]
        if max((piece.body.area for piece in found), default=0) < 1:  # whatever is asked for: these are degrees
            raise InputError(
                f"{self.path} has no region of at least {max(self.min_area, 1):g} px^2 in the {image.width} x "
                f"{image.height} px image: check that its coordinates are pixels of this image, or lower "
                "segment.min_area"
            )
        return found

    def _ids(self, found: list[_Piece]) -> list[int]:
        given = [piece.region.id for piece in found if piece.rank == 0]
        usable = [id for id in given if id is not None and id < 2**53]  # what a JSON number holds exactly
        if len(set(usable)) < len(given):
            if any(piece.region.source_id is not None for piece in found):
                self.notes.append("the regions' ids are not distinct whole numbers: numbered from 0 instead")
            return list(range(len(found)))
        further = max(usable)
        ids = []
        for piece in found:
            further += piece.rank > 0
            ids.append(further if piece.rank or piece.region.id is None else piece.region.id)
        return ids


def _named(polygon: Polygon, id: int, region: GivenRegion) -> Polygon:
    """A polygon with all that the file says of its region."""
    return replace(
        polygon,
        id=id,
        score=region.score,
        label=region.label,
        source_id=region.source_id,
        properties=region.properties,
    )


def _valid(parts: tuple[geojson.Rings, ...], box: shapely.Polygon, counts: Counter[str]) -> list[shapely.Polygon]:
    """The polygons of a region, repaired and cut at the image's `box`, the largest first; `counts` says what was done,
    once for all parts.

    What is valid and inside keeps its vertices, but for repeated ones.
    """
    if not parts:
        counts["that are no polygons left out"] += 1
    told, found, covered = list[str](), list[shapely.Polygon](), True
    for part in parts:
        rings = [_without_repeats(ring) for ring in part]
        if not rings or len(rings[0]) < 3:
            told.append("with fewer than 3 vertices left out")
            continue
        shape: Shape = shapely.Polygon(rings[0], [ring for ring in rings[1:] if len(ring) >= 3])
        if not shape.is_valid:
            told.append("with crossing rings repaired")
            shape = repaired(shape)
            if shape.is_empty:
                told.append("without any area left out")
                continue
        if not box.covers(shape):
            shape, covered = shape.intersection(box), False
        found += polygons_in(shape)
    if not covered:
        told.append("reaching out of the image cut at its border" if found else "outside of the image left out")
    counts.update(dict.fromkeys(told, 1))
    return sorted(found, key=lambda shape: -shape.area)


def _without_repeats(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """A ring (n, 2) without vertices that equal the next one."""
    return ring[(ring != np.concatenate([ring[1:], ring[:1]])).any(1)]
