"""A command that was killed, and started again, leaves what it would have left."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from bench import HIDDEN, Bench, Stop, differences, half, same
from commands import READ_ONLY, Case, cases, names_of_commands

QUICK = ("match in tiles", "weights get")  # more, and all others: long.py


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, list[Case]]]:
    folder = tmp_path_factory.mktemp("kills")
    with cases(folder, ready=False) as found:
        yield folder, found


@pytest.mark.parametrize("name", QUICK)
def test_killed_and_started_again(name: str, known: tuple[Path, list[Case]]) -> None:
    bench = Bench(next(case for case in known[1] if case.name == name), known[0])
    try:
        assert bench.reference() == []
        assert bench.trial(0) == []
    finally:
        bench.clear()


def test_every_command_is_killed_or_writes_nothing(known: tuple[Path, list[Case]]) -> None:
    """A new command is put into `commands.py`, or on its list of those that only print."""
    names = sorted(names_of_commands(), key=len, reverse=True)
    killed = {next(name for name in names if " ".join(case.words).startswith(name)) for case in known[1]}
    assert killed | set(READ_ONLY) == set(names)
    assert not killed & set(READ_ONLY)


def test_what_may_differ_is_what_a_run_took_and_nothing_else(tmp_path: Path) -> None:
    texts = {
        "matches.json": '{"timings": {"read": %s}, "notes": ["%s"]}',
        "rows.csv": "pair,s_read,peak_mb\n%s,%s,1\n",
        "summary.md": "# pairs\n\n| figure | value |\n| --- | ---: |\n| seconds | %s |\n| P | %s |\n",
        "left.geojson": '{"timings": %s, "a": "%s"}',
    }
    for name, text in texts.items():
        cost, content = (0, 1) if name != "rows.csv" else (1, 0)
        for place in (cost, content):
            values = ["1", "1"]
            one, other = tmp_path / name, tmp_path / f"other-{name}"
            one.write_text(text % tuple(values))
            values[place] = "2"
            other.write_text(text % tuple(values))
            assert same(one, other) is (place == cost and name != "left.geojson")


def test_what_is_wrong_is_seen(tmp_path: Path) -> None:
    alone, again = tmp_path / "alone", tmp_path / "again"
    for folder in (alone, again):
        folder.mkdir()
        (folder / "a.json").write_text("{}")
    assert differences(alone, again) == []
    (alone / "b.png").write_bytes(b"whole")
    (again / "b.png").write_bytes(b"who")
    (again / "c.tmp").write_text("")
    (again / HIDDEN / "parts" / "1-x.part").mkdir(parents=True)
    found = ["c.tmp is there", "b.png differs", f"left behind: {HIDDEN}/parts/1-x.part"]
    assert differences(alone, again) == found
    assert sorted(half(alone, again)) == ["b.png differs", "c.tmp is there"]


def test_a_stop_says_when() -> None:
    assert str(Stop(signal.SIGKILL, change=3)) == "SIGKILL before change 3"
