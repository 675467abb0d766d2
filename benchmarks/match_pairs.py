"""The everyday table: match real pairs with ground truth, score them, and say how long each stage took.

    python benchmarks/match_pairs.py --root DATA --scorer score_pair.py [--pairs NAME ...] [--grid 16 32]

`DATA/pairs.json` lists pairs: name, left, right (paths relative to DATA) and gt, which is null or has a "kind". The
scorer is a program of its own that reads a matches.json (`score_pair.py MATCHES --disp FILE --disp-scale S --iou 0.5`,
or `--depth ... --K ... --T ...`) and prints JSON; pairs whose truth it cannot use are run and timed but not scored.
Prints the table to stderr and one JSON document (schema zpm2-bench-pairs/1) to stdout.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import document
import numpy as np

from zpm2 import config
from zpm2.pipeline import PairMatcher
from zpm2.segment.given.precomputed import PrecomputedSegmenter

FIGURES = ("MAS", "P", "R", "CCR", "CCR5")


def score(scorer: Path, root: Path, pair: dict[str, Any], matches: Path) -> dict[str, Any] | None:
    truth = pair["gt"] or {}
    command = [sys.executable, str(scorer), str(matches), "--iou", "0.5"]
    if truth.get("kind") == "disparity":
        command += ["--disp", str(root / truth["file"]), "--disp-scale", str(truth["scale"])]
    elif truth.get("kind") == "depth":
        command += ["--depth", str(root / truth["file"]), "--scale", str(truth["scale"])]
        if "file1" in truth:
            command += ["--depth2", str(root / truth["file1"])]
        for option, key in (("--K", "K0"), ("--K2", "K1"), ("--T", "T_0to1")):
            text = matches.parent / f"{key}.txt"
            np.savetxt(text, np.array(truth[key], float).reshape(-1, 3 if key != "T_0to1" else 4))
            command += [option, str(text)]
    else:
        return None
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(run.stdout.splitlines()[-1])


def kept(folder: Path) -> tuple[PrecomputedSegmenter, PrecomputedSegmenter]:
    """The polygons of a kept result, vertex by vertex."""
    return PrecomputedSegmenter(folder / "left.geojson"), PrecomputedSegmenter(folder / "right.geojson")


def totals(rows: list[dict[str, Any]]) -> dict[str, Any]:
    scores = [row["score"] for row in rows if row["score"]]
    summed = {name: sum(s[name] for s in scores) for name in ("good", "scored", "gt")}
    means = {name: round(float(np.mean([s[name] for s in scores])), 4) for name in FIGURES} if scores else {}
    return {"pairs": len(scores), **summed, **{f"mean {name}": value for name, value in means.items()}}


def line(row: dict[str, Any]) -> str:
    s, seconds = row["score"], row["seconds"]
    scored = " ".join(f"{name} {s[name]:.3f}" for name in FIGURES) if s else "not scored"
    good = f"{s['good']:3d} /{s['scored']:3d} of {s['gt']:3d}" if s else f"{row['matches']:3d} matches    "
    times = " ".join(f"{stage} {seconds[stage]:.2f}" for stage in ("detect", "points", "global", "local"))
    return (
        f"{row['pair']:34s} {row['grid']:2d} {row['polygons'][0]:4d}{row['polygons'][1]:4d}  {good}  {scored}  {times}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--scorer", type=Path, required=True)
    parser.add_argument("--pairs", nargs="+")
    parser.add_argument("--grid", type=int, nargs="+", default=[32])
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--set", dest="settings", action="append", default=[])
    parser.add_argument("--save", type=Path, help="keep each pair's result files in this folder")
    parser.add_argument("--reuse", type=Path, help="take the polygons of results kept there instead of detecting them")
    options = parser.parse_args()
    pairs = json.loads((options.root / "pairs.json").read_text())
    known = {pair["name"]: pair for pair in pairs}
    names = options.pairs or list(known)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as temporary:
        keep = options.save or Path(temporary)
        for grid in options.grid:
            chosen = config.assign(config.preset(options.preset), [f"segment.grid={grid}", *options.settings])
            matcher = PairMatcher(chosen)
            for name in names:
                pair = known[name]
                if options.reuse:
                    matcher = PairMatcher(chosen, segmenter=kept(options.reuse / f"{name.replace('/', '_')}_{grid}"))
                result = matcher(options.root / pair["left"], options.root / pair["right"])
                folder = result.save(keep / f"{name.replace('/', '_')}_{grid}")
                row = {
                    "pair": name,
                    "grid": grid,
                    "polygons": [len(result.left.polygons), len(result.right.polygons)],
                    "points": len(result.points),
                    "matches": len(result.matches),
                    "score": score(options.scorer, options.root, pair, folder / "matches.json"),
                    "seconds": {stage: round(seconds, 3) for stage, seconds in result.timings.items()},
                    "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
                }
                rows.append(row)
                print(line(row), file=sys.stderr, flush=True)
            print(json.dumps(totals([row for row in rows if row["grid"] == grid])), file=sys.stderr, flush=True)
    content = {
        "preset": options.preset,
        "settings": options.settings,
        "rows": rows,
        "totals": {grid: totals([row for row in rows if row["grid"] == grid]) for grid in options.grid},
    }
    print(document.text("zpm2-bench-pairs/1", **content))


if __name__ == "__main__":
    main()
