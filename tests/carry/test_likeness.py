"""The labels of cells move with what the cells look like."""

import numpy as np
import pytest
import shapely

from zpm2.carry.likeness import Cells, cells_of, transferred
from zpm2.config import CarryConfig
from zpm2.polygons.rasterize import CELL_SAMPLES

CONFIG = CarryConfig()


def embedding(thing_at, size=(16, 20), seed=0):
    """(8, h, w): background of one kind, and a thing of another in the 4 x 4 cells at (row, column)."""
    random = np.random.default_rng(seed)
    cells = np.zeros((8, *size), np.float32)
    cells[0] = 1
    row, column = thing_at
    cells[:, row : row + 4, column : column + 4] = np.eye(8, dtype=np.float32)[3][:, None, None]
    return cells + random.normal(0, 0.05, cells.shape).astype(np.float32)


def slow(source: Cells, target: Cells, shares, config):
    """The reference: one cell after the other."""
    found = np.zeros((len(shares), len(target.vectors)))
    for c, vector in enumerate(target.vectors):
        cosine = source.vectors @ vector
        nearest = np.argsort(-cosine, kind="stable")[: config.neighbors]
        weight = np.exp(cosine[nearest] / config.temperature)
        found[:, c] = shares[:, nearest] @ (weight / weight.sum())
    return found.reshape(len(shares), *target.size)


def test_a_thing_that_moved_is_where_it_looks_like_itself():
    left, right = cells_of(embedding((2, 3)), embedding((9, 12), seed=1), (0.1, 0.1))
    shape = np.array([shapely.box(30, 20, 70, 60)], object)  # 10 px a cell
    (picture,) = transferred(left, right, left.shares(shape), CONFIG)
    inside = np.zeros(picture.shape, bool)
    inside[9:13, 12:16] = True
    assert picture[inside].min() > 0.9
    assert picture[~inside].max() < 0.5


def test_it_equals_the_loop_over_cells():
    left, right = cells_of(embedding((2, 3)), embedding((9, 12), seed=1), (0.1, 0.1))
    shapes = np.array([shapely.box(33, 21, 69, 57), shapely.box(0, 0, 100, 40)], object)
    shares = left.shares(shapes)
    assert np.allclose(transferred(left, right, shares, CONFIG), slow(left, right, shares, CONFIG), atol=1e-6)


def test_shares_are_areas():
    cells, _ = cells_of(embedding((0, 0)), embedding((0, 0)), (0.1, 0.1))
    shares = cells.shares(np.array([shapely.box(10, 10, 25, 20)], object)).reshape(16, 20)
    assert shares[1, 1] == 1
    assert shares[1, 2] == pytest.approx(0.5, abs=1 / CELL_SAMPLES)
    assert shares.sum() == pytest.approx(1.5, abs=1 / CELL_SAMPLES)
