"""`zpm2 app` as a person runs it: in a process of its own, to its end."""

import http.client
import os
import signal
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from rendered import Run
from squares import save

pytest.importorskip("starlette", reason='needs pip install "zpm2[app]"')

PATIENCE = 60.0  # seconds


def started(folder: Path, *words: object) -> tuple[subprocess.Popen[str], str]:
    """The process, and the address that it printed. `folder` takes its temporary files."""
    options = ["--no-open", "--segmenter", "classical", "--points", "sift", "--device", "cpu"]
    done = subprocess.Popen(
        [sys.executable, "-m", "zpm2", "app", *map(str, words), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(folder)},
    )
    assert done.stdout is not None
    return done, done.stdout.readline().strip()


def get(address: str, path: str, headers: dict[str, str]) -> tuple[int, bytes]:
    where = urlsplit(address)
    connection = http.client.HTTPConnection(str(where.hostname), where.port, timeout=PATIENCE)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals to end a command with")
def test_ctrl_c_ends_it_quietly_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "scratch").mkdir()
    files = save(tmp_path / "in")
    done, address = started(tmp_path / "scratch", *files)
    assert address.startswith("http://127.0.0.1:")
    token = address.partition("#token=")[2]
    assert len(token) > 40
    assert get(address, "/api/state", {})[0] == 401
    assert get(address, "/api/state", {"X-Zpm2-Token": token})[0] == 200
    assert get(address, "/", {"Host": "evil.example"})[0] == 403
    status, content = get(address, "/static/..%2f..%2ferrors.py", {"X-Zpm2-Token": token})
    assert (status, b"class" in content) == (404, False)
    done.send_signal(signal.SIGINT)
    out, err = done.communicate(timeout=PATIENCE)
    assert (done.returncode, out, err) == (0, "", "Ctrl-C ends it.\n")
    assert list((tmp_path / "scratch").iterdir()) == []
    assert sorted(path.name for path in (tmp_path / "in").iterdir()) == ["left.png", "right.png"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["a.png"], "cannot read a.png"),
        (["a.png", "b.png"], "left image a.png does not exist"),
        (["a", "b", "c"], "two photographs or one folder, not 3 paths"),
        (["--max-upload", "much"], "is not a size"),
        (["--max-upload", "auto"], "--max-upload auto is not a size"),
        (["--max-upload", "0"], "--max-upload 0 is not a size"),
        (["--host", "999.1.1.1"], "cannot listen on 999.1.1.1"),
        (["--port", "70000"], "--port"),
        (["--segmenter", "nothing"], "nothing"),
    ],
)
def test_misuse(words: list[str], text: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run("app", *words, "--no-open")
    assert (code, out) == (2, "")
    assert text in err
    lines = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert len(lines) == 1


def test_another_host_is_warned_of(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("uvicorn.Server.run", lambda self, sockets: None)
    monkeypatch.setattr("webbrowser.open", lambda address: bool(opened.append(address)))
    code, out, err = run("app", "--host", "0.0.0.0")
    assert code == 0
    assert "warning: whoever reaches 0.0.0.0" in err
    assert "no browser was found" in err
    assert opened == [out.strip()]
    assert out.startswith("http://127.0.0.1:")


def test_without_its_packages(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    code, _, err = run("app")
    assert (code, err) == (2, 'zpm2: zpm2 app needs starlette and uvicorn: pip install "zpm2[app]"\n')
