"""The whole of a pose, from a result to `pose.json`, on scenes with exact truth."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from views import SIZE, Views, angle, matched, rotation, views

from zpm2 import config
from zpm2.config import Config, PoseConfig
from zpm2.errors import Failed, InputError
from zpm2.model import PointMatches
from zpm2.pose import PoseFinder, PoseResult, RelativePose
from zpm2.pose.points import Correspondences

PLAIN = Config(pose=PoseConfig(crops="off"))


def found(of: Views, options: Config = PLAIN) -> PoseResult:
    return PoseFinder(options)(matched(of), of.cameras)


def pose_of(result: PoseResult) -> RelativePose:
    assert not isinstance(result.pose, Failed), result.pose
    return result.pose


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("points", ["regions", "all"])
def test_pose(seed: int, points: str) -> None:
    of = views(seed, noise=0.3, outliers=0.3)
    result = found(of, Config(pose=PoseConfig(crops="off", points=points)))  # type: ignore[arg-type]
    pose = pose_of(result)
    assert pose.sound
    assert angle(pose.rotation, of.rotation) < 0.3
    assert pose.translation is not None
    assert angle(pose.translation, of.direction) < 1.5
    assert result.counts()["inliers"] > 0.6 * len(of.points)


def test_regions_that_are_wrong_go_as_a_whole() -> None:
    """Two cells whose points all moved by the same vector: a wrong match, or a thing that moved."""
    of = views(1, n=400, noise=0.2)
    step = np.array(SIZE) / (4, 3)
    cell = (of.points.left // step).astype(int)
    wrong = (cell == (1, 1)).all(1) | (cell == (2, 0)).all(1)
    right = of.points.right + np.where(wrong[:, None], [3.0, 25.0], 0.0)
    result = found(dataclasses.replace(of, points=PointMatches(of.points.left, right, of.points.score)))
    assert sorted(left for left, _ in result.rejected) == [2, 5]
    assert not result.inliers[np.isin(result.points.region, [2, 5])].any()
    assert angle(pose_of(result).rotation, of.rotation) < 0.2


def test_points_outside_of_regions_are_left_out() -> None:
    of = views(0)
    whole = matched(of)
    half = dataclasses.replace(whole, matches=whole.matches[:6])
    result = PoseFinder(PLAIN)(half, of.cameras)
    assert set(np.unique(result.points.region)) <= set(range(6))
    everything = PoseFinder(Config(pose=PoseConfig(crops="off", points="all")))(half, of.cameras)
    assert len(everything.points) == len(of.points)
    assert (everything.points.region == -1).sum() == len(of.points) - len(result.points)


def test_without_matches_all_points_are_used_and_it_says_so() -> None:
    of = views(0)
    result = PoseFinder(PLAIN)(dataclasses.replace(matched(of), matches=[]), of.cameras)
    assert len(result.points) == len(of.points)
    assert any("all points are used" in text for text in result.all_warnings())


def test_no_points() -> None:
    of = views(0)
    result = PoseFinder(PLAIN)(dataclasses.replace(matched(of), points=PointMatches.empty()), of.cameras)
    assert isinstance(result.pose, Failed)
    assert result.translation is None
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert document["pose"] is None
    assert "there are 0" in document["failed"]


def test_a_pure_rotation_has_no_translation() -> None:
    of = views(0, noise=0.3, shift=(0, 0, 0))
    result = found(of)
    assert pose_of(result).flags == ("pure_rotation",)
    assert result.translation is None
    assert pose_of(result).essential is None
    assert angle(pose_of(result).rotation, of.rotation) < 0.1
    assert any("only turned" in text for text in result.all_warnings())


def test_two_motions_are_ambiguous() -> None:
    one, other = (
        views(0, n=200, noise=0.2),
        views(1, n=160, noise=0.2, turn=rotation(-5.0, 0, 9.0), shift=(0.3, 1.0, 0)),
    )
    both = PointMatches.join([one.points, other.points])
    result = found(dataclasses.replace(one, points=both), Config(pose=PoseConfig(crops="off", points="all")))
    assert "ambiguous" in pose_of(result).flags
    assert any("another pose" in text for text in result.all_warnings())


@pytest.mark.parametrize("points", ["regions", "all"])
@pytest.mark.parametrize("estimator", ["opencv", "poselib"])
@pytest.mark.parametrize("n", [30, 100, 300])
def test_unrelated_photographs_have_no_pose(n: int, estimator: str, points: str) -> None:
    """As many points as you like: what agrees is chance."""
    pytest.importorskip("poselib")
    result = found(views(n, n=n, outliers=1.0), Config(pose=PoseConfig(estimator, points=points, crops="off")))  # type: ignore[arg-type]
    assert isinstance(result.pose, Failed)
    document = result.to_dict()
    assert document["pose"] is None
    assert document["failed"]
    assert any(text.startswith("no pose: ") for text in result.all_warnings())


def test_more_starts_find_no_pose_of_unrelated_photographs() -> None:
    pytest.importorskip("poselib")
    assert config.preset("default").pose.starts > 1
    of = views(5, n=100, outliers=1.0)
    assert isinstance(found(of, config.assign(config.preset("default"), ["pose.crops=off"])).pose, Failed)


@pytest.mark.parametrize(("outliers", "starts"), [(0.3, 1), (0.7, 10)])
def test_the_pose_says_of_how_many_starts_it_is(outliers: float, starts: int) -> None:
    of = views(1, n=400, noise=0.2, outliers=outliers)
    settings = ["pose.crops=off", "pose.bucket=0", "pose.min_region_agreement=0"]
    result = found(of, config.assign(config.preset("default"), settings))
    assert angle(pose_of(result).rotation, of.rotation) < 0.5
    assert pose_of(result).starts == starts
    assert isinstance(pose := result.to_dict()["pose"], dict)
    assert pose["starts"] == starts


def test_points_of_crops_prove_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """They agree because they were looked for where the matches put them."""
    good, wrong = views(0), views(1, n=60, outliers=1.0)
    region = np.zeros(len(good.points), np.intp)
    local = Correspondences(good.points, region, np.ones(len(region), bool))
    monkeypatch.setattr(PoseFinder, "gather", lambda *_: local)
    result = found(dataclasses.replace(good, points=wrong.points))
    assert isinstance(result.pose, Failed)
    assert "may be chance" in result.pose.reason


@pytest.mark.parametrize("scene", ["deep", "plane"])
@pytest.mark.parametrize("turned", [0, 90, 180])
def test_a_mirrored_photograph_has_no_pose(scene: str, turned: int) -> None:
    of = views(0, noise=0.3, scene=scene, turn=rotation(0, 0, turned), shift=(-0.5, 0.1, 0.0))
    assert not isinstance(found(of).pose, Failed)
    right = of.points.right * [-1, 1] + [SIZE[0], 0]
    result = found(dataclasses.replace(of, points=PointMatches(of.points.left, right, of.points.score)))
    assert isinstance(result.pose, Failed)
    assert "mirrored" in result.pose.reason


def test_a_doubtful_pose_has_no_sigma() -> None:
    """Flags that say that it may be another pose, and a small sigma, never stand together."""
    whole = views(0, noise=0.2)
    half = dataclasses.replace(matched(whole), matches=matched(whole).matches[:2])
    few = pose_of(PoseFinder(Config(pose=PoseConfig(crops="off", points="all")))(half, whole.cameras))
    plane = pose_of(found(views(0, noise=0.2, scene="plane")))
    for pose in (few, plane):
        assert pose.doubtful
        assert pose.rotation_sigma is pose.translation_sigma is pose.covariance is None
    assert few.flags == ("few_regions",)
    assert "planar_scene" in plane.flags
    sound = pose_of(found(whole))
    assert not sound.doubtful
    assert sound.rotation_sigma is not None
    assert sound.covariance is not None


def test_sigmas_are_inflated_by_what_was_measured() -> None:
    of = views(0, noise=0.3)
    plain, twice = (pose_of(found(of, Config(pose=PoseConfig(crops="off", inflation=f)))) for f in (1.0, 2.0))
    assert plain.rotation_sigma is not None
    assert twice.rotation_sigma == pytest.approx(2 * plain.rotation_sigma)
    assert np.allclose(plain.rotation, twice.rotation)


def test_a_plane_is_flagged() -> None:
    assert "planar_scene" in pose_of(found(views(0, noise=0.2, scene="plane"))).flags


def test_unknown_cameras_get_an_estimated_focal_length() -> None:
    from test_focal import centred

    from zpm2 import geometry

    cameras = centred(800.0), centred(800.0)
    of = views(3, n=500, noise=0.05, turn=rotation(8.0, 15.0, 4.0), shift=(-2.0, 0.8, 0.6), cameras=cameras)
    fundamental = geometry.fundamental_matrix(of.points.left, of.points.right, 1.0)
    assert not isinstance(fundamental, Failed)
    result = PoseFinder(PLAIN)(dataclasses.replace(matched(of), fundamental=fundamental[0]), None)
    assert not isinstance(result.cameras, Failed)
    assert result.cameras[0].source == "estimated"
    assert result.cameras[0].focal == pytest.approx(800, rel=0.03)
    assert angle(pose_of(result).rotation, of.rotation) < 1.0
    assert any("estimated from the epipolar geometry" in text for text in result.all_warnings())


def test_unknown_cameras_without_a_focal_length() -> None:
    of = views(0)
    result = PoseFinder(PLAIN)(matched(of), None)
    assert isinstance(result.pose, Failed)
    assert "K guess" in result.pose.reason
    assert result.to_dict()["cameras"] is None


def test_baseline() -> None:
    of = views(0)
    result = found(of).with_baseline(0.54)
    assert result.translation is not None
    assert np.linalg.norm(result.translation) == pytest.approx(0.54)
    assert result.to_dict()["pose"]["metric"] is True
    for bad in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError):
            result.with_baseline(bad)


def test_motions_of_the_homography() -> None:
    of = views(0, scene="plane")
    from zpm2 import geometry

    plane = geometry.homography(of.points.left, of.points.right, 1.0)
    assert not isinstance(plane, Failed)
    result = PoseFinder(PLAIN)(dataclasses.replace(matched(of), homography=plane[0]), of.cameras)
    motions = result.motions_of_homography()
    assert min(angle(r, of.rotation) for r, _, _ in motions) < 0.5
    assert len(result.to_dict()["homography_motions"]) == len(motions)


def test_pose_json(tmp_path: Path) -> None:
    of = views(0, noise=0.2, outliers=0.2)
    result = found(of)
    path = result.save(tmp_path / "new")
    document = json.loads(path.read_text())
    assert document["schema"] == "zpm2-pose/1"
    e = np.array(document["pose"]["essential"])
    rays = [
        camera.rays(np.array(document["points"][side]))
        for camera, side in zip(of.cameras, ("left", "right"), strict=True)
    ]
    inlier = np.array(document["points"]["inlier"])
    assert inlier.sum() == document["counts"]["inliers"]
    a, b = (np.c_[r, np.ones(len(r))][inlier] for r in rays)
    assert np.abs(np.einsum("ni,ij,nj->n", b, e, a)).max() < 0.01
    ids = {m.left for m in matched(of).matches}
    assert {p for p in document["points"]["left_polygon"] if p is not None} <= ids
    assert np.array(document["pose"]["covariance_rad2"]).shape == (5, 5)


def test_the_same_again() -> None:
    of = views(2, noise=0.5, outliers=0.3)
    first, second = (found(of).to_dict() for _ in range(2))
    assert json.dumps({**first, "timings": 0}) == json.dumps({**second, "timings": 0})


def test_presets() -> None:
    paper, best = config.preset("paper").pose, config.preset("default").pose
    assert (paper.points, paper.crops) == ("regions", "boxes")
    assert best != paper
