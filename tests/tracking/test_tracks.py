"""Regions of a painted wall followed through photographs, with known maps between them, and their files."""

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import wall

from zpm2 import config
from zpm2 import tracks as follow
from zpm2.api import Matcher
from zpm2.errors import ConfigError
from zpm2.formats.regions.registry import open_regions
from zpm2.model import Image, ImagePolygons, Mask, Polygon
from zpm2.result import MatchResult
from zpm2.tracking import TracksResult
from zpm2.tracking.extend import Errand
from zpm2.tracking.join import Observation
from zpm2.tracking.matches import Store
from zpm2.tracking.photographs import read_photographs
from zpm2.tracking.run import _Work

CONFIG = config.assign(config.preset("default"), [*wall.SETTINGS, "tracks.neighbors=2"])


@pytest.fixture(scope="module", autouse=True)
def _matched_once() -> Iterator[None]:
    """The matcher works once on each pair, in whatever folder it lies."""
    found: dict[tuple[object, ...], object] = {}
    plain = {"__call__": Matcher.__call__, "carry": Matcher.carry}

    def once(name: str) -> Callable[..., object]:
        def call(matcher: Matcher, left: str, right: str, *regions: Sequence[Polygon]) -> object:
            key = name, left, right, *(polygon.exterior.tobytes() for each in regions for polygon in each)
            if key not in found:
                found[key] = plain[name](matcher, left, right, *regions)
            return found[key]

        return call

    with pytest.MonkeyPatch.context() as patch:
        for name in plain:
            patch.setattr(Matcher, name, once(name))
        yield


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return wall.save_photographs(tmp_path_factory.mktemp("photographs"), 3)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def found(photographs: list[Path], kept: Path) -> TracksResult:
    return follow(photographs, CONFIG, kept=kept)


def at_border(polygon: Polygon) -> bool:
    """Whether a photograph's border cuts a region."""
    x0, y0, x1, y1 = polygon.shape.bounds
    return bool(min(x0, y0) < 1 or x1 > wall.SIZE[0] - 1 or y1 > wall.SIZE[1] - 1)


def test_a_track_is_one_place_of_the_wall(found: TracksResult) -> None:
    assert found.chosen == "auto, by points"
    assert len(found.tracks) > 15
    assert found.lengths().get(3, 0) >= 8
    spread = [
        np.ptp([wall.on_wall(row, seen.polygon.center) for row, seen in track.seen.items()], axis=0).max()
        for track in found.tracks
        if not any(at_border(seen.polygon) for seen in track.seen.values())  # the centres of those move
    ]
    assert len(spread) > 15
    assert max(spread) < 4  # px
    assert len(found.warnings) == 1  # that the segmenter is a simple one: once, not for each pair


def test_ids_go_down_the_first_photograph(found: TracksResult) -> None:
    assert [track.id for track in found.tracks] == list(range(1, len(found.tracks) + 1))
    places = [(next(iter(track.seen)), track.center[1]) for track in found.tracks]
    assert places == sorted(places)


def test_the_order_of_the_photographs_does_not_matter(photographs: list[Path], kept: Path, found: TracksResult) -> None:
    again = follow([photographs[k] for k in (2, 0, 1)], CONFIG, kept=kept)
    assert json.dumps(again.to_dict()) == json.dumps(found.to_dict())
    folder = follow(photographs[0].parent, CONFIG, kept=kept)
    assert json.dumps(folder.to_dict()) == json.dumps(found.to_dict())


def test_an_interrupted_run_goes_on(
    photographs: list[Path], found: TracksResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called = []
    plain = Matcher.__call__

    def interrupted(matcher: Matcher, left: str, right: str) -> MatchResult:
        called.append((Path(left).name, Path(right).name))
        if len(called) == 2:
            raise KeyboardInterrupt
        return plain(matcher, left, right)

    monkeypatch.setattr(Matcher, "__call__", interrupted)
    with pytest.raises(KeyboardInterrupt):
        follow(photographs, CONFIG, kept=tmp_path)
    said = list[str]()
    again = follow(photographs, CONFIG, kept=tmp_path, say=said.append)
    assert json.dumps(again.to_dict()) == json.dumps(found.to_dict())
    assert called.count(("p0.png", "p1.png")) == 1
    assert any("1 finished pairs were taken from an earlier run" in line for line in said)


def test_pairs_are_kept_of_methods_that_have_a_name(photographs: list[Path], tmp_path: Path) -> None:
    class Own:
        name = "own"

        def segment(self, image: Image) -> list[Mask]:
            return []

    with pytest.raises(ConfigError, match="kept pairs cannot take a segmenter or point matcher"):
        follow(photographs, CONFIG, kept=tmp_path, segmenter=Own())
    with pytest.raises(ConfigError, match="kept pairs cannot take a segmenter or point matcher"):
        follow(photographs, CONFIG, kept=tmp_path, matcher=Matcher(CONFIG, segmenter=Own()))


def test_files(found: TracksResult, tmp_path: Path) -> None:
    out = found.save(tmp_path / "out", sheet_count=2)
    document = json.loads((out / "tracks.json").read_text())
    assert document["schema"] == "zpm2-tracks/1"
    assert len(document["tracks"]) == len(found.tracks)
    assert [each["name"] for each in document["photographs"]] == ["p0.png", "p1.png", "p2.png"]
    assert {s["how"] for track in document["tracks"] for s in track["seen"]} <= {"matched", "carried"}
    sheets = sorted((out / "sheets").iterdir())
    assert len(sheets) == 2
    assert PIL.Image.open(sheets[0]).width > 3 * 150
    with (out / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(track.seen) for track in found.tracks)
    first = found.tracks[0]
    assert (rows[0]["track"], rows[0]["photograph"]) == ("1", "p0.png")
    assert float(rows[0]["x"]) == pytest.approx(first.center[0], abs=1e-3)


def test_label_images_and_coco_have_the_ids_of_the_tracks(
    found: TracksResult, tmp_path: Path, photographs: list[Path]
) -> None:
    out = found.save(tmp_path / "out", 0)
    assert not list((out / "sheets").iterdir())
    for row, path in enumerate(photographs):
        labels = np.asarray(PIL.Image.open(out / "labels" / path.name))
        assert labels.shape == wall.SIZE[::-1]
        own = {polygon.id: polygon for polygon in found.polygons(row)}
        assert set(np.unique(labels)) - {0} <= set(own)
        assert len(np.unique(labels)) > 0.8 * len(own)  # some lie under smaller ones
    document = json.loads((out / "coco.json").read_text())
    assert {(a["track_id"], a["image_id"] - 1) for a in document["annotations"]} == {
        (track.id, row) for track in found.tracks for row in track.seen
    }
    side = ImagePolygons(*wall.SIZE, [], str(photographs[1]))
    regions = open_regions(out / "coco.json").read(side).regions
    assert {(region.id, region.label) for region in regions} == {(each.id, "region") for each in found.polygons(1)}


def test_a_second_run_replaces_its_own_files_only(found: TracksResult, tmp_path: Path) -> None:
    out = found.save(tmp_path / "out", 3)
    (out / "sheets" / "mine.txt").write_text("mine")
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file() and ".zpm2" not in path.parts}
    found.save(out, 3)
    assert {path: path.read_bytes() for path in before} == before
    found.save(out, 1)
    assert len(list((out / "sheets").glob("track_*.png"))) == 1
    assert (out / "sheets" / "mine.txt").read_text() == "mine"


def test_a_sheet_in_python(found: TracksResult) -> None:
    assert found.sheet(1).ndim == 3
    assert "TracksResult" in repr(found)


class Squares:
    """A segmenter that takes no prompts: squares of a grid."""

    name = "squares"

    def segment(self, image: Image) -> list[Mask]:
        return [Mask(x, y, np.ones((40, 40), bool)) for y in (20, 70, 120) for x in (20, 70, 120, 170)]


def test_without_prompts_nothing_is_carried(photographs: list[Path]) -> None:
    errand = Errand(0, 1, (0,), (Observation(0, 0, Polygon(0, np.array([[0, 0], [9, 0], [9, 9.0]]))),))
    found = read_photographs(photographs, CONFIG.raster)
    mute = {"progress": lambda stage, share: None, "say": lambda text: None}
    work = _Work(found, CONFIG, Squares(), None, Store(None), None, **mute)
    assert work.carried([errand]) == []
    assert work.messages == ["the segmenter takes no prompts: regions were not carried further"]
