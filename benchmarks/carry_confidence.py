"""Fits the confidence of carried outlines, and says how true it is on data sets that the fit has not seen.

    python benchmarks/carry_confidence.py ROWS.json [...] > carry_confidence.json

ROWS are what `carry_regions.py` and `carry_labels.py` write with `--rows`. An outline is right that overlaps the true
one by IoU 0.5; outlines of regions that the right photograph does not show are wrong, and those of which it shows some
are left out. The model is logistic in the agreement, the trust in the place, how many points of the pair agree on one
geometry, and the share of the region among these; each data set counts by the root of its outlines. One data set at a
time is left out and judged by the others' weights. Prints a table to stderr and one JSON document (schema
zpm2-bench-carry-confidence/1) to stdout.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import document
import numpy as np
from carry_regions import SEEN, is_unseen
from numpy.typing import NDArray
from scipy.optimize import minimize

from zpm2 import config

BINS = 10
PRIOR = 1e-3  # of the squared weights, so that they stay finite
SAME_SET = {"vgg_affine": "homography"}  # photographs of one publisher, some of one scene
Array = NDArray[np.float64]


def evidence(rows: list[dict[str, Any]]) -> Array:
    """(n, 5) what the confidence is computed from."""
    many = config.preset("default").carry.many_points
    told = [row["points"] / (row["points"] + many) for row in rows]
    seen = [(row["agreement"], row["trust"], t, row["surrounded"]) for row, t in zip(rows, told, strict=True)]
    return np.array([(-1.0, *each) for each in seen])


def fitted(x: Array, right: Array, weight: Array) -> Array:
    """(5,) intercept, and the weights of the agreement, the trust, the points and the share among them."""

    def loss(w: Array) -> float:
        z = x @ w
        return float(np.sum(weight * (np.logaddexp(0, z) - right * z)) / weight.sum() + PRIOR * w @ w)

    return np.asarray(minimize(loss, np.zeros(x.shape[1]), method="BFGS").x)


def calibration(p: Array, right: Array) -> dict[str, float]:
    """Expected calibration error over equal bins, Brier score, mean confidence and share that is right."""
    row = np.minimum((p * BINS).astype(int), BINS - 1)
    gaps = [abs(p[row == k].sum() - right[row == k].sum()) for k in range(BINS)]
    found = {"error": sum(gaps) / len(p), "brier": ((p - right) ** 2).mean(), "said": p.mean(), "right": right.mean()}
    return {name: round(float(value), 3) for name, value in found.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path, nargs="+")
    options = parser.parse_args()
    read = [row for file in options.rows for row in json.loads(file.read_text())]
    told = [row for row in read if row["status"] in ("found", "in part")]
    rows = [row for row in told if row["seen"] >= SEEN or is_unseen(row)]
    x = evidence(rows)
    right = np.array([float(row["seen"] >= SEEN and row["carried"] >= 0.5) for row in rows])
    kind = np.array([SAME_SET.get(row["pair"].split("/")[0], row["pair"].split("/")[0]) for row in rows])
    kinds, of = np.unique(kind, return_inverse=True)
    weight = np.bincount(of)[of] ** -0.5
    chosen = fitted(x, right, weight)
    unseen = np.zeros(len(rows))
    table = []
    for k, name in enumerate(kinds):
        out = of == k
        unseen[out] = 1 / (1 + np.exp(-x[out] @ fitted(x[~out], right[~out], weight[~out])))
        table.append({"name": str(name), "outlines": int(out.sum()), **calibration(unseen[out], right[out])})
    table.append({"name": "all", "outlines": len(rows), **calibration(unseen, right)})
    for row in table:
        print(json.dumps(row), file=sys.stderr)
    names = ("intercept", "by_agreement", "by_trust", "by_points", "by_surrounded")
    weights = {name: round(float(value), 2) for name, value in zip(names, chosen, strict=True)}
    print(document.text("zpm2-bench-carry-confidence/1", weights=weights, rows=table))


if __name__ == "__main__":
    main()
