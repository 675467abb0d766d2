"""Patches of surfaces that are known exactly: as large and as bent as they must be, bounded by what bounds them."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import cylinder, grid, sphere
from test_lift import CONCAVE, HOLE, SQUARE, above

from zpm2.cloud import Cutter, SurfaceMesh, SurfacePatch, SurfaceView, lift
from zpm2.cloud.lift import Lifted
from zpm2.cloud.rays import EveryTriangle
from zpm2.config import CloudConfig
from zpm2.model import Camera, Polygon, PosedCamera


def cut(surface: SurfaceMesh, polygon: Polygon, view: PosedCamera) -> tuple[Lifted, SurfacePatch]:
    (found,) = lift([polygon], SurfaceView(view, surface, EveryTriangle(surface)), CloudConfig())
    assert isinstance(found, Lifted), found
    patch = Cutter(surface, view).cut(found)
    assert isinstance(patch, SurfacePatch), patch
    return found, patch


def edges_at_the_border(patch: SurfacePatch) -> set[tuple[int, int]]:
    pairs = np.sort(np.stack([patch.faces, np.roll(patch.faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, count = np.unique(pairs, axis=0, return_counts=True)
    assert count.max() <= 2
    return {(int(a), int(b)) for a, b in edges[count == 1]}


def check_bounded_by(patch: SurfacePatch, found: Lifted) -> None:
    """The border of the patch is the boundary, edge by edge."""
    rings = [[np.flatnonzero((patch.vertices == p).all(1)) for p in ring.points] for ring in found.rings]
    expected = set()
    for ring in rings:
        at = [int(rows[0]) for rows in ring if len(rows)]
        assert len(at) == len(ring)
        expected |= {(min(a, b), max(a, b)) for a, b in zip(at, np.roll(at, -1).tolist(), strict=True)}
    assert edges_at_the_border(patch) == expected


@pytest.mark.parametrize(("ring", "holes"), [(SQUARE, ()), (CONCAVE, ()), (SQUARE, (HOLE,))])
def test_on_a_plane(ring: np.ndarray, holes: tuple[np.ndarray, ...]) -> None:
    polygon = Polygon(0, ring, holes)
    found, patch = cut(grid(16, seed=3), polygon, above(2.0))
    assert patch.area == pytest.approx(polygon.area * (2.0 / 500) ** 2, rel=1e-5)
    check_bounded_by(patch, found)
    assert patch.normal == pytest.approx([0, 0, 1])
    assert patch.normal_spread == pytest.approx(0, abs=1e-5)
    assert patch.planarity == pytest.approx(1)
    assert patch.curvature == pytest.approx(0, abs=1e-12)
    center = polygon.center
    expected = (center - [320, 240]) * [1, -1] * 2.0 / 500 + [0.013, -0.007]
    assert patch.centroid[:2] == pytest.approx(expected, abs=1e-5)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(3, 20), corners=st.integers(3, 9))
def test_any_polygon_on_any_plane(seed: int, n: int, corners: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    ring = np.c_[np.cos(angle), np.sin(angle)] * rng.uniform(20, 180, (corners, 1)) + [320, 240]
    shape = shapely.Polygon(ring)
    if not shape.is_valid or shape.area < 500:
        return
    polygon = Polygon(0, ring)
    found, patch = cut(grid(n, size=3.0, seed=seed), polygon, above(2.0))
    assert found.scale == 1.0
    assert patch.area == pytest.approx(shape.area * (2.0 / 500) ** 2, rel=1e-4)
    check_bounded_by(patch, found)


def test_on_a_sphere() -> None:
    """A disc seen from above is a cap: area and curvature are known."""
    surface, view = sphere(4), above(4.0)
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    center = view.project(np.array([[0.0, 0, 1]]))[0]
    found, patch = cut(surface, Polygon(0, center + 60 * np.c_[np.cos(angle), np.sin(angle)]), view)
    check_bounded_by(patch, found)
    half = np.arctan(60 / 500)  # of the cone; it meets the sphere where sin(turn) = distance sin(half)
    turn = np.arcsin(np.linalg.norm(view.center) * np.sin(half)) - half
    assert patch.area == pytest.approx(2 * np.pi * (1 - np.cos(turn)), rel=0.01)
    assert patch.curvature == pytest.approx(1.0, rel=0.1)
    assert 0.5 < patch.planarity < 1
    assert patch.normals @ patch.normal == pytest.approx(1, abs=1 - np.cos(turn + 0.1))


def test_on_a_cylinder() -> None:
    surface = cylinder(radius=1.0, length=4.0, n=96)
    view = above(3.0)
    found, patch = cut(surface, Polygon(0, SQUARE), view)
    check_bounded_by(patch, found)
    assert patch.curvature == pytest.approx(0.5, rel=0.1)
    # the true area: unrolled, boundary points by angle and height
    dense = np.concatenate(
        [a + (b - a) * np.linspace(0, 1, 200)[:, None] for a, b in zip(SQUARE, np.roll(SQUARE, -1, 0), strict=True)]
    )
    d, o = view.directions(dense), view.center
    a, b, c = d[:, 1] ** 2 + d[:, 2] ** 2, o[1] * d[:, 1] + o[2] * d[:, 2], o[1] ** 2 + o[2] ** 2 - 1
    p = o + d * ((-b - np.sqrt(b * b - a * c)) / a)[:, None]
    unrolled = shapely.Polygon(np.c_[p[:, 0], np.arctan2(p[:, 1], p[:, 2])])
    assert patch.area == pytest.approx(unrolled.area, rel=0.01)


def test_what_lies_behind_stays_out() -> None:
    """A ball, its whole front asked for: the back is not part of it, though it is in the same place of the image."""
    surface, view = sphere(3), above(3.0)
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    center = view.project(np.array([[0.0, 0, 1]]))[0]
    silhouette = 500 * np.tan(np.arcsin(1 / 3.0))
    _, patch = cut(surface, Polygon(0, center + 0.97 * silhouette * np.c_[np.cos(angle), np.sin(angle)]), view)
    middles = patch.vertices[patch.faces].mean(1)
    assert np.einsum("ni,ni->n", middles, view.center - middles).min() > 0
    assert patch.area < 2 * np.pi


def test_inside_one_triangle() -> None:
    surface = SurfaceMesh.of([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]])
    found, patch = cut(surface, Polygon(0, SQUARE), above(2.0))
    check_bounded_by(patch, found)
    assert patch.area == pytest.approx(Polygon(0, SQUARE).area * (2.0 / 500) ** 2, rel=1e-5)


def test_a_camera_with_distortion() -> None:
    """The polygon is straight in a bent image; its patch is bounded by its boundary all the same."""
    view = above(2.0)
    bent = PosedCamera(
        Camera(view.camera.matrix, view.camera.size, np.array([-0.2, 0.05, 0.001, -0.001])),
        view.rotation,
        view.translation,
    )
    found, patch = cut(grid(16, size=3.0, seed=3), Polygon(0, SQUARE), bent)
    check_bounded_by(patch, found)
    dense = np.concatenate(
        [a + (b - a) * np.linspace(0, 1, 500)[:, None] for a, b in zip(SQUARE, np.roll(SQUARE, -1, 0), strict=True)]
    )
    assert patch.area == pytest.approx(shapely.Polygon(bent.camera.rays(dense) * 2.0).area, rel=1e-4)


def test_a_flipped_mesh_gives_the_same() -> None:
    surface = sphere(3)
    turned = SurfaceMesh.of(surface.vertices, surface.faces[:, ::-1])
    ring = SQUARE * 0.5 + [160, 120]
    one, other = (cut(s, Polygon(0, ring), above(4.0))[1] for s in (surface, turned))
    assert one.area == pytest.approx(other.area, rel=1e-9)
    assert one.normal == pytest.approx(other.normal)
    assert one.curvature == pytest.approx(other.curvature)
