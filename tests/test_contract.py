"""The contract: our data sets and formats keep it, and each way to break it is told with what to do."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zpm2.contract import Finding, datasets, formats, points, run, segmenters
from zpm2.contract.__main__ import main
from zpm2.contract.scenes import plane
from zpm2.errors import InputError
from zpm2.evaluate.datasets import DATASETS
from zpm2.evaluate.datasets.registry import DatasetFormat
from zpm2.evaluate.pairs import EvalPair
from zpm2.formats.registry import FORMATS, OutputFormat
from zpm2.model import Image, Mask, PointMatches


def wrong(findings: list[Finding]) -> dict[str, str]:
    return {finding.check: finding.problem for finding in findings if finding.problem is not None}


@pytest.mark.parametrize("name", DATASETS)
def test_our_data_sets(name: str) -> None:
    assert wrong(list(run(datasets.CHECKS, datasets.Folder(DATASETS.get(name))))) == {}


@pytest.mark.parametrize("name", FORMATS)
def test_our_formats(name: str) -> None:
    FORMATS.get(name).check()
    assert wrong(list(run(formats.CHECKS, FORMATS.get(name)))) == {}


class Quarters:
    """Four regions: a segmenter that keeps the contract."""

    name = "quarters"

    def segment(self, image: Image) -> list[Mask]:
        x, y = image.width // 2, image.height // 2
        sizes = [(0, 0, x, y), (x, 0, image.width - x, y), (0, y, x, image.height - y)]
        return [Mask(x0, y0, np.ones((h, w), bool)) for x0, y0, w, h in sizes if w and h]


def test_a_good_segmenter() -> None:
    assert wrong(list(run(segmenters.CHECKS, lambda image: Quarters()))) == {}


class Nameless(Quarters):
    name = ""


class Outside(Quarters):
    def segment(self, image: Image) -> list[Mask]:
        return [Mask(image.width - 1, 0, np.ones((1, 2), bool))]


class Ints(Quarters):
    def segment(self, image: Image) -> list[Mask]:
        return [dataclasses.replace(mask, bits=mask.bits.astype(np.uint8)) for mask in super().segment(image)]


class Numbered(Quarters):
    def segment(self, image: Image) -> list[Mask]:
        return [dataclasses.replace(mask, label=7) for mask in super().segment(image)]  # type: ignore[arg-type]


class OneNote(Quarters):
    notes = "slow device"


class Random(Quarters):
    count = -1

    def segment(self, image: Image) -> list[Mask]:
        Random.count += 1
        masks = super().segment(image)
        return masks[::-1] if Random.count % 3 == 0 else masks


class Writes(Quarters):
    def segment(self, image: Image) -> list[Mask]:
        image.rgb[:1] += 1
        return super().segment(image)


class Fails(Quarters):
    def segment(self, image: Image) -> list[Mask]:
        if image.width == 1:
            raise ZeroDivisionError("division\nby zero")
        return super().segment(image)


@pytest.mark.parametrize(
    ("kind", "check", "told"),
    [
        (Nameless, "has a name", "give the class name = 'word'"),
        (Outside, "finds the regions of a scene", "lies outside: 2 x 1 px at 399, 0; cut it to the image"),
        (Ints, "finds the regions of a scene", "no 2-D array of bool: use bits.astype(bool)"),
        (Numbered, "finds the regions of a scene", "is 7: give a str or None"),
        (OneNote, "keeps what else it promises", "its notes are no texts: give a list of str"),
        (Random, "gives the same bytes twice", "come in another order the second time: sort them"),
        (Writes, "leaves the image alone", "writes into the pixels"),
        (
            Fails,
            "takes images of any size and colour",
            "of 1 x 1 px raises ZeroDivisionError: division by zero; return no",
        ),
    ],
)
def test_what_is_wrong_with_a_segmenter_is_told(
    kind: type[Quarters], check: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zpm2.contract.segmenters.scene", lambda: tuple(Image(i.rgb.copy()) for i in SCENE))
    made = kind()
    found = wrong(list(run(segmenters.CHECKS, lambda image: made)))
    assert told in found[check]


SCENE = segmenters.scene()


class Sift:
    """SIFT, to be spoilt."""

    name = "sift"

    def __init__(self) -> None:
        from zpm2.config import PointsConfig
        from zpm2.features import create

        self.matcher = create(PointsConfig(methods=("sift",), max_keypoints=400))

    def match(self, left: Image, right: Image) -> PointMatches:
        return self.matcher.match(left, right)

    def match_many(self, pairs: Any) -> list[PointMatches]:
        return [self.match(*pair) for pair in pairs]


class CentresAtZero(Sift):
    def match(self, left: Image, right: Image) -> PointMatches:
        found = super().match(left, right)
        return PointMatches(np.maximum(found.left - 0.5, 0), np.maximum(found.right - 0.5, 0), found.score)


class RowsFirst(Sift):
    def match(self, left: Image, right: Image) -> PointMatches:
        found = super().match(left, right)
        return PointMatches(found.left[:, ::-1], found.right[:, ::-1], found.score)


class Single(Sift):
    def match(self, left: Image, right: Image) -> PointMatches:
        found = super().match(left, right)
        return PointMatches(found.left.astype(np.float32), found.right, found.score)  # type: ignore[arg-type]


class Percent(Sift):
    def match(self, left: Image, right: Image) -> PointMatches:
        found = super().match(left, right)
        return PointMatches(found.left, found.right, found.score * 100)


class Lazy(Sift):
    def match_many(self, pairs: Any) -> list[PointMatches]:
        return [self.match(*pairs[0])]


@pytest.mark.parametrize(
    ("kind", "check", "told"),
    [
        (CentresAtZero, "has pixel centres at +0.5", "points are off by 0."),
        (RowsFirst, "finds what is there", "lie outside of an image of 320 x 256 px: x first"),
        (Single, "finds what is there", "left points are no (n, 2) array of float64"),
        (Percent, "finds what is there", "scores are not from 0 to 1"),
        (Lazy, "matches many pairs", "match_many gives 1 results for 3 pairs"),
    ],
)
def test_what_is_wrong_with_a_point_matcher_is_told(kind: type[Sift], check: str, told: str) -> None:
    made = kind()
    assert told in wrong(list(run({check: points.CHECKS[check]}, lambda side: made)))[check]
    assert plane()[0].width == 320


@pytest.mark.parametrize(
    ("load", "check", "told"),
    [
        (lambda root: iter(()), "takes a root and a split", "has 1 positional parameters"),
        (lambda root, split: iter(()), "says what it looked for in an empty folder", "no pairs and no error"),
        (
            lambda root, split: (root / "list").read_text(),
            "says what it looked for in an empty folder",
            "FileNotFoundError",
        ),
    ],
)
def test_what_is_wrong_with_a_data_set_is_told(load: Callable[..., Any], check: str, told: str) -> None:
    found = run(datasets.CHECKS, datasets.Folder(DatasetFormat("mine", load, "none", None)))
    assert told in wrong(list(found))[check]


def test_pairs_that_are_not_whole_are_told(tmp_path: Path) -> None:
    names = ["one", "one", "../two"]

    def load(root: Path, split: str | None) -> Any:
        if not (root / "left.png").is_file():
            raise InputError(f"{root / 'left.png'} is not there")
        return (EvalPair(name, root / "left.png", root / "right.png") for name in names)

    folder = datasets.Folder(DatasetFormat("mine", load, "none", None), tmp_path)
    (tmp_path / "left.png").touch()
    checks = {**datasets.CHECKS, **datasets.WITH_FILES}
    assert "two pairs have one name" in wrong(list(run(checks, folder)))["gives whole pairs"]
    names[1] = "three"
    assert "right.png is no file" in wrong(list(run(checks, folder)))["gives whole pairs"]
    (tmp_path / "right.png").touch()
    assert "pair '../two' has a name that is no path" in wrong(list(run(checks, folder)))["gives whole pairs"]
    names.reverse()
    names[0] = "two"
    assert wrong(list(run(checks, folder))) == {}


def test_what_is_wrong_with_a_format_is_told() -> None:
    written: list[Path] = []

    def write(result: Any, folder: Path) -> None:
        written.append(folder)
        (folder / "a.txt").write_text(str(len(written)))
        (folder / "b.txt").touch()

    found = wrong(list(run(formats.CHECKS, OutputFormat("mine", ("a.txt", "x/c.txt"), write))))
    assert "files holds paths" in found["names its files"]
    assert "it writes b.txt, which its files do not name" in found["writes what it says"]
    assert set(found) == {"names its files", "writes what it says", "gives the same bytes twice"}


def test_the_command(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["geojson"]) == 0
    assert capsys.readouterr().out.splitlines()[::5] == ["geojson: format, built in", "all is well"]
    (tmp_path / "spoilt_zpm2.py").write_text(
        "class Spoilt:\n    name = 'spoilt'\n    def segment(self, image):\n        return None\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["spoilt_zpm2:Spoilt"]) == 1
    out = capsys.readouterr().out
    assert "  WRONG  finds the regions of a scene\n         segment returns a NoneType: return a list" in out
    assert "of the checks failed" in out
    for words, why in (
        (["sfit"], "unknown model, data set or format 'sfit' (did you mean 'sift'?)"),
        (["spoilt_zpm2:Spolit"], "plug-in 'spoilt_zpm2:Spolit' cannot be loaded: AttributeError"),
        (["json:dumps"], "json:dumps is no plug-in: give a class"),
        (["eth3d", "--root", str(tmp_path / "no")], "no is no folder"),
        (["sift", "--set", "points.options.x=3"], "unknown option 'points.options.x'; sift takes: no options"),
    ):
        assert main(words) == 2
        assert why in capsys.readouterr().err
