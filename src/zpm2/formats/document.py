"""The parts of a `matches.json` as plain values, and back."""

import re
from collections.abc import Mapping
from operator import index
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import Failed
from zpm2.model import Georeference, ImagePolygons, PointMatches, Polygon, PolygonMatch

_CRS = re.compile(r"EPSG:\d+|\s*[A-Z][A-Z_0-9]*\s*[\[(].*", re.DOTALL)


def side_to_dict(side: ImagePolygons) -> dict[str, Any]:
    """A side of `matches.json`."""
    polygons = [
        {
            "id": p.id,
            "vertices": p.exterior.tolist(),
            "holes": [hole.tolist() for hole in p.holes],
            "area": p.area,
            "score": p.score,
            "parent": p.parent,
            **({"label": p.label} if p.label is not None else {}),
            **({"source_id": p.source_id} if p.source_id is not None else {}),
            **({"properties": dict(p.properties)} if p.properties else {}),
            **({"unmatched": side.unmatched[p.id]} if p.id in side.unmatched else {}),
        }
        for p in side.polygons
    ]
    geo = {
        "crs": side.geo.crs,
        "transform": None if side.geo.transform is None else side.geo.transform.tolist(),
        "gsd": side.geo.gsd,
        "rpc": None if side.geo.rpc is None else dict(side.geo.rpc),
    }
    return {"path": side.path, "width": side.width, "height": side.height, **geo, "polygons": polygons}


def points_to_dict(points: PointMatches) -> dict[str, Any]:
    """The points of `matches.json`."""
    return {"left": points.left.tolist(), "right": points.right.tolist(), "score": points.score.tolist()}


def points_from_dict(values: Mapping[str, Any]) -> PointMatches:
    """The points that `points_to_dict` wrote. `KeyError` or `ValueError` for others."""
    left, right, score = (np.array(values[name], np.float64) for name in ("left", "right", "score"))
    return PointMatches(left.reshape(-1, 2), right.reshape(-1, 2), score)


def match_to_dict(match: PolygonMatch) -> dict[str, Any]:
    """A match of `matches.json`."""
    return {
        "id": match.id,
        "left": match.left,
        "right": match.right,
        "confidence": match.confidence,
        "cost": match.cost,
        "dsf": match.dsf,
        "stage": match.stage,
        "overlap": match.overlap,
        "nodes": match.nodes.tolist(),
        **({"outline": match.outline.round(3).tolist()} if len(match.outline) else {}),
    }


def matrix_to_list(matrix: NDArray[np.float64] | Failed) -> list[list[float]] | None:
    """A 3 x 3 matrix of `matches.json`; none where there is none."""
    return None if isinstance(matrix, Failed) else matrix.tolist()


def match_from_dict(values: Mapping[str, Any]) -> PolygonMatch:
    """The match that `match_to_dict` wrote. `KeyError`, `TypeError` or `ValueError` for others."""
    known: dict[str, Any] = {name: values[name] for name in ("confidence", "cost", "dsf", "stage", "overlap")}
    known |= {side: index(values[side]) for side in ("left", "right")}
    return PolygonMatch(
        **known,
        nodes=np.array(values.get("nodes", []), np.int64).reshape(-1, 2),
        outline=np.array(values.get("outline", []), np.float64).reshape(-1, 5),
    )


def side_from_dict(values: Mapping[str, Any]) -> ImagePolygons:
    """The side that `side_to_dict` wrote. `KeyError`, `TypeError` or `ValueError` for others."""
    polygons = [
        Polygon(
            id=index(p["id"]),
            exterior=_ring(p["vertices"]),
            holes=tuple(_ring(hole) for hole in p["holes"]),
            score=p["score"],
            parent=p["parent"],
            label=p.get("label"),
            source_id=p.get("source_id"),
            properties=_named(p.get("properties", {})),
        )
        for p in values["polygons"]
    ]
    transform, rpc = values.get("transform"), values.get("rpc")
    crs = values.get("crs")
    if crs is not None and not _CRS.fullmatch(crs):  # GDAL takes addresses and names of files too
        raise ValueError(f"crs {crs[:40]!r} is neither EPSG:... nor WKT")
    geo = Georeference(
        crs,
        None if transform is None else np.array(transform, np.float64).reshape(2, 3),
        values.get("gsd"),
        None if rpc is None else _named(rpc),
    )
    unmatched = {index(p["id"]): str(p["unmatched"]) for p in values["polygons"] if "unmatched" in p}
    return ImagePolygons(int(values["width"]), int(values["height"]), polygons, values["path"], None, geo, unmatched)


def _named(values: Any) -> dict[str, Any]:
    """A JSON object."""
    return {str(name): value for name, value in dict(values).items()}


def _ring(values: Any) -> NDArray[np.float64]:
    ring = np.array(values, np.float64)
    if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3 or not np.isfinite(ring).all():
        raise ValueError("a ring must have at least 3 vertices [x, y]")
    return ring


def matrix_from_list(values: Any, reason: str) -> NDArray[np.float64] | Failed:
    """The matrix that `matrix_to_list` wrote; `reason` is why there is none."""
    return Failed(reason) if values is None else np.array(values, np.float64).reshape(3, 3)
