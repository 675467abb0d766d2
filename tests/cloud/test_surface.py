"""Meshes in: cleaning leaves notes, bad files give one line, large coordinates stay exact."""

from pathlib import Path

import numpy as np
import pytest
from meshes import grid, sphere

from zpm2.cloud import SurfaceMesh
from zpm2.errors import InputError

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def test_neighbors_equal_a_search_one_by_one() -> None:
    surface = grid(4, seed=1)
    for face, corners in enumerate(surface.faces):
        for k in range(3):
            edge = {corners[k], corners[(k + 1) % 3]}
            expected = [f for f, c in enumerate(surface.faces) if f != face and edge <= set(c)]
            assert surface.neighbors[face, k] == (expected[0] if expected else -1)


def test_a_closed_surface_has_no_border() -> None:
    surface = sphere(2)
    assert (surface.neighbors >= 0).all()
    assert surface.notes == ()
    outward = np.einsum("ni,ni->n", surface.normals, surface.corners.mean(1))
    assert (outward > 0.9).all()


def test_large_coordinates_stay_exact() -> None:
    offset = np.array([4_500_000.25, 5_400_000.5, 312.125])
    surface = SurfaceMesh.of(SQUARE / 1024 + offset, TWO)
    assert np.array_equal(surface.vertices + surface.origin, np.unique(SQUARE / 1024 + offset, axis=0))
    assert np.abs(surface.vertices).max() < 1


def test_cleaning_leaves_notes() -> None:
    points = np.r_[SQUARE, SQUARE[:1], [[np.nan, 0, 0]], [[0.5, 0, 0]]]
    faces = np.r_[TWO, [[4, 1, 2], [0, 1, 5], [0, 6, 1]]]  # one twice by another vertex, one NaN, one flat
    surface = SurfaceMesh.of(points, faces)
    assert len(surface.faces) == 2
    assert len(surface.vertices) == 5  # 0.5, 0, 0 is left without a triangle
    notes = " ".join(surface.notes)
    assert "1 triangles were left out: a vertex is not finite" in notes
    assert "1 triangles were left out: they have no area" in notes
    assert "1 triangles were left out: they are repeated" in notes


def test_edges_of_three_triangles_are_borders() -> None:
    surface = SurfaceMesh.of(np.r_[SQUARE, [[0.5, 0.5, 1]]], np.r_[TWO, [[0, 2, 4]]])
    assert "1 edges belong to more than two triangles" in surface.notes[0]
    assert (surface.neighbors == -1).all()


def test_flipped_triangles_are_noted_and_neighbors_nonetheless() -> None:
    surface = SurfaceMesh.of(SQUARE, np.array([[0, 1, 2], [0, 3, 2]]))
    assert "opposite orientation" in surface.notes[0]
    assert (surface.neighbors >= 0).sum() == 2


@pytest.mark.parametrize(
    ("vertices", "faces", "why"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "0 vertices and 0 triangles"),
        (SQUARE, np.zeros((0, 3), int), "there is no surface"),
        (SQUARE[:, :2], TWO, "expected vertices"),
        (SQUARE, np.array([[0, 1, 2, 3]]), "expected vertices"),
        (SQUARE, TWO + 2, "refer to missing vertices"),
        (SQUARE * np.nan, TWO, "no triangle with finite vertices"),
        (SQUARE * 1e200, TWO, "no triangle with finite vertices"),
        (SQUARE * 0, TWO, "no triangle with an area"),
    ],
)
def test_what_is_no_surface(vertices: np.ndarray, faces: np.ndarray, why: str) -> None:
    with pytest.raises(InputError, match=why):
        SurfaceMesh.of(vertices, faces)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "glb", "off"])
def test_files(suffix: str, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    known = sphere(1)
    path = tmp_path / f"mesh.{suffix}"
    trimesh.Trimesh(known.vertices, known.faces, process=False).export(path)
    surface = SurfaceMesh.read(path)
    assert len(surface.faces) == len(known.faces)
    assert len(surface.vertices) == len(known.vertices)
    assert (surface.neighbors >= 0).all()


def test_files_that_are_none(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    (tmp_path / "text.ply").write_text("no mesh")
    (tmp_path / "mesh.xyz").write_text("0 0 0")
    for name, why in (("text.ply", "cannot be read"), ("mesh.xyz", "are read from"), ("none.obj", "does not exist")):
        with pytest.raises(InputError, match=why):
            SurfaceMesh.read(tmp_path / name)
