"""Fits the confidence of matches to their evidence, and says how true it is on data sets that the fit has not seen.

    python benchmarks/confidence_fit.py --evaluation ROOT OUT [--evaluation ...] [--more ROOT OUT ...] --cache FOLDER

OUT is the folder of a `zpm2 eval pairs --root ROOT` of preset `default`, best with `local_match.judge=off`; the pairs
with dense truth count. Nothing is detected or matched anew. Wrong matches are rare there, so three kinds of matches are
fitted together, with the same weights and an intercept each:

- those of the evaluations: they alone are judged, and theirs is the intercept;
- those of the same regions without half of the right ones and a fifth of the left ones, drawn at random (`--thinned`
  times), with `--share` of a match's weight each: what lost its partner finds a wrong one more often,
- those of `--more` evaluations, with other segmenters or points, with the same share.

Left out of the fit, but not of the tables: matches of which the truth shows less than a tenth in both images (windows
of cars seen by a laser: the truth is that of what lies behind). One data set at a time is left out and judged by the
others' weights; photographs of one publisher are one set. Prints tables to stderr and one JSON document (schema
zpm2-bench-confidence/1) to stdout.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import document
import numpy as np
from scipy.optimize import minimize

from zpm2 import config
from zpm2.config import Config
from zpm2.evaluate import predictions
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.ground_truth import covisible, overlap
from zpm2.evaluate.metrics import match_rows
from zpm2.evaluate.pairs import DepthTruth, EvalPair, PoseTruth
from zpm2.global_match import Candidates, initial_geometry, locate, search_candidates
from zpm2.guided.prior import GuidedPrior
from zpm2.local_match import MatchProblem, match_polygons
from zpm2.model import PolygonArrays
from zpm2.photos.images import read_image
from zpm2.polygons.warp import warp_by_points
from zpm2.result import MatchResult
from zpm2.verify.confidence import FEATURES, features
from zpm2.verify.evidence import gather

Rows = dict[str, Any]
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0)
SIZES = (0, 200, 500, 2000, 10_000, np.inf)  # px^2 of the smaller polygon
SAME_SET = {"vgg_affine": "homography"}  # photographs of one publisher, some of one scene
CHOSEN: Config = config.preset("default")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--evaluation", type=Path, nargs=2, action="append", required=True)
    parser.add_argument("--more", type=Path, nargs=2, action="append", default=[])
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--thinned", type=int, default=3)
    parser.add_argument("--share", type=float, default=0.3)
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    found = [rows for place in options.evaluation for rows in evidence_of(*place, "", options.thinned, options.cache)]
    for root, out in options.more:
        found += evidence_of(root, out, out.name, 0, options.cache)
    rows = {name: np.concatenate([each[name] for each in found]) for name in found[0]}
    report(rows, options.share)


def evidence_of(root: Path, out: Path, kind: str, thinned: int, cache: Path) -> Iterator[Rows]:
    """The matches of each pair with dense truth, with their evidence, without those that the truth cannot judge."""
    for pair in open_dataset("pairs", root, None).pairs():
        truth = pair.truth
        if truth is None or (isinstance(truth, PoseTruth) and not isinstance(truth, DepthTruth)):
            continue
        file = cache / f"{out.resolve().name}-{pair.name.replace('/', '__')}-{thinned}.npz"
        if not file.exists():
            result = predictions.load(pair, out)
            if not isinstance(result, MatchResult):
                print(f"no prediction of {pair.name} in {out}", file=sys.stderr)
                continue
            np.savez(file, **measured(pair, result, kind, thinned))
            print(pair.name, file=sys.stderr, flush=True)
        yield dict(np.load(file))


def measured(pair: EvalPair, result: MatchResult, kind: str, thinned: int) -> Rows:
    images = read_image(pair.left, "left image"), read_image(pair.right, "right image")
    sizes = [(image.width, image.height) for image in images]
    assert pair.truth is not None
    polygons = result.left.polygons, result.right.polygons
    truth = overlap(*polygons, covisible(pair.truth, *sizes), *sizes)
    initial = initial_geometry(result.points, CHOSEN.global_match, CHOSEN.seed)
    chosen = CHOSEN.local_match
    asked = [{getattr(m, side) for m in result.matches if m.stage == "guided"} for side in ("left", "right")]
    found = []
    for seed in range(thinned + 1):
        rng = np.random.default_rng(seed)
        kept = [np.arange(len(side)) for side in polygons]
        if seed:
            kept = [
                np.sort(rng.permutation(rows)[: int(len(rows) * s)]) for rows, s in zip(kept, (0.8, 0.5), strict=True)
            ]
        left, right = (PolygonArrays([side[row] for row in rows]) for side, rows in zip(polygons, kept, strict=True))
        prior = None
        if any(asked):
            sure = np.ones(len(left), bool), np.ones(len(right), bool)
            guided = [np.isin(side.ids, list(ids)) for side, ids in zip((left, right), asked, strict=True)]
            warped = warp_by_points(left, *initial.forward(), chosen)
            prior = GuidedPrior(warped, sure, (guided[0], guided[1]), CHOSEN.guided)
        locations = locate(*images, left.centers, initial, CHOSEN.global_match)
        candidates = search_candidates(left, right, locations, CHOSEN.global_match)
        problem = MatchProblem(images, (left, right), initial, locations, candidates, prior)
        matches = match_polygons(problem, chosen) if seed else result.matches
        rows = match_rows(left.polygons, right.polygons, matches)
        pairs = Candidates(rows[:, 0], rows[:, 1])
        evidence = gather(problem, pairs, pairs, chosen)
        whole = np.stack([kept[0][rows[:, 0]], kept[1][rows[:, 1]]], axis=1)
        seen = [
            count[of] / np.maximum(pixels[of], 1)
            for count, pixels, of in zip(truth.seen, (truth.left.pixels, truth.right.pixels), whole.T, strict=True)
        ]
        judged = truth.enough(whole)
        n = len(rows)
        found.append(
            {
                "x": features(evidence, chosen.confidence)[judged],
                "right": (truth.iou(whole) >= 0.5)[judged],
                "clear": (np.maximum(*seen) >= 0.1)[judged],
                "area": np.minimum(left.areas[rows[:, 0]], right.areas[rows[:, 1]])[judged],
                "stored": np.array([m.confidence for m in matches], np.float64)[judged],
                "kind": np.full(n, kind or ("thinned" if seed else "reported"))[judged],
                "pair": np.full(n, pair.name)[judged],
            }
        )
    return {name: np.concatenate([each[name] for each in found]) for name in found[0]}


def report(rows: Rows, share: float) -> None:
    x, right = rows["x"], rows["right"].astype(float)
    sets = np.array([SAME_SET.get(name.split("/")[0], name.split("/")[0]) for name in rows["pair"]])
    kinds = [kind for kind in np.unique(rows["kind"]) if kind != "reported"]
    level = np.stack([rows["kind"] == kind for kind in ["reported", *kinds]], axis=1).astype(float)
    shown = rows["kind"] == "reported"
    weight = np.where(shown, 1.0, share) * rows["clear"]
    says, run_says, folds = np.zeros(len(right)), np.zeros(len(right)), {}
    for name in np.unique(sets):
        train = sets != name
        weights, levels = fit(x[train], level[train], right[train], weight[train])
        says[~train] = chance(x[~train] @ weights + level[~train] @ levels)
        run_says[~train] = chance(x[~train] @ weights + levels[0])  # a run does not know of kinds
        folds[str(name)] = dict(zip(FEATURES, np.round(weights, 2).tolist(), strict=True))
    weights, levels = fit(x, level, right, weight)
    fitted = {"intercept": round(-float(levels[0]), 2)} | dict(
        zip(FEATURES, np.round(weights, 2).tolist(), strict=True)
    )
    p, y = says[shown], right[shown]
    print(json.dumps(fitted), file=sys.stderr)
    tables: dict[str, Any] = {
        "bins": [line(f"{a:g} to {b:g}", p, y, (p >= a) & ((p < b) | (b == 1))) for a, b in itertools.pairwise(EDGES)],
        "sets": [line(str(name), p, y, sets[shown] == name) for name in np.unique(sets)],
        "sizes": [
            line(f"{a:g} to {b:g} px²", p, y, (rows["area"][shown] >= a) & (rows["area"][shown] < b))
            for a, b in itertools.pairwise(SIZES)
        ],
    }
    tables["kinds"] = [line(str(kind), run_says, right, rows["kind"] == kind) for kind in ["reported", *kinds]]
    for name, lines in tables.items():
        print(f"\n| {name} | matches | says | is | error |\n| --- | ---: | ---: | ---: | ---: |", file=sys.stderr)
        for each in lines:
            print(
                "| " + " | ".join(f"{v:.3f}" if isinstance(v, float) else str(v) for v in each.values()) + " |",
                file=sys.stderr,
            )
    quality = {"new": figures(p, y), "stored": figures(rows["stored"][shown], y)}
    clear = rows["clear"][shown]
    quality["new, clear truth"] = figures(p[clear], y[clear])
    quality["stored, clear truth"] = figures(rows["stored"][shown][clear], y[clear])
    rejects = [
        {"under": t, **{k: lost(says, right, (rows["kind"] == k) & rows["clear"], t) for k in ["reported", "thinned"]}}
        for t in (0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    ]
    print(json.dumps({"quality": quality, "rejects": rejects}, indent=1), file=sys.stderr)
    counts = {
        str(k): [int((rows["kind"] == k).sum()), int((right[rows["kind"] == k] == 0).sum())]
        for k in np.unique(rows["kind"])
    }
    print(
        document.text(
            "zpm2-bench-confidence/1",
            fitted=fitted,
            folds=folds,
            counts=counts,
            quality=quality,
            rejects=rejects,
            **tables,
        )
    )


def fit(x: Any, level: Any, right: Any, weight: Any) -> tuple[Any, Any]:
    """Weights (not negative) and an intercept for each kind: the most likely ones, all but undamped."""
    n = x.shape[1]

    def loss(b: Any) -> tuple[float, Any]:
        z = x @ b[:n] + level @ b[n:]
        slope = weight * (chance(z) - right)
        value = float((weight * (np.logaddexp(0, z) - right * z)).sum() + 1e-3 * (b[:n] ** 2).sum())
        return value, np.append(x.T @ slope + 2e-3 * b[:n], level.T @ slope)

    start = np.append(np.full(n, 0.5), np.zeros(level.shape[1]))
    bounds = [(0, None)] * n + [(None, None)] * level.shape[1]
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 2000}).x
    return found[:n], found[n:]


def chance(z: Any) -> Any:
    return 1 / (1 + np.exp(-z))


def figures(p: Any, y: Any) -> Rows:
    """Of a confidence `p` of matches that are right or not: calibration in 10 bins of equal count, and order."""
    parts = [part for part in np.array_split(np.argsort(p, kind="stable"), 10) if len(part)]
    off = [abs(float(p[part].mean() - y[part].mean())) for part in parts]
    q = np.clip(p, 1e-4, 1 - 1e-4)
    above = p[y == 1][:, None] - p[y == 0]
    return {
        "matches": len(p),
        "wrong": int((y == 0).sum()),
        "calibration error": round(float(np.average(off, weights=[len(part) for part in parts])), 4),
        "worst bin": round(max(off), 3),
        "log loss": round(float(-(y * np.log(q) + (1 - y) * np.log(1 - q)).mean()), 4),
        "AUC": round(float(((above > 0) + 0.5 * (above == 0)).mean()), 3),
    }


def line(name: str, p: Any, y: Any, rows: Any) -> Rows:
    if not rows.any():
        return {"name": name, "matches": 0, "says": "", "is": "", "error": ""}
    says, right = float(p[rows].mean()), float(y[rows].mean())
    return {"name": name, "matches": int(rows.sum()), "says": says, "is": right, "error": abs(says - right)}


def lost(p: Any, right: Any, rows: Any, limit: float) -> list[int]:
    """Right and wrong matches that a limit would reject."""
    under = rows & (p < limit)
    return [int(right[under].sum()), int((right[under] == 0).sum())]


if __name__ == "__main__":
    main()
