"""The contract of every ray caster, on surfaces that are known exactly."""

import numpy as np
import pytest
from meshes import distance_to, grid, sphere

from zpm2.cloud import RayCaster, SurfaceMesh, open_caster
from zpm2.cloud.rays import Embree, EveryTriangle

CASTERS = {"embree": Embree, "every triangle": EveryTriangle}


def caster(name: str, surface: SurfaceMesh) -> RayCaster:
    if name == "embree":
        pytest.importorskip("embreex")
    return CASTERS[name](surface)


@pytest.fixture(params=CASTERS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_sphere(name: str) -> None:
    surface = sphere(3)
    rng = np.random.default_rng(0)
    direction = rng.normal(0, 1, (300, 3))
    origin = -4 * direction / np.linalg.norm(direction, axis=1, keepdims=True) + rng.normal(0, 0.2, (300, 3))
    hits = caster(name, surface).first_hits(origin, direction)
    assert hits.found.mean() > 0.9
    point = hits.point[hits.found]
    assert np.abs(np.linalg.norm(point, axis=1) - 1).max() < 0.02
    assert (np.einsum("ni,ni->n", point, direction[hits.found]) < 0).all()  # the near side
    assert np.isnan(hits.point[~hits.found]).all()
    for face, p in zip(hits.face[hits.found][:50], point[:50], strict=True):
        assert distance_to(surface, face, p) < 1e-12
    along = np.cross(point - origin[hits.found], direction[hits.found])
    assert np.abs(along).max() < 1e-6
    assert np.allclose(hits.weights[hits.found].sum(1), 1)
    assert (hits.weights[hits.found] >= 0).all()


def test_both_casters_agree() -> None:
    pytest.importorskip("embreex")
    surface = grid(10, height=np.random.default_rng(1).uniform(-0.2, 0.2, (11, 11)))
    rng = np.random.default_rng(2)
    origin = np.c_[rng.uniform(-1.2, 1.2, (400, 2)), np.full(400, 3.0)]
    direction = np.c_[rng.normal(0, 0.1, (400, 2)), np.full(400, -1.0)]
    one, other = (CASTERS[name](surface).first_hits(origin, direction) for name in CASTERS)
    assert (one.found == other.found).mean() > 0.99
    both = one.found & other.found
    assert np.abs(one.point[both] - other.point[both]).max() < 1e-6


def test_nothing_to_cast(name: str) -> None:
    hits = caster(name, grid()).first_hits(np.zeros((0, 3)), np.zeros((0, 3)))
    assert hits.point.shape == (0, 3)


def test_rays_that_miss(name: str) -> None:
    away = np.array([[0, 0, 1.0], [5, 5, 1], [0, 0, 1]]), np.array([[0, 0, 1.0], [0, 0, -1], [1, 0, 0]])
    assert not caster(name, grid()).first_hits(*away).found.any()


def test_the_fallback_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zpm2.cloud.rays.find_spec", lambda name: None)
    slow = open_caster(grid())
    assert isinstance(slow, EveryTriangle)
    assert slow.note
    assert "pip install" in slow.note
