"""Every path that a command takes, under names and of kinds that cannot be used: one line, exit code 2."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from rendered import Run

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")

STEREO = ("--stereo", "--K", "50,50,40,32", "--baseline", "1")
# of a path under test and the folder with what is good: the words of a command
PATHS: dict[str, Callable[[str, Path], list[object]]] = {
    "left": lambda path, base: ["match", path, base / "b.png"],
    "right": lambda path, base: ["match", base / "a.png", path],
    "regions": lambda path, base: ["match", *_two(base), "--left-regions", path, "--right-regions", path],
    "configuration": lambda path, base: ["match", *_two(base), "--config", path],
    "K": lambda path, base: ["pose", *_two(base), "--K", path],
    "matches": lambda path, base: ["pose", *_two(base), "--K", "50,50,40,32", "--matches", path],
    "workspace": lambda path, base: ["cloud", path],
    "mesh": lambda path, base: ["cloud", base / "workspace", "--mesh", path],
    "images": lambda path, base: ["cloud", base / "workspace", "--images", path],
    "cameras": lambda path, base: ["cloud", base / "workspace", "--cameras", path],
    "calibration": lambda path, base: ["cloud", *_two(base), "--stereo", "--calib", path],
    "disparity": lambda path, base: ["cloud", *_two(base), *STEREO, "--disparity", path],
    "matches of a cloud": lambda path, base: ["cloud", *_two(base), *STEREO, "--matches", path],
    "photographs": lambda path, base: ["reconstruct", path, base / "b.png"],
    "photographs of tracks": lambda path, base: ["tracks", path, base / "b.png"],
    "pairs of tracks": lambda path, base: ["tracks", *_two(base), "--pairs", path],
    "known cameras": lambda path, base: ["reconstruct", base / "workspace", "--cameras", path],
    "layers": lambda path, base: ["link", path, path],
    "root": lambda path, base: ["eval", "pairs", "--root", path],
    "results": lambda path, base: ["eval", "isprs", "--root", base / "workspace", "--results", "areas", path],
    "kept regions": lambda path, base: ["eval", "isprs", "--root", base / "workspace", "--regions", path],
}
FOLDERS: dict[str, Callable[[str, Path], list[object]]] = {  # which may be there, or not yet
    "weights": lambda path, base: ["match", *_two(base), "--weights-dir", path],
    "sources of VRTs": lambda path, base: ["match", *_two(base), "--allow-vrt", path],
}
OUTPUTS: dict[str, list[str]] = {
    "match": ["match", "a.png", "b.png", "--points", "sift"],
    "pose": ["pose", "a.png", "b.png", "--K", "50,50,40,32"],
    "cloud": ["cloud", "workspace"],
    "reconstruct": ["reconstruct", "a.png", "b.png"],
    "tracks": ["tracks", "a.png", "b.png", "--pairs", "sequential"],
    "eval": ["eval", "isprs", "--root", "workspace"],
}
NAMES = ("long", "long path", "not UTF-8", "NUL", "pipe", "device", "folder", "missing")


def _two(base: Path) -> tuple[Path, Path]:
    return base / "a.png", base / "b.png"


@pytest.fixture(autouse=True)
def in_time() -> Iterator[None]:
    """Nobody waits for a pipe."""

    def late(*_: object) -> None:
        raise AssertionError("it waits")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    (tmp_path / "workspace").mkdir()
    for folder in (tmp_path, tmp_path / "workspace"):
        for name in ("a.png", "b.png"):
            PIL.Image.fromarray(rng.integers(0, 255, (64, 80, 3), np.uint8)).save(folder / name)
    model = tmp_path / "workspace" / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("1 PINHOLE 80 64 50 50 40 32\n")
    (model / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n")
    return tmp_path


def _bad(kind: str, base: Path) -> str:
    name = {"long": "x" * 300, "long path": "/".join(["y" * 200] * 30), "not UTF-8": "\udcff.png", "NUL": "a\0b"}.get(
        kind
    )
    path = str(base / (name or kind))
    if kind == "not UTF-8":
        (base / "a.png").rename(base / "copy")
        Path(path).write_bytes((base / "copy").read_bytes())
        (base / "copy").rename(base / "a.png")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        os.mkdir(path)
    return "/dev/zero" if kind == "device" else path


@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize("what", [*PATHS, *FOLDERS])
def test_what_no_reader_can_use(what: str, kind: str, base: Path, run: Run) -> None:
    if what in FOLDERS and kind == "folder":
        pytest.skip("which is what it asks for")
    words = (PATHS | FOLDERS)[what](_bad(kind, base), base)
    before = sorted(base.iterdir())
    code, _, err = run(*words, "-o", base / "out")
    assert code == 2, err
    assert len(err.splitlines()) == 1
    err.encode()
    assert sorted(base.iterdir()) == before  # nothing half-written


@pytest.mark.parametrize("kind", ["long", "long path", "not UTF-8", "pipe", "device"])
@pytest.mark.parametrize("command", OUTPUTS)
def test_what_no_writer_can_use(command: str, kind: str, base: Path, run: Run) -> None:
    path = str(base / "\udcff") if kind == "not UTF-8" else _bad(kind, base)
    before = sorted(base.iterdir())
    code, _, err = run(*OUTPUTS[command], "-o", path)
    assert code == 2, err
    assert len(err.splitlines()) == 1
    assert "output folder" in err or "too long" in err
    assert sorted(base.iterdir()) == before
