"""The paper's tables: what is run for each, and that each figure lands in its column."""

import json
from pathlib import Path

import pytest
from rendered import Pair, Run
from result_files import dataset

from zpm2.api import METHODS
from zpm2.config import assign, preset
from zpm2.errors import ConfigError, InputError, WeightsError
from zpm2.evaluate import published, report, table_run
from zpm2.evaluate.run import Evaluation
from zpm2.evaluate.tables import TABLES, here
from zpm2.files.writing import atomic_write, claim
from zpm2.pipeline import PairMatcher
from zpm2.segment.given.precomputed import PrecomputedSegmenter

SUMMARY = {
    "matches": 31.5, "seconds": 12.25, "s_global": 0.75, "good": 77, "P": 0.911, "R": 0.822, "F1": 0.864,
    "MAS40": 0.941, "MAS50": 0.932, "MAS80": 0.873, "ACR": 0.984, "AOR": 0.655, "CCR": 0.766, "CCR5": 0.377,
    "P_paper": 0.511, "R_paper": 0.522, "F1_paper": 0.533, "ACR_paper": 0.544, "AUC5": 0.151, "AUC10": 0.262,
    "AUC20": 0.373, "pairs": 4, "done": 3, "peak_mb": 2000, "s_detect": 9.5, "s_local": 0.125, "s_points": 2.5,
    "AUC5_points": 0.141, "AUC10_points": 0.252, "AUC20_points": 0.363,
}  # fmt: skip
FIGURES = {
    1: {"MAS40": 94.1, "MAS50": 93.2, "MAS80": 87.3, "matches": 31.5, "seconds": 12.25},
    2: {"recall": 52.2, "precision": 51.1, "F1": 0.533, "ACR": 54.4},
    3: {"recall": 82.2, "precision": 91.1, "F1": 0.864, "seconds": 12.25},
    4: {"seconds": 12.25, "global stage s": 0.75, "ACR": 98.4, "matches": 31.5},
    5: {"ACR": 54.4, "matches": 31.5, "seconds": 12.25, "good": 77, "P": 91.1},
    6: {"AUC@5": 15.1, "AUC@10": 26.2, "AUC@20": 37.3},
}
PUBLISHED = (
    published.MATCHING, published.DISCRETE, published.SAM_SIZES,
    published.LARGE_FORMAT, published.ABLATION, published.POSE,
)  # fmt: skip


@pytest.fixture
def runs(monkeypatch) -> list:
    """The evaluations that a table starts, none of which is run, with their folders."""
    started: list = []
    monkeypatch.setattr(Evaluation, "pairs", lambda self: [])
    monkeypatch.setattr(Evaluation, "run", lambda self, out, **_: started.append((self, Path(out))) or [])
    monkeypatch.setattr(report, "summary", lambda rows: SUMMARY)
    return started


def rows(folder: Path) -> list[dict]:
    return json.loads((folder / "table.json").read_text())["rows"]


@pytest.mark.parametrize("number", TABLES)
def test_published_rows_stand_beside_measured_ones(number: int, runs, tmp_path):
    text = table_run.run_table(Evaluation("pairs", "DIR", limit=3), number, tmp_path)
    printed = [row for row in rows(tmp_path) if row["source"].startswith("published")]
    measured = [row for row in rows(tmp_path) if row["source"] == "measured, 3 of 4 pairs"]
    assert len(printed) == len(PUBLISHED[number - 1])
    assert len(measured) == len(TABLES[number].lines)
    for name, value in FIGURES[number].items():
        assert measured[0][name] == pytest.approx(value), name
    assert all(evaluation.limit == 3 and evaluation.root == "DIR" for evaluation, _ in runs)
    assert len({out for _, out in runs}) == len(runs)
    assert {out.name for _, out in runs} < set(table_run.file_names(number))
    assert text in (tmp_path / "table.md").read_text()
    assert all(row["method"] in text for row in printed + measured)


def test_the_second_view_of_a_run(runs, tmp_path):
    table_run.run_table(Evaluation("sceneflow", "DIR"), 2, tmp_path)
    assert len(runs) == 1
    printed, first, second = rows(tmp_path)
    assert printed["recall"] == 72.67  # of SceneFlow alone
    assert (first["recall"], second["recall"]) == (pytest.approx(52.2), pytest.approx(82.2))
    table_run.run_table(Evaluation("scannet1500", "DIR"), 6, tmp_path / "pose")
    assert rows(tmp_path / "pose")[7]["AUC@5"] == pytest.approx(14.1)


def test_ablations_run_on_the_same_polygons(runs, tmp_path):
    table_run.run_table(Evaluation("sceneflow", "DIR", config=preset("paper")), 5, tmp_path)
    base, *others = [evaluation for evaluation, _ in runs]
    assert base.regions is None
    assert base.config == preset("paper")
    assert [evaluation.regions for evaluation in others] == [runs[0][1]] * 3
    fixed, greedy = "global_match.search=fixed", "local_match.assign=greedy"
    wanted = [assign(preset("paper"), words) for words in ([fixed], [greedy], [fixed, greedy])]
    assert [evaluation.config for evaluation in others] == wanted


def test_every_method_is_in_the_first_table():
    assert {line.method for line in TABLES[1].lines} == set(METHODS)


def test_what_there_is_of_a_published_row():
    assert here(TABLES[6], "SP + SGMNet") == "would need the matcher SGMNet and its weights"
    assert here(TABLES[6], "SiLK") == "would need the detector SiLK and its weights"
    assert here(TABLES[6], "MESA + LoFTR") == "see: MESA, our implementation, LoFTR"
    assert here(TABLES[5], "w/o LoJoGM and pyramid") == "see: zpm2 w/o both"
    assert here(TABLES[1], "MESA, SceneFlow") == "see: MESA, our implementation"
    for number, table in TABLES.items():
        for row in table.printed:
            assert here(table, row[1]) != "published only", (number, row)


def test_a_line_that_cannot_be_run_says_why(monkeypatch, runs, tmp_path):
    def refuse(self, out, **_):
        if self.config.points.methods == ("loftr-outdoor",):
            raise WeightsError("the weights of loftr cannot be had")
        return []

    monkeypatch.setattr(Evaluation, "run", refuse)
    told: list[str] = []
    text = table_run.run_table(Evaluation("sceneflow", "DIR"), 1, tmp_path, told.append)
    (line,) = (row for row in rows(tmp_path) if row["method"] == "zpm2, LoFTR")
    assert line["source"] == "not run: the weights of loftr cannot be had"
    assert line["MAS50"] is None
    assert told == ["zpm2, LoFTR: the weights of loftr cannot be had"]
    assert text.count("measured, 3 of 4 pairs") == len(TABLES[1].lines) - 1


def test_a_data_set_that_cannot_be_read_is_no_matter_of_a_line(tmp_path):
    with pytest.raises(InputError, match="is not a folder"):
        table_run.run_table(Evaluation("pairs", tmp_path / "none"), 1, tmp_path / "out")
    with pytest.raises(ConfigError, match="the paper has no table 7: its tables are 1, 2, 3, 4, 5, 6"):
        table_run.run_table(Evaluation("pairs", tmp_path), 7, tmp_path / "out")


def test_the_command_line(pair: Pair, runs, run: Run, tmp_path):
    root = dataset(pair, tmp_path / "data")
    words = ["eval", "pairs", "--root", root, "-o", tmp_path / "out", "--table", "5", "--preset", "paper"]
    code, out, err = run(*words)
    assert code == 0, err
    assert "| zpm2 w/o pyramid |" in out
    assert (tmp_path / "out" / "table.md").exists()
    code, _, err = run(*words, "--method", "vote")
    assert code == 2
    assert "--table runs the methods of that table: leave out --method" in err
    assert run(*words[:-4], "--table", "9").code == 2


def test_a_table_goes_on_where_it_stopped(pair: Pair, runs, run: Run, tmp_path, monkeypatch):
    """What lines have left stays, and is no one else's."""

    def leave(self, out, **_):
        atomic_write(claim(Path(out), ["run.json"]) / "run.json", "{}")
        runs.append((self, out))
        if len(runs) == 2:
            raise KeyboardInterrupt
        return []

    monkeypatch.setattr(Evaluation, "run", leave)
    root = dataset(pair, tmp_path / "data")
    words = ["eval", "pairs", "--root", root, "-o", tmp_path / "out", "--table", "5"]
    assert run(*words).code == 130
    assert (tmp_path / "out" / "zpm2" / "run.json").exists()
    code, _, err = run(*words)
    assert code == 0, err
    assert (tmp_path / "out" / "zpm2" / "run.json").exists()
    assert len(rows(tmp_path / "out")) == 8


def test_real_lines_are_run_once(pair: Pair, run: Run, tmp_path, monkeypatch):
    regions = PrecomputedSegmenter(pair.left_regions), PrecomputedSegmenter(pair.right_regions)
    matched = []

    def matcher(method, config, kept):
        match = PairMatcher(config, segmenter=regions)
        return lambda asked: matched.append(asked.name) or match(asked.left, asked.right)

    monkeypatch.setattr("zpm2.evaluate.run._matcher", matcher)
    words = ["eval", "pairs", "--root", dataset(pair, tmp_path / "data"), "-o", tmp_path / "out", "--table", "5"]
    words += ["--preset", "paper", "--set", "points.methods=sift", "--set", "device=cpu"]
    first, again = run(*words), run(*words)
    assert (first.code, again.code) == (0, 0), first.err + again.err
    assert matched == ["a/good"] * 4
    assert first.out == again.out
    ours, *others = (row for row in rows(tmp_path / "out") if row["source"] == "measured, 1 of 1 pairs")
    assert ours["P"] > 90
    assert all(row["ACR"] is not None for row in others)
