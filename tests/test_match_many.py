"""Many pairs: the same results as one by one, in their order; one look at each photograph; errors in their places."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import PIL.Image
import pytest
import shapely.affinity
from painted import PaintedSegmenter, PaintedView, Region
from rendered import Pair, photograph

from zpm2 import Matcher, MatchResult, Polygon, Zpm2Error
from zpm2.config import Config, PointsConfig, TilesConfig, assign, preset
from zpm2.errors import ConfigError, InputError, PointMatcherError, SegmenterError
from zpm2.model import Image, Mask, PointMatches
from zpm2.pipeline import PairMatcher

CONFIG = Config(points=PointsConfig(methods=("sift",)), device="cpu")


class Squares:
    """A segmenter: squares of 40 px."""

    name = "squares"

    def segment(self, image: Image) -> list[Mask]:
        corners = [(x, y) for y in range(0, image.height - 39, 40) for x in range(0, image.width - 39, 40)]
        return [Mask(x, y, np.ones((40, 40), bool), 1 - k / 1000) for k, (x, y) in enumerate(corners)]


def squares(config: Config = CONFIG, **more: Any) -> Matcher:
    return Matcher(config, segmenter=Squares(), **more)


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The segmenter counts as one of zpm2's own."""
    monkeypatch.setattr(PairMatcher, "takes_threads", True)


def content(result: MatchResult | Zpm2Error) -> dict[str, Any]:
    """Everything but times."""
    assert isinstance(result, MatchResult), result
    return {**result.to_dict(), "timings": None}


@pytest.fixture(scope="module")
def views(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three photographs: both of the pair, and the left one a little brighter."""
    folder = tmp_path_factory.mktemp("views")
    brighter = np.asarray(PIL.Image.open(pair.left)).astype(int) + 9
    PIL.Image.fromarray(np.clip(brighter, 0, 255).astype(np.uint8)).save(folder / "third.png")
    return [pair.left, pair.right, folder / "third.png"]


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("at_once", [1, 3])
def test_results_are_those_of_single_calls_in_the_order_of_the_pairs(views: list[Path], at_once: int) -> None:
    a, b, c = views
    pairs = [(a, b), (b, c), (a, c), (a, b)]
    matcher = squares()
    many = list(matcher.match_many(pairs, at_once=at_once))
    assert [content(each) for each in many] == [content(matcher(*each)) for each in pairs]
    assert len(content(many[0])["matches"]) > 5


@pytest.mark.usefixtures("threads")
def test_an_error_takes_the_place_of_its_pair(views: list[Path]) -> None:
    a, b, _ = views
    found = list(squares().match_many([(a, "missing.png"), (a, b), (np.zeros(3), b)]))
    assert [type(each) for each in found] == [InputError, MatchResult, InputError]
    assert "missing.png" in str(found[0])


@pytest.mark.usefixtures("threads")
def test_each_photograph_is_described_once(views: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    from zpm2.features.methods.sift import SiftDetector

    detect, seen = SiftDetector.detect, []
    monkeypatch.setattr(SiftDetector, "detect", lambda own, images: seen.extend(images) or detect(own, images))
    matcher = squares()
    list(matcher.match_many(itertools.combinations(views, 2)))
    assert sorted(Path(str(image.path)).name for image in seen) == ["left.png", "right.png", "third.png"]
    seen.clear()
    list(matcher.match_many([views[:2], views[1:], views[:2]], at_once=1, photographs=2))
    assert 3 < len(seen) < 6  # the left one was forgotten when it came again


BY_PART: dict[str, tuple[str, object, type[Zpm2Error]]] = {  # what is called, a good answer, the error
    "segmenter": ("segment", [], SegmenterError),
    "points": ("match", PointMatches.empty(), PointMatcherError),
}


@pytest.mark.parametrize("part", BY_PART)
def test_a_part_that_fails_costs_its_pair(part: str, views: list[Path]) -> None:
    seen = itertools.count()
    method, good, wrong = BY_PART[part]
    own = SimpleNamespace(name="own", **{method: lambda *images: good if next(seen) else None})
    parts: Any = {"segmenter": Squares(), part: own}
    found = list(Matcher(CONFIG, **parts).match_many([(views[0], views[1])] * 2))
    assert [type(each) for each in found] == [wrong, MatchResult]


def test_a_photograph_and_itself_match_as_in_a_call(views: list[Path]) -> None:
    pixels = np.asarray(PIL.Image.open(views[0]))[:150, :200]
    (many,) = squares().match_many([(pixels, pixels)])
    assert content(many) == content(squares()(pixels, pixels))


class Shifted:
    """A point matcher that knows that every photograph shows the scene 24 px further left than the one before it."""

    name = "shifted"

    def match(self, left: Image, right: Image) -> PointMatches:
        x, y = np.meshgrid(np.arange(10.5, 250, 12), np.arange(10.5, 250, 12))
        at = np.c_[x.ravel(), y.ravel()]
        shift = 24.0 * (int(right.path or 0) - int(left.path or 0))
        return PointMatches(at, at - np.array([shift, 0.0]), np.ones(len(at)))


def test_a_left_photograph_is_segmented_once() -> None:
    rgb = photograph(5, 256, 256)
    images = [Image(np.ascontiguousarray(np.roll(rgb, -24 * k, axis=1)), str(k)) for k in range(3)]
    cells = [shapely.box(x, y, x + 36, y + 40) for y in range(10, 200, 60) for x in range(80, 200, 60)]
    moved = [[Region(shapely.affinity.translate(cell, -24 * k)) for cell in cells] for k in range(3)]
    views = [PaintedView(image, regions) for image, regions in zip(images, moved, strict=True)]
    config = assign(preset("default"), ["device=cpu", "segment.grid=16", "segment.min_area=50"])
    matcher = Matcher(config, segmenter=PaintedSegmenter(views), points=Shifted())
    pairs = [(images[0], images[1]), (images[0], images[2])]
    alone = [content(matcher(*pair)) for pair in pairs]
    asked = len(views[0].asked)
    views[0].asked.clear()
    assert [content(each) for each in matcher.match_many(pairs)] == alone
    assert len(alone[1]["matches"]) == len(cells)
    assert 0 < len(views[0].asked) <= asked / 2


def test_a_matcher_remembers_the_last_photographs_for_further_calls() -> None:
    rgb = photograph(5, 256, 256)
    images = [Image(np.ascontiguousarray(np.roll(rgb, -24 * k, axis=1)), str(k)) for k in range(2)]
    cell = shapely.box(100, 100, 140, 140)
    config = assign(preset("default"), ["device=cpu", "segment.grid=16", "segment.min_area=50"])
    seen: list[str | None] = []

    class Counting(PaintedSegmenter):
        def view(self, image: Image) -> PaintedView:
            seen.append(image.path)
            return super().view(image)

    carried = []
    for photographs, matching, carrying in (
        (0, 4, 1),
        (2, 2, 0),
    ):  # a painted view has no embedding: carry sees the right
        views = [
            PaintedView(image, [Region(shapely.affinity.translate(cell, -24 * k))]) for k, image in enumerate(images)
        ]
        matcher = Matcher(config, segmenter=Counting(views), points=Shifted(), photographs=photographs)
        first, second = (content(matcher(*images)) for _ in range(2))
        assert first == second
        assert len(first["matches"]) == 1
        assert len(seen) == matching
        seen.clear()
        square = Polygon(0, np.array(cell.exterior.coords)[:-1])
        carried += [matcher.carry(*images, [square]).outcomes[0] for _ in range(2)]
        assert len(seen) == carrying
        seen.clear()
    assert [each.status for each in carried] == ["found"] * 4
    assert all(each.shape.equals(carried[0].shape) for each in carried)


def test_a_view_that_answers_wrongly_costs_its_pair() -> None:
    rgb, seen = photograph(5, 256, 256), itertools.count()
    images = [Image(np.ascontiguousarray(np.roll(rgb, -24 * k, axis=1)), str(k)) for k in range(2)]
    cell = shapely.box(100, 100, 140, 140)
    views = [PaintedView(image, [Region(shapely.affinity.translate(cell, -24 * k))]) for k, image in enumerate(images)]
    predict = views[0].predict
    setattr(views[0], "predict", lambda *given: predict(*given) if next(seen) else None)  # noqa: B010
    config = assign(preset("default"), ["device=cpu", "segment.grid=16", "segment.min_area=50"])
    matcher = Matcher(config, segmenter=PaintedSegmenter(views), points=Shifted())
    found = list(matcher.match_many([(images[0], images[1])] * 2))
    assert [type(each) for each in found] == [SegmenterError, MatchResult]


def test_models_of_others_see_one_pair_at_a_time(views: list[Path]) -> None:
    matcher = squares()
    inside = []

    def pairs() -> Iterator[tuple[Path, Path]]:
        for k in range(3):
            inside.append(k)
            yield views[0], views[1]

    for k, _ in enumerate(matcher.match_many(pairs(), at_once=3)):
        assert inside == list(range(k + 1))


@pytest.mark.usefixtures("threads")
def test_pairs_are_taken_when_there_is_room_and_none_after_the_end(views: list[Path]) -> None:
    taken = []

    def endless() -> Iterator[tuple[Path, Path]]:
        for k in itertools.count():
            taken.append(k)
            yield views[0], views[1]

    found = squares().match_many(endless())
    assert taken == []
    next(found)
    assert taken == [0, 1]
    found.close()
    assert taken == [0, 1]


def test_progress_is_silent_among_many_and_told_again_after_them(views: list[Path]) -> None:
    told: list[str] = []
    matcher = squares(progress=lambda stage, share: told.append(stage))
    list(matcher.match_many([views[:2]]))
    assert told == []
    matcher(*views[:2])
    assert "detect" in told


@pytest.mark.usefixtures("threads")
def test_pairs_in_tiles_are_matched_too(views: list[Path]) -> None:
    tiled = Config(points=CONFIG.points, device="cpu", tiles=TilesConfig(mode="on", size=256))
    matcher = squares(tiled)
    (found,) = matcher.match_many([views[:2]])
    assert content(found) == content(matcher(*views[:2]))


def test_what_is_no_number_of_pairs_is_refused(views: list[Path]) -> None:
    for wrong in ({"at_once": 0}, {"photographs": 0}):
        with pytest.raises(ConfigError, match="at least 1"):
            squares().match_many([], **wrong)
    assert list(squares().match_many([])) == []
