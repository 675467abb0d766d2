"""The Python API: one call, a matcher that is kept, inputs of every kind, own stages, and what a run says."""

import dataclasses
import sys
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import shapely.affinity
from painted import PaintedSegmenter, PaintedView, Region
from rendered import Pair, photograph

import zpm2
from zpm2 import MatchResult
from zpm2.config import Config, PointsConfig, SegmentConfig, assign, preset
from zpm2.errors import ConfigError, Failed, InputError
from zpm2.global_match import InitialGeometry, points_with_data
from zpm2.guided.regions import PairRegions, RegionFinder
from zpm2.model import Image, Mask, PointMatches, PolygonMatch
from zpm2.pipeline import PairMatcher
from zpm2.runtime import resolve_device
from zpm2.segment.given.precomputed import PrecomputedSegmenter

Match = Callable[[PairRegions], Sequence[PolygonMatch]]
SIFT = Config(points=PointsConfig(methods=("sift",)), device="cpu")


class Squares:
    """A segmenter: squares of 40 px, numbered by their score's rank."""

    name = "squares"

    def segment(self, image: Image) -> list[Mask]:
        corners = [(x, y) for y in range(0, image.height - 39, 40) for x in range(0, image.width - 39, 40)]
        return [Mask(x, y, np.ones((40, 40), bool), 1 - k / 1000) for k, (x, y) in enumerate(corners)]


class Nothing:
    """A segmenter that finds no region."""

    name = "nothing"

    def segment(self, image: Image) -> list[Mask]:
        return []


class Given:
    """A point matcher that knows its answer."""

    name = "given"

    def __init__(self, points: PointMatches) -> None:
        self.points = points

    def match(self, left: Image, right: Image) -> PointMatches:
        return self.points


def grid_points(shift: float, step: int = 12) -> PointMatches:
    x, y = np.meshgrid(np.arange(10.5, 380, step), np.arange(10.5, 230, step))
    left = np.c_[x.ravel(), y.ravel()]
    return PointMatches(left, left + np.array([shift, 0.0]), np.ones(len(left)))


def regions(pair: Pair) -> tuple[PrecomputedSegmenter, PrecomputedSegmenter]:
    return PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)


def pairs_of(result: MatchResult) -> list[tuple[int, int]]:
    return [(m.left, m.right) for m in result.matches]


def content(result: MatchResult) -> dict[str, Any]:
    """Everything but times and file names."""
    values = result.to_dict()
    for side in ("left", "right"):
        values[side]["path"] = None
    return {**values, "timings": None}


@pytest.fixture(scope="module")
def result(pair: Pair) -> MatchResult:
    return PairMatcher(SIFT, segmenter=regions(pair))(pair.left, pair.right)


def test_inputs_of_every_kind_agree(pair: Pair, result: MatchResult) -> None:
    matcher = PairMatcher(SIFT, segmenter=regions(pair))
    scene = pair.scene
    with PIL.Image.open(pair.left) as left, PIL.Image.open(pair.right) as right:
        from_pil = matcher(left, right)
    for other in (
        matcher(str(pair.left), str(pair.right)),
        matcher(scene.left, scene.right),
        matcher(scene.left / 255, scene.right.astype(np.int32)),
        from_pil,
    ):
        assert {**content(other), "notes": None} == {**content(result), "notes": None}
    assert result.left.path == str(pair.left)
    assert matcher(scene.left, scene.right).left.path is None


def test_grey_and_16_bit_arrays(pair: Pair) -> None:
    grey = [np.asarray(PIL.Image.fromarray(rgb).convert("L")) for rgb in (pair.scene.left, pair.scene.right)]
    matcher = PairMatcher(SIFT, segmenter=regions(pair))
    plain = matcher(*grey)
    assert len(plain.matches) > 30
    deep = matcher(*(g.astype(np.uint16) * 257 for g in grey))
    assert len(set(pairs_of(deep)) & set(pairs_of(plain))) > 0.9 * len(plain.matches)
    assert any("16-bit" in note for note in deep.notes)


@pytest.mark.parametrize(
    ("bad", "word"),
    [
        (np.full((60, 80), np.nan), "NaN"),
        (np.zeros((1, 1, 3), np.uint8), "1 x 1 px"),
        (np.zeros((3, 60, 80), np.uint8), "channels last"),
        ("nowhere.png", "does not exist"),
        (None, "got NoneType"),
    ],
)
def test_inputs_that_cannot_be_used(bad: Any, word: str) -> None:
    good = photograph(0)
    matcher = PairMatcher(SIFT, segmenter=Nothing())
    for name, inputs in (("left", (bad, good)), ("right", (good, bad))):
        with pytest.raises(InputError, match=word) as caught:
            matcher(*inputs)
        assert str(caught.value).startswith(f"{name} image")
        assert "\n" not in str(caught.value)


def test_match_is_one_call(pair: Pair, result: MatchResult, monkeypatch: pytest.MonkeyPatch) -> None:
    class Sam:
        """Stands for SAM: the known regions, the left image first."""

        name = "stand-in"

        def __init__(self, *_: object) -> None:
            self.sources = list(regions(pair))

        def load(self) -> None:
            pass

        def polygons(self, image: Image) -> list[zpm2.Polygon]:
            return self.sources.pop(0).polygons(image)

    monkeypatch.setattr("zpm2.segment.sam.SamSegmenter", Sam)
    found = zpm2.match(pair.left, pair.right, config=SIFT)
    assert isinstance(found, MatchResult)
    assert content(found) == content(result) | {"warnings": content(found)["warnings"]}
    assert result.config == SIFT.to_dict()


def test_models_are_loaded_once(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    loads: list[str] = []

    class Sam(Squares):
        def __init__(self, config: SegmentConfig, device: str, say: Any, progress: Any, download: Any) -> None:
            loads.append(config.model)

        def load(self) -> None:
            loads.append("networks")

    def create(*_: object, progress: object) -> Given:
        loads.append("points")
        return Given(grid_points(-5))

    monkeypatch.setattr("zpm2.segment.sam.SamSegmenter", Sam)
    monkeypatch.setattr("zpm2.features.create", create)
    matcher = PairMatcher("paper")
    assert loads == []
    results = [matcher(pair.left, pair.right), matcher(pair.right, pair.left), matcher(pair.left, pair.right)]
    assert sorted(loads) == ["mobile_sam", "networks", "points"]
    assert content(results[0]) == content(results[2])
    assert content(results[0]) != content(results[1])


def test_own_segmenter_and_points(pair: Pair) -> None:
    rgb = photograph(5)
    shifted = np.roll(rgb, -40, axis=1)
    matcher = PairMatcher(SIFT, segmenter=Squares(), points=Given(grid_points(-40)))
    found = matcher(rgb, shifted)
    assert len(found.left.polygons) == len(found.right.polygons) == 60
    assert len(found.points) == len(grid_points(-40))
    centers = [{p.id: p.center for p in side.polygons} for side in (found.left, found.right)]
    moves = np.array([centers[1][m.right] - centers[0][m.left] for m in found.matches])
    assert len(moves) >= 50
    assert np.allclose(moves, [-40, 0], atol=0.5)


def test_progress_is_monotone_and_complete(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    class Sam(Squares):
        def __init__(self, config: SegmentConfig, device: str, say: Any, progress: Any, download: Any) -> None:
            self.progress = progress

        def load(self) -> None:
            pass

        def segment(self, image: Image) -> list[Mask]:
            for share in (0.3, 0.6, 1.0):
                self.progress(share)
            return super().segment(image)

    monkeypatch.setattr("zpm2.segment.sam.SamSegmenter", Sam)
    told: list[tuple[str, float]] = []
    matcher = PairMatcher(SIFT, progress=lambda stage, share: told.append((stage, share)))
    for _ in range(2):
        told.clear()
        found = matcher(pair.left, pair.right)
        shares = defaultdict(list)
        for stage, share in told:
            shares[stage].append(share)
        assert list(shares) == list(found.timings) == ["read", "load", "points", "detect", "global", "local", "verify"]
        for values in shares.values():
            assert values == sorted(values)
            assert (values[0], values[-1]) == (0, 1)
        assert shares["detect"][1:-1] == pytest.approx([0.15, 0.3, 0.5, 0.65, 0.8, 1.0])


@pytest.mark.parametrize("count", [0, 1, 3])
def test_too_few_points_are_no_error(pair: Pair, count: int) -> None:
    points = grid_points(-10)[np.arange(count)]
    found = PairMatcher(SIFT, segmenter=regions(pair), points=Given(points))(pair.left, pair.right)
    for estimate in (found.fundamental, found.homography):
        assert isinstance(estimate, Failed)
        assert not estimate
        assert estimate.reason
    assert found.to_dict()["fundamental"] is found.to_dict()["homography"] is None
    text = "\n".join(found.warnings)
    assert "no fundamental matrix: " in text
    assert f"0 of {count} homologous points agree on one geometry" in text
    assert len(found.left.polygons) > 30


def test_a_mirrored_photograph_is_said(pair: Pair) -> None:
    points = grid_points(0)
    for right, said in ((points.right, 0), (points.right * [-1, 1] + [400, 0], 1)):
        given = Given(PointMatches(points.left, right, points.score))
        found = PairMatcher(SIFT, segmenter=regions(pair), points=given)(pair.left, pair.right)
        assert sum("one of the photographs is mirrored" in warning for warning in found.warnings) == said


def test_unrelated_points_leave_no_confidence(pair: Pair) -> None:
    points = grid_points(0)
    mixed = PointMatches(points.left, np.random.default_rng(0).permutation(points.right), points.score)
    found = PairMatcher(SIFT, segmenter=regions(pair), points=Given(mixed))(pair.left, pair.right)
    assert any("may not show the same scene" in warning for warning in found.warnings)
    assert all(match.confidence <= 0.1 for match in found.matches)


def test_no_regions_are_no_error(pair: Pair) -> None:
    for left, right, missing in (
        (Nothing(), Squares(), {"left"}),
        (Squares(), Nothing(), {"right"}),
        (Nothing(), Nothing(), {"left", "right"}),
    ):
        found = PairMatcher(SIFT, segmenter=(left, right))(pair.left, pair.right)
        assert found.matches == []
        for side in ("left", "right"):
            assert (f"no regions were found in the {side} image" in found.warnings) == (side in missing)
        assert "no polygons were matched" in found.warnings


def test_notes_of_own_regions_say_whose_they_are(result: MatchResult, pair: Pair, tmp_path: Path) -> None:
    with_crumb = np.array(PIL.Image.open(pair.left_regions))
    with_crumb[:3, :3] = 999
    PIL.Image.fromarray(with_crumb).save(tmp_path / "labels.png")
    sources = PrecomputedSegmenter(tmp_path / "labels.png"), PrecomputedSegmenter(pair.right_regions)
    found = PairMatcher(SIFT, segmenter=sources)(pair.left, pair.right)
    assert any(w.startswith("left regions: 1 region under 100 px^2 left out") for w in found.warnings)
    assert not any(w.startswith("left regions") for w in result.warnings)


def test_the_seed_alone_decides(pair: Pair) -> None:
    def once(seed: int) -> MatchResult:
        config = dataclasses.replace(SIFT, seed=seed)
        return PairMatcher(config, segmenter=regions(pair))(pair.left, pair.right)

    np.random.seed(1)  # noqa: NPY002  (the state of other people's generators must not matter)
    first = once(4)
    np.random.seed(2)  # noqa: NPY002
    assert content(first) == content(once(4))


def test_preset_by_name_and_unknown_preset() -> None:
    assert PairMatcher("paper").config == zpm2.preset("paper")
    with pytest.raises(ConfigError, match="unknown preset 'best'"):
        PairMatcher("best")


def test_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    for there, expected in ((True, "cuda"), (False, "cpu")):
        monkeypatch.setattr("torch.cuda.is_available", lambda there=there: there)
        assert resolve_device("auto") == expected
        assert resolve_device("cpu") == "cpu"
    with pytest.raises(ConfigError, match="device cuda is not available"):
        resolve_device("cuda")
    with pytest.raises(ConfigError, match="unknown device 'gpu'"):
        resolve_device("gpu")


def test_torch_is_not_loaded_to_ask_for_a_gpu_without_a_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def no_driver(name: str) -> None:
        asked.append(name)
        raise OSError

    monkeypatch.setattr("ctypes.CDLL", no_driver)
    monkeypatch.setattr("importlib.metadata.version", lambda name: "2.9.0+cu130")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    assert resolve_device("auto") == "cpu"
    assert asked == ["libcuda.so.1"]
    assert "torch" not in sys.modules


def test_polygons_that_no_texture_places_are_told() -> None:
    uniform = np.full((240, 400, 3), 90, np.uint8)
    found = PairMatcher(SIFT, segmenter=Squares(), points=Given(grid_points(-40)))(uniform, uniform)
    told = [text for text in found.notes if "stay where the geometry predicts them" in text]
    assert len(told) == 1
    assert told[0].startswith("60 of 60 left polygons")
    assert "without texture that correlates" in told[0]


def painted_pair() -> tuple[PaintedSegmenter, PaintedView, PaintedView]:
    """A photograph and the same 24 px further left. One region in three answers only when it is asked for."""
    rgb = photograph(5, 256, 256)
    images = Image(rgb), Image(np.ascontiguousarray(np.roll(rgb, -24, axis=1)))
    cells = [shapely.box(x, y, x + 36, y + 40) for y in range(10, 200, 60) for x in range(30, 200, 60)]
    views = []
    for n, (image, moved) in enumerate(zip(images, (0, -24), strict=True)):
        shapes = [shapely.affinity.translate(cell, moved) for cell in cells]
        views.append(PaintedView(image, [Region(shape, prompt_only=k % 3 == n) for k, shape in enumerate(shapes)]))
    return PaintedSegmenter(views), views[0], views[1]


GUIDED = assign(preset("default"), ["device=cpu", "segment.grid=16", "segment.min_area=50"])


def test_guided_matches_say_so() -> None:
    segmenter, left, right = painted_pair()
    found = PairMatcher(GUIDED, segmenter=segmenter, points=Given(grid_points(-24)))(left.image.rgb, right.image.rgb)
    assert len(found.matches) == len(left.regions)
    assert "guided" in found.timings
    assert {m.stage for m in found.matches} >= {"guided"}
    assert sum(m.stage == "guided" for m in found.matches) >= len(left.regions) / 2
    centers = [{p.id: p.center for p in side.polygons} for side in (found.left, found.right)]
    assert np.allclose([centers[1][m.right] - centers[0][m.left] for m in found.matches], [-24, 0], atol=1.5)
    again = PairMatcher(GUIDED, segmenter=segmenter, points=Given(grid_points(-24)))(left.image.rgb, right.image.rgb)
    assert content(found) == content(again)


def test_guidance_in_one_direction_asks_the_left_image_nothing_new() -> None:
    segmenter, left, right = painted_pair()
    forward = assign(GUIDED, ["guided.direction=forward"])
    found = PairMatcher(forward, segmenter=segmenter, points=Given(grid_points(-24)))(left.image.rgb, right.image.rgb)
    assert "guided" not in found.timings
    assert len(found.matches) < len(left.regions)
    assert len(found.right.polygons) == len(right.regions)


def test_a_segmenter_without_prompts_is_told(pair: Pair) -> None:
    rgb = photograph(5)
    found = PairMatcher(GUIDED, segmenter=Squares(), points=Given(grid_points(-40)))(rgb, np.roll(rgb, -40, axis=1))
    assert any("takes no prompts" in warning for warning in found.warnings)
    assert "guided" not in found.timings
    given = PairMatcher(GUIDED, segmenter=regions(pair), points=Given(grid_points(-5)))(pair.left, pair.right)
    assert not any("prompts" in warning for warning in given.warnings)


def test_where_nothing_can_be_looked_at_again_it_is_said(pair: Pair) -> None:
    high = assign(GUIDED, ["segment.detail.level=high"])
    given, points = regions(pair), Given(grid_points(-5))
    asked = {
        "regions are given": PairMatcher(high, segmenter=given, points=points),
        "needs guided re-detection": PairMatcher(high, segmenter=Squares(), points=points),
    }
    for why, matcher in asked.items():
        found = matcher(pair.left, pair.right)
        assert [why in warning for warning in found.warnings if "--detail high" in warning] == [True]
        assert "detail" not in found.timings


def test_a_closer_look_is_a_stage_of_its_own_and_can_be_left_out() -> None:
    segmenter, left, right = painted_pair()
    images, points = (left.image.rgb, right.image.rgb), Given(grid_points(-24))
    off, auto = (
        PairMatcher(assign(GUIDED, [f"segment.detail.level={level}"]), segmenter=segmenter, points=points)(*images)
        for level in ("off", "auto")
    )
    assert "detail" not in off.timings
    assert "detail" in auto.timings
    assert len(auto.matches) >= len(off.matches)


def test_a_closer_look_knows_only_matches_that_are_sure(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the judge rejects covers nothing, and its regions are looked for again."""
    segmenter, left, right = painted_pair()
    known: list[tuple[int, int]] = []

    def look(
        self: RegionFinder, found: PairRegions, matches: Sequence[PolygonMatch], initial: InitialGeometry, match: Match
    ) -> None:
        known.append((len(matches), len(match(found))))

    monkeypatch.setattr(RegionFinder, "look_closer", look)
    for settings in (["local_match.verify.min_confidence=1"], ["local_match.judge=off"]):
        PairMatcher(assign(GUIDED, settings), segmenter=segmenter, points=Given(grid_points(-24)))(
            left.image.rgb, right.image.rgb
        )
    assert known == [(0, 0), (len(left.regions),) * 2]


def test_points_on_pixels_without_data_are_left_out() -> None:
    valid = np.ones((40, 60), bool)
    valid[:, :30] = False
    images = Image(np.zeros((40, 60, 3), np.uint8), valid=valid), Image(np.zeros((40, 60, 3), np.uint8))
    at = np.array([[29.5, 10.0], [30.5, 10.0], [59.9, 39.9]])
    kept = points_with_data(PointMatches(at, at, np.ones(3)), images)
    assert kept.left.tolist() == at[1:].tolist()
