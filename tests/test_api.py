"""`zpm2.match`: the command line's options from Python."""

import inspect
from pathlib import Path
from typing import Any

import pytest
from rendered import Pair

import zpm2
from zpm2.cli.match import match as match_command
from zpm2.config import OPTIONS
from zpm2.errors import ConfigError

COMMAND_ONLY = {"out", "formats", "config_file", "settings", "weights_dir", "allowed", "quiet", "as_json"}
COMMAND_ONLY |= {"masks", "mask_regions", "page"}  # files: formats.masks.write_masks, MatchResult.report
COMMAND_ONLY |= {"engine", "gpus", "address"}  # parts of what Python gives as `workers`
PYTHON_ONLY = {"config", "kept", "progress", "say"}


def regions(pair: Pair) -> dict[str, Any]:
    return {"left_regions": pair.left_regions, "right_regions": str(pair.right_regions)}


def test_match_takes_every_option_of_the_command() -> None:
    ours, theirs = (set(inspect.signature(f).parameters) for f in (zpm2.match, match_command))
    assert ours - PYTHON_ONLY == theirs - COMMAND_ONLY
    assert set(OPTIONS) - {"estimator"} <= ours


def test_options_reach_the_configuration(pair: Pair) -> None:
    result = zpm2.match(
        str(pair.left),
        pair.right,
        preset="paper",
        points=["sift"],
        gsd=0.5,
        min_area_m2=20,
        seed=4,
        device="cpu",
        outlines=True,
        non_overlapping=True,
        **regions(pair),
    )
    config = result.config
    assert (config["guided"]["direction"], config["points"]["methods"]) == ("off", ("sift",))
    assert (config["raster"]["gsd"], config["raster"]["min_area_m2"], config["seed"]) == ((0.5,), 20.0, 4)
    assert result.non_overlapping
    assert all(len(match.outline) for match in result.matches)
    assert len(result.matches) > 20


def test_a_configuration_or_a_preset_may_stand_in_the_place_of_preset(pair: Pair) -> None:
    own = zpm2.config.assign(zpm2.preset("paper"), ["points.methods=sift", "local_match.iota=4"])
    assert zpm2.match(pair.left, pair.right, own, **regions(pair)).config["local_match"]["iota"] == 4
    found = zpm2.match(pair.left, pair.right, "paper", points="sift", **regions(pair))
    assert found.config["local_match"]["shape"] == "graph"


def test_a_classical_baseline_by_its_name(pair: Pair) -> None:
    found = zpm2.match(pair.left, pair.right, method="shape-context", device="cpu", **regions(pair))
    assert found.config["baseline"]["method"] == "shape-context"


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"quality": "best"}, "segment.quality must be one of"),
        ({"preset": "papr"}, "did you mean 'paper'"),
        ({"method": "sift"}, "methods are"),
        ({"segmenter": "precomputed"}, "--left-regions"),
        ({"segmenter": "vit_x"}, "segmenters are: .*mobile_sam, .*, precomputed"),
        ({"bands": (1, 2)}, "one or three band numbers"),
        ({"bands": 1.5}, "must be of type int"),
        ({"segmenter": object()}, r"segmenter is a name, got object: give an object to zpm2.Matcher"),
        ({"method": None}, "unknown method 'None'; methods are"),
        ({"preset": None}, "config is a zpm2.Config or the name of a preset, got NoneType"),
    ],
)
def test_misuse_is_named(pair: Pair, options: dict[str, Any], word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        zpm2.match(pair.left, pair.right, **options)


def test_a_matcher_keeps_no_negative_number_of_photographs() -> None:
    with pytest.raises(ConfigError, match="photographs to keep must be at least 0, got -1"):
        zpm2.Matcher("paper", photographs=-1)


def test_unknown_options_are_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean 'quality'"):
        zpm2.config.with_options(zpm2.Config(), {"qualty": "full"})
    assert zpm2.config.with_options(zpm2.Config(), {"bands": "3,2,1"}).raster.bands == (3, 2, 1)
    assert zpm2.config.with_options(zpm2.Config(), {"bands": 2, "quality": None}).raster.bands == (2,)
    assert Path(inspect.getfile(zpm2.match)).name == "api.py"


@pytest.mark.parametrize("name", ["PolygonMatcher", "TiledMatcher"])
def test_earlier_names_still_work_and_warn(name: str) -> None:
    with pytest.warns(DeprecationWarning, match=f"{name} is now called zpm2.Matcher") as said:
        assert getattr(zpm2, name) is zpm2.Matcher
    assert Path(said[0].filename).name == "test_api.py"
    assert name not in zpm2.__all__


def test_progress_and_finished_tiles_are_told(pair: Pair, tmp_path: Path) -> None:
    told: set[str] = set()
    options = {"points": "sift", "device": "cpu", "progress": lambda stage, share: told.add(stage), **regions(pair)}
    assert len(zpm2.match(pair.left, pair.right, kept=tmp_path, **options).matches) > 20
    assert {"points", "detect", "local"} <= told
