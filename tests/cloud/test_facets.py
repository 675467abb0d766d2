"""Faces of many corners as triangles: of the same area, the same orientation, inside the same outline."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from zpm2.cloud import SurfaceMesh
from zpm2.cloud.facets import triangulate
from zpm2.cloud.surface import crosses
from zpm2.errors import InputError

SEVEN = np.array([[0.0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])  # an L of area 3
KEYHOLE = np.array([[0.0, 0], [6, 0], [6, 6], [0, 6], [0, 0], [2, 2], [2, 4], [4, 4], [4, 2], [2, 2]])  # 36 - 4
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7])


def placed(flat: np.ndarray, turn: Rotation = TURN) -> np.ndarray:
    return turn.apply(np.c_[flat, np.zeros(len(flat))]) + np.array([4_500_000.0, 5_400_000, 300])


def areas(points: np.ndarray, triangles: np.ndarray, turn: Rotation = TURN) -> np.ndarray:
    """Of the triangles, below 0 where they are turned over."""
    return crosses(points[triangles]) @ turn.apply([0, 0, 1]) / 2


@pytest.mark.parametrize("start", range(6))
@pytest.mark.parametrize("back", [False, True])
def test_a_concave_face_keeps_its_area(start: int, back: bool) -> None:
    flat = np.roll(SEVEN, start, axis=0)[:: -1 if back else 1]
    points = placed(flat)
    triangles, odd = triangulate(points, [np.arange(6)[None]])
    assert areas(points, triangles).sum() == pytest.approx(-3 if back else 3)
    assert np.abs(areas(points, triangles)).sum() == pytest.approx(3)
    assert len(triangles) == 4
    assert odd == []


@settings(max_examples=50, deadline=None)
@given(st.integers(4, 12), st.integers(0, 2**32 - 1))
def test_any_simple_face_anywhere(k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, (5, k)), axis=1)
    flat = rng.uniform(0.2, 1.0, (5, k, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    turn = Rotation.random(random_state=seed)
    points = turn.apply(np.c_[flat.reshape(-1, 2), np.zeros(5 * k)]) + rng.normal(size=3)
    outlines = shapely.polygons(flat)
    triangles, _ = triangulate(points, [np.arange(5 * k).reshape(5, k)])
    of = triangles[:, 0] // k
    assert (triangles // k == of[:, None]).all()
    for face, outline in enumerate(outlines):
        mine = triangles[of == face]
        if outline.is_valid and outline.area > 1e-3:
            assert len(mine) == k - 2
            assert np.abs(areas(points, mine, turn)).sum() == pytest.approx(outline.area, rel=1e-6)
            assert (areas(points, mine, turn) > -1e-9).all() == shapely.is_ccw(outline.exterior)


def test_convex_faces_are_fans_and_holes_stay_open() -> None:
    square = placed(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]))
    assert triangulate(square, [np.arange(4)[None]])[0].tolist() == [[0, 1, 2], [0, 2, 3]]
    points = placed(KEYHOLE)
    triangles, odd = triangulate(points, [np.arange(10)[None]])
    assert areas(points, triangles).sum() == pytest.approx(32)
    assert (areas(points, triangles) > 0).all()
    assert odd == []


def test_a_concave_quad_is_cut_at_its_dent() -> None:
    points = placed(np.array([[0.0, 0], [4, 0], [1, 1], [0, 4]]))
    for shift in range(4):
        triangles, _ = triangulate(points, [np.roll(np.arange(4), shift)[None]])
        assert areas(points, triangles) == pytest.approx([2, 2])


def test_what_is_odd_is_said() -> None:
    points = placed(np.array([[0.0, 0], [2, 2], [2, 0], [0, 2.5], [9, 9]]))
    triangles, odd = triangulate(points, [np.array([[0, 1, 2, 3]]), np.array([[0, 1]])])
    assert len(triangles) == 2
    assert odd == ["1 faces cross themselves, so their triangles overlap", "1 faces have fewer than three corners"]
    points[1] = np.nan
    assert len(triangulate(points, [np.array([[0, 1, 2, 3]])])[0]) == 2


@pytest.mark.parametrize("suffix", ["ply", "obj", "off"])
def test_a_concave_face_of_a_file(suffix: str, tmp_path: Path) -> None:
    rows = "\n".join(f"{x} {y} 1" for x, y in SEVEN)
    head = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n"
    content = {
        "ply": f"{head}element face 1\nproperty list uchar int vertex_index\nend_header\n{rows}\n6 0 1 2 3 4 5\n",
        "obj": "\n".join(f"v {row}" for row in rows.splitlines()) + "\nf 1 2 3 4 5 6\n",
        "off": f"OFF\n6 1 0\n{rows}\n6 0 1 2 3 4 5\n",
    }
    (tmp_path / f"m.{suffix}").write_text(content[suffix])
    assert SurfaceMesh.read(tmp_path / f"m.{suffix}").areas.sum() == pytest.approx(3)


@pytest.mark.parametrize("suffix", ["ply", "obj", "off"])
def test_a_point_cloud_is_called_one(suffix: str, tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    content = {"ply": f"{head}1 2 3\n4 5 6\n", "obj": "v 1 2 3\nv 4 5 6\n", "off": "OFF\n2 0 0\n1 2 3\n4 5 6\n"}
    (tmp_path / f"m.{suffix}").write_text(content[suffix])
    with pytest.raises(InputError, match=r"is a point cloud, 2 points without faces: .* zpm2 reconstruct"):
        SurfaceMesh.read(tmp_path / f"m.{suffix}")
