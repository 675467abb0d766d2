"""What the commands share: interrupts, lines without a terminal."""

import contextlib
import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from zpm2.cli.console import Interrupted, bars, fresh_folder, lines
from zpm2.errors import ConfigError
from zpm2.files.record import make_folder
from zpm2.files.writing import atomic_write


def stopped(*places: object) -> str:
    """What is said of an interrupt inside these context managers, the outermost first."""
    with pytest.raises(KeyboardInterrupt) as stop:
        enter(list(places))
    return str(Interrupted(stop.value))


def enter(places: list) -> None:
    if not places:
        raise KeyboardInterrupt
    with places[0]:
        enter(places[1:])


@contextlib.contextmanager
def making(out: Path) -> Iterator[None]:
    """A run that has finished a pair."""
    atomic_write(make_folder(out / "pairs") / "matches.json", "{}")
    yield


def test_an_interrupt_says_what_stays_and_what_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert stopped(fresh_folder(out)) == "interrupted; nothing was written"
    assert not out.exists()
    out.mkdir()
    assert stopped(fresh_folder(out)) == "interrupted; nothing was written"
    made = f"interrupted; what was finished stays in {out}"
    assert stopped(fresh_folder(out), making(out)) == made
    kept = f"interrupted; what is finished is kept in {out / 'pairs'}: run the same command again to go on"
    assert stopped(fresh_folder(out, names=["pairs"], kept="pairs"), making(out)) == kept


def test_texts_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    text = f"run[raw][/x] 12 {'long ' * 40}:warning:"
    with bars(False) as (_, say):
        say(text)
    assert capsys.readouterr().err == f"{text}\n"


def test_other_ends_leave_no_empty_folder(tmp_path: Path) -> None:
    for error in (MemoryError, RuntimeError):
        with pytest.raises(error), fresh_folder(tmp_path / "out"):
            raise error
        assert not (tmp_path / "out").exists()


def test_lines_come_now_and_then_and_stop_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = io.StringIO()
    monkeypatch.setattr(sys, "stderr", heard)
    monkeypatch.setattr("zpm2.cli.console.EVERY", 0.05)
    with lines() as progress:
        for k in range(200):  # as often as it likes
            progress("tiles", k / 200)
            time.sleep(0.001)
    said = heard.getvalue().splitlines()
    assert 1 <= len(said) <= 20
    assert all(line.startswith("tiles: ") for line in said)
    time.sleep(0.12)
    assert heard.getvalue().splitlines() == said


def test_a_stage_that_ends_gives_way_to_the_one_around_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ZPM2_PROGRESS", "0.02")
    with lines() as progress:
        for stage, share in (("tiles", 0.25), ("load", 0.0), ("load", 1.0)):
            progress(stage, share)
        heard = ""
        while not heard:
            time.sleep(0.01)
            heard = capsys.readouterr().err
    assert heard.startswith("tiles: 25%, ")


def test_programs_that_show_the_progress_say_how_often(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ZPM2_PROGRESS", "0.02")
    with lines() as progress:
        progress("points", 0.5)
        time.sleep(0.1)
    assert "points: 50%, 0 s\n" in capsys.readouterr().err
    for wrong in ("often", "0", "-1", "nan", "inf"):
        monkeypatch.setenv("ZPM2_PROGRESS", wrong)
        with pytest.raises(ConfigError, match=f"^ZPM2_PROGRESS={wrong}: give the seconds"), lines():
            pass


def test_a_short_run_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with lines() as progress:
        progress("points", 0.5)
    assert capsys.readouterr().err == ""
