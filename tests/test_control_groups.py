"""Quotas of processor time, as Linux shows them."""

import math
from pathlib import Path

import pytest

from zpm2 import control_groups, cores

V1, V2 = ("cpu.cfs_quota_us", "cpu.cfs_period_us"), ("cpu.max",)


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in place of where control groups are mounted; `listed` in it says in which we are."""
    monkeypatch.setattr(control_groups, "_MOUNTED", tmp_path)
    monkeypatch.setattr(control_groups, "_LISTED", tmp_path / "listed")
    return tmp_path


def group(folder: Path, names: tuple[str, ...], text: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, line in zip(names, text.split("\n"), strict=True):
        (folder / name).write_text(line + "\n")


@pytest.mark.parametrize(
    ("listed", "folder", "names", "text", "expected"),
    [
        ("0::/a/b", "a/b", V2, "400000 100000", 4.0),
        ("0::/a/b", "a", V2, "150000 100000", 1.5),  # of a group that ours is in
        ("0::/a/b", "a/b", V2, "max 100000", math.inf),
        ("0::/a/b", "a/c", V2, "100000 100000", math.inf),  # not ours
        ("0::/a/b", "a/b", V2, "", math.inf),
        ("0::/a/b", "a/b", V2, "all 100000", math.inf),
        ("0::/a/b", "a/b", V2, "100000 0", math.inf),
        ("of no form", "", V2, "100000 100000", math.inf),
        ("0::/", "", V2, "200000 100000", 2.0),  # as a container sees it
        ("2:cpu:/a\n0::/", "cpu/a", V1, "50000\n100000", 0.5),
        ("2:cpu,cpuacct:/a", "cpu,cpuacct/a", V1, "300000\n100000", 3.0),
        ("2:cpu,cpuacct:/docker/12ab", "cpu,cpuacct", V1, "300000\n100000", 3.0),  # mounted elsewhere than listed
        ("2:cpu:/a", "cpu/a", V1, "-1\n100000", math.inf),
        ("3:cpuset:/a", "cpuset/a", V1, "100000\n100000", math.inf),  # another kind
    ],
)
def test_a_quota_is_read(
    system: Path, listed: str, folder: str, names: tuple[str, ...], text: str, expected: float
) -> None:
    (system / "listed").write_text(listed + "\n")
    group(system / folder, names, text)
    assert control_groups.quota() == expected


def test_the_lowest_quota_counts(system: Path) -> None:
    (system / "listed").write_text("0::/a/b\n")
    for folder, time in (("a/b", 400), ("a", 200), ("", 300)):
        group(system / folder, V2, f"{time} 100")
    assert control_groups.quota() == 2


def test_there_is_no_quota_where_the_system_has_no_control_groups(system: Path) -> None:
    assert control_groups.quota() == math.inf


@pytest.mark.parametrize(
    ("quota", "threads", "expected"),
    [(math.inf, "", None), (0.2, "", 1), (1.0, "", 1), (2.5, "", 3), (2.5, "5", 5), (math.inf, "5", 5), (1.0, "0", 1)],
)
def test_threads_use_up_a_quota_unless_told_how_many(
    monkeypatch: pytest.MonkeyPatch, quota: float, threads: str, expected: int | None
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    monkeypatch.setattr(cores, "quota", lambda: quota)
    cores._quota.cache_clear()
    try:
        assert cores.told() == expected
        assert 1 <= cores.usable() <= (expected or 10**6)
    finally:
        monkeypatch.undo()
        cores._quota.cache_clear()
