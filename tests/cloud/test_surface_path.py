"""Paths: on the surface at every point, in the plane of the camera, there or with a reason why not."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import distance_to, grid, on_faces, sphere

from zpm2.cloud import SurfaceMesh, SurfacePaths, trace_paths
from zpm2.cloud.surface_path import AT_BORDER, TOO_LONG
from zpm2.config import CloudConfig

CONFIG = CloudConfig()
ABOVE = np.array([0.05, -0.03, 5.0])


def traced(surface: SurfaceMesh, a: np.ndarray, b: np.ndarray, center: np.ndarray = ABOVE, seed: int = 0) -> tuple:
    begin, target = (a, on_faces(surface, a, seed)), (b, on_faces(surface, b, seed + 1))
    return begin, target, trace_paths(surface, begin, target, np.broadcast_to(center, (len(a), 3)), CONFIG)


def check(
    surface: SurfaceMesh, begin: tuple, target: tuple, found: SurfacePaths, row: int, center: np.ndarray
) -> float:
    """Every segment on one triangle, from the first to the last; returns the length."""
    points, faces = found.of(row)
    path = [begin[1][row], *points, target[1][row]]
    on = [begin[0][row], *faces]
    assert on[-1] == target[0][row]
    normal = np.cross(path[0] - center, path[-1] - center)
    normal /= np.linalg.norm(normal)
    for face, p, q in zip(on, path[:-1], path[1:], strict=True):
        assert distance_to(surface, face, p) < 1e-12
        assert distance_to(surface, face, q) < 1e-12
    assert np.abs((np.array(path) - center) @ normal).max() < 1e-12
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@settings(max_examples=25)
@given(st.integers(0, 2**31))
def test_on_a_plane_the_way_is_straight(seed: int) -> None:
    surface = grid(9, seed=seed % 1000)
    faces = np.random.default_rng(seed).integers(0, len(surface.faces), (2, 12))
    begin, target, found = traced(surface, *faces, seed=seed % 997)
    assert found.arrived.all()
    for row in range(12):
        length = check(surface, begin, target, found, row, ABOVE)
        assert np.isclose(length, np.linalg.norm(target[1][row] - begin[1][row]), rtol=1e-9)


@settings(max_examples=25)
@given(st.integers(0, 2**31))
def test_on_a_rough_surface_it_stays_on_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = grid(9, height=rng.uniform(-0.05, 0.05, (10, 10)), seed=1)
    faces = rng.integers(0, len(surface.faces), (2, 12))
    begin, target, found = traced(surface, *faces, seed=seed % 997)
    assert found.arrived.all()
    for row in range(12):
        check(surface, begin, target, found, row, ABOVE)


def test_on_a_sphere() -> None:
    surface = sphere(4)
    top = np.flatnonzero(surface.corners.mean(1)[:, 2] > 0.6)
    faces = np.random.default_rng(0).choice(top, (2, 40))
    begin, target, found = traced(surface, *faces)
    assert found.arrived.all()
    for row in range(40):
        length = check(surface, begin, target, found, row, ABOVE)
        assert length >= np.linalg.norm(target[1][row] - begin[1][row]) - 1e-12
        for point in found.of(row)[0]:
            assert np.isclose(np.linalg.norm(point), 1, atol=0.01)


def test_through_vertices_and_along_edges() -> None:
    """A regular grid, points on its lines: the plane runs through vertices all the way."""
    surface = grid(8)
    center = np.array([0.0, 0, 4])
    nearest = [np.argmin(np.linalg.norm(surface.corners.mean(1) - p, axis=1)) for p in ([-0.9, 0.1, 0], [0.9, 0.1, 0])]
    a, b = (np.array([face]) for face in nearest)
    starts = np.array([[-0.9, 1e-9, 0]]), np.array([[0.9, 1e-9, 0]])
    found = trace_paths(surface, (a, starts[0]), (b, starts[1]), center[None], CONFIG)
    assert found.arrived.all()
    assert np.abs(found.points[:, 1]).max() < 1e-8


def test_a_border_ends_a_path() -> None:
    """Two squares with a gap between them."""
    left, right = grid(4), grid(4)
    vertices = np.r_[left.vertices, right.vertices + np.array([3, 0, 0])]
    surface = SurfaceMesh.of(vertices, np.r_[left.faces, right.faces + len(left.vertices)])
    middle = surface.corners.mean(1)
    a, b = np.argmin(middle[:, 0]), np.argmax(middle[:, 0])
    _, _, found = traced(surface, np.array([a]), np.array([b]))
    assert found.ended.tolist() == [AT_BORDER]
    assert len(found.points) == 0


def test_a_way_around_is_no_way() -> None:
    """From the top of a disk to its under side, which no camera sees: the section goes around the rim."""
    surface = sphere(3)
    middle = surface.corners.mean(1)
    disk = SurfaceMesh.of(surface.vertices * [1, 1, 0.05], surface.faces)
    below = np.linalg.norm(middle - [0.1, 0, -1], axis=1)
    top, under = np.array([middle[:, 2].argmax()]), np.array([below.argmin()])
    begin, target = ((face, disk.corners[face].mean(1)) for face in (top, under))
    found = trace_paths(disk, begin, target, np.array([[0.5, 0.3, 9.0]]), CONFIG)
    assert found.ended.tolist() == [TOO_LONG]


def test_the_same_triangle() -> None:
    surface = grid(3)
    begin, target, found = traced(surface, np.array([4]), np.array([4]))
    assert found.arrived.all()
    assert len(found.of(0)[0]) == 0
    assert not np.array_equal(begin[1], target[1])


def test_no_paths() -> None:
    none = np.zeros(0, np.int64), np.zeros((0, 3))
    found = trace_paths(grid(3), none, none, np.zeros((0, 3)), CONFIG)
    assert found.start.tolist() == [0]
    assert found.arrived.shape == (0,)
