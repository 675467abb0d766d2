"""Holes: small ones closed on the surface that was there, wide and bent ones left."""

import numpy as np
import pytest
from meshes import grid, sphere

from zpm2.cloud import SurfaceMesh
from zpm2.cloud.holes import fill_holes
from zpm2.config import CloudConfig


def filled_to(surface: SurfaceMesh, widest: float) -> SurfaceMesh:
    return fill_holes(surface, CloudConfig(fill=widest / surface.extent))


def without(surface: SurfaceMesh, gone: np.ndarray) -> SurfaceMesh:
    return SurfaceMesh.of(surface.vertices, surface.faces[~gone])


def open_edges(surface: SurfaceMesh) -> int:
    return int((surface.neighbors < 0).sum())


def area(surface: SurfaceMesh) -> float:
    a, b, c = np.moveaxis(surface.corners, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_hole_in_a_plane() -> None:
    whole = grid(20, seed=5)
    holed = without(whole, np.linalg.norm(whole.corners.mean(1)[:, :2], axis=1) < 0.4)
    filled = filled_to(holed, 1.2)
    assert area(filled) == pytest.approx(area(whole), rel=1e-9)
    assert open_edges(filled) == open_edges(whole)
    assert filled.filled == len(filled.faces) - len(holed.faces) > 0
    assert "1 holes were filled" in filled.notes
    assert filled.normals[-filled.filled :] == pytest.approx(np.tile([0, 0, 1.0], (filled.filled, 1)))
    edges = np.linalg.norm(filled.corners - np.roll(filled.corners, -1, axis=1), axis=2)[-filled.filled :]
    assert edges.max() < 3 * np.median(edges)  # good triangles, none from rim to rim


def test_a_hole_in_a_ball_is_closed_round() -> None:
    whole = sphere(4)
    holed = without(whole, whole.corners.mean(1)[:, 2] > 0.93)
    filled = filled_to(holed, 1.2)
    assert open_edges(filled) == 0
    new = filled.corners[-filled.filled :].reshape(-1, 3) + filled.origin
    assert np.linalg.norm(new, axis=1) == pytest.approx(1.0, abs=0.02)  # a flat lid would reach down to 0.93
    assert (np.einsum("ni,ni->n", filled.normals, filled.corners.mean(1)) > 0).all()


def test_wide_holes_and_the_outer_rim_stay() -> None:
    whole = grid(20)
    holed = without(whole, np.linalg.norm(whole.corners.mean(1)[:, :2], axis=1) < 0.4)
    same = filled_to(holed, 0.5)
    assert (same.filled, len(same.faces)) == (0, len(holed.faces))
    assert any("1 holes are wider" in note for note in same.notes)
    assert filled_to(whole, 9.0).filled == 0  # the outer rim is none
    assert filled_to(holed, 0.0) is holed


def test_a_bent_rim_stays_open() -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))
    saddle = grid(20, height=2 * (x**2 - y**2))
    holed = without(saddle, np.linalg.norm(saddle.corners.mean(1)[:, :2], axis=1) < 0.45)
    kept = filled_to(holed, 3.0)
    assert "1 holes are too bent to be filled" in kept.notes
    assert kept.filled == 0


def test_holes_that_touch_in_a_vertex() -> None:
    whole = grid(10)
    middle = (whole.corners.mean(1)[:, :2] / 0.2).astype(int)
    gone = ((middle == [1, 1]).all(1)) | ((middle == [2, 2]).all(1))
    filled = filled_to(without(whole, gone & (whole.corners.mean(1)[:, :2] > 0).all(1)), 0.9)
    assert "2 holes were filled" in filled.notes
    assert open_edges(filled) == open_edges(whole)
    assert area(filled) == pytest.approx(4.0)


def test_non_manifold_edges_are_no_rims() -> None:
    fin = SurfaceMesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 1]], [[0, 1, 2], [1, 3, 2], [1, 2, 4]])
    kept = filled_to(fin, 10.0)
    assert kept.filled == 0
