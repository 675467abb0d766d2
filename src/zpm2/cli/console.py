"""What a person sees of a run: progress, interrupts, and what becomes of the output folder."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from time import monotonic
from types import FrameType

from zpm2.errors import ConfigError

EVERY = 30.0  # seconds between lines of progress where the error stream is no terminal
VARIABLE = "ZPM2_PROGRESS"  # of the environment: other seconds, for programs that show the progress (qgis/)


@contextmanager
def bars(silent: bool) -> Iterator[tuple[Callable[[str, float], None], Callable[[str], None]]]:
    """How far each stage is: a bar on stderr, or a line now and then where that is no terminal. Gives a function of a
    stage and its share, and one that prints a line; both do nothing when `silent`."""
    if silent:
        yield lambda stage, share: None, lambda text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    say = partial(console.print, markup=False, emoji=False, highlight=False, soft_wrap=True)
    if not console.is_terminal:
        with lines() as tell:
            yield tell, say
        return
    columns = TextColumn("{task.description:<8}", markup=False), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as shown:
        tasks: dict[str, TaskID] = {}

        def progress(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = shown.add_task(stage, total=1.0)
            shown.update(tasks[stage], completed=share)

        yield progress, say


@contextmanager
def lines() -> Iterator[Callable[[str, float], None]]:
    """How far a long run is: a line on stderr every `EVERY` seconds, or as often as `VARIABLE` says. Gives a function
    of a stage and its share. `ConfigError`."""
    start, last, over, every = monotonic(), ("start", 0.0), threading.Event(), _seconds()
    unfinished: dict[str, float] = {}  # one stage may lie in another, as those of a tile do; the newest is told

    def tell() -> None:
        while not over.wait(every):
            stage, share = next(reversed(list(unfinished.items())), last)
            print(f"{stage}: {share:.0%}, {monotonic() - start:.0f} s", file=sys.stderr, flush=True)

    def progress(stage: str, share: float) -> None:
        nonlocal last
        last = stage, share
        unfinished.pop(stage, None)
        if share < 1:
            unfinished[stage] = share

    voice = threading.Thread(target=tell, daemon=True)
    voice.start()
    try:
        yield progress
    finally:
        over.set()
        voice.join()


def _seconds() -> float:
    given = os.environ.get(VARIABLE, "")
    if not given:
        return EVERY
    try:
        seconds = float(given)
    except ValueError:
        seconds = 0.0
    if not 0.01 <= seconds <= 86_400:
        raise ConfigError(f"{VARIABLE}={given}: give the seconds between two lines of progress, from 0.01 to 86400")
    return seconds


@contextmanager
def fresh_folder(out: Path, *inputs: Path | None, names: Iterable[str] = (), kept: str = "") -> Iterator[Path]:
    """The output folder (`files.writing.results_folder`): in it only what a run made is replaced, and it is removed
    where a run creates it and ends early without having written anything. An interrupt says what stays.

    names: of the files and folders that the command may write there. kept: the path in it where an interrupted run
    leaves its work for the next one.
    """
    from zpm2.files.record import HIDDEN
    from zpm2.files.writing import results_folder

    try:
        with results_folder(out, names, [path for path in inputs if path is not None]):
            yield out
    except KeyboardInterrupt as stop:
        if kept and any((out / kept).glob("*")):
            stop.add_note(f"what is finished is kept in {out / kept}: run the same command again to go on")
        else:
            stop.add_note(f"what was finished stays in {out}" if (out / HIDDEN).exists() else "nothing was written")
        raise


class Interrupted(Exception):
    """A run was interrupted; the text says what stays, from the notes of the `KeyboardInterrupt`."""

    def __init__(self, stop: KeyboardInterrupt) -> None:
        super().__init__("; ".join(["interrupted", *dict.fromkeys(getattr(stop, "__notes__", []))]))


@contextmanager
def terminable() -> Iterator[None]:
    """SIGTERM ends the run as Ctrl-C does, so that it cleans up and says what stays."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def warn(texts: Iterable[str]) -> None:
    """Prints warnings on stderr, a line each."""
    for text in texts:
        print(f"warning: {text}", file=sys.stderr)
