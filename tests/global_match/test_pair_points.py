"""When a pair is searched again, in which order, and when that ends."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from zpm2 import config as configuration
from zpm2 import memory
from zpm2.config import Config, EscalateConfig, PointsConfig
from zpm2.contract.scenes import texture, warped
from zpm2.errors import ConfigError, WeightsError
from zpm2.geometry import project
from zpm2.global_match import initial_geometry, pair_points
from zpm2.global_match.coarse import Hint
from zpm2.global_match.pair_points import PointFinder, is_safe, view_sizes
from zpm2.model import Image, PointMatches
from zpm2.runtime import StageTimer

IMAGE = Image(np.zeros((480, 640, 3), np.uint8))
PAIR = IMAGE, IMAGE


def scene(n: int, seed: int = 0) -> PointMatches:
    """n points all over a scene with relief, seen by two cameras side by side."""
    rng = np.random.default_rng(seed)
    at = rng.uniform((60, 5), (635, 475), (n, 2))
    return PointMatches(at, at - np.c_[rng.uniform(5, 50, n), np.zeros(n)], np.ones(n))


class Points:
    """A matcher that finds these points, and writes down what it was shown."""

    def __init__(self, name: str, found: PointMatches, seen: list[str]) -> None:
        self.name, self.found, self.seen = name, found, seen

    def match(self, left: Image, right: Image) -> PointMatches:
        self.seen.append(f"{self.name}@{max(left.width, left.height)}")
        scale = left.width / IMAGE.width
        return PointMatches(self.found.left * scale, self.found.right * scale, self.found.score)

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        return [PointMatches.empty() for _ in pairs]


def finder(
    monkeypatch: pytest.MonkeyPatch, found: dict[str, PointMatches | str], **settings: object
) -> tuple[PointFinder, list[str]]:
    """One whose methods find these points, or whose weights cannot be had; and what they are shown."""
    seen: list[str] = []

    def open_points(config: PointsConfig, device: str = "cpu", progress: object = None) -> Points:
        name = "+".join(config.methods)
        points = found.get(name, PointMatches.empty())
        if isinstance(points, str):
            raise WeightsError(points)
        return Points(name, points, seen)

    monkeypatch.setattr("zpm2.features.create", open_points)
    monkeypatch.setattr("zpm2.features.combined", open_points)
    base = configuration.preset("default")
    escalate = replace(base.points.escalate, **{"searches": ("own@300", "aliked@300", "aliked@500"), **settings})
    chosen = replace(base, points=replace(base.points, escalate=escalate))
    return PointFinder(chosen, "cpu"), seen


def look(points: PointFinder) -> pair_points.PairPoints:
    return points(PAIR, StageTimer(lambda stage, share: None))


def test_a_safe_geometry_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {"xfeat": scene(800)})
    timer = StageTimer(lambda stage, share: None)
    found = points(PAIR, timer)
    assert seen == ["xfeat@640"]
    assert found.notes == []
    assert found.initial.points.left.tobytes() == scene(800).left.tobytes()
    assert list(timer.seconds) == ["points"]


def test_searches_follow_in_order_until_one_is_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {"xfeat": scene(30), "aliked": scene(800, 1)})
    timer = StageTimer(lambda stage, share: None)
    found = points(PAIR, timer)
    assert seen == ["xfeat@640", "xfeat@300", "aliked@300"]
    assert len(found.initial.points) > 800
    assert is_safe(found.initial, PAIR, points.config.points.escalate)
    assert any("aliked@300" in note and "800 of 800 points agree" in note for note in found.notes)
    assert list(timer.seconds) == ["points", "escalate"]


def test_freed_memory_goes_back_before_a_larger_network_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {})
    monkeypatch.setattr("zpm2.memory.give_back", lambda: seen.append("given back"))
    look(points)
    assert seen == ["xfeat@640", "xfeat@300", "given back", "aliked@300"]


@pytest.mark.parametrize("looks", [1, 2, 3])
def test_the_budget_is_a_number_of_searches(monkeypatch: pytest.MonkeyPatch, looks: int) -> None:
    points, seen = finder(monkeypatch, {}, max_looks=looks)
    monkeypatch.setattr(pair_points, "hints", lambda images, opened, config: [Hint(0.0, 1.0, -50.0)])
    assert look(points).initial.agreeing == 0
    assert seen == ["xfeat@640", "xfeat@300", "aliked@300", "aliked@500"][: looks + 1]


def test_without_a_hint_it_soon_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {})
    look(points)
    assert seen == ["xfeat@640", "xfeat@300", "aliked@300"]


def test_it_can_be_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {}, on=False)
    assert look(points).notes == []
    assert seen == ["xfeat@640"]
    assert not Config().points.escalate.on


def test_a_given_matcher_looks_once() -> None:
    seen: list[str] = []
    points = PointFinder(configuration.preset("default"), "cpu", Points("mine", PointMatches.empty(), seen))
    assert look(points).notes == []
    assert seen == ["mine@640"]


def test_weights_that_cannot_be_had_are_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {"aliked": "no network"})
    first, second = look(points), look(points)
    assert "aliked@300" not in seen
    assert "looked again without aliked: no network" in first.notes
    assert first.notes == second.notes


def test_methods_without_weights_ask_for_none(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {})
    points.config = replace(points.config, points=replace(points.config.points, methods=("sift",)))
    notes = look(points).notes
    assert seen == ["sift@640", "sift@300"]
    assert "looked again without aliked: it needs weights, sift needs none" in notes


def test_a_search_that_does_not_fit_into_memory_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {}, searches=("own@300", "aliked@2000"))
    with memory.within("2GB"):
        notes = look(points).notes
    assert seen == ["xfeat@640", "xfeat@300"]
    assert any(note.startswith("looked again without aliked@2000: it needs about") for note in notes)


def test_worse_points_are_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    noise = PointMatches(rng.uniform(0, 480, (900, 2)), rng.uniform(0, 480, (900, 2)), np.ones(900))
    points, _ = finder(monkeypatch, {"xfeat": scene(40), "aliked": noise})
    monkeypatch.setattr(pair_points, "hints", lambda images, opened, config: [])
    assert look(points).initial.agreeing >= 40


def test_the_turn_with_more_evidence_is_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hint is tried at the turn of its similarity and at the turn at which it was seen; then one of them stays."""
    points, _ = finder(monkeypatch, {})
    shown: list[float] = []

    def look_at(images: object, matcher: object, hint: Hint, sizes: object, config: object) -> PointMatches:
        shown.append(hint.turn)
        return scene(150 if hint.turn == 135.0 else 9, len(shown))

    monkeypatch.setattr(pair_points, "hints", lambda images, opened, config: [Hint(90.0, 1.0, -50.0, "xfeat", 135.0)])
    monkeypatch.setattr(pair_points, "_look", look_at)
    found = look(points)
    assert shown[:3] == [90.0, 135.0, 135.0]
    assert 90.0 not in shown[2:]
    assert found.initial.agreeing > 200


def test_the_first_look_is_left_out_where_it_looked_at_the_wrong_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    points, _ = finder(monkeypatch, {"xfeat": scene(30)})
    monkeypatch.setattr(pair_points, "_look", lambda *_: scene(120, 7))
    for turn, kept in ((0.0, 150), (180.0, 120)):
        hint = Hint(turn, 1.0, -50.0, "sift", turn)
        monkeypatch.setattr(pair_points, "hints", lambda images, opened, config, hint=hint: [hint])
        assert len(look(points).initial.points) == kept


def test_the_same_pair_gives_the_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    points, _ = finder(monkeypatch, {"xfeat": scene(60), "aliked": scene(150, 3)})
    one, two = look(points), look(points)
    assert one.notes == two.notes
    assert one.initial.points.left.tobytes() == two.initial.points.left.tobytes()
    assert one.initial.fundamental.tobytes() == two.initial.fundamental.tobytes()


def test_a_thin_pair_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    points, seen = finder(monkeypatch, {})
    strip = Image(np.zeros((20, 2000, 3), np.uint8))
    assert points((strip, strip), StageTimer(lambda stage, share: None)).notes == []
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("points", "safe"),
    [(scene(800), True), (scene(100), False), (scene(0), False)],
)
def test_what_is_safe(points: PointMatches, safe: bool) -> None:
    found = initial_geometry(points, configuration.preset("default").global_match, 0)
    assert is_safe(found, PAIR, EscalateConfig()) == safe


def test_points_in_a_corner_are_not_safe() -> None:
    corner = scene(800)
    corner = PointMatches(corner.left / 6, corner.right / 6, corner.score)
    found = initial_geometry(corner, configuration.preset("default").global_match, 0)
    assert found.agreeing == 800
    assert not is_safe(found, PAIR, replace(EscalateConfig(), safe_chance=0))


@pytest.mark.parametrize("turn", [0.0, 45.0, 150.0])
@pytest.mark.parametrize("scale", [0.25, 1.0, 4.0])
def test_views_have_one_resolution_and_bounded_size(turn: float, scale: float) -> None:
    images = Image(np.zeros((1200, 1600, 3), np.uint8)), Image(np.zeros((1500, 1000, 3), np.uint8))
    left, right = view_sizes(images, Hint(turn, scale, 0.0), 800)
    assert left / 1600 == pytest.approx(scale * right / 1500, rel=0.02)
    for image, size in zip(images, (left, right), strict=True):
        seen = pair_points.view(image, size, turn if image is images[1] else 0.0).image
        assert seen.width * seen.height <= 1.02 * 800**2


def test_views_are_never_enlarged() -> None:
    assert view_sizes(PAIR, Hint(0.0, 1.0, 0.0), 4000) == (640, 640)


def test_an_unknown_search_is_refused() -> None:
    for searches, message in ((("nothing@640",), "nothing"), (("xfeat",), "xfeat@640"), (("xfeat@9",), "xfeat@640")):
        with pytest.raises(ConfigError, match=message):
            PointFinder(Config(points=PointsConfig(escalate=EscalateConfig(on=True, searches=searches))), "cpu")


def test_results_of_earlier_versions_are_read() -> None:
    old = {"points": {"rotated_retry": True, "retry": {"sizes": [640]}, "max_keypoints": 77}}
    assert configuration.recorded(old).points.max_keypoints == 77


@pytest.mark.weights
@pytest.mark.parametrize(("turn", "zoom"), [(70, 0.8), (180, 1.0)])
def test_turned_photographs(turn: float, zoom: float) -> None:
    """XFeat alone does not tolerate such turns."""
    left = Image(texture(480, 360))
    truth = np.vstack([cv2.getRotationMatrix2D((240, 180), turn, zoom), [0, 0, 1]])
    right = Image(warped(left.rgb, truth))
    chosen = configuration.preset("default")

    def good(escalate: bool) -> int:
        settings = replace(chosen.points, escalate=replace(chosen.points.escalate, on=escalate))
        points = PointFinder(replace(chosen, points=settings), "cpu")
        found = points((left, right), StageTimer(lambda stage, share: None)).initial.points
        return int((np.linalg.norm(project(truth, found.left) - found.right, axis=1) < 3).sum())

    assert good(escalate=False) < 20
    assert good(escalate=True) > 100
