"""The same pair gives the same result to the last bit, in one process and in fresh ones."""

import json
import subprocess
import sys
from pathlib import Path

from rendered import Pair

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "same_bytes.py"


def test_calls_and_processes_agree(pair: Pair) -> None:
    """The processes with one thread, the calls with as many as there are cores."""
    own = "--regions", pair.left_regions, pair.right_regions, "--set", "points.methods=sift"
    command = [sys.executable, SCRIPT, pair.left, pair.right, *own, "--times", 2, "--threads", 1]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["calls"] == found["processes"]
    assert list(found["calls"].values()) == [2]
