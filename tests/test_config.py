import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import (
    PRESETS,
    Config,
    DetailConfig,
    GuidedConfig,
    PointsConfig,
    RasterConfig,
    SegmentConfig,
    TilesConfig,
    as_config,
    assign,
    describe,
    load,
    preset,
    recorded,
    with_options,
)
from zpm2.config.fields import rule_of
from zpm2.config.whole import _fields
from zpm2.errors import ConfigError


def refused(setting):
    with pytest.raises(ConfigError) as caught:
        assign(Config(), [setting])
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_survive_json(name):
    config = preset(name)
    assert Config.from_dict(json.loads(json.dumps(config.to_dict()))) == config


def test_paper_is_the_paper():
    """The values of the paper's Experimental environment (4.1.3)."""
    config = preset("paper")
    assert (config.global_match.factor, config.global_match.top_size) == (3, 200)
    assert (config.global_match.phi, 2 * config.global_match.tau) == (15, 50)
    assert config.local_match.shape == "graph"


def test_an_unknown_preset_names_those_there_are():
    with pytest.raises(
        ConfigError, match=r"unknown preset 'papre' \(did you mean 'paper'\?\); presets are: paper, default"
    ):
        preset("papre")


def test_values_lie_over_the_base_and_leave_the_rest():
    base = Config(segment=SegmentConfig(grid=16, nms_iou=0.5), seed=4)
    config = Config.from_dict({"segment": {"grid": 8}, "device": "cpu"}, base)
    assert (config.segment.grid, config.segment.nms_iou, config.seed, config.device) == (8, 0.5, 4, "cpu")
    assert base.segment.grid == 16
    assert Config.from_dict({}, base) == base


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("segment.grid=16", 16),
        ("raster.bands=-", ()),
        (" segment.grid = 16 ", 16),
        ("segment.nms_iou=0.25", 0.25),
        ("segment.min_area=1e3", 1000.0),
        ("segment.min_area=7", 7.0),
        ("segment.model=vit_b", "vit_b"),
        ("points.methods=sift", ("sift",)),
        ("points.methods=sift, xfeat-dense", ("sift", "xfeat-dense")),
        ("seed=9", 9),
        ("device=cpu", "cpu"),
    ],
)
def test_set(setting, value):
    found = assign(Config(), [setting])
    for name in setting.partition("=")[0].strip().split("."):
        found = getattr(found, name)
    assert found == value
    assert type(found) is type(value)


def test_the_last_setting_wins_and_none_is_lost():
    config = assign(Config(), ["segment.grid=16", "seed=1", "segment.grid=8"])
    assert (config.segment.grid, config.seed) == (8, 1)
    assert assign(Config(), []) == Config()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("segment.grid", "expected stage.field=value"),
        ("segment.gird=4", "unknown option 'segment.gird' (did you mean 'grid'?)"),
        ("segmnt.grid=4", "unknown option 'segmnt' (did you mean 'segment'?)"),
        ("xyz=4", "unknown option 'xyz'; known here: segment"),
        ("=4", "unknown option ''"),
        ("segment=4", "option 'segment' is a stage; set one of its fields: model"),
        ("segment.grid.x=4", "segment.grid must be of type int"),
        ("segment.grid=many", "segment.grid must be of type int, got 'many'"),
        ("segment.grid=4.5", "segment.grid must be of type int"),
        ("segment.nms_iou=", "segment.nms_iou must be of type float"),
        ("segment.model=", "segment.model is empty"),
        ("segment.options=3", "segment.options holds options by name; set one of them: segment.options.NAME=VALUE"),
        ("segment.options.a.b=3", "segment.options.a must be a number, a word, true or false, got '{'b': '3'}'"),
        ("points.options.a-b=3", "points.options.a-b is not the name of an option"),
        ("local_match.assign=best", "local_match.assign must be one of optimal, greedy"),
        ("segment.grid=0", "segment.grid must be at least 1"),
        ("segment.grid=-3", "segment.grid must be a finite number >= 0"),
        ("segment.min_area=nan", "segment.min_area must be a finite number >= 0"),
        ("vectorize.tolerance=inf", "vectorize.tolerance must be a finite number >= 0"),
        ("vectorize.tolerance=-1", "vectorize.tolerance must be a finite number >= 0"),
        ("global_match.phi=14", "global_match.phi must be odd and at least 3 px, got 14"),
        ("global_match.phi=1", "global_match.phi must be odd and at least 3 px, got 1"),
        ("global_match.factor=1", "global_match.factor must be at least 2"),
        ("global_match.top_size=0", "global_match.top_size must be at least 1"),
        ("points.methods=", "points.methods is empty"),
        ("global_match.tau=0", "global_match.tau must be at least 1"),
        ("local_match.patch=3", "local_match.patch must be at least 4 px"),
        ("pose.crop_size=0", "pose.crop_size must be at least 32 px"),
        ("pose.noise_px=0", "pose.noise_px must be above 0"),
        ("pose.max_crops=0", "pose.max_crops must be at least 1"),
        ("local_match.neighbors=0", "local_match.neighbors must be at least 1"),
        ("points.max_keypoints=0", "points.max_keypoints must be at least 1"),
        ("segment.grid=9999999999", "segment.grid must be at most 1000, got 9999999999"),
        ("seed=4294967296", "seed must be at most 2147483647, got 4294967296"),
        ("seed=" + "9" * 5000, "seed must be of type int, got '9999"),
        ("segment.stability_offset=1e300", "segment.stability_offset must be at most 2147483647, got 1e+300"),
    ],
)
def test_what_set_refuses(setting, message):
    assert message in refused(setting)


@pytest.mark.parametrize(
    "values",
    [
        5,
        {"segment": 5},
        {"segment": {"grid": None}},
        {"segment": {"grid": 4.5}},
        {"segment": {"grid": "x"}},
        {"segment": {"model": ["vit_b"]}},
        {"points": {"methods": 5}},
        {"points": {"methods": [5]}},
        {"points": {"methods": []}},
        {"device": 0},
        {"segment": {"min_area": 10**400}},
        {"seed": 10**5000},
    ],
)
def test_values_of_wrong_type(values):
    with pytest.raises(ConfigError):
        Config.from_dict(values)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"guided": GuidedConfig(direction="bothways")},
            "guided.direction must be one of off, forward, both, got 'both",
        ),
        ({"segment": SegmentConfig(quality="ful")}, "segment.quality must be one of fast, balanced, full, got 'ful'"),
        ({"segment": SegmentConfig(detail=DetailConfig(level="hihg"))}, "segment.detail.level must be one of"),
        ({"tiles": TilesConfig(mode="yes")}, "tiles.mode must be one of off, on, auto, got 'yes'"),
        ({"segment": SegmentConfig(grid=8.5)}, "segment.grid must be of type int, got '8.5'"),
        ({"segment": SegmentConfig(min_area="100")}, "segment.min_area must be of type float, got '100' of type str"),
        ({"segment": SegmentConfig(model=None)}, "segment.model must be of type str, got 'None'"),
        ({"segment": None}, "segment must be of type SegmentConfig, got 'None'"),
        ({"segment": TilesConfig()}, "segment must be of type SegmentConfig, got 'TilesConfig"),
        ({"points": PointsConfig(methods="sift")}, "points.methods must be of type tuple, got 'sift' of type str"),
        ({"points": PointsConfig(methods=("sift", 5))}, "points.methods must be of type str, got '5'"),
        ({"points": PointsConfig(options=3)}, "points.options holds options by name"),
        ({"raster": RasterConfig(gsd=[-1.0])}, "raster.gsd must be a finite number >= 0"),
        ({"seed": 1.5}, "seed must be of type int, got '1.5'"),
        ({"seed": True}, "seed must be of type int, got 'True'"),
        ({"seed": np.int64(3)}, "seed must be of type int, got '3' of type int64"),
    ],
)
def test_words_and_types_in_python(fields, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        Config(**fields)


def test_floats_may_be_whole_and_tuples_lists():
    config = Config(segment=SegmentConfig(min_area=100), raster=RasterConfig(gsd=[1, 0.5]))
    assert (config.segment.min_area, config.raster.gsd) == (100, [1, 0.5])


def test_values_of_numpy_are_those_of_python():
    given = {"seed": np.int64(3), "gsd": np.float32(0.5), "bands": np.array([3, 2, 1]), "quality": np.str_("full")}
    config = with_options(Config(), given)
    assert config == Config(
        segment=SegmentConfig(quality="full"), raster=RasterConfig(bands=(3, 2, 1), gsd=(0.5,)), seed=3
    )
    assert type(config.seed) is int
    assert Config.from_dict({"segment": {"options": {"a": np.int64(3)}}}).segment.options == {"a": 3}
    with pytest.raises(ConfigError, match=r"seed must be of type int, got '3\.5'"):
        with_options(Config(), {"seed": np.float64(3.5)})
    with pytest.raises(ConfigError, match=r"segment.quality must be one of .*, got '\['full', 'fast'\]'"):
        with_options(Config(), {"quality": np.array(["full", "fast"])})


@pytest.mark.parametrize("value", [None, {}, 3])
def test_what_is_no_configuration(value):
    with pytest.raises(ConfigError, match=f"got {type(value).__name__}: make one with zpm2.config.load"):
        as_config(value)


def test_whole_floats_are_whole_numbers():
    grid = Config.from_dict({"segment": {"grid": 16.0}}).segment.grid
    assert grid == 16
    assert isinstance(grid, int)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.toml", 'seed = 3\n[segment]\ngrid = 16\n[points]\nmethods = ["sift", "xfeat"]\n'),
        ("a.json", '{"seed": 3, "segment": {"grid": 16}, "points": {"methods": ["sift", "xfeat"]}}'),
        ("a.JSON", '{"seed": 3, "segment": {"grid": 16}, "points": {"methods": "sift,xfeat"}}'),
    ],
)
def test_files(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    config = load(tmp_path / name, Config(device="cpu"))
    assert (config.seed, config.segment.grid, config.points.methods) == (3, 16, ("sift", "xfeat"))
    assert config.device == "cpu"
    assert load(str(tmp_path / name)).device == "auto"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.toml", b"seed = \n = 3", "is not valid toml"),
        ("a.json", b"{", "is not valid json"),
        ("a.json", b"[1]", "must hold a table of stages, got list"),
        ("a.toml", b"\xff\xfe", "is not valid toml"),
        ("a.toml", b"sede = 3", r"unknown option 'sede' \(did you mean 'seed'\?\)"),
        ("a.toml", b"[segment]\nmodel = 3", "segment.model must be of type str, got '3'"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        load(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_files_that_are_not_there(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(ConfigError, match="cannot read configuration"):
            load(path)


def test_a_configuration_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Config().seed = 4


@given(st.integers(1, 1000), st.floats(0, 1e6), st.integers(1, 31))
def test_every_number_survives_set_and_dict(grid, tolerance, half):
    settings = [f"segment.grid={grid}", f"vectorize.tolerance={tolerance!r}", f"global_match.phi={2 * half + 1}"]
    config = assign(Config(), settings)
    assert (config.segment.grid, config.vectorize.tolerance, config.global_match.phi) == (grid, tolerance, 2 * half + 1)
    assert Config.from_dict(config.to_dict()) == config


def test_configuration_and_errors_import_no_torch():
    code = "import sys, zpm2.config, zpm2.errors, zpm2.model; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("field", [name for name, kind, *_ in describe(Config()) if kind in ("int", "float")])
def test_every_number_has_an_upper_end(field):
    assert f"{field} must be at most" in refused(f"{field}=2147483649") or "share" in refused(f"{field}=2147483649")
    assert field in refused(f"{field}={10**30}")


@pytest.mark.parametrize(("name", "text"), [("a.json", "[" * 100_000), ("a.toml", "a = " + "[" * 100_000)])
def test_a_file_that_is_nested_too_deeply(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=name):
        load(tmp_path / name)


def test_a_stage_within_a_stage():
    config = assign(Config(), ["local_match.outline.epipolar=3", "segment.prompts.blob_sigmas=1,2.5"])
    assert config.local_match.outline.epipolar == 3.0
    assert config.segment.prompts.blob_sigmas == (1.0, 2.5)
    assert Config.from_dict(json.loads(json.dumps(config.to_dict()))) == config
    assert "segment.prompts.blob_sigmas are one or more numbers above 0, got 0" in refused(
        "segment.prompts.blob_sigmas=0"
    )
    assert "did you mean 'outline'" in refused("local_match.outlin.epipolar=3")
    assert "is a share from 0 to 1" in refused("guided.min_return_overlap=1.5")


def test_the_configuration_that_a_result_holds():
    config = assign(preset("default"), ["segment.min_area=7", "local_match.exclusive.min_kept=0.5"])
    assert recorded(config.to_dict()) == config
    older = config.to_dict() | {"baseline": {"method": "x"}, "cloud": 5}
    del older["local_match"]["outline"]
    older["local_match"]["gamma"] = "many"
    found = recorded(older)
    assert found.segment == config.segment
    assert found.local_match.exclusive == config.local_match.exclusive
    assert (found.local_match.outline, found.local_match.gamma) == (
        Config().local_match.outline,
        Config().local_match.gamma,
    )
    assert recorded({}) == Config()


def test_no_source_is_an_empty_word():
    sources = [rule_of(item).source for _, item, _ in _fields(Config())]
    assert not {"chosen", "default", "ours", "the same", "empirical"} & set(sources)


def test_photographs_of_a_result_of_another_version_are_read_as_far_as_its_configuration_says():
    stored = {"raster": {"bands": [4, 3, 2], "gsd": "unknown", "sharpen": 2, "stretch": {"fill_share": 7}}}
    assert recorded(stored).raster == RasterConfig(bands=(4, 3, 2))
    assert recorded({"raster": "none"}).raster == RasterConfig()
