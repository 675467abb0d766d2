"""Every command and every Python example of the README and the docs is run; tables agree with the code."""

import json
import os
import re
import runpy
import shlex
import shutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import boards
import numpy as np
import PIL.Image
import pytest
from remembered import remembered
from rendered import Pair, Run

import zpm2
from zpm2 import config
from zpm2.cli.app import COMMANDS

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
# prompts, points and windows, to be done in seconds
FEW = ["segment.grid=4", "points.max_keypoints=1000", "segment.detail.level=off"]
QUICK = [word for setting in FEW for word in ("--set", setting)]  # laid over what the page says


def blocks(language: str) -> list[tuple[Path, str]]:
    found = []
    for page in PAGES:
        found += [(page, text) for text in re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.M | re.S)]
    return found


def commands() -> list[str]:
    """Each `zpm2 ...` line once, without its comment. Lines that install are run by .ci/run, exactly as printed."""
    lines = [line.partition("  #")[0].strip() for _, text in blocks("bash") for line in text.splitlines()]
    return list(dict.fromkeys(line for line in lines if line.startswith("zpm2 ")))


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of three photographs of one scene."""
    folder = tmp_path_factory.mktemp("scene") / "photographs"
    boards.write(folder, 4)[-1].unlink()  # four of them are as near to each other as surfaces need
    return folder


@pytest.fixture(scope="module")
def grey(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the photographs in grey: band 1 of the GeoTIFFs is what the networks saw before."""
    folder = tmp_path_factory.mktemp("grey")
    for side in ("left", "right"):
        grey = PIL.Image.open(getattr(pair, side)).convert("L")
        grey.convert("RGB").save(folder / f"{side}.png")
        georeferenced(folder / f"{side}.tif", np.asarray(grey.convert("RGB")))
    return folder


@pytest.fixture
def workplace(pair: Pair, grey: Path, photographs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the pages speak of."""
    (tmp_path / "zpm2-demo").mkdir()
    for folder in (tmp_path, tmp_path / "zpm2-demo"):
        for side in ("left", "right"):
            shutil.copy(grey / f"{side}.png", folder)
            shutil.copy(getattr(pair, f"{side}_regions"), folder / f"{side}_labels.png")
        some = np.asarray(PIL.Image.open(folder / "left_labels.png"))
        PIL.Image.fromarray(np.where(some <= 8, some, 0).astype(some.dtype)).save(folder / "left_labels.png")
    (tmp_path / "data").mkdir()
    pairs = [{"name": "demo", "left": str(grey / "left.png"), "right": str(grey / "right.png"), "gt": None}]
    (tmp_path / "data" / "pairs.json").write_text(json.dumps(pairs))
    (tmp_path / "pairs.csv").write_text("left,right\nleft.png,right.png\n")
    (tmp_path / "theirs").mkdir()
    theirs = {"schema": "zpm2-area-matches/1", "matches": []}
    (tmp_path / "theirs" / "demo.json").write_text(json.dumps(theirs))
    for name, side in (("epoch1", "left"), ("epoch2", "right")):
        shutil.copy(grey / f"{side}.tif", tmp_path / f"{name}.tif")
    for year, turn in (("2019", 0.0), ("2024", 0.05)):
        layer(tmp_path / f"houses_{year}.geojson", turn)
    shutil.copytree(photographs, tmp_path / "photos")
    monkeypatch.setattr("zpm2.cloud.picture.SIZE", (160, 140))
    monkeypatch.setattr("zpm2.evaluate.speed._marked", lambda image, run: image)  # see test_speed.py
    (tmp_path / "options.toml").write_text(next(text for _, text in blocks("toml")))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module", autouse=True)
def networks() -> Iterator[None]:
    with remembered():
        yield


def georeferenced(path: Path, pixels: np.ndarray) -> None:
    """A GeoTIFF with a quarter of a metre a pixel."""
    rasterio = pytest.importorskip("rasterio")
    height, width, bands = pixels.shape
    profile = {"driver": "GTiff", "dtype": "uint8", "count": bands, "width": width, "height": height}
    place = rasterio.transform.from_origin(500000, 5000000, 0.25, 0.25)
    with rasterio.open(path, "w", crs="EPSG:32633", transform=place, **profile) as file:
        file.write(pixels.transpose(2, 0, 1))


def layer(path: Path, turn: float) -> None:
    """Houses on the ground, turned by some radians."""
    rng = np.random.default_rng(0)
    centers, half = 20.0 * rng.permutation(np.indices((8, 8)).reshape(2, -1).T)[:40], rng.uniform(3, 8, (40, 1, 2))
    corners = centers[:, None] + rng.uniform(-3, 3, (40, 1, 2)) + half * [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    cosine, sine = np.cos(turn), np.sin(turn)
    rings = (corners @ [[cosine, sine], [-sine, cosine]] + [500_000, 5_000_000]).tolist()
    features = [
        {"type": "Feature", "id": k, "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for k, ring in enumerate(rings)
    ]
    crs = {"type": "name", "properties": {"name": "EPSG:32633"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))


@pytest.fixture(scope="session")
def reconstructed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the workspace is kept that one command makes and the next one takes."""
    return tmp_path_factory.getbasetemp() / "reconstructed"


def test_pages_have_commands_and_only_known_ones() -> None:
    assert len(commands()) >= 6
    for page, text in blocks("bash"):
        for line in text.splitlines():
            known = line.startswith(
                ("zpm2 ", "python -m pip install ", "python -m venv ", "export ", "python benchmarks/")
            )
            assert known or not line.strip(), f"{page.name}: no test runs {line!r}"


@pytest.mark.weights
@pytest.mark.parametrize("command", commands())
def test_command(command: str, run: Run, workplace: Path, reconstructed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = shlex.split(command, comments=True)[1:]
    if words[0] in ("match", "eval", "pose", "cloud", "bench", "tracks"):
        words += QUICK
    if words[0] == "batch":  # in processes of its own, for which no network is remembered
        words += ["--segmenter", "classical", "--points", "sift", "--set", "guided.direction=off", *QUICK]
    if "--tiles" in words:
        words += ["--set", "tiles.size=400"]  # fewer ones
    if words[0] == "tracks":
        words += ["--set", "tracks.window=1", "--set", "tracks.extend=false"]
    if words[0] == "reconstruct":
        words += ["--set", "reconstruct.poisson_depth=8"]
    if "vismatch" in words and "ZPM2_VISMATCH_PYTHON" not in os.environ:
        pytest.skip("vismatch needs an environment of its own; tests/features runs a stand-in")
    if "--accept-licence" in words:
        pytest.skip("accepting a licence is for a person to do; tests/weights tries it with a stand-in")
    if words[:2] == ["cloud", "ws"]:
        words += ["--set", "cloud.neighbors=1"]
        if reconstructed.exists():
            shutil.copytree(reconstructed, "ws")
        else:
            coarse = "--set", "reconstruct.poisson_depth=8"
            assert run("reconstruct", "photos", "-o", "ws", "--max-size", "480", *coarse).code == 0
    if "out/left.geojson" in words or words[:2] == ["export", "out"]:
        assert run("match", "left.png", "right.png", "-o", "out", *QUICK).code == 0
    if words[0] == "view" and words[1] == "out":
        assert run("match", "left.png", "right.png", "-o", "out", *QUICK).code == 0
    if words[0] == "view" and words[1] == "scores":
        assert run("eval", "pairs", "--root", "data", "-o", "scores", *QUICK).code == 0
    if words[0] == "app":
        pytest.importorskip("starlette", reason='needs pip install "zpm2[app]"')
        monkeypatch.setattr("uvicorn.Server.run", lambda self, sockets: None)  # else it would serve for ever
        monkeypatch.setattr("webbrowser.open", lambda address: True)
    if "--score-only" in words:
        assert run(*(word for word in words if word != "--score-only")).code == 0
    if "--matches" in words:
        assert run("match", "left.png", "right.png", "-o", words[words.index("--matches") + 1], *QUICK).code == 0
    if words[0] == "eval" and "--regions" in words:
        scores = words[words.index("--regions") + 1]
        assert run("eval", "pairs", "--root", "data", "-o", scores, *QUICK).code == 0
    code, out, err = run(*words)
    assert code == 0, err
    assert out
    if words[0] == "match":
        assert (workplace / "out" / "matches.json").exists()
    if words[0] == "reconstruct":
        shutil.copytree("ws", reconstructed)


@pytest.mark.weights
def test_python_examples(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PIL.Image.Image, "show", lambda self: None)
    quick = config.assign(config.preset("default"), [*FEW, "pose.crops=off"])  # the command has them
    monkeypatch.setitem(config.PRESETS, "default", quick)
    names: dict[str, object] = {"zpm2": zpm2, "np": np}
    for page, text in blocks("python"):
        exec(compile(text, page.name, "exec"), names)
    assert names["sure"] is not None
    assert (workplace / "out" / "overlay.png").exists()


@pytest.mark.weights
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_from_top_to_bottom(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rasterio")
    monkeypatch.chdir(tmp_path)
    quick = config.assign(config.preset("default"), [*FEW, "pose.crops=off"])
    monkeypatch.setitem(config.PRESETS, "default", quick)
    names: dict[str, object] = {}
    for number, cell in enumerate(json.loads(notebook.read_text(encoding="utf-8"))["cells"], 1):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), names)
            assert cell["outputs"] == []
            assert cell["execution_count"] is None


def test_equations_name_code_that_exists() -> None:
    names = re.findall(r"`zpm2\.([\w.]+)`", (ROOT / "docs" / "equations.md").read_text(encoding="utf-8"))
    assert len(names) >= 20
    for name in names:
        *rooms, last = name.split(".")
        holder = rooms.pop() if rooms[-1][0].isupper() else None  # a class
        module = import_module(".".join(["zpm2", *rooms]))
        assert hasattr(getattr(module, holder) if holder else module, last), name


def test_links_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_page_is_in_the_navigation_of_the_site(tmp_path: Path) -> None:
    site = runpy.run_path(str(ROOT / "docs" / "site" / "build.py"))
    site["gather"](tmp_path / "pages")
    assert site["not_in_navigation"](tmp_path / "pages") == set()
    reference = (tmp_path / "pages" / "commands.md").read_text(encoding="utf-8")
    for command in COMMANDS:
        assert f"## `zpm2 {command}`\n" in reference
    assert site["below"]("../SECURITY.md#top") == "security.md#top"
    assert site["below"]("docs/files.md") == "files.md"


def configuration_table() -> str:
    """The table of docs/configuration.md; print it and paste it there when an option changes."""
    lines = ["| option | paper | default | what |", "| --- | --- | --- | --- |"]
    paper, default = (config.describe(config.preset(name)) for name in ("paper", "default"))
    for (option, _, first, meaning), (_, _, second, _) in zip(paper, default, strict=True):
        shown = [",".join(map(str, v)) if isinstance(v, tuple) else v for v in (first, second)]
        lines.append(f"| `{option}` | {shown[0]} | {shown[1]} | {meaning} |")
    return "\n".join(re.sub(r"\|  +\|", "| |", re.sub(r"\|  +\|", "| |", line)) for line in lines)


def test_configuration_page_lists_every_option() -> None:
    assert configuration_table() in (ROOT / "docs" / "configuration.md").read_text()
