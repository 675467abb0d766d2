"""The package of docs/plugins.md, installed into a folder: listed, checked and used by fresh processes."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rendered import Pair

import zpm2

PAGE = Path(__file__).parent.parent / "docs" / "plugins.md"
SOURCE = Path(zpm2.__file__).parents[1]
PARTS = {
    "segmenter": ("levels", "zpm2_toy.levels:Levels"),
    "point matcher": ("orb", "zpm2_toy.orb:Orb"),
    "data set": ("scenes", "zpm2_toy.scenes:pairs"),
    "format": ("table", "zpm2_toy.table:TABLE"),
}


def templates() -> dict[str, str]:
    """The files of the page, by name."""
    return dict(re.findall(r"^```\w+ ([\w.]+)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip has installed the package."""
    for needed in ("setuptools", "pip"):  # not imported: setuptools replaces distutils in the process
        if importlib.util.find_spec(needed) is None:
            pytest.skip(f"needs {needed}")
    project, site = tmp_path_factory.mktemp("project"), tmp_path_factory.mktemp("site")
    (project / "zpm2_toy").mkdir()
    (project / "zpm2_toy" / "__init__.py").touch()
    for name, text in templates().items():
        (project / name if name == "pyproject.toml" else project / "zpm2_toy" / name).write_text(text, encoding="utf-8")
    words = [
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--target",
        str(site),
        str(project),
    ]
    done = subprocess.run([sys.executable, "-m", "pip", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return site


@pytest.fixture
def fresh(site: Path, tmp_path: Path) -> "Fresh":
    return Fresh(site, tmp_path)


class Fresh:
    """Runs modules in processes that find the package."""

    def __init__(self, site: Path, folder: Path) -> None:
        self.folder = folder
        self.environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site), str(SOURCE)]), "COLUMNS": "200"}

    def __call__(self, module: str, *words: object) -> tuple[int, str, str]:
        command = [sys.executable, "-m", module, *map(str, words)]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, env=self.environment, cwd=self.folder
        )
        return done.returncode, done.stdout, done.stderr


def test_each_template_is_short_and_has_a_place_in_the_package() -> None:
    files = templates()
    assert {path.partition(".")[2].partition(":")[0] + ".py" for _, path in PARTS.values()} == set(files) - {
        "pyproject.toml"
    }
    assert max(len([line for line in text.splitlines() if line.strip()]) for text in files.values()) <= 42


def test_it_is_listed(fresh: Fresh) -> None:
    code, out, err = fresh("zpm2", "models", "--all", "--json")
    assert (code, err) == (0, "")
    found = {(row["kind"], row["name"]): row["origin"] for row in json.loads(out)}
    for kind, (name, _) in PARTS.items():
        assert found[kind, name] == "package zpm2-toy 1.0"
    assert found["segmenter", "mobile_sam"] == "built in"


@pytest.mark.parametrize("kind", PARTS)
def test_it_keeps_the_contract(fresh: Fresh, pair: Pair, kind: str) -> None:
    name, path = PARTS[kind]
    scene = fresh.folder / "data" / "one"
    scene.mkdir(parents=True)
    for side in ("left", "right"):
        (scene / f"{side}.png").write_bytes(getattr(pair, side).read_bytes())
    root = ["--root", fresh.folder / "data"] if kind == "data set" else []
    code, out, err = fresh("zpm2.contract", path, *root)
    assert (code, err) == (0, ""), out
    assert out.startswith(f"{path}: {kind}, ")
    assert out.endswith("all is well\n")
    assert name


def test_it_is_used_by_name(fresh: Fresh, pair: Pair) -> None:
    words = ["match", pair.left, pair.right, "-o", "out", "--device", "cpu", "--segmenter", "levels", "--points", "orb"]
    options = ["--set", "segment.options.levels=8", "--set", "points.options.ratio=0.9", "--format", "table"]
    code, _, err = fresh("zpm2", *words, *options)
    assert code == 0, err
    result = zpm2.MatchResult.load(fresh.folder / "out")
    assert len(result.matches) > 10
    assert result.config["segment"]["model"] == "levels"
    assert result.config["segment"]["options"] == {"levels": 8}
    assert result.config["points"]["options"] == {"ratio": 0.9}
    rows = (fresh.folder / "out" / "matches.csv").read_text().splitlines()
    assert len(rows) == 1 + len(result.matches)
    code, _, err = fresh("zpm2", *words, "--set", "segment.options.level=8")
    assert code == 2
    assert err == (
        "zpm2: unknown option 'segment.options.level' (did you mean 'levels'?); levels takes: levels, blur\n"
    )


def test_a_data_set_is_evaluated_by_its_path(fresh: Fresh) -> None:
    code, _, err = fresh("zpm2", "eval", "zpm2_toy.scenes:pairs", "--root", fresh.folder, "-o", "scores")
    assert code == 2
    assert err.startswith("zpm2: ")
    assert "left.png is not there: give the folder that holds the scenes" in err


def test_a_format_by_its_path(fresh: Fresh, pair: Pair) -> None:
    regions = ["--left-regions", pair.left_regions, "--right-regions", pair.right_regions, "--points", "sift"]
    code, _, err = fresh(
        "zpm2", "match", pair.left, pair.right, "-o", "out", *regions, "--format", "zpm2_toy.table:TABLE"
    )
    assert code == 0, err
    assert (fresh.folder / "out" / "matches.csv").is_file()


def test_a_broken_package_costs_a_line(fresh: Fresh, pair: Pair) -> None:
    info = fresh.folder / "broken-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text("[zpm2.segmenters]\nbad = broken_zpm2:Bad\n")
    (fresh.folder / "broken_zpm2.py").write_text("raise OSError('no\\nway')\n")
    fresh.environment["PYTHONPATH"] += os.pathsep + str(fresh.folder)
    why = "segmenter 'bad' of package broken 2.0 cannot be loaded: OSError: no way; repair that package or remove it\n"
    code, out, err = fresh("zpm2", "models")
    assert (code, err) == (0, f"warning: {why}")
    assert "levels" in out
    words = ["match", pair.left, pair.right, "-o", "out", "--points", "sift", "--segmenter"]
    assert fresh("zpm2", *words, "bad")[::2] == (2, f"zpm2: {why}")
    code, _, err = fresh("zpm2", *words, "levels")
    assert (code, "broken" in err) == (0, False), err


def test_no_package_is_looked_for_where_none_is_needed(fresh: Fresh) -> None:
    """Entry points take time to read: not for the help, nor for a built-in name."""
    (fresh.folder / "watch.py").write_text(
        "import importlib.metadata as metadata\n"
        "metadata.entry_points = None\n"
        "from zpm2.cli.app import app\n"
        "app(['--help'], standalone_mode=False)\n"
        "from zpm2.plugins import BUILT_IN\n"
        "from zpm2.segment.registry import SEGMENTERS\n"
        "assert SEGMENTERS.origin('vit_b') == BUILT_IN\n"
    )
    code, out, err = fresh("watch")
    assert (code, err) == (0, ""), err
    assert "models" in out
