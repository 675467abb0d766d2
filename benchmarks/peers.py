"""Every method on the same regions and the same points: what the matching alone is worth.

    python benchmarks/peers.py --root DATA --regions EVALUATION -o OUT > peers.json

`DATA/pairs.json` lists the pairs; those with dense truth count. EVALUATION is the folder of an earlier `zpm2 eval` of
them, whose polygons all methods take. Prints one JSON document (schema zpm2-bench-peers/1): a row a method, and the
pairs. Seconds a pair are those of the homologous points, and of all that follows them, without reading and loading.
"""

import argparse
import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import document

from zpm2.api import METHODS

FIGURES = ("good", "scored", "gt", "P", "R", "MAS50", "CCR", "CCR5")
OTHER_STAGES = ("read", "load", "detect", "points", "pose")  # that are the same for all methods


def dense_pairs(root: Path, folder: Path) -> Path:
    """A folder whose pairs.json lists the pairs of `root` that have dense truth, by the paths of their files."""
    kept = []
    for pair in json.loads((root / "pairs.json").read_text()):
        truth = pair.get("gt") or {}
        if truth and truth["kind"] != "pose":
            files = {name: str(root / truth[name]) for name in ("file", "file1") if truth.get(name)}
            photographs = {side: str(root / pair[side]) for side in ("left", "right")}
            kept.append({**pair, **photographs, "gt": {**truth, **files}})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pairs.json").write_text(json.dumps(kept, indent=1))
    return folder


def measure(method: str, root: Path, regions: Path, out: Path) -> dict[str, Any]:
    """The row of a method."""
    command = ["zpm2", "eval", "pairs", "--root", str(root), "-o", str(out), "--method", method, "--quiet"]
    if subprocess.run([*command, "--regions", str(regions)], check=False).returncode:
        sys.exit(1)
    total = json.loads((out / "summary.json").read_text())
    stages = {name.removeprefix("s_"): value for name, value in total.items() if name.startswith("s_")}
    own = sum(value for name, value in stages.items() if name not in OTHER_STAGES)
    figures = {name: round(total[name], 4) for name in FIGURES}
    seconds = {"points s": round(stages.get("points", 0.0), 2), "matching s": round(own, 2)}
    return {"method": method, "pairs": total["dense"], **figures, **seconds}


def good_of_scored(file: Path) -> dict[str, str]:
    """For each pair, its matches that are good / that can be judged."""
    with file.open(newline="") as lines:
        return {row["pair"]: f"{row['good']} / {row['scored']}" for row in csv.DictReader(lines)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--regions", type=Path, required=True)
    parser.add_argument("-o", "--out", type=Path, required=True, help="predictions and scores; a run can be resumed")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    options = parser.parse_args()
    root = dense_pairs(options.root.resolve(), options.out / "data")
    rows = []
    for method in options.methods:
        rows.append(measure(method, root, options.regions.resolve(), options.out / method))
        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    pairs = {method: good_of_scored(options.out / method / "rows.csv") for method in options.methods}
    print(document.text("zpm2-bench-peers/1", rows=rows, pairs=pairs))


if __name__ == "__main__":
    main()
