"""The budget of memory: sizes in words, what is free, what is refused."""

import math
import platform
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2 import control_groups, memory
from zpm2.errors import ConfigError, InputError


@pytest.mark.parametrize(
    ("text", "expected"),
    [("8GB", 8e9), ("512MB", 512e6), ("7.5 GiB", 7.5 * 2**30), ("100kb", 1e5), ("2TB", 2e12), ("none", math.inf)],
)
def test_sizes(text: str, expected: float) -> None:
    assert memory.size(text) == expected


@pytest.mark.parametrize("text", ["8", "GB", "-1GB", "0GB", "1e3GB", "8 G B", "nan", "", "8GB\n", "9" * 5000 + "GB"])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="is not a size: give a number with a unit"):
        memory.size(text)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library frees its memory itself")
def test_freed_memory_is_given_back() -> None:
    pieces = [b"." * 100_000 for _ in range(2000)]  # 200 MB: each below the size that is mapped by itself
    kept = pieces[::20]  # between what is freed
    full = memory._own()
    del pieces
    memory.give_back()
    assert full - memory._own() > 150e6
    assert len(kept) == 100


@given(st.integers(1, 10**6), st.sampled_from(sorted(memory.UNITS)))
def test_words_are_read_back_nearly(number: int, unit: str) -> None:
    bytes_ = number * memory.UNITS[unit]
    if bytes_ >= 1e6:
        assert memory.size(memory.in_words(bytes_)) == pytest.approx(bytes_, rel=0.05)


def test_the_default_is_a_share_of_what_is_free() -> None:
    assert 0 < memory.budget() < math.inf
    assert memory.size("auto") == pytest.approx(memory.FREE_SHARE * (memory.free() + memory._own()), rel=0.2)


def test_a_control_group_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for kind, group, names in (
        ("", "a/b", ("memory.max", "memory.current", "inactive_file")),
        ("memory", "c", ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")),
    ):
        folder = tmp_path / kind / group
        folder.mkdir(parents=True)
        (folder / names[0]).write_text("1000000\n")
        (folder / names[1]).write_text("700000\n")
        (folder / "memory.stat").write_text(f"cache 5\n{names[2]} 200000\n")
    (tmp_path / "a" / "memory.max").write_text("max\n")
    (tmp_path / "a" / "memory.current").write_text("900000\n")
    (tmp_path / "a" / "memory.stat").write_text("")
    listed = tmp_path / "listed"
    listed.write_text("4:memory:/c\n2:cpu:/x\n0::/a/b\n")
    monkeypatch.setattr(control_groups, "_MOUNTED", tmp_path)
    monkeypatch.setattr(control_groups, "_LISTED", listed)
    assert sorted(memory._free_of_groups()) == [500_000, 500_000]
    assert memory.free() == 500_000


def test_the_budget_ends_with_its_block() -> None:
    with memory.within("1GB"):
        assert memory.budget() == 1e9
        with memory.reserved(4e8), memory.reserved(1e8):
            assert memory.budget() == 5e8
        memory.limit("3GB")
        assert memory.budget() == 3e9
    assert memory.budget() != 3e9


def test_a_refusal_names_need_budget_and_way_out() -> None:
    with memory.within("2GB"):
        memory.refuse_above(2e9, "this", "do that")
        with pytest.raises(InputError) as refused:
            memory.refuse_above(20.7e9, "this", "do that")
    said = "this needs about 20.7 GB of memory, the budget is 2.0 GB (--max-memory 2GB): do that"
    assert str(refused.value) == said
