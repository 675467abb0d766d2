"""CONTRIBUTING.md names files and folders that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "zpm2"
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    return TEXT.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def test_each_question_has_a_file() -> None:
    answers = [line.split("|")[2] for line in section("Where is it?").splitlines() if line.startswith("| ")][2:]
    assert len(answers) == 10
    for answer in answers:
        named = re.findall(r"`([\w/]+(?:\.py|/))`", answer)
        assert named, answer
        for name in named:
            assert (PACKAGE / name).exists(), name


def test_files_to_touch_exist() -> None:
    for name in re.findall(r"`([\w/]+(?:\.py|/))`", section("Adding things")):
        assert (PACKAGE / name).exists(), name


def test_the_tree_is_the_package() -> None:
    rooms = set(re.findall(r"^      ([\w.]+)/? ", section("The tree"), re.MULTILINE))
    hidden = {"__init__.py", "__main__.py", "py.typed"}
    there = {path.name for path in PACKAGE.iterdir() if path.name not in {"__pycache__", *hidden}}
    assert rooms == there
