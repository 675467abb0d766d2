"""The contract of every estimator of a pose, on scenes with exact truth."""

import sys

import numpy as np
import pytest
from views import Views, angle, matched, rotation, views

from zpm2.config import PoseConfig, preset
from zpm2.errors import ConfigError, Failed, MissingDependency
from zpm2.pose.estimators import ESTIMATORS, OpenCv, PoseEstimate, PoseEstimator, most_likely, open_estimator
from zpm2.pose.points import RayPairs

PX = 1 / 700  # of rays


def test_auto(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("poselib")
    assert open_estimator("auto").name == "poselib"
    monkeypatch.setattr("zpm2.pose.estimators.find_spec", lambda name: None)
    assert open_estimator("auto").name == "opencv"
    from zpm2.config import Config, PoseConfig
    from zpm2.pose import PoseFinder

    of = views(0)
    result = PoseFinder(Config(pose=PoseConfig(crops="off", estimator="auto")))(matched(of), of.cameras)
    assert any("pip install poselib" in text for text in result.all_warnings())
    assert result.config["estimator"] == "opencv"


@pytest.fixture(params=ESTIMATORS)
def estimator(request: pytest.FixtureRequest) -> PoseEstimator:
    if request.param == "poselib":
        pytest.importorskip("poselib")
    return open_estimator(request.param)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("noise", "outliers", "most"), [(0.0, 0.0, 0.01), (0.0, 0.4, 0.5), (0.5, 0.4, 1.0)])
def test_pose(estimator: PoseEstimator, seed: int, noise: float, outliers: float, most: float) -> None:
    of = views(seed, noise=noise, outliers=outliers)
    found = estimator.estimate(*of.rays, PX, 0)
    assert not isinstance(found, Failed)
    assert angle(found.rotation, of.rotation) < most
    assert angle(found.translation, of.direction) < 5 * most
    assert np.isclose(np.linalg.norm(found.translation), 1)
    assert np.allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-9)
    assert (1 - outliers) * 0.6 < found.inliers.mean() < (1 - outliers) + 0.12


@pytest.mark.parametrize("shift", [(1.0, 0, 0), (0, -1.0, 0), (0.1, 0, 1.0), (0, 0, -0.8)])
def test_every_direction(estimator: PoseEstimator, shift: tuple[float, float, float]) -> None:
    of = views(5, shift=shift, turn=rotation(0, 0, 25.0))
    found = estimator.estimate(*of.rays, PX, 0)
    assert not isinstance(found, Failed)
    assert angle(found.translation, of.direction) < 0.1


def test_the_same_again(estimator: PoseEstimator) -> None:
    of = views(1, noise=0.5, outliers=0.3)
    first, second = (estimator.estimate(*of.rays, PX, 3) for _ in range(2))
    assert not isinstance(first, Failed)
    assert not isinstance(second, Failed)
    assert first.rotation.tobytes() == second.rotation.tobytes()
    assert first.translation.tobytes() == second.translation.tobytes()


@pytest.mark.parametrize("n", [0, 1, 4, 5, 7])
def test_too_few_points(estimator: PoseEstimator, n: int) -> None:
    of = views(0)
    found = estimator.estimate(of.rays[0][:n], of.rays[1][:n], PX, 0)
    assert isinstance(found, Failed)
    assert f"there are {n}" in found.reason


@pytest.mark.parametrize("name", ESTIMATORS)
def test_how_many_points_it_needs_is_configured(name: str) -> None:
    if name == "poselib":
        pytest.importorskip("poselib")
    of = views(0)
    found = open_estimator(name, PoseConfig(min_points=10)).estimate(of.rays[0][:9], of.rays[1][:9], PX, 0)
    assert isinstance(found, Failed)
    assert "from 10 homologous points on, there are 9" in found.reason


def test_chance_has_few_inliers(estimator: PoseEstimator) -> None:
    rng = np.random.default_rng(0)
    found = estimator.estimate(rng.uniform(-0.5, 0.5, (200, 2)), rng.uniform(-0.5, 0.5, (200, 2)), PX, 0)
    assert isinstance(found, Failed) or found.inliers.mean() < 0.25


def test_names() -> None:
    with pytest.raises(ConfigError, match="opencv, poselib"):
        open_estimator("magic")


def test_a_missing_package_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "poselib", None)
    with pytest.raises(MissingDependency, match="pip install poselib"):
        open_estimator("poselib")


class Drawn:
    """An estimator that answers with what it was given for each seed."""

    name = "drawn"

    def __init__(self, answers: dict[int, PoseEstimate | Failed]) -> None:
        self.answers, self.seeds = answers, list[int]()

    def estimate(self, left: np.ndarray, right: np.ndarray, threshold: float, seed: int) -> PoseEstimate | Failed:
        self.seeds.append(seed)
        return self.answers[seed]


def agreeing(of: Views, rotation: np.ndarray, share: float) -> PoseEstimate:
    """A pose on which that share of the points is said to agree."""
    return PoseEstimate(rotation, of.direction, np.arange(len(of.points)) < share * len(of.points))


def found_by(
    first: PoseEstimator, further: PoseEstimator, of: Views, seed: int, options: PoseConfig
) -> PoseEstimate | Failed:
    """The most likely pose, all of whose points are of the whole images."""
    return most_likely(first, further, RayPairs(*of.rays, PX), np.ones(len(of.points), bool), seed, options)


def test_where_few_points_agree_the_most_likely_of_several_poses_counts() -> None:
    of = views(0, noise=0.5, outliers=0.6)
    wrong = rotation(0, 3.0, 0) @ of.rotation
    answers = {
        6: agreeing(of, wrong, 0.32),
        7: Failed("none"),
        8: agreeing(of, of.rotation, 0.2),  # fewer are said to agree, as of a threshold that is too tight
    }
    for starts, expected in ((3, of.rotation), (1, wrong)):
        estimator = Drawn(answers if starts == 3 else {6: answers[6]})
        seed = 6 // starts
        found = found_by(estimator, estimator, of, seed, PoseConfig(starts=starts))
        assert not isinstance(found, Failed)
        assert np.array_equal(found.rotation, expected)
        assert found.starts == starts
        assert sorted(estimator.seeds) == list(range(6, 6 + starts))


def test_one_start_is_enough_where_many_points_agree() -> None:
    of = views(0)
    estimator = Drawn({0: agreeing(of, of.rotation, 0.4)})
    found = found_by(estimator, estimator, of, 0, PoseConfig(starts=10))
    assert found is estimator.answers[0]
    assert estimator.seeds == [0]


def test_further_starts_are_of_the_other_estimator() -> None:
    of = views(0)
    first, further = Drawn({8: Failed("none")}), Drawn({k: agreeing(of, of.rotation, 0.1) for k in (9, 10, 11)})
    assert not isinstance(found_by(first, further, of, 2, PoseConfig(starts=4)), Failed)
    assert (first.seeds, sorted(further.seeds)) == ([8], [9, 10, 11])


def test_points_of_crops_have_no_say() -> None:
    """Most points agree on a wrong pose, but those of the whole images do not."""
    pytest.importorskip("poselib")
    of, other = views(0, n=200, noise=0.3), views(1, n=600, noise=0.3, turn=rotation(-5.0, 0, 9.0), shift=(0.3, 1.0, 0))
    rays = RayPairs(*(np.concatenate(each) for each in zip(of.rays, other.rays, strict=True)), PX)
    whole = np.arange(800) < 200
    for starts, truth in ((5, of), (1, other)):
        options = PoseConfig(starts=starts)
        found = most_likely(open_estimator("poselib"), OpenCv(options), rays, whole, 0, options)
        assert not isinstance(found, Failed)
        assert angle(found.rotation, truth.rotation) < 0.5
        assert found.inliers[whole == (truth is of)].mean() > 0.8


def test_no_start_finds_a_pose() -> None:
    of = views(0)
    estimator = Drawn(dict.fromkeys(range(4), Failed("none")))
    assert found_by(estimator, estimator, of, 0, PoseConfig(starts=4)) == Failed("none")


def test_seeds_agree_where_few_points_are_right() -> None:
    pytest.importorskip("poselib")
    of, best = views(3, n=600, noise=1.0, outliers=0.8), preset("default").pose
    errors = []
    for seed in range(4):
        found = found_by(open_estimator("poselib", best), OpenCv(best), of, seed, best)
        assert not isinstance(found, Failed)
        errors.append(angle(found.rotation, of.rotation))
    assert max(errors) < 1.5
