"""`zpm2 match`, `demo` and `doctor` as a person uses them. Regions are given and points are SIFT: no weights."""

import json
import re
import shlex
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
import shapely
from rendered import Pair, Run

import zpm2
from zpm2.api import Matcher
from zpm2.cli import app
from zpm2.polygons.rasterize import rasterize
from zpm2.segment.given.precomputed import PrecomputedSegmenter

FILES = ["left.geojson", "matches.json", "overlay.png", "report.html", "right.geojson", "unmatched.png"]
STAGES = ["read", "load", "points", "detect", "global", "local", "verify"]


def read(folder: Path) -> Any:
    return json.loads((folder / "matches.json").read_text())


@pytest.fixture(scope="module")
def saved(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that the command line wrote."""
    out = tmp_path_factory.mktemp("run") / "deep" / "out"
    with pytest.MonkeyPatch.context() as patch:
        arguments = ["zpm2", "match", str(pair.left), str(pair.right), "-o", str(out), *pair.regions]
        patch.setattr("sys.argv", arguments)
        with pytest.raises(SystemExit) as end:
            zpm2.cli.app.main()
        assert end.value.code == 0
    return out


def test_a_folder_is_printed_by_its_name(run: Run, pair: Pair, tmp_path: Path) -> None:
    out = tmp_path / ("deep" * 20) / "run[raw][" / "x]"
    code, text, err = run("match", pair.left, pair.right, "-o", out, *pair.regions, "--no-report")
    assert code == 0, err
    assert str(out) in text.replace(" ", "").replace("\n", "")


def test_all_files(saved: Path) -> None:
    assert sorted(p.name for p in saved.iterdir()) == [".zpm2", *FILES]
    with PIL.Image.open(saved / "overlay.png") as picture:
        picture.load()
        assert picture.width > 800


def test_matches_json_holds_what_the_design_promises(saved: Path, pair: Pair) -> None:
    document = read(saved)
    assert document["schema"] == "zpm2-matches/1"
    assert document["version"] == zpm2.__version__
    assert list(document["timings"]) == STAGES
    assert all(seconds >= 0 for seconds in document["timings"].values())
    for name, path in (("left", pair.left), ("right", pair.right)):
        side = document[name]
        assert (side["path"], side["width"], side["height"]) == (str(path), 400, 240)
        for polygon in side["polygons"]:
            assert {"id", "vertices", "holes", "area", "score", "parent"} <= set(polygon)
            assert all(0 <= x <= 400 and 0 <= y <= 240 for x, y in polygon["vertices"])
    points = document["points"]
    assert len(points["left"]) == len(points["right"]) == len(points["score"]) > 100
    assert len(document["fundamental"]) == len(document["homography"]) == 3
    for match in document["matches"]:
        assert {"left", "right", "confidence", "cost", "dsf", "stage"} <= set(match)
        assert 0 <= match["confidence"] <= 1
        assert match["stage"] in ("global", "local", "guided")


def test_matches_are_one_to_one_and_right(saved: Path) -> None:
    """Both sides' regions carry the same numbers."""
    document = read(saved)
    pairs = [(m["left"], m["right"]) for m in document["matches"]]
    listed = [{p["id"] for p in document[side]["polygons"]} for side in ("left", "right")]
    for k in range(2):
        ids = [p[k] for p in pairs]
        assert len(set(ids)) == len(ids)
        assert set(ids) <= listed[k]
    assert len(pairs) >= 0.9 * len(listed[0] & listed[1])
    assert sum(a == b for a, b in pairs) >= 0.95 * len(pairs)


def test_geojson_names_partners(saved: Path) -> None:
    document = read(saved)
    for name, other in (("left", "right"), ("right", "left")):
        collection = json.loads((saved / f"{name}.geojson").read_text())
        partners = {f["id"]: f["properties"]["match"] for f in collection["features"]}
        assert set(partners) == {p["id"] for p in document[name]["polygons"]}
        assert {k: v for k, v in partners.items() if v is not None} == {m[name]: m[other] for m in document["matches"]}


def test_own_output_serves_as_regions(run: Run, pair: Pair, saved: Path, tmp_path: Path) -> None:
    regions = ["--left-regions", saved / "left.geojson", "--right-regions", saved / "right.geojson"]
    arguments = ["--segmenter", "precomputed", *regions, "--points", "sift"]
    assert run("match", pair.left, pair.right, "-o", tmp_path, *arguments).code == 0
    again, before = read(tmp_path), read(saved)
    assert [p["vertices"] for p in again["left"]["polygons"]] == [p["vertices"] for p in before["left"]["polygons"]]
    assert [(m["left"], m["right"]) for m in again["matches"]] == [(m["left"], m["right"]) for m in before["matches"]]


def test_masks_show_the_matched_regions(run: Run, pair: Pair, tmp_path: Path) -> None:
    common = ["match", pair.left, pair.right, "-o", tmp_path / "out", *pair.regions, "--quiet"]
    (tmp_path / "out" / "masks").mkdir(parents=True)
    (tmp_path / "out" / "masks" / "mine.txt").write_text("mine")
    assert run(*common).code == 0  # a folder of that name is only in the way where masks are asked for
    assert run(*common, "--masks", "colmap").code == 2
    (tmp_path / "out" / "masks" / "mine.txt").unlink()
    code, _, err = run(*common, "--masks", "colmap", "--masks", "nerfstudio")
    assert code == 0
    assert "warning: there is no transforms.json" in err
    result = zpm2.MatchResult.load(tmp_path / "out")
    for side, polygons in zip(("left", "right"), result.matched_polygons(), strict=True):
        inside = np.zeros((240, 400), bool)
        for polygon in polygons:
            mask = rasterize(polygon.shape)
            rows, columns = mask.bits.shape
            inside[mask.y0 : mask.y0 + rows, mask.x0 : mask.x0 + columns] |= mask.bits
        for name in (f"colmap/{side}.png.png", f"nerfstudio/masks/{side}.png"):
            assert ((np.asarray(PIL.Image.open(tmp_path / "out" / "masks" / name)) > 0) == inside).all()


def test_non_overlapping_with_outlines(run: Run, pair: Pair, tmp_path: Path) -> None:
    """The regions of the right image are also enlarged, so that there is something to take apart."""
    with PIL.Image.open(pair.right_regions) as picture:
        labels = np.asarray(picture)
    regions = tmp_path / "regions.geojson"
    features = [
        {"type": "Feature", "id": int(k), "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for k in np.unique(labels[labels > 0])
        for y, x in [np.nonzero(labels == k)]
        for x0, y0, x1, y1 in [(int(x.min()), int(y.min()), int(x.max()) + 1, int(y.max()) + 1)]
        for ring in [[[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]]
    ]
    regions.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    options = [*pair.regions[:4], "--right-regions", regions, *pair.regions[6:], "--quiet"]
    common = ["match", pair.left, pair.right, "-o", tmp_path / "out", *options]
    assert run(*common).code == 0
    before = read(tmp_path / "out")
    assert before["non_overlapping"] is False
    assert not any("outline" in match for match in before["matches"])
    assert covered(before, "right").max() > 1

    assert run(*common, "--non-overlapping", "--outlines").code == 0
    after = read(tmp_path / "out")
    assert after["non_overlapping"] is True
    assert {(m["left"], m["right"]) for m in after["matches"]} <= {(m["left"], m["right"]) for m in before["matches"]}
    for side in ("left", "right"):
        assert covered(after, side).max() == 1
        collection = json.loads((tmp_path / "out" / f"{side}.geojson").read_text())
        assert [f["properties"]["area"] for f in collection["features"]] == [p["area"] for p in after[side]["polygons"]]
    assert all(len(match["outline"]) > 10 and len(match["outline"][0]) == 5 for match in after["matches"])


def covered(document: Any, side: str) -> Any:
    """(h, w) how many matched polygons hold each pixel."""
    count = np.zeros((document[side]["height"], document[side]["width"]), int)
    matched = {match[side] for match in document["matches"]}
    for polygon in document[side]["polygons"]:
        if polygon["id"] in matched:
            mask = rasterize(shapely.Polygon(polygon["vertices"], polygon["holes"]))
            height, width = mask.bits.shape
            count[mask.y0 : mask.y0 + height, mask.x0 : mask.x0 + width] += mask.bits
    return count


def test_summary_table(run: Run, pair: Pair, tmp_path: Path) -> None:
    code, out, err = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions)
    assert code == 0
    assert all(stage in out for stage in [*STAGES, "total"])
    assert f"{len(read(tmp_path)['matches'])} matches" in out
    assert all(line.startswith("warning: ") for line in err.splitlines())


def test_json_is_one_object_on_stdout(run: Run, pair: Pair, tmp_path: Path) -> None:
    code, out, err = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--json")
    summary, document = json.loads(out), read(tmp_path)
    assert code == 0
    assert out.count("\n") == 1
    assert summary["matches"] == sum(summary["by_stage"].values()) == len(document["matches"])
    assert summary["left_polygons"] == len(document["left"]["polygons"])
    assert summary["points"] == len(document["points"]["score"])
    assert summary["warnings"] == document["warnings"]
    assert list(summary["seconds"]) == STAGES
    assert summary["out"] == str(tmp_path)
    assert err.splitlines() == [f"warning: {w}" for w in summary["warnings"]]


def test_quiet_prints_warnings_only(run: Run, pair: Pair, tmp_path: Path) -> None:
    code, out, err = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--quiet")
    assert (code, out) == (0, "")
    assert err.splitlines() == [f"warning: {w}" for w in read(tmp_path)["warnings"]]


def test_progress_goes_to_the_terminal_on_stderr(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("FORCE_COLOR", "1")
    _, out, err = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions, "--json")
    assert "detect" not in err
    _, out, err = run("match", pair.left, pair.right, "-o", tmp_path, *pair.regions)
    assert all(stage in err for stage in STAGES)
    assert "\x1b[2K" not in out


def test_presets_and_settings_are_in_the_result(run: Run, pair: Pair, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text('seed = 3\ndevice = "cpu"\n[local_match]\niota = 4.0\ngamma = 6\n[points]\nmax_keypoints = 900\n')
    common = ["match", pair.left, pair.right, "-o", tmp_path / "out", *pair.regions]

    def config(*arguments: object) -> Any:
        assert run(*common, *arguments).code == 0
        return read(tmp_path / "out")["config"]

    paper = config("--preset", "paper", "--config", file, "--set", "local_match.gamma=7", "--set", "segment.grid=9")
    assert paper["local_match"]["shape"] == "graph"
    assert (paper["local_match"]["iota"], paper["local_match"]["gamma"]) == (4.0, 7)
    assert (paper["points"]["max_keypoints"], paper["points"]["methods"]) == (900, ["sift"])
    assert (paper["segment"]["grid"], paper["seed"], paper["device"]) == (9, 3, "cpu")
    assert config() == json.loads(json.dumps(zpm2.Config.from_dict(_cpu_sift(), zpm2.preset("default")).to_dict()))
    assert config("--config", file, "--seed", 8)["seed"] == 8
    assert config("--set", "seed=5")["seed"] == 5


def _cpu_sift() -> dict[str, Any]:
    return {"points": {"methods": ["sift"]}, "device": "cpu"}


def test_segmenter_names_the_model(run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[zpm2.Config] = []

    def stand_in(config: zpm2.Config, **options: Any) -> Matcher:
        asked.append(config)
        own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
        return Matcher(config, **{**options, "segmenter": own})

    monkeypatch.setattr("zpm2.api.Matcher", stand_in)
    arguments = ["--segmenter", "vit_b", "--points", "sift"]
    assert run("match", pair.left, pair.right, "-o", tmp_path, *arguments).code == 0
    assert asked[0].segment.model == "vit_b"


def test_same_seed_same_bytes(run: Run, pair: Pair, tmp_path: Path) -> None:
    for name in "ab":
        assert run("match", pair.left, pair.right, "-o", tmp_path / name, *pair.regions, "--seed", 1).code == 0
    for file in FILES:
        first, second = ((tmp_path / name / file).read_bytes() for name in "ab")
        if file == "matches.json":
            first, second = (json.dumps({**json.loads(b), "timings": 0}).encode() for b in (first, second))
        if file == "report.html":
            first, second = (re.sub(rb'id="timings">.*?<', b"", b) for b in (first, second))
        assert first == second


@pytest.fixture
def quick_demo(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """`zpm2 demo` with the small scene and its own regions; the command line options for it."""
    own = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    monkeypatch.setattr("zpm2.evaluate.rendered.render_scene", lambda seed: pair.scene)
    monkeypatch.setattr("zpm2.api.Matcher", partial(Matcher, segmenter=own))
    return ["--set", "points.methods=sift", "--device", "cpu"]


def test_demo_scores_itself_and_says_what_next(run: Run, quick_demo: list[str], tmp_path: Path) -> None:
    code, out, _ = run("demo", "-o", tmp_path, *quick_demo)
    assert code == 0
    assert sorted(p.name for p in tmp_path.glob("*.*")) == sorted(
        [".zpm2", *FILES, *(f"{side}{kind}.png" for side in ("left", "right") for kind in ("", "_labels"))]
    )
    assert "Against the exact depth" in out
    assert f"Open {tmp_path / 'report.html'}" in out
    assert "zpm2 match left.png right.png -o out" in out


def test_the_regions_of_the_demo_are_files_to_try(run: Run, quick_demo: list[str], tmp_path: Path) -> None:
    assert run("demo", "-o", tmp_path / "demo", *quick_demo).code == 0
    sides = [tmp_path / "demo" / f"{side}.png" for side in ("left", "right")]
    regions = ["--left-regions", tmp_path / "demo" / "left_labels.png"]
    regions += ["--right-regions", tmp_path / "demo" / "right_labels.png"]
    assert run("match", *sides, *regions, "--points", "sift", "-o", tmp_path / "out").code == 0
    document = read(tmp_path / "out")
    assert len(document["matches"]) > 20
    assert np.mean([m["left"] == m["right"] for m in document["matches"]]) > 0.8


def test_demo_as_json(run: Run, quick_demo: list[str], tmp_path: Path) -> None:
    summary = json.loads(run("demo", "-o", tmp_path, *quick_demo, "--json").out)
    assert summary["good"] >= 0.9 * summary["scored"] > 20
    assert 0.8 < summary["coverage"] <= 1
    assert run("demo", "-o", tmp_path, *quick_demo, "-q").out == ""


def test_doctor(run: Run, tmp_path: Path) -> None:
    findings = json.loads(run("doctor", "--json").out)
    assert findings["versions"]["zpm2"] == zpm2.__version__
    assert findings["devices"]["cuda"]
    assert findings["weights"]["cache"] == str(tmp_path / "cache" / "weights")
    assert findings["weights"]["mobile_sam"] == "not here"
    code, out, err = run("doctor")
    assert (code, err) == (0, "")
    assert all(str(value) in out for section in findings.values() for value in section.values())


def test_doctor_sees_the_weights_folder(run: Run, tmp_path: Path) -> None:
    item = zpm2.weights.entry("xfeat")
    with (tmp_path / item.file).open("wb") as file:
        file.truncate(item.size)
    findings = json.loads(run("doctor", "--json", "--weights-dir", tmp_path).out)
    assert findings["weights"]["xfeat"] == str(tmp_path / item.file)


def test_version(run: Run) -> None:
    assert run("--version") == (0, f"{zpm2.__version__}\n", "")


@pytest.mark.parametrize(
    "command", [[], ["match"], ["demo"], ["doctor"], ["weights"], ["weights", "list"], ["weights", "get"]]
)
def test_help(run: Run, command: list[str]) -> None:
    code, out, err = run(*command, "--help")
    assert (code, err) == (0, "")
    assert f"Usage: zpm2 {' '.join(command)}".rstrip() in out
    assert max(map(len, out.splitlines())) <= 80


@pytest.mark.parametrize("command", [[], ["weights"]])
def test_no_command_prints_the_help(run: Run, command: list[str]) -> None:
    code, out, err = run(*command)
    assert (code, out) == (2, "")
    assert "Commands:" in err.splitlines()


def test_an_interrupt_is_130_and_leaves_nothing(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("zpm2.pipeline.search_candidates", interrupt)
    out = tmp_path / "out"
    code, _, err = run("match", pair.left, pair.right, "-o", out, *pair.regions)
    assert (code, err.strip()) == (130, "zpm2: interrupted; nothing was written")
    assert not out.exists()
    out.mkdir()
    (out / "mine.txt").touch()
    code, _, err = run("match", pair.left, pair.right, "-o", out, *pair.regions)
    assert (code, err.strip()) == (130, "zpm2: interrupted; nothing was written")
    assert [path.name for path in out.iterdir()] == ["mine.txt"]


def test_sigterm_ends_a_run_as_an_interrupt_does(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("zpm2.pipeline.search_candidates", lambda *_: signal.raise_signal(signal.SIGTERM))
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path / "out", *pair.regions)
    assert (code, err.strip()) == (130, "zpm2: interrupted; nothing was written")
    assert signal.getsignal(signal.SIGTERM) is before


def test_without_a_terminal_a_long_run_says_how_far_it_is(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zpm2.cli.console.EVERY", 0.02)
    arguments = ["match", pair.left, pair.right, "-o", tmp_path, *pair.regions]
    said = run(*arguments).err.splitlines()
    assert any(re.fullmatch(r"points: \d+%, \d+ s", line) for line in said)
    for mute in ("--quiet", "--json"):
        assert not any(re.search(r"\d+%", line) for line in run(*arguments, mute).err.splitlines())


def test_notes_are_kept_and_not_printed(run: Run, pair: Pair, tmp_path: Path) -> None:
    deep = np.asarray(PIL.Image.open(pair.left).convert("L")).astype(np.uint16) * 200
    PIL.Image.fromarray(deep).save(tmp_path / "deep.png")
    code, out, err = run("match", tmp_path / "deep.png", pair.right, "-o", tmp_path / "o", *pair.regions, "--json")
    assert code == 0
    assert "stretched" not in err
    assert any("stretched" in note for note in json.loads(out)["notes"])
    assert json.loads(out)["notes"] == read(tmp_path / "o")["notes"]
    assert not any("stretched" in warning for warning in read(tmp_path / "o")["warnings"])


def test_the_output_folder_has_a_usual_name(
    run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("match", pair.left, pair.right, *pair.regions).code == 0
    assert (tmp_path / "zpm2-match" / "matches.json").exists()


def test_commands_come_in_the_order_of_use(run: Run) -> None:
    listed = run("--help").out.partition("Commands:")[2]
    assert [line.split()[0] for line in listed.splitlines() if line[2:3].strip()] == list(app.COMMANDS)


def test_options_come_in_groups(run: Run) -> None:
    text = run("match", "--help").out
    titles = [line for line in text.splitlines() if line.endswith(":") and not line.startswith(" ")]
    expected = ["Arguments", "Results", "Method", "Your own regions", "Large and georeferenced photographs", "Run"]
    assert [title.rstrip(":") for title in titles] == [*expected, "Options"]


def test_help_is_as_wide_as_the_terminal(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "140")
    assert 100 < max(map(len, run("match", "--help").out.splitlines())) <= 140


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (["match"], "match"),
        (["match", "a", "b", "--nothing"], "match"),
        (["pose", "a"], "pose"),
        (["weights", "path"], "weights path"),
        (["config", "list", "x"], "config list"),
    ],
)
def test_usage_errors_point_to_the_help_of_the_command(run: Run, arguments: list[str], command: str) -> None:
    code, out, err = run(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.endswith(f"see zpm2 {command} --help\n")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("zpm2 c", ["carry", "cloud", "config"]),
        ("zpm2 match --preset p", ["paper"]),
        ("zpm2 match --quality f", ["fast", "full"]),
        ("zpm2 match --segmenter p", ["precomputed"]),
        ("zpm2 match --points xfeat,si", ["xfeat,sift"]),
        ("zpm2 match --format s", ["shapefile"]),
        ("zpm2 match --method sh", ["shape-context"]),
        ("zpm2 match --tiles o", ["on", "off"]),
        ("zpm2 match --set guided.dir", ["guided.direction="]),
        ("zpm2 match --set guided.direction=f", ["guided.direction=forward"]),
        ("zpm2 pose --estimator p", ["poselib"]),
        ("zpm2 eval midd", ["middlebury"]),
        ("zpm2 weights get mobile", ["mobile_sam"]),
    ],
)
def test_the_shell_completes_values(run: Run, words: str, expected: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_ZPM2_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert sorted(run().out.split()) == sorted(expected)


def test_config_list_has_every_field_with_type_value_and_meaning(run: Run) -> None:
    rows = json.loads(run("config", "list", "--json").out)
    assert len(rows) == len({row["option"] for row in rows}) > 60
    row = {row["option"]: row for row in rows}
    assert row["segment.grid"] == {
        "option": "segment.grid",
        "type": "int",
        "value": 32,
        "meaning": "prompts along each image side, grid x grid in all (SAM's automatic mask generator)",
    }
    assert row["segment.quality"]["type"] == "fast | balanced | full"
    assert row["points.methods"]["type"] == "str,..."
    assert row["seed"]["meaning"]
    assert {row["segment.quality"]["value"]} != {
        row["value"]
        for row in json.loads(run("config", "list", "--preset", "paper", "--json").out)
        if row["option"] == "segment.quality"
    }
    text = run("config", "list").out.splitlines()
    assert [line.split()[0] for line in text] == list(row)


@pytest.mark.parametrize("preset", ["paper", "default"])
def test_config_show_is_a_file_for_config(run: Run, tmp_path: Path, preset: str) -> None:
    for ending, extra in (("toml", []), ("json", ["--json"])):
        file = tmp_path / f"shown.{ending}"
        file.write_text(run("config", "show", "--preset", preset, "--set", "segment.grid=7", *extra).out)
        expected = zpm2.config.assign(zpm2.preset(preset), ["segment.grid=7"])
        assert zpm2.config.load(file) == expected


def test_config_show_is_toml_whatever_the_words(run: Run, tmp_path: Path) -> None:
    odd = ['segment.options.größe="🙂\\ü\x7f', "segment.model=🙂", "raster.bands=-"]
    words = [word for setting in odd for word in ("--set", setting)]
    (tmp_path / "shown.toml").write_text(run("config", "show", *words).out, encoding="utf-8")
    assert zpm2.config.load(tmp_path / "shown.toml") == zpm2.config.assign(zpm2.preset("default"), odd)


def test_standard_error_is_not_a_terminal_here() -> None:
    """What the tests of single error lines stand on."""
    assert not sys.stderr.isatty()


LONG = "x" * 300


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("match L R --seed 4294967296", "seed must be at most 2147483647"),
        ("match L R --set segment.grid=9999999999", "segment.grid must be at most 1000"),
        ("match L R --points zift", "unknown point method 'zift' (did you mean 'sift'?)"),
        ("match L R --tiles on --points zift", "unknown point method 'zift'"),
        ("demo --seed 4294967296", "seed must be at most"),
        ("match L R --set global_match.phi=53", "global_match.phi=53 is wider than the search window of 2 x"),
        ("reconstruct . --max-size 99999999999", "reconstruct.max_size must be at most 100000, got 99999999999"),
        ("reconstruct . --neighbors 99999999999", "reconstruct.neighbors must be at most 1000, got 99999999999"),
        ("match L R -o ''", "the value after -o is empty: give one"),
        ("match L R --out=", "--out is empty: give one"),
        ("match L ''", "is empty: give one"),
        ("'' L", "the first argument is empty: give one"),
        ("match L R --weights-dir ''", "the value after --weights-dir is empty"),
        ("weights list --weights-dir ''", "the value after --weights-dir is empty"),
        ("match L LONG", "File name too long"),
        ("match L R -o LONG", "the name is too long; give a shorter one"),
        ("match L R -o new/LONG/out", "the name is too long; give a shorter one"),
        ("match L R --config LONG", "File name too long"),
        ("match L R --weights-dir LONG", "too long for a file"),
        ("pose L R --K LONG", "is neither a file nor fx,fy,cx,cy"),
        ("cloud LONG", "is not a folder"),
        ("reconstruct LONG", "not there: check the path"),
        ("reconstruct . -o LONG", "the name is too long"),
        ("eval pairs --root LONG", "is not a folder"),
    ],
)
def test_options_are_refused_before_any_work(
    words: str, message: str, run: Run, pair: Pair, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def load(*_: object) -> None:
        raise AssertionError("networks were loaded")

    monkeypatch.setattr("zpm2.guided.regions.RegionFinder.load", load)
    monkeypatch.chdir(tmp_path)
    for k, path in enumerate((pair.left, pair.right)):
        (tmp_path / f"{k}.png").write_bytes(path.read_bytes())
    before = set(tmp_path.rglob("*"))
    named = {"L": "0.png", "R": "1.png"}
    code, out, err = run(*(named.get(word, word).replace("LONG", LONG) for word in shlex.split(words)))
    assert (code, out, err.count("\n")) == (2, "", 1), err
    assert message in err
    assert set(tmp_path.rglob("*")) == before
