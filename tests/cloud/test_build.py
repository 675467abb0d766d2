"""The whole cloud on surfaces that are known exactly."""

from pathlib import Path

import numpy as np
import pytest
from clouds import cloud_of, looking_down, matched, squares, views_of
from meshes import distance_to, grid

from zpm2.cloud import MatchedPair, SurfaceMesh, build, open_caster
from zpm2.config import CloudConfig
from zpm2.errors import InputError

CAMERAS = [looking_down(-0.5, 0.1, 2.5), looking_down(0.0, 0.0, 2.6), looking_down(0.5, -0.1, 2.5)]


def test_one_patch_for_each_region_of_all_views(tmp_path: Path) -> None:
    cloud = cloud_of(grid(12, seed=1), squares(), CAMERAS, tmp_path)
    assert len(cloud.patches) == 9
    assert [p.id for p in cloud.patches] == list(range(9))
    assert not cloud.rejected
    for patch in cloud.patches:
        assert patch.views == (0, 1, 2)
        assert len(patch.supports) == 2
        assert patch.patch.area == pytest.approx(0.09, rel=1e-3)
        assert patch.length == pytest.approx(1.2, rel=1e-3)
        assert patch.supports[0].overlap > 0.99
        assert patch.supports[0].distance < 0.01
    assert cloud.matches == cloud.accepted == 18
    document = cloud.to_dict()
    assert [s["match"] for p in document["patches"] for s in p["supports"]] == [
        s.left_polygon for p in cloud.patches for s in p.supports
    ]
    # the views see more than the mesh, which is 2 x 2
    assert cloud.coverage == pytest.approx(9 * 0.09 / 4, rel=0.05)


def test_wrong_matches_are_rejected_with_their_reason(tmp_path: Path) -> None:
    wrong = [1, 0, 2, 3, 4, 5, 6, 7, 8]
    cloud = cloud_of(grid(12), squares(), CAMERAS[:2], tmp_path, wrong)
    assert len(cloud.patches) == 7
    assert {(r.left_polygon, r.right_polygon) for r in cloud.rejected} == {(0, 1), (1, 0)}
    assert all("not the same place" in r.reason for r in cloud.rejected)
    assert [r["match"] for r in cloud.to_dict()["rejected"]] == [r.left_polygon for r in cloud.rejected]
    assert cloud.reasons() == {"left and right are not the same place": 2}


def test_a_cycle_that_does_not_close(tmp_path: Path) -> None:
    """On a mesh that is far too low both lifts agree by chance; the third view says that the match is wrong."""
    loose = CloudConfig(min_overlap=0.0, max_distance=1e9)
    wrong = [1, 0, 2, 3, 4, 5, 6, 7, 8]
    cloud = cloud_of(grid(12), squares(), CAMERAS, tmp_path, wrong, loose)
    for patch in cloud.patches:
        seen = [(s.left_view, s.left_polygon) for s in patch.supports] + [
            (s.right_view, s.right_polygon) for s in patch.supports
        ]
        by_view = {view: {p for v, p in seen if v == view} for view in patch.views}
        assert all(len(regions) == 1 for regions in by_view.values())


def test_large_coordinates_lose_nothing(tmp_path: Path) -> None:
    offset = np.array([431_000.5, 5_411_000.25, 310.0])
    near = grid(12, seed=2)
    far = SurfaceMesh.of(near.vertices + near.origin + offset, near.faces)
    cameras = [looking_down(x, 0.1, 2.5, offset) for x in (-0.4, 0.4)]
    cloud = cloud_of(far, squares(offset), cameras, tmp_path)
    assert len(cloud.patches) == 9
    for patch in cloud.patches:
        assert patch.patch.area == pytest.approx(0.09, rel=1e-3)
        for ring in patch.rings:
            for p, face in zip(ring.points, ring.faces, strict=True):
                assert distance_to(far, int(face), p) < 1e-9 * far.extent
        assert np.abs(cloud.world(ring.points)[:, 2] - 310).max() < 1e-6


def test_parts_know_their_wholes(tmp_path: Path) -> None:
    whole = squares()[0]
    middle = whole.mean(0)
    part = middle + 0.5 * (whole - middle)
    cloud = cloud_of(grid(12), [whole, part, squares()[8]], CAMERAS[:2], tmp_path)
    assert len(cloud.patches) == 3
    inner = min(cloud.patches, key=lambda p: p.patch.area)
    outer = next(p for p in cloud.patches if p.id == inner.parent)
    assert np.allclose(outer.patch.centroid, inner.patch.centroid, atol=1e-3)
    assert (inner.level, outer.level) == (1, 0)


def test_a_mesh_in_another_frame_is_said(tmp_path: Path) -> None:
    away = SurfaceMesh.of(grid(6).vertices + np.array([500.0, 0, 0]), grid(6).faces)
    with pytest.raises(InputError, match="same coordinates"):
        cloud_of(away, squares(), CAMERAS[:2], tmp_path)


def test_an_empty_cloud_says_why(tmp_path: Path) -> None:
    """The regions lie beside the mesh."""
    cloud = cloud_of(grid(6, size=0.1), squares()[:4], CAMERAS[:2], tmp_path)
    assert not cloud.patches
    assert any("matches gave a polygon on the surface" in w for w in cloud.warnings)
    assert len(cloud.rejected) == cloud.matches == 4
    assert cloud.coverage == 0


def test_tracks_that_no_match_joins_are_one_patch(tmp_path: Path) -> None:
    """Views 0 and 1 match, and views 2 and 3: the same regions, and one patch for each."""
    cameras = [*CAMERAS, looking_down(0.2, 0.4, 2.6)]
    surface, outlines = grid(12, seed=1), squares()
    pairs = [MatchedPair(a, b, matched(outlines, (cameras[a], cameras[b]))) for a, b in ((0, 1), (2, 3))]
    cloud = build(views_of(cameras, tmp_path), pairs, surface, open_caster(surface), CloudConfig())
    assert len(cloud.patches) == 9
    assert all(patch.views == (0, 1, 2, 3) for patch in cloud.patches)
