"""Every command in a folder full of other people's files with the names that we write: all keep their bytes."""

import json
from functools import partial
from pathlib import Path

import boards
import pytest
from rendered import Pair, Run, fewer

from zpm2.api import Matcher
from zpm2.config import assign, preset
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter

MATCH = ["matches.json", "left.geojson", "right.geojson", "overlay.png", "unmatched.png", "report.html"]
SHAPES = [f"{side}{suffix}" for side in ("left", "right") for suffix in (".shp", ".shx", ".dbf", ".cpg", ".qix")]
FORMATS = [*SHAPES, "matches.gpkg", "matches.gpkg-wal", "left.coco.json", "right.coco.json"]
CLOUD = [
    *("cloud.json", "cloud.html", "cloud.png", "cloud.glb", "patches.ply", "points.ply", "points.las", "mesh.ply"),
    *("boundaries.geojson", "boundaries.wkt"),
]
EVAL = ["run.json", "predictions/a/matches.json", "rows.csv", "rows.parquet", "summary.json", "summary.md"]
RECONSTRUCT = ["reconstruct.json", "images/0.png", "sparse/0/cameras.bin", "dense/sparse/cameras.bin", "fused.ply"]
WRITES = {
    "match": [*MATCH, *FORMATS, "contact.png"],
    "demo": [
        *MATCH,
        "left.png",
        "right.png",
        "left_labels.png",
        "right_labels.png",
        "contact.png",
        "matches.gpkg",
        "matches.gpkg-wal",
    ],
    "pose": ["pose.json", "rectified/left.png", "colmap/database.db"],
    "cloud": [*CLOUD, "pairs/left-right/matches.json"],
    "reconstruct": [*RECONSTRUCT, "mesh.ply"],
    "eval": EVAL,
}
OTHERS = [
    *("tiles/a.png", "database.db", "sparse.part/x", "dense.part/x", "mesh.part.ply", "fused.part.ply.vis"),
    *(".0123456789abcdef.part", ".zpm2.txt", "notes.txt"),
]
ALL = sorted({*OTHERS, *(name for names in WRITES.values() for name in names)})
Command = tuple[str, tuple[object, ...]]  # its name in `WRITES`, and the command without -o


def write(folder: Path, names: list[str]) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"theirs: {name}")


def check(folder: Path, names: list[str]) -> None:
    for name in names:
        assert (folder / name).read_text() == f"theirs: {name}", name


@pytest.fixture(scope="module")
def matches(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    chosen = assign(preset("default"), ["points.methods=sift", "device=cpu"])
    sides = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    return Matcher(chosen, segmenter=sides)(pair.left, pair.right).save(tmp_path_factory.mktemp("matches"))


@pytest.fixture(params=WRITES)
def command(
    request: pytest.FixtureRequest, pair: Pair, matches: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Command:
    """One that writes all that it can."""
    k = ("--K", f"{pair.scene.f},{pair.scene.f},{pair.scene.cx},{pair.scene.cy}")
    both, quick = (pair.left, pair.right), ("--set", "points.methods=sift", "--device", "cpu")
    monkeypatch.setattr("zpm2.cloud.picture.SIZE", (160, 140))
    if request.param == "match":
        pytest.importorskip("pyogrio")
        formats = [word for name in ("gpkg", "shapefile", "coco") for word in ("--format", name)]
        return "match", ("match", *both, *pair.regions, *formats)
    if request.param == "demo":
        own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
        monkeypatch.setattr("zpm2.evaluate.rendered.render_scene", lambda seed: pair.scene)
        monkeypatch.setattr("zpm2.api.Matcher", partial(Matcher, segmenter=own))
        return "demo", ("demo", *quick)
    if request.param == "pose":
        pytest.importorskip("pycolmap")
        return "pose", ("pose", *both, *k, "--matches", matches, "--rectify", "--colmap", "--set", "pose.crops=off")
    if request.param == "cloud":
        pytest.importorskip("trimesh")
        monkeypatch.setattr("zpm2.api.Matcher", Loaded(fewer(matches, tmp_path, 8)))
        return "cloud", ("cloud", *both, "--stereo", *k, "--baseline", 0.2, "--las", *quick)
    if request.param == "reconstruct":
        pytest.importorskip("pycolmap")
        boards.write(tmp_path / "photographs")
        small = "--max-size", 240, "--set", "reconstruct.poisson_depth=8"
        return "reconstruct", ("reconstruct", tmp_path / "photographs", *small)
    data = tmp_path / "data"
    data.mkdir()
    known = {"left": str(pair.left), "right": str(pair.right), "gt": None}
    (data / "pairs.json").write_text(json.dumps([{"name": "a", **known}]))
    monkeypatch.setattr("zpm2.api.Matcher", Loaded(matches))
    return "eval", ("eval", "pairs", "--root", data, "--parquet")


class Loaded:
    """Stands for a matcher's class and for the matcher: the matches that are there."""

    def __init__(self, matches: Path) -> None:
        self.matches = matches

    def __call__(self, *words: object, **named: object) -> object:
        return MatchResult.load(self.matches) if len(words) == 2 else self


def refused(run: Run, words: tuple[object, ...], out: Path) -> str:
    code, text, err = run(*words, "-o", out)
    assert (code, text, err.count("\n")) == (2, "", 1), err
    return err


def test_names_that_are_taken_are_refused_before_the_work_begins(
    command: Command, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All at once, and each alone."""
    name, words = command
    for number, names in enumerate([ALL, *([name] for name in WRITES[name])]):
        out = tmp_path / f"out{number}"
        write(out, names)
        before = sorted(str(p) for p in out.rglob("*"))
        err = refused(run, words, out)
        assert "is there already, and is not on record as made by zpm2" in err
        if len(names) == 1:
            assert names[0].partition("/")[0] in err
        check(out, names)
        assert sorted(str(p) for p in out.rglob("*")) == before


def test_other_names_are_left_alone_and_a_second_run_works(command: Command, run: Run, tmp_path: Path) -> None:
    name, words = command
    written = {written.partition("/")[0] for written in WRITES[name]}
    others = [other for other in ALL if other.partition("/")[0] not in written]
    out = tmp_path / "out"
    write(out, others)
    for _ in range(2):
        code, _, err = run(*words, "-o", out, "-q")
        assert code == 0, err
        check(out, others)
    there = {p.name for p in out.iterdir()} - {other.partition("/")[0] for other in others} - {".zpm2"}
    side_files = {f"{side}.prj" for side in ("left", "right")}
    assert there <= written | side_files
    assert not any((out / ".zpm2" / "parts").iterdir())


def test_a_hidden_folder_that_is_not_ours_is_refused(command: Command, run: Run, tmp_path: Path) -> None:
    _, words = command
    write(tmp_path / "out", [".zpm2/tiles/x"])
    assert ".zpm2 is not the folder that zpm2 keeps its files in" in refused(run, words, tmp_path / "out")
    check(tmp_path / "out", [".zpm2/tiles/x"])


def test_photographs_in_a_folder_called_tiles(
    pair: Pair, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    photographs = {tmp_path / "tiles" / f"{name}.png": getattr(pair, name).read_bytes() for name in ("left", "right")}
    (tmp_path / "tiles").mkdir()
    for path, content in photographs.items():
        path.write_bytes(content)
    code, _, err = run("match", "tiles/left.png", "tiles/right.png", "-o", ".", *pair.regions)
    assert code == 0, err
    assert {path: path.read_bytes() for path in photographs} == photographs
    assert (tmp_path / "matches.json").exists()


def test_an_input_is_never_written_over(pair: Pair, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither one that somebody else made, nor our own picture that is an input now."""
    monkeypatch.chdir(tmp_path)
    for name in ("left", "overlay"):
        (tmp_path / f"{name}.png").write_bytes(pair.left.read_bytes())
    assert "overlay.png is there already" in refused(run, ("match", "left.png", "overlay.png", *pair.regions), tmp_path)
    out = tmp_path / "out"
    assert run("match", pair.left, pair.right, "-o", out, *pair.regions).code == 0
    before = (out / "overlay.png").read_bytes()
    words = ("match", out / "overlay.png", pair.right, *pair.regions)
    assert "overlay.png is an input and would be written over" in refused(run, words, out)
    assert (out / "overlay.png").read_bytes() == before
    regions = ("--left-regions", out / "left.geojson", "--right-regions", out / "right.geojson", "--points", "sift")
    words = ("match", pair.left, pair.right, *regions)
    assert "left.geojson is an input and would be written over" in refused(run, words, out)


def test_photographs_in_the_workspace_are_used_where_they_are(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("pycolmap")
    paths = boards.write(tmp_path / "ws" / "images", 3)
    before = {path: path.read_bytes() for path in paths}
    run("reconstruct", tmp_path / "ws" / "images", "-o", tmp_path / "ws", "--max-size", 240)
    assert {path: path.read_bytes() for path in (tmp_path / "ws" / "images").iterdir()} == before
    assert (tmp_path / "ws" / "sparse" / "0" / "cameras.bin").is_file()
