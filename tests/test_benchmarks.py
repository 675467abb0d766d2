"""The scripts of the paper's tables: how they call `zpm2 eval`, and that each figure lands in its column.

And the schema of the JSON that all benchmarks write.
"""

import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
import document  # noqa: E402

# Stands for `zpm2`: notes its words and writes a summary in which every figure has a value of its own.
STAND_IN = """#!{python}
import json, pathlib, sys
words = sys.argv[1:]
out = pathlib.Path(words[words.index("-o") + 1])
out.mkdir(parents=True, exist_ok=True)
with open({log!r}, "a") as log:
    log.write(json.dumps(words) + "\\n")
(out / "summary.json").write_text(json.dumps({summary!r}))
"""
SUMMARY = {
    "matches": 31.5, "seconds": 12.25, "s_global": 0.75, "good": 77, "P": 0.911, "R": 0.822, "F1": 0.864,
    "MAS40": 0.941, "MAS50": 0.932, "MAS80": 0.873, "ACR": 0.984, "AOR": 0.655, "CCR": 0.766, "CCR5": 0.377,
    "P_paper": 0.511, "R_paper": 0.522, "F1_paper": 0.533, "ACR_paper": 0.544, "AUC5": 0.151, "AUC10": 0.262,
    "AUC20": 0.373, "pairs": 4, "done": 4, "peak_mb": 2000, "s_detect": 9.5, "s_local": 0.125, "s_points": 2.5,
    "AUC5_points": 0.141, "AUC10_points": 0.252, "AUC20_points": 0.363,
}  # fmt: skip


def run(script: str, tmp_path: Path, *words: str) -> tuple[str, list[list[str]]]:
    """What a table prints, and the words of each `zpm2 eval` that it started."""
    bin_, log = tmp_path / "bin", tmp_path / "log"
    bin_.mkdir()
    stand_in = bin_ / "zpm2"
    stand_in.write_text(STAND_IN.format(python=sys.executable, log=str(log), summary=SUMMARY))
    stand_in.chmod(0o755)
    environment = {**os.environ, "PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}"}
    command = [sys.executable, str(BENCHMARKS / script), *words, "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, [json.loads(line) for line in log.read_text().splitlines()]


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def rows(text: str, source: str) -> list[dict[str, str]]:
    lines = [line for line in text.splitlines() if line.startswith("|")]
    columns = cells(lines[0])
    found = [dict(zip(columns, cells(line), strict=True)) for line in lines[2:]]
    return [row for row in found if row["source"].startswith(source)]


TABLES = {
    "table_matching.py": ("SceneFlow=sceneflow:DIR", {"MAS40": 94.1, "MAS80": 87.3, "seconds": 12.25}),
    "table_discrete.py": ("SceneFlow=sceneflow:DIR", {}),
    "table_sam_size.py": ("SceneFlow=sceneflow:DIR", {}),
    "table_large_format.py": ("ISPRS=isprs:DIR", {"seconds": 12.25, "global stage s": 0.75, "ACR": 98.4}),
    "table_ablation.py": ("SceneFlow=sceneflow:DIR", {"ACR": 54.4, "good": 77, "P": 91.1}),
    "table_pose.py": ("ScanNet1500=scannet1500:DIR", {"AUC@5": 15.1, "AUC@10": 26.2, "AUC@20": 37.3}),
}


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a script with a shebang")
@pytest.mark.parametrize("script", TABLES)
def test_published_rows_stand_beside_measured_ones(script: str, tmp_path: Path) -> None:
    data, figures = TABLES[script]
    text, calls = run(script, tmp_path, "--data", data, "--limit", "3")
    measured, published = rows(text, "measured"), rows(text, "published")
    assert published
    assert measured
    assert all(words[:4] == ["eval", data.split("=")[1].split(":")[0], "--root", "DIR"] for words in calls)
    assert all(words[-2:] == ["--limit", "3"] for words in calls)
    assert len({words[words.index("-o") + 1] for words in calls}) == len(calls)
    for name, value in figures.items():
        assert float(measured[0][name]) == pytest.approx(value, rel=0.006), name


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a script with a shebang")
def test_ablations_run_on_the_same_polygons(tmp_path: Path) -> None:
    _, calls = run("table_ablation.py", tmp_path, "--data", "X=sceneflow:DIR")
    first = calls[0][calls[0].index("-o") + 1]
    assert "--regions" not in calls[0]
    assert [words[words.index("--regions") + 1] for words in calls[1:]] == [first] * 3
    settings = [[w for w in words if w.startswith(("global_match", "local_match"))] for words in calls]
    fixed, greedy = "global_match.search=fixed", "local_match.assign=greedy"
    assert settings == [[], [fixed], [greedy], [fixed, greedy]]


@pytest.mark.parametrize("data", ["SceneFlow", "SceneFlow=sceneflow", "=sceneflow:DIR"])
def test_a_data_set_that_is_not_spelt_out_is_one_line(data: str, tmp_path: Path) -> None:
    command = [sys.executable, str(BENCHMARKS / "table_pose.py"), "--data", data, "-o", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "expected NAME=KIND:FOLDER" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("file", sorted(BENCHMARKS.glob("*.json")), ids=lambda file: file.name)
def test_written_results_keep_the_schema(file: Path) -> None:
    document.check(json.loads(file.read_text()))


def test_a_document_is_stamped_and_keeps_the_schema() -> None:
    found = json.loads(document.text("zpm2-bench-toy/1", rows=[{"seconds": 1.5}]))
    document.check(found)
    assert found["rows"] == [{"seconds": 1.5}]
    assert found["environment"]["python"] == platform.python_version()
    assert found["environment"]["versions"]["numpy"] == np.__version__
    assert found["environment"]["machine"]["cores"] == os.cpu_count()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "pairs"}, "schema is 'pairs'"),
        ({"environment": None}, "environment is missing"),
        ({"environment": {"commit": "HEAD"}}, "commit is 'HEAD'"),
        ({"environment": {"commit": "0123abc", "python": "3.12", "versions": {}}}, "versions are missing"),
        ({"environment": {"commit": "0123abc", "versions": {"numpy": "2"}}}, "a version is no text"),
        ({"environment": {"commit": "0123abc", "python": "3", "versions": {"numpy": "2"}}}, "machine is missing"),
        ({"rows": "many"}, "rows are no rows"),
        ({"rows": None}, "rows are no rows"),
    ],
)
def test_other_documents_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        document.check({**document.stamped("zpm2-bench-toy/1", rows=[]), **change})
    with pytest.raises(ValueError, match="there is no content"):
        document.stamped("zpm2-bench-toy/1")


def test_every_script_that_writes_json_uses_the_stamp() -> None:
    """A document begins with its schema: only `document.py` writes that."""
    for script in BENCHMARKS.glob("*.py"):
        text = script.read_text()
        assert script.name == "document.py" or '"schema":' not in text, script.name
        names = re.findall(r"\bzpm2-bench-[a-z-]+/\d+", text)
        assert not names or "document." in text, script.name
