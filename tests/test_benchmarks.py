"""The schema of the JSON that all benchmarks write."""

import json
import os
import platform
import re
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
import document  # noqa: E402


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
