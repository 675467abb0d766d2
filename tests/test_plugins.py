"""Parts of other packages: installed ones, modules, dotted paths; what is broken breaks nothing else."""

import importlib
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rendered import Pair, Run

import zpm2
from zpm2.config import Config, PointsConfig, SegmentConfig, assign
from zpm2.errors import ConfigError, PluginWarning
from zpm2.features import create as create_points
from zpm2.model import Image
from zpm2.pipeline import plugin_code
from zpm2.plugins import ModelInfo, Models
from zpm2.segment.registry import SEGMENTERS, create, segmenter

BLOCKS = """
import numpy as np

from zpm2.config import SegmentConfig
from zpm2.model import Mask


class Blocks:
    name = "blocks"

    def __init__(self, config: SegmentConfig, *, side: int = 64) -> None:
        self.side, self.smallest = int(side), config.min_area

    def segment(self, image):
        starts = [(x, y) for y in range(0, image.height, self.side) for x in range(0, image.width, self.side)]
        sizes = [(min(self.side, image.width - x) - 1, min(self.side, image.height - y) - 1) for x, y in starts]
        return [Mask(x, y, np.ones((h, w), bool)) for (x, y), (w, h) in zip(starts, sizes) if w > 0 and h > 0]


class Needs(Blocks):
    def __init__(self, side):
        raise RuntimeError("no\\nway")
"""

Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Puts a package with entry points into a folder on the path, as an installer would."""
    before = set(sys.modules)

    def write(name: str, source: str, group: str = "zpm2.segmenters", **offers: str) -> Path:
        folder = tmp_path / "site"
        info = folder / f"{name}-1.5.dist-info"
        info.mkdir(parents=True)
        (folder / f"{name}.py").write_text(source)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.5\n")
        lines = "\n".join(f"{key} = {value}" for key, value in offers.items())
        (info / "entry_points.txt").write_text(f"[{group}]\n{lines}\n")
        monkeypatch.syspath_prepend(folder)
        importlib.invalidate_caches()
        return folder

    yield write
    for module in set(sys.modules) - before:
        if (getattr(sys.modules[module], "__file__", None) or "").startswith(str(tmp_path)):
            del sys.modules[module]


@pytest.fixture
def segmenters(monkeypatch: pytest.MonkeyPatch) -> Models:
    """The segmenters, with what is installed not looked at yet; what a test adds is forgotten after it."""
    SEGMENTERS.names()
    monkeypatch.setattr(SEGMENTERS, "_parts", dict(SEGMENTERS._parts))
    monkeypatch.setattr(SEGMENTERS, "_at_paths", {})
    monkeypatch.setattr(SEGMENTERS, "_warned", set())
    monkeypatch.setattr(SEGMENTERS, "_known_offers", None)
    return SEGMENTERS


@pytest.fixture
def image() -> Image:
    return Image(np.zeros((100, 200, 3), np.uint8))


def test_an_installed_package_is_one_of_them(install: Install, segmenters: Models, image: Image) -> None:
    install("blocks_zpm2", BLOCKS, blocks="blocks_zpm2:Blocks")
    assert list(segmenters)[-1] == "blocks"
    assert "blocks_zpm2" not in sys.modules
    assert segmenters.origin("blocks") == "package blocks_zpm2 1.5"
    assert segmenters.origin("vit_b") == "built in"
    assert len(create(SegmentConfig(model="blocks")).segment(image)) == 8
    assert len(create(SegmentConfig(model="blocks", options={"side": 50})).segment(image)) == 8
    with pytest.raises(ConfigError, match=r"unknown segmenter 'blokcs' \(did you mean 'blocks'\?\); segmenters are: "):
        create(SegmentConfig(model="blokcs"))


def test_a_dotted_path_needs_no_registration(install: Install, segmenters: Models, image: Image) -> None:
    install("paths_zpm2", BLOCKS)
    path = "paths_zpm2:Blocks"
    assert segmenters.origin(path) == "dotted path"
    assert len(create(SegmentConfig(model=path)).segment(image)) == 8
    assert path not in list(segmenters)
    assert segmenters.get("zpm2.segment.methods.sam:sam").name == "mobile_sam"
    with pytest.raises(ConfigError, match=r"SAM has no model .*:sam'; models are: mobile_sam"):
        create(SegmentConfig(model="zpm2.segment.methods.sam:sam"))


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("nowhere_zpm2:Blocks", "ModuleNotFoundError: No module named 'nowhere_zpm2'; give package.module:Class"),
        ("paths_zpm2:Blokcs", "module 'paths_zpm2' has no attribute 'Blokcs'"),
        ("paths_zpm2:", "give package.module:Class"),
        (":Blocks", "give package.module:Class"),
        ("paths_zpm2:np.pi", "is a float: give a class, or a function"),
    ],
)
def test_a_path_that_leads_nowhere(install: Install, segmenters: Models, path: str, why: str) -> None:
    install("paths_zpm2", BLOCKS)
    with pytest.raises(ConfigError, match="segmenter '") as caught:
        create(SegmentConfig(model=path))
    assert why in str(caught.value)


def test_options(install: Install, segmenters: Models) -> None:
    install("options_zpm2", BLOCKS)
    config = assign(Config(), ["segment.model=options_zpm2:Blocks", "segment.options.side=25"])
    assert config.segment.options == {"side": 25}
    assert Config.from_dict(config.to_dict()) == config
    assert hash(config) is not None
    with pytest.raises(
        ConfigError, match=r"option 'segment.options.sied' \(did you mean 'side'\?\); options_zpm2:Blocks takes"
    ):
        create(SegmentConfig(model="options_zpm2:Blocks", options={"sied": 3}))
    with pytest.raises(ConfigError, match=r"unknown option 'segment.options.side'; vit_b takes: no options"):
        create(SegmentConfig(model="vit_b", options={"side": 3}))
    with pytest.raises(ConfigError, match=r"unknown option 'points.options.side'; sift and xfeat take: no options"):
        create_points(PointsConfig(methods=("sift", "xfeat"), options={"side": 3}))
    with pytest.raises(ConfigError, match=r"needs a value of its option side: --set segment.options.side=VALUE"):
        create(SegmentConfig(model="options_zpm2:Needs"))
    with pytest.raises(
        ConfigError, match=r"'options_zpm2:Needs' \(dotted path\) cannot be built: RuntimeError: no way$"
    ):
        create(SegmentConfig(model="options_zpm2:Needs", options={"side": 3}))


def test_a_broken_package_breaks_nothing_else(install: Install, segmenters: Models) -> None:
    install("broken_zpm2", "import no_such_module", broken="broken_zpm2:Broken")
    install("whole_zpm2", BLOCKS, whole="whole_zpm2:Blocks")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert {"broken", "whole"} < set(segmenters.names())
        assert segmenters.get("whole").name == "whole"
    with pytest.warns(PluginWarning) as told:
        usable = dict([*segmenters.items(), *segmenters.items()])
    assert "whole" in usable
    assert "broken" not in usable
    (line,) = (str(warning.message) for warning in told)
    assert line.startswith(
        "segmenter 'broken' of package broken_zpm2 1.5 cannot be loaded: ModuleNotFoundError: No mod"
    )
    with pytest.raises(ConfigError, match=r"of package broken_zpm2 1\.5 cannot be loaded: ModuleNotFoundError"):
        segmenters.get("broken")


def test_a_name_is_taken_once(install: Install, segmenters: Models) -> None:
    install("one_zpm2", BLOCKS, vit_b="one_zpm2:Blocks", both="one_zpm2:Blocks")
    install("two_zpm2", BLOCKS, both="two_zpm2:Blocks")
    with pytest.warns(
        PluginWarning, match="segmenter 'vit_b' of package one_zpm2 1.5 is left out, the name is built in"
    ):
        assert "both" in segmenters.names()
    assert segmenters.origin("vit_b") == "built in"
    with pytest.raises(
        ConfigError,
        match=r"'both': package one_zpm2 1.5 \(one_zpm2:Blocks\) and package two_zpm2 1.5 \(two_zpm2:Blocks\)",
    ):
        segmenters.get("both")
    with pytest.raises(
        ValueError, match="two segmenters have the name 'vit_b': one is built in, the other is of the mod"
    ):
        segmenter("vit_b")(dict)


def test_what_registers_itself_keeps_its_facts(install: Install, segmenters: Models) -> None:
    source = "from zpm2.plugins import ModelInfo\nfrom zpm2.segment.registry import segmenter\n"
    source += BLOCKS.replace("class Blocks", "@segmenter('facts', ModelInfo(task='blocks'))\nclass Blocks")
    install("facts_zpm2", source, facts="facts_zpm2:Blocks")
    assert segmenters.get("facts").info == ModelInfo(task="blocks")
    assert segmenters.origin("facts") == "package facts_zpm2 1.5"
    assert segmenters.get("facts_zpm2:Blocks") is segmenters.get("facts")


def test_changed_code_is_another_key(install: Install, segmenters: Models) -> None:
    folder = install("keys_zpm2", BLOCKS)
    config = assign(Config(), ["segment.model=keys_zpm2:Blocks"])
    first = plugin_code(config)
    assert first == plugin_code(config) != []
    (folder / "keys_zpm2.py").write_text(BLOCKS + "# changed\n")
    assert plugin_code(config) != first
    assert plugin_code(Config()) == []


def test_one_call_and_one_command(install: Install, segmenters: Models, pair: Pair, run: Run, tmp_path: Path) -> None:
    folder = install("called_zpm2", BLOCKS, called="called_zpm2:Blocks")
    assert folder.is_dir()
    config = assign(zpm2.config.preset("default"), ["segment.options.side=40", "device=cpu"])
    found = zpm2.match(pair.left, pair.right, config, segmenter="called", points="sift")
    assert found.config["segment"]["model"] == "called"
    assert found.config["segment"]["options"] == {"side": 40}
    assert len(found.left.polygons) > 20
    assert "the segmenter takes no prompts: no guided re-detection" in [*found.notes, *found.warnings]
    words: list[Any] = [pair.left, pair.right, "-o", tmp_path / "out", "--points", "sift", "--device", "cpu", "-q"]
    code, _, err = run("match", *words, "--segmenter", "called_zpm2:Blocks", "--set", "segment.options.side=40")
    assert (code, "Traceback" in err) == (0, False), err
    assert zpm2.MatchResult.load(tmp_path / "out").config["segment"]["model"] == "called_zpm2:Blocks"
    code, _, err = run("match", *words, "--segmenter", "caled")
    assert (code, err.startswith("zpm2: unknown segmenter 'caled' (did you mean 'called'?); segmenters are: ")) == (
        2,
        True,
    )
