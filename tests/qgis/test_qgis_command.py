"""The command as QGIS runs it, with a stand-in for QgsProcessingFeedback and for zpm2."""

import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from zpm2_processing import command
from zpm2_processing.command import Canceled, CommandError, Told, environment, find, run


@dataclass
class Feedback:
    """What QGIS is told."""

    said: list[tuple[str, object]] = field(default_factory=list)

    def isCanceled(self) -> bool:
        return False

    def setProgress(self, progress: float) -> None:
        self.said.append(("progress", progress))

    def setProgressText(self, text: str) -> None:
        self.said.append(("stage", text))

    def pushInfo(self, info: str) -> None:
        self.said.append(("info", info))

    def pushWarning(self, warning: str) -> None:
        self.said.append(("warning", warning))

    def pushCommandInfo(self, info: str) -> None:
        self.said.append(("command", info))


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_the_command_is_the_one_of_the_settings_or_on_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CommandError, match=r"not found on PATH. Install zpm2 .* Settings > Options > Processing"):
        find("")
    with pytest.raises(CommandError, match="not found at /nowhere/zpm2"):
        find("/nowhere/zpm2")
    name = "zpm2.exe" if sys.platform == "win32" else "zpm2"
    for folder in (tmp_path, tmp_path / "other"):
        folder.mkdir(exist_ok=True)
        (folder / name).touch(0o755)
    assert find("") == str(tmp_path / name)
    assert find(f" {tmp_path / 'other' / name} ") == str(tmp_path / "other" / name)


def test_what_qgis_sets_for_its_own_python_is_left_out() -> None:
    given = {"PYTHONHOME": "/qgis", "PYTHONPATH": "/qgis", "PROJ_LIB": "/qgis", "HOME": "/home/me"}
    made = environment(given)
    assert not set(command.OF_QGIS) & set(made)
    assert made["HOME"] == "/home/me"
    assert made["ZPM2_PROGRESS"] == "1"


def test_lines_are_progress_warnings_errors_or_information() -> None:
    feedback = Feedback()
    told = Told(feedback)
    for line in ["points: 0%, 1 s", "points: 40%, 2 s", "", "warning: few points", "2 matches", "zpm2: it is full"]:
        told.line(line)
    assert feedback.said == [
        ("stage", "points"),
        ("progress", 0.0),
        ("progress", 40.0),
        ("warning", "few points"),
        ("info", "2 matches"),
    ]
    assert told.reason == "it is full"


def test_a_run_tells_what_it_says_and_ends_at_100() -> None:
    feedback = Feedback()
    run(python("print('a ä b')"), feedback)
    assert feedback.said[1:] == [("info", "a ä b"), ("progress", 100.0)]


def test_the_one_line_of_a_failed_run_is_the_error() -> None:
    code = "import sys; print('zpm2: no such file', file=sys.stderr); sys.exit(2)"
    with pytest.raises(CommandError, match=r"^no such file$"):
        run(python(code), Feedback())
    with pytest.raises(CommandError, match="code 3 and said nothing"):
        run(python("raise SystemExit(3)"), Feedback())
    with pytest.raises(CommandError, match="cannot be started"):
        run([str(Path(__file__).parent)], Feedback())


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_cancel_ends_the_command_and_what_it_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "GRACE", 0.3)
    monkeypatch.setattr(command, "POLL", 0.05)
    child = f"import os, time; open({str(tmp_path / 'child')!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    code = (  # deaf to the first signal, as is its child
        "import signal, subprocess, sys, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        f"subprocess.Popen([sys.executable, '-c', {child!r}])\n"
        "time.sleep(60)"
    )
    feedback = Feedback()
    ready = tmp_path / "child"
    feedback.isCanceled = lambda: ready.exists() and ready.read_text() != ""  # type: ignore[method-assign]
    start = time.monotonic()
    with pytest.raises(Canceled):
        run(python(code), feedback)
    assert time.monotonic() - start < 20
    for _ in range(100):  # the child's parent is gone: whoever has it now collects it
        if not _runs(int(ready.read_text())):
            return
        time.sleep(0.05)
    pytest.fail("the child still runs")


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_an_interrupt_of_the_reader_ends_the_command() -> None:
    feedback = Feedback()

    def stop(info: str) -> None:
        raise KeyboardInterrupt

    feedback.pushInfo = stop  # type: ignore[method-assign]
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run(python("import time; print('begun', flush=True); time.sleep(60)"), feedback)
    assert time.monotonic() - start < 20
