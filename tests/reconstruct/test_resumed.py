"""Two reconstructions of the same photographs are the same to the last bit, also if one was killed and resumed."""

import hashlib
import subprocess
import sys
from pathlib import Path

import boards
import pytest

from zpm2.config import Config, ReconstructConfig
from zpm2.reconstruct import reconstruct

pytest.importorskip("pycolmap")
CONFIG = Config(reconstruct=ReconstructConfig(max_size=240, poisson_depth=8))

# argv: workspace, the stage and its share after which the process dies, and how many seconds after, photographs...
DYING = """
import os, signal, sys, threading
from pathlib import Path
from zpm2.config import Config, ReconstructConfig
from zpm2.reconstruct import reconstruct
config = Config(reconstruct=ReconstructConfig(max_size=240, poisson_depth=8))
workspace, stage, share, delay, *photographs = sys.argv[1:]
def tell(at, done):
    if at == stage and done >= float(share):
        threading.Timer(float(delay), os.kill, (os.getpid(), signal.SIGKILL)).start()
reconstruct([Path(p) for p in photographs], Path(workspace), config, tell=tell)
threading.Event().wait()  # where the machine was faster
"""


def digests(workspace: Path) -> dict[str, str]:
    """Of each file but those of the folder's own record."""
    files = [path for path in workspace.rglob("*") if path.is_file() and ".zpm2" not in path.parts]
    return {str(p.relative_to(workspace)): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(files)}


def test_killed_in_each_stage_and_resumed(tmp_path: Path) -> None:
    photographs = boards.write(tmp_path / "photographs", 4)
    assert reconstruct(photographs, tmp_path / "once", CONFIG).registered == 4
    for stage, share, delay in (("structure", 0, 1.0), ("depth", 0.5, 0.0), ("mesh", 0, 0.3)):
        words = [sys.executable, "-c", DYING, tmp_path / "ws", stage, share, delay, *photographs]
        done = subprocess.run(list(map(str, words)), check=False, capture_output=True, text=True, timeout=200)
        assert done.returncode == -9, done.stderr
    reconstruct(photographs, tmp_path / "ws", CONFIG)
    assert digests(tmp_path / "ws") == digests(tmp_path / "once")
