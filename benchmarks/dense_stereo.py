"""Dense stereo of rectified pairs with known disparity: how much is found, how well, how fast.

    python benchmarks/dense_stereo.py --root DATA [--pairs NAME ...] [--variant "aerial: stereo.method=mc-cnn ..." ...]

DATA/pairs.json lists the pairs (those with a disparity are taken). Searched are the disparities of the truth and 8 px
more at either end. A variant is a name and options. For each pair and variant, of the pixels with a known truth, hidden
ones too: percent that have a disparity (density), percent of these that are wrong by more than 1 and 3 px (bad_1,
bad_3), percent of all that are right within 1 and 3 px (right_1, right_3); seconds without loading; and by how many MB
the peak of memory of a process of its own rose. Prints the table to stderr and JSON (schema
zpm2-bench-dense-stereo/1).
"""

import argparse
import multiprocessing
import resource
import sys
import time
from pathlib import Path
from typing import Any

import document
import numpy as np

from zpm2.config import Config, assign
from zpm2.evaluate.datasets.pair_list import from_json
from zpm2.evaluate.pairs import DisparityTruth, EvalPair
from zpm2.formats.maps import read_disparity
from zpm2.photos.images import read_image
from zpm2.stereo.dense import stereo_matcher

VARIANTS = ("sgbm:", "mc-cnn: stereo.method=mc-cnn", "mc-cnn aerial: stereo.method=mc-cnn stereo.weights=aerial")
COLUMNS = ("pair", "method", "density", "bad_1", "bad_3", "right_1", "right_3", "s", "MB")
MARGIN = 8  # px


def measured(pair: EvalPair, method: str, options: list[str]) -> dict[str, Any]:
    assert isinstance(pair.truth, DisparityTruth)
    left, right = read_image(pair.left), read_image(pair.right)
    truth = read_disparity(pair.truth.file, (left.width, left.height), pair.truth.scale, pair.truth.sign)
    known = np.isfinite(truth)
    low, high = int(np.floor(truth[known].min())) - MARGIN, int(np.ceil(truth[known].max())) + MARGIN
    config = assign(Config(), options)
    find = stereo_matcher(config.stereo, config.device)
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    found = find(left, right, low, high)
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    error = np.abs(found - truth)[known]
    given = np.isfinite(error)
    return {
        "pair": pair.name,
        "method": method,
        "search": [low, high],
        "density": _percent(given),
        "bad_1": _percent(error[given] > 1),
        "bad_3": _percent(error[given] > 3),
        "right_1": _percent(error <= 1),
        "right_3": _percent(error <= 3),
        "s": round(seconds, 1),
        "MB": round((after - before) / 1000),
    }


def _percent(values: Any) -> float:
    return round(100 * float(values.mean()), 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--pairs", nargs="*")
    parser.add_argument("--variant", action="append")
    options = parser.parse_args()
    rows = []
    print("| " + " | ".join(COLUMNS) + " |", file=sys.stderr)
    for pair in from_json(options.root, None):
        if not isinstance(pair.truth, DisparityTruth) or (options.pairs and pair.name not in options.pairs):
            continue
        for variant in options.variant or VARIANTS:
            method, _, words = variant.partition(":")
            with multiprocessing.get_context("spawn").Pool(1) as alone:
                row = alone.apply(measured, (pair, method, words.split()))
            rows.append(row)
            print("| " + " | ".join(str(row[name]) for name in COLUMNS) + " |", file=sys.stderr, flush=True)
    print(document.text("zpm2-bench-dense-stereo/1", rows=rows))


if __name__ == "__main__":
    main()
