"""Shared options: completion reads the package's registries, help and checks agree with them."""

from collections.abc import Callable, Iterable

import pytest
import typer
from rendered import Run

from zpm2.cli import app, options
from zpm2.cli.options import one_of


def result_formats() -> Iterable[str]:
    from zpm2.evaluate.results.registry import RESULTS

    return RESULTS.names()


REGISTRIES: dict[str, Callable[[], Iterable[str]]] = {
    "match --format": options.known_formats,
    "match --segmenter": options.segmenters,
    "match --quality": options.choices("segment.quality"),
    "match --tiles": options.choices("tiles.mode"),
    "match --method": options.methods,
    "match --preset": options.presets,
    "match --device": options.devices,
    "pose --estimator": options.choices("pose.estimator"),
    "eval --results": result_formats,
}


def test_the_last_of_a_list_is_completed() -> None:
    complete = one_of(lambda: ("sift", "xfeat"))
    assert complete("") == ["sift", "xfeat"]
    assert complete("x") == ["xfeat"]
    assert complete("sift,") == ["sift,sift", "sift,xfeat"]


def test_settings_are_completed() -> None:
    assert "segment.grid=" in options.settings_of("segment.")
    assert "tiles.mode=off" in options.settings_of("tiles.mode=")
    assert options.settings_of("segment.model=vit") == [f"segment.model=vit_{size}" for size in "blh"]
    assert "points.methods=sift,xfeat" in options.settings_of("points.methods=sift,")
    assert options.settings_of("segment.options.side=") == []


def test_what_is_completed_is_what_the_package_takes() -> None:
    from zpm2 import api, config, features
    from zpm2.evaluate.datasets import DATASETS
    from zpm2.formats import registry
    from zpm2.segment.registry import SEGMENTERS

    assert {"mobile_sam", "vit_b", "vit_l", "vit_h", "sam2_tiny", "classical"} <= set(SEGMENTERS)
    assert tuple(options.methods()) == api.METHODS == ("zpm2", "shape-context", "idsc", "vote", "masa", "sgam", "mesa")
    assert tuple(options.segmenters()) == (*SEGMENTERS, "precomputed") == api.segmenters()
    assert tuple(options.point_matchers()) == tuple(features.METHODS)
    assert tuple(options.known_formats()) == tuple(registry.names())
    assert tuple(options.datasets()) == tuple(DATASETS)
    assert tuple(options.presets()) == tuple(config.PRESETS)


@pytest.mark.parametrize("option", REGISTRIES)
def test_the_help_names_all_there_is(option: str) -> None:
    name, flag = option.split()
    command = typer.main.get_command(app.app).commands[name]  # type: ignore[attr-defined]
    (parameter,) = (parameter for parameter in command.params if flag in parameter.opts)
    for value in REGISTRIES[option]():
        assert value in parameter.help or "zpm2 models" in parameter.help  # a long list has a command of its own


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("cloud", "ws", "--spacing", "nan"), "--spacing nan: give a distance above 0"),
        (("cloud", "ws", "--disparity-scale", "-1"), "--disparity-scale -1.0: give a number above 0"),
        (("pose", "a.png", "b.png", "--baseline", "inf"), "--baseline inf: give a length above 0"),
        (("reconstruct", "x", "--max-size", "99"), "reconstruct.max_size must be at least 100 px, got 99"),
        (("reconstruct", "x", "--neighbors", "0"), "reconstruct.neighbors must be at least 1, got 0"),
    ],
)
def test_numbers_out_of_range(run: Run, words: tuple[str, ...], why: str) -> None:
    assert run(*words) == (2, "", f"zpm2: {why}\n")


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("match", "a.png", "b.png", "--mask-regions", "keep"), "--mask-regions needs --masks"),
        (("export", "x", "--to", "stac", "--matched"), "--matched is of --to colmap and hloc: leave it out"),
        (("export", "x", "--to", "stac", "--images", "y"), "--images is of --to colmap and hloc: leave it out"),
    ],
)
def test_options_that_do_not_apply(run: Run, words: tuple[str, ...], why: str) -> None:
    assert run(*words) == (2, "", f"zpm2: {why}\n")


@pytest.mark.parametrize("group", [(), ("config",), ("weights",)])
def test_descriptions_of_commands_are_not_cut_off(run: Run, group: tuple[str, ...]) -> None:
    listed = run(*group, "--help").out.partition("Commands:")[2]
    assert listed
    assert "..." not in listed
