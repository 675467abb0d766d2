"""The installed zpm2 command as a process of its own: its progress, its warnings, its error, and how to stop it.

Nothing here needs QGIS. `Feedback` is what it reads of a QgsProcessingFeedback.
"""

from __future__ import annotations

import contextlib
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import IO

WINDOWS = sys.platform == "win32"
PROGRESS = re.compile(r"(?P<stage>.+): (?P<percent>\d+)%, \d+ s")  # a line of `zpm2.cli.console.lines`
WARNING, ERROR = "warning: ", "zpm2: "
POLL, GRACE = 0.2, 10.0  # seconds: between two looks at the button Cancel; for the command to end by itself
# QGIS sets these for its own Python and its own GDAL; those of zpm2 are others
OF_QGIS = ("PYTHONHOME", "PYTHONPATH", "GDAL_DATA", "GDAL_DRIVER_PATH", "PROJ_DATA", "PROJ_LIB")
NOT_FOUND = (
    "The command zpm2 was not found{where}. Install zpm2 (docs/install.md), then set the path of the command in "
    "Settings > Options > Processing > Providers > zpm2"
)


class Feedback(Protocol):
    """The part of QgsProcessingFeedback that is used."""

    def isCanceled(self) -> bool: ...
    def setProgress(self, progress: float) -> None: ...
    def setProgressText(self, text: str) -> None: ...
    def pushInfo(self, info: str) -> None: ...
    def pushWarning(self, warning: str) -> None: ...
    def pushCommandInfo(self, info: str) -> None: ...


class CommandError(Exception):
    """The command is not there, or failed; the text is the line that it ended with."""


class Canceled(Exception):
    """The user has stopped the command, and it has ended."""


def find(setting: str) -> str:
    """The path of the command: that of the settings, else the one on PATH. `CommandError`."""
    found = shutil.which(os.path.expanduser(setting.strip()) or "zpm2")
    if found is None:
        raise CommandError(NOT_FOUND.format(where=f" at {setting}" if setting.strip() else " on PATH"))
    return found


def environment(of: Mapping[str, str]) -> dict[str, str]:
    """The command's environment: without what QGIS sets for itself, with progress every second, and UTF-8."""
    kept = {name: value for name, value in of.items() if name not in OF_QGIS}
    return {**kept, "ZPM2_PROGRESS": "1", "PYTHONUNBUFFERED": "1", "PYTHONUTF8": "1", "COLUMNS": "120", "NO_COLOR": "1"}


def run(words: Sequence[str], feedback: Feedback) -> None:
    """Runs the command to its end, and tells `feedback` what it says. `CommandError`, `Canceled`.

    If the user cancels, the command and all processes that it started are asked to end, as with Ctrl-C, and are ended
    if they do not.
    """
    feedback.pushCommandInfo(" ".join(f'"{word}"' if " " in word else word for word in words))
    try:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment(os.environ),
            encoding="utf-8",
            errors="replace",
            start_new_session=not WINDOWS,
            creationflags=subprocess.CREATE_NO_WINDOW if WINDOWS else 0,
        )
    except OSError as error:
        raise CommandError(f"The command {words[0]} cannot be started: {error.strerror or error}") from error
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    assert process.stdout is not None
    reader = threading.Thread(target=_read, args=(process.stdout, lines), daemon=True)
    reader.start()
    told = Told(feedback)
    try:
        while not feedback.isCanceled():
            try:
                line = lines.get(timeout=POLL)
            except queue.Empty:
                continue
            if line is None:  # the end of what it says
                process.wait()
                break
            told.line(line)
        else:
            raise Canceled
    except BaseException:
        stop(process)
        raise
    if process.returncode != 0:
        raise CommandError(told.reason or f"zpm2 ended with code {process.returncode} and said nothing")
    feedback.setProgress(100.0)


class Told:
    """Passes what the command says on to QGIS, line by line."""

    def __init__(self, feedback: Feedback) -> None:
        self.feedback = feedback
        self.stage = ""
        self.reason = ""  # the last line that may be why the command ends

    def line(self, text: str) -> None:
        """Progress, a warning, an error, or anything else."""
        progress = PROGRESS.fullmatch(text)
        if progress:
            if progress["stage"] != self.stage:
                self.stage = progress["stage"]
                self.feedback.setProgressText(self.stage)
            self.feedback.setProgress(float(progress["percent"]))
        elif text.startswith(WARNING):
            self.feedback.pushWarning(text[len(WARNING) :])
        elif text.strip():
            self.reason = text.removeprefix(ERROR)
            if not text.startswith(ERROR):  # the algorithm ends with the error, which QGIS shows
                self.feedback.pushInfo(text)


def stop(process: subprocess.Popen[str]) -> None:
    """Ends the process and those that it started: first as with Ctrl-C, after `GRACE` at once (on Windows, where a
    process without a console gets no signal, always at once; zpm2 goes on from there all the same)."""
    if WINDOWS:
        subprocess.run(["taskkill", "/F", "/T", "/PID", str(process.pid)], check=False, capture_output=True)
        process.wait()
        return
    _signal_group(process, signal.SIGTERM)
    _ended(process, GRACE)
    _signal_group(process, signal.SIGKILL)
    process.wait()


def _signal_group(process: subprocess.Popen[str], number: int) -> None:
    with contextlib.suppress(ProcessLookupError):  # all have ended
        os.killpg(process.pid, number)  # the group has the number of the process (start_new_session)


def _read(pipe: IO[str], lines: queue.SimpleQueue[str | None]) -> None:
    with pipe:
        for line in pipe:
            lines.put(line.rstrip("\n"))
    lines.put(None)


def _ended(process: subprocess.Popen[str], seconds: float) -> bool:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        return False
    return True
