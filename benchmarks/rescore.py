"""What scoring stored predictions costs: one prediction with its truth, as often as asked.

    python benchmarks/rescore.py --root DATA --pair NAME --prediction FOLDER [--copies 100 1000]

`DATA/pairs.json` lists the pair, FOLDER is what `zpm2 match` or `zpm2 eval` wrote for it. Runs `zpm2 eval pairs
--score-only` in a process of its own for each number of copies. Prints one JSON document (schema zpm2-bench-rescore/1):
CPU and wall seconds a pair, and the peak memory of the process, which must not grow with the copies.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import document

from zpm2 import MatchResult
from zpm2.evaluate.predictions import PredictionSettings
from zpm2.files.record import make_folder

TRUTH_FILES = ("file", "file1")


def measure(pair: dict[str, Any], prediction: Path, copies: int, folder: Path) -> dict[str, Any]:
    names = [f"{k:05d}" for k in range(copies)]
    (folder / "pairs.json").write_text(json.dumps([{**pair, "name": name} for name in names]))
    out = folder / "out"
    PredictionSettings("pairs", None, "zpm2", dict(MatchResult.load(prediction).config)).claim(out)
    make_folder(out / "predictions")
    for name in names:
        (out / "predictions" / name).symlink_to(prediction.resolve())
    command = ["zpm2", "eval", "pairs", "--root", str(folder), "-o", str(out), "--score-only", "--quiet"]
    start = time.perf_counter()
    child = subprocess.Popen(command)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        sys.exit(1)
    done = json.loads((out / "summary.json").read_text())["done"]
    return {
        "copies": copies,
        "scored": done,
        "wall s a pair": round((time.perf_counter() - start) / copies, 4),
        "cpu s a pair": round((used.ru_utime + used.ru_stime) / copies, 4),
        "peak_mb": used.ru_maxrss // 1024,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--pair", required=True)
    parser.add_argument("--prediction", type=Path, required=True)
    parser.add_argument("--copies", type=int, nargs="+", default=[100, 1000])
    options = parser.parse_args()
    root = options.root.resolve()
    listed = json.loads((root / "pairs.json").read_text())
    pair = next(pair for pair in listed if pair["name"] == options.pair)
    truth = {key: str(root / value) if key in TRUTH_FILES else value for key, value in (pair["gt"] or {}).items()}
    pair = {**pair, "left": str(root / pair["left"]), "right": str(root / pair["right"]), "gt": truth or None}
    rows = []
    for copies in options.copies:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measure(pair, options.prediction, copies, Path(folder)))
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    print(document.text("zpm2-bench-rescore/1", rows=rows))


if __name__ == "__main__":
    main()
