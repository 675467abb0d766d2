"""Are poses as sure as they say: errors of pairs with known poses over their standard deviations.

    python benchmarks/pose_sigma.py --root DATA [--root MORE ...] --points FOLDER

Points alone, found once and kept in FOLDER; cells of the left image stand for the regions. Poses that are flagged as
doubtful have no sigma: they are counted. An error is the norm of three angles of R, or of two of the direction of t;
how many are expected below 1, 2 and 3 sigma follows from each pair's own covariance, for normal errors. `factor` is by
how much sigmas must be multiplied, so that as many as expected lie below 1 and 2 of them, told from the other sets (one
set is left out at a time). Prints tables to stderr and one JSON document (schema zpm2-bench-sigma/2) to stdout.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import document
import numpy as np
from known_points import KnownPoints, pairs_of

from zpm2 import config
from zpm2.errors import Failed
from zpm2.evaluate import pose_error
from zpm2.evaluate.pairs import PoseTruth
from zpm2.model import Camera
from zpm2.pose import PoseFinder
from zpm2.pose.points import Correspondences, cell_of, spread

LOST = 10.0  # degrees, errors from which a pose is another one: no sigma covers it
DRAWS = 4000  # of each pair's own errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True, action="append")
    parser.add_argument("--points", type=Path, required=True)
    options = parser.parse_args()
    finder, known = PoseFinder(config.preset("default")), KnownPoints(options.points)
    rows = []
    for pair in pairs_of(options.root):
        if isinstance(pair.truth, PoseTruth):
            points, *sizes = known(pair.name, pair.left, pair.right)
            cameras = [Camera(k, size) for k, size in zip(pair.truth.intrinsics, sizes, strict=True)]
            rows.append({"pair": pair.name, **judged(finder, points, (cameras[0], cameras[1]), pair.truth.pose)})
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    table = [summary(name, rows) for name in dict.fromkeys(set_of(row) for row in rows)] + [summary("", rows)]
    for line in table:
        print(json.dumps(line), file=sys.stderr)
    print(document.text("zpm2-bench-sigma/2", table=table, rows=rows))


def judged(finder: PoseFinder, points: Any, cameras: tuple[Camera, Camera], truth: Any) -> dict[str, Any]:
    """Errors and sigmas in degrees, and the shares expected below 1, 2 and 3 sigma."""
    chosen = Correspondences(points, cell_of(points, cameras[0].size, 8), np.zeros(len(points), bool))
    chosen = chosen[spread(points, cameras[0].size, 8, finder.config.pose.bucket)]
    pose, _, _ = finder.estimate(chosen, cameras)
    if isinstance(pose, Failed) or pose.translation is None:
        return {"status": "no pose"}
    errors = pose_error(pose.rotation, pose.translation, truth)
    row = {"errors": [round(float(e), 4) for e in errors], "flags": list(pose.flags)}
    if pose.rotation_sigma is None or pose.translation_sigma is None or pose.covariance is None:
        return {"status": "doubtful", **row}
    sigmas = pose.rotation_sigma, pose.translation_sigma
    parts = pose.covariance[:3, :3], pose.covariance[3:, 3:]
    return {
        "status": "lost" if max(errors) > LOST and "uncertain" not in pose.flags else "ok",
        **row,
        "sigmas": [round(float(sigma), 4) for sigma in sigmas],
        "expected": [[round(share, 3) for share in expected(part)] for part in parts],
    }


def expected(covariance: Any) -> list[float]:
    """Shares of normal errors of that covariance whose norm is below 1, 2 and 3 sigma, sigma^2 being its trace."""
    weight = np.linalg.eigvalsh(covariance)
    squares = np.random.default_rng(0).normal(size=(DRAWS, len(weight))) ** 2 @ (weight / weight.sum())
    return [float((squares < k**2).mean()) for k in (1, 2, 3)]


def set_of(row: dict[str, Any]) -> str:
    return str(row["pair"].split("/")[0])


def summary(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Of one set, or of all: `name` is empty."""
    of = [row for row in rows if not name or set_of(row) == name]
    sure = [row for row in of if row["status"] == "ok"]
    others = [row for row in rows if row["status"] == "ok" and set_of(row) != name]
    line: dict[str, Any] = {"set": name or "all", "pairs": len(of), "with sigma": len(sure)}
    line |= {status: sum(row["status"] == status for row in of) for status in ("no pose", "doubtful", "lost")}
    for k, what in enumerate(("R", "t")):
        ratio = np.array([row["errors"][k] / row["sigmas"][k] for row in sure])
        line[what] = [round(float((ratio < s).mean()), 2) for s in (1, 2, 3)] if sure else None
    if sure:
        line["expected"] = np.mean([row["expected"] for row in sure], (0, 1)).round(2).tolist()
    line["factor"] = factor(others) if others else None
    return line


def factor(rows: list[dict[str, Any]]) -> float:
    """By which all sigmas must be multiplied, so that errors lie below 1 and 2 of them as often as expected."""
    ratio = np.array([[row["errors"][k] / row["sigmas"][k] for k in (0, 1)] for row in rows]).ravel()
    wanted = np.mean([row["expected"] for row in rows], (0, 1))
    return round(float(np.mean([np.quantile(ratio, wanted[k]) / (k + 1) for k in (0, 1)])), 2)


if __name__ == "__main__":
    main()
