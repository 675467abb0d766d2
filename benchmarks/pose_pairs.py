"""Relative pose with and without polygons: errors and AUC by set, several seeds, the same matches.

    python benchmarks/pose_pairs.py --root DATA --predictions OUT [--seeds 5]

DATA holds a pairs.json whose pairs have a pose (docs/datasets.md), OUT is what `zpm2 eval pairs --root DATA -o OUT`
left. A pair's set is the first part of its name. Compared are all points without polygons and the paper's protocol with
the paper's estimator (five-point, MAGSAC++), and all points and the preset `default` with that preset's. Prints tables
to stderr and one JSON document (schema zpm2-bench-pose/1) to stdout.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import document
import numpy as np

from zpm2 import config
from zpm2.config import Config
from zpm2.errors import Failed
from zpm2.evaluate import pose_auc, pose_error
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import PoseTruth
from zpm2.evaluate.predictions import folder_of
from zpm2.evaluate.report import cameras_of, without_polygons
from zpm2.pose import PoseFinder
from zpm2.result import MatchResult


def variants() -> dict[str, Config]:
    """What is compared, by name."""
    paper, best = config.preset("paper"), config.preset("default")

    return {
        "all points, opencv": without_polygons(paper),
        "paper's protocol, opencv": paper,
        "all points, poselib": without_polygons(best),
        "default": best,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--predictions", type=Path, required=True)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    finders = {name: PoseFinder(of) for name, of in variants().items()}
    rows: list[dict[str, Any]] = []
    for pair in open_dataset("pairs", options.root, None).pairs():
        folder = folder_of(pair, options.predictions)
        if not isinstance(pair.truth, PoseTruth) or not (folder / "matches.json").exists():
            continue
        result = MatchResult.load(folder)
        cameras, images = cameras_of(result, pair.truth), result.images()
        for name, finder in finders.items():
            start = time.perf_counter()
            points = finder.gather(result, images)
            gathered = time.perf_counter()
            errors, inliers = [], []
            for seed in range(options.seeds):
                pose, agree, _ = finder.estimate(points, cameras, seed)
                inliers.append(int(agree.sum()))
                if isinstance(pose, Failed) or pose.translation is None:
                    errors.append((float("inf"), float("inf")))
                else:
                    errors.append(pose_error(pose.rotation, pose.translation, pair.truth.pose))
            row = {
                "pair": pair.name,
                "variant": name,
                "errors": [[round(float(value), 3) for value in error] for error in errors],
                "points": len(points),
                "inliers": float(np.mean(inliers)),
                "seconds_points": round(gathered - start, 3),
                "seconds_pose": round((time.perf_counter() - gathered) / options.seeds, 3),
            }
            rows.append(row)
            print(json.dumps(row), file=sys.stderr, flush=True)
    table = summary(rows, options.seeds)
    for line in table:
        print(json.dumps(line), file=sys.stderr)
    print(document.text("zpm2-bench-pose/1", table=table, rows=rows))


def summary(rows: list[dict[str, Any]], seeds: int) -> list[dict[str, Any]]:
    """AUC of each set and variant in percent: mean and standard deviation over seeds."""
    found = []
    for name in dict.fromkeys(row["pair"].split("/")[0] for row in rows):
        for variant in dict.fromkeys(row["variant"] for row in rows):
            of = [row for row in rows if row["variant"] == variant and row["pair"].startswith(name + "/")]
            auc = 100 * np.array([pose_auc([row["errors"][seed] for row in of]) for seed in range(seeds)])
            found.append(
                {
                    "set": name,
                    "pairs": len(of),
                    "variant": variant,
                    **{f"AUC@{t}": round(float(m), 1) for t, m in zip((5, 10, 20), auc.mean(0), strict=True)},
                    "spread@10": round(float(auc[:, 1].std()), 1),
                    **{k: round(float(np.mean([row[k] for row in of])), 2) for k in ("points", "seconds_points")},
                    "inliers": round(float(np.mean([row["inliers"] / max(row["points"], 1) for row in of])), 3),
                    "seconds_pose": round(float(np.mean([row["seconds_pose"] for row in of])), 2),
                }
            )
    return found


if __name__ == "__main__":
    main()
