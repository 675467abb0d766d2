"""How `matches.json` holds the classes of a result, where that differs from their fields (`formats.convert`)."""

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from zpm2.formats.convert import Converter, Layout, Members
from zpm2.model import Georeference, ImagePolygons, PointMatches, Polygon, PolygonMatch

_CRS = re.compile(r"EPSG:\d+|\s*[A-Z][A-Z_0-9]*\s*[\[(].*", re.DOTALL)
_GEOREFERENCE = ("crs", "transform", "gsd", "rpc")


def _with_area(polygon: Polygon, members: Members) -> Members:
    return members | {"area": polygon.area}


def _check_rings(polygon: Polygon) -> None:
    for ring in (polygon.exterior, *polygon.holes):
        _check_ring(ring)


def _check_ring(ring: NDArray[np.float64]) -> None:
    if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or not np.isfinite(ring).all():
        raise ValueError("a ring must have at least 3 vertices [x, y]")


def _check_crs(geo: Georeference) -> None:
    if geo.crs is not None and not _CRS.fullmatch(geo.crs):  # GDAL would also accept URLs and file names
        raise ValueError(f"crs {geo.crs[:40]!r} is neither EPSG:... nor WKT")


def _fold_side(side: ImagePolygons, members: Members) -> Members:
    """Puts the georeference's members beside the side's own, and the reason for no match into each polygon."""
    geo, reasons = members.pop("geo"), members.pop("unmatched")
    for polygon in members["polygons"]:
        if polygon["id"] in reasons:
            polygon["unmatched"] = reasons[polygon["id"]]
    return members | geo


def _unfold_side(members: Members) -> Members:
    unmatched = {p["id"]: p["unmatched"] for p in members["polygons"] if "unmatched" in p}
    geo = {name: members.pop(name) for name in _GEOREFERENCE if name in members}
    return members | {"geo": geo, "unmatched": unmatched}


def _with_id(match: PolygonMatch, members: Members) -> Members:
    if match.visible == 1.0:
        del members["visible"]
    return {"id": match.id} | members


LAYOUTS: Mapping[type, Layout] = {
    Polygon: Layout(
        names={"exterior": "vertices"},
        order=("id", "vertices", "holes", "area", "score", "parent"),
        sparse=("label", "source_id", "properties"),
        fold=_with_area,
        check=_check_rings,
    ),
    Georeference: Layout(optional=_GEOREFERENCE, shapes={"transform": (2, 3)}, check=_check_crs),
    ImagePolygons: Layout(
        order=("path", "width", "height", *_GEOREFERENCE, "polygons"),
        unsaved=("image",),  # pixels stay in the photographs
        fold=_fold_side,
        unfold=_unfold_side,
    ),
    PointMatches: Layout(shapes={"left": (-1, 2), "right": (-1, 2), "score": (-1,)}),
    PolygonMatch: Layout(
        sparse=("outline",),
        optional=("nodes", "visible"),
        shapes={"nodes": (-1, 2), "outline": (-1, 5)},
        decimals={"outline": 3},
        fold=_with_id,
    ),
}
_CONVERTER = Converter(LAYOUTS)


to_plain = _CONVERTER.to_plain
from_plain = _CONVERTER.from_plain
