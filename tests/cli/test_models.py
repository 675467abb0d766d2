"""The listing of models: what is known of each, what is here, and what one costs on this machine."""

import json
from pathlib import Path
from typing import Any

import pytest
from rendered import Run

from zpm2 import weights
from zpm2.evaluate import models
from zpm2.evaluate.datasets import DATASETS
from zpm2.features import METHODS
from zpm2.formats import registry
from zpm2.segment.registry import SEGMENTERS


def listed(run: Run, *words: object) -> list[dict[str, Any]]:
    code, out, _ = run("models", "--json", *words)
    assert code == 0
    found: list[dict[str, Any]] = json.loads(out)
    return found


def test_every_model_is_listed_with_its_facts(run: Run) -> None:
    found = listed(run)
    assert [row["name"] for row in found] == [*SEGMENTERS, *METHODS]
    for row in found:
        assert row["origin"] == "built in"
        assert row["task"]
        assert "unknown" not in (row["code_licence"], row["weights_licence"], row["training_data"])
        sizes = [weights.entry(name).size for name in row["weights"]]
        assert row["size"] == (sum(sizes) if all(sizes) else None)
        assert row["weights_licence"] != "none" or not row["weights"]
    assert "non-commercial" in {row["name"]: row for row in found}["superpoint"]["weights_licence"]


def test_what_is_missing_is_said_and_is_no_error(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path))
    monkeypatch.delenv("ZPM2_WEIGHTS", raising=False)
    assert [row["name"] for row in listed(run) if row["here"]] == ["classical", "sift"]
    code, out, err = run("models", "superpoint", "--measure")
    assert (code, err) == (0, "")
    assert "needs: zpm2 weights get superpoint --accept-licence" in out


def test_data_sets_and_formats_on_request(run: Run) -> None:
    found = [(row["kind"], row["name"]) for row in listed(run, "sift", "--all")]
    others = [("data set", name) for name in DATASETS] + [("format", name) for name in registry.names()]
    assert found == [("point matcher", "sift"), *others]
    assert "scannet1500" in run("models", "--all")[1]


def test_names_and_paths(run: Run) -> None:
    assert [row["name"] for row in listed(run, "zpm2.features.methods.sift:sift")] == [
        "zpm2.features.methods.sift:sift"
    ]
    assert run("models", "sfit")[2].startswith("zpm2: unknown model, data set or format 'sfit' (did you mean 'sift'?)")
    assert "json:dumps is no plug-in: give a class with the method segment or match" in run("models", "json:dumps")[2]


def test_a_model_is_measured_in_a_process_of_its_own(run: Run) -> None:
    (row,) = listed(run, "sift", "--measure")
    assert row["measured"]["found"] > 100
    assert row["measured"]["seconds"] > 0


def test_one_that_fails_says_why(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "failing_zpm2.py").write_text(
        "class Failing:\n    name = 'failing'\n    def segment(self, image):\n        raise OSError('no more')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    (row,) = models.rows(["failing_zpm2:Failing"])
    assert (row.origin, row.kind, row.here) == ("dotted path", "segmenter", True)
    measured = models.measure(row)
    assert measured.measured == "OSError: no more"
    monkeypatch.setattr(models, "measure", lambda asked: measured if asked == row else asked)  # it takes seconds
    code, _, err = run("models", "failing_zpm2:Failing", "--measure")
    assert (code, "warning: failing_zpm2:Failing was not measured: OSError: no more" in err) == (0, True)
