"""Left against right."""

import pytest
from clouds import looking_down, matched, squares
from meshes import grid

from zpm2.cloud import SurfaceView, lift
from zpm2.cloud.check import Agreement, cross_check
from zpm2.cloud.rays import EveryTriangle
from zpm2.config import CloudConfig, preset
from zpm2.errors import Failed

CAMERAS = looking_down(-0.5, 0.1, 2.5), looking_down(0.5, -0.1, 2.4)


def agreements(partner: list[int] | None = None, size: float = 2.0) -> list[Agreement | Failed]:
    surface, config = grid(14, size=size, seed=4), preset("default").cloud
    caster = EveryTriangle(surface)
    left, right = matched(squares(), CAMERAS, partner).matched_polygons()
    views = SurfaceView(CAMERAS[0], surface, caster), SurfaceView(CAMERAS[1], surface, caster)
    lifted = [lift(side, view, config) for side, view in zip((left, right), views, strict=True)]
    pairs, both = list(zip(left, right, strict=True)), list(zip(*lifted, strict=True))
    return cross_check(pairs, both, views, config)


def test_true_matches_agree() -> None:
    for agreement in agreements():
        assert isinstance(agreement, Agreement)
        assert agreement.overlap > 0.99
        assert agreement.distance < 0.005
        assert agreement.size == pytest.approx(0.3, rel=0.01)
        assert agreement.objection(CloudConfig()) == ""


def test_wrong_ones_do_not() -> None:
    found = agreements([1, 0, 2, 3, 4, 5, 6, 7, 8])
    for agreement in found[:2]:
        assert isinstance(agreement, Agreement)
        assert agreement.overlap == 0
        assert agreement.distance > 0.05
        assert "not the same place" in agreement.objection(CloudConfig())
        assert "lie apart" in agreement.objection(CloudConfig(min_overlap=0.0, max_distance=0.1))


def test_a_part_is_compared_with_its_share() -> None:
    """The mesh ends within the outer squares: what is lifted of them is less, and still in its place."""
    found = agreements(size=0.9)
    inner, outer = found[4], found[0]
    assert isinstance(inner, Agreement)
    assert isinstance(outer, Agreement)
    assert inner.overlap > 0.99
    assert outer.overlap > 0.8


def test_what_is_nowhere_fails_with_its_reason() -> None:
    assert all(isinstance(found, Failed) and "surface" in found.reason for found in agreements(size=0.02)[:3])
