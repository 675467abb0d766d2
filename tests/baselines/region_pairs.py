"""Pairs of regions with points in them, for the tests of the methods that use points."""

import numpy as np
import shapely

from zpm2.baselines.method import RegionPair
from zpm2.model import Image, PointMatches, Polygon, PolygonArrays
from zpm2.polygons.shapes import from_shape
from zpm2.runtime import StageTimer

SIZE = 200


def squares(*boxes):
    """Polygons of (x, y, side), with ids from 10 on."""
    return [from_shape(shapely.box(x, y, x + side, y + side), 10 + k) for k, (x, y, side) in enumerate(boxes)]


def points(left, right):
    """Homologous points from two lists of (x, y)."""
    return PointMatches(np.array(left, float).reshape(-1, 2), np.array(right, float).reshape(-1, 2), np.ones(len(left)))


def grid(x, y, side, n):
    """n x n points inside a square."""
    at = (np.arange(n) + 0.5) / n * side
    return np.stack(np.meshgrid(x + at, y + at), axis=-1).reshape(-1, 2)


def region_pair(left: list[Polygon], right: list[Polygon], matches=None, embed=None) -> RegionPair:
    image = Image(np.zeros((SIZE, SIZE, 3), np.uint8), "x.png")
    sides = PolygonArrays(left), PolygonArrays(right)
    return RegionPair((image, image), sides, matches or PointMatches.empty(), embed or no_embedding)


def no_embedding(shapes):
    raise AssertionError("this method asks for no embeddings")


def found(method, pair: RegionPair) -> dict:
    """The confidence of each match, by rows."""
    pairing = method.match(pair, StageTimer(lambda stage, share: None))
    rows = [tuple(row) for row in pairing.rows.tolist()]
    assert len({i for i, _ in rows}) == len({j for _, j in rows}) == len(rows)
    assert ((pairing.confidence >= 0) & (pairing.confidence <= 1)).all()
    assert np.allclose(pairing.cost + pairing.confidence, 1)
    return dict(zip(rows, pairing.confidence.tolist(), strict=True))
