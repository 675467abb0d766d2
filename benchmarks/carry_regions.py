"""Region by region: each detected left region, carried to the right photograph, against its true place there.

    python benchmarks/carry_regions.py --root DATA --regions EVALUATION [--most 40] > carry_regions.json

`DATA/pairs.json` lists the pairs; those with dense truth count. EVALUATION is the folder of an earlier `zpm2 eval` of
them: its left polygons are carried, by its points. IoU is over the points that both photographs see. Beside the carried
outline stand the place by points alone (no segmenter) and the segmenter asked by the box of that place alone. Prints
one JSON document (schema zpm2-bench-carry/1): a row a pair, a kind of pair and a size, and how often a region that the
right photograph does not show was claimed to be there.
"""

import argparse
import itertools
import json
import sys
from pathlib import Path
from time import process_time
from typing import Any

import document
import numpy as np
from numpy.typing import NDArray

from zpm2 import config
from zpm2.carry import pair
from zpm2.carry.places import places
from zpm2.evaluate import ground_truth
from zpm2.evaluate.datasets import open_dataset
from zpm2.evaluate.pairs import DepthTruth, DisparityTruth, EvalPair, PoseTruth
from zpm2.formats.maps import read_disparity, read_map
from zpm2.global_match import initial_geometry
from zpm2.model import Image
from zpm2.photos.images import read_image
from zpm2.photos.kept import KeptPhotos
from zpm2.polygons.rasterize import rasterize_stack
from zpm2.result import MatchResult
from zpm2.segment.predictions import CORNER, OTHER_CORNER, MaskThresholds, Prompts
from zpm2.segment.registry import create
from zpm2.segment.suppression import boxes
from zpm2.segment.view_of import view_of

SIZES = (200, 500, 2000, 10000)  # px^2
SEEN = 0.3  # of a region, from which on the right photograph shows it
UNSEEN = 0.02  # up to which it does not, where the truth is known for
KNOWN = 0.5  # of it
METHODS = ("carried", "points alone", "box alone")
Bits = NDArray[np.bool_]


def regions_of(
    each: EvalPair, folder: Path, most: int, segmenter: Any, settings: config.Config
) -> list[dict[str, Any]]:
    """A row for each left polygon (`most` of them, evenly drawn): its area, the share that is seen, the status, and the
    IoU of each method."""
    images = read_image(each.left, "left image"), read_image(each.right, "right image")
    result = MatchResult.load(folder)
    polygons = result.left.polygons
    drawn = [polygons[k] for k in np.unique(np.linspace(0, len(polygons) - 1, min(most, len(polygons))).astype(int))]
    shapes = np.array([polygon.shape for polygon in drawn], object)
    names = [str(polygon.id) for polygon in drawn]
    initial = initial_geometry(result.points, settings.global_match, settings.seed)
    start = process_time()
    kept = KeptPhotos(2)
    images = kept.same(images[0]), kept.same(images[1])
    found = pair.carry(images, shapes, names, initial, segmenter, settings, kept)
    seconds = (process_time() - start) / max(len(shapes), 1)
    place = places(shapes, initial, settings.carry, settings.local_match)
    view = view_of(segmenter, images[1], kept)
    size = images[1].width, images[1].height
    boxed = _boxed(view, view.cover(place.shapes), size)
    known = _known(each.truth, images[0])
    truth = ground_truth.covisible(each.truth, (images[0].width, images[0].height), size)
    density = len(truth) / (images[0].width * images[0].height)
    left = rasterize_stack(shapes, (images[0].width, images[0].height))
    rows = []
    for k, outcome in enumerate(found):
        inside = _at(left[k], truth.left)
        there: list[Bits | None] = [None if outcome.shape is None else _bits(outcome.shape, size)]
        there += [None if place.shapes[k].is_empty else _bits(place.shapes[k], size), boxed.get(k)]
        rows.append(
            {
                "pair": each.name,
                "area": float(shapes[k].area),
                "seen": float(inside.sum() / max(shapes[k].area * density, 1e-9)),
                "known": float(known[left[k]].mean()) if left[k].any() else 0.0,
                "status": outcome.status,
                "confidence": outcome.confidence,
                "agreement": outcome.agreement,
                "trust": outcome.trust,
                "points": outcome.pair_points,
                "surrounded": outcome.surrounded,
                "seconds": seconds,
                **{name: _iou(inside, bits, truth.right) for name, bits in zip(METHODS, there, strict=True)},
            }
        )
    return rows


def _bits(shape: Any, size: tuple[int, int]) -> Bits:
    return rasterize_stack(np.array([shape], object), size)[0]


def _at(bits: Bits, points: NDArray[np.float64]) -> Bits:
    return np.asarray(bits[points[:, 1].astype(int), points[:, 0].astype(int)])


def _iou(inside: Bits, bits: Bits | None, right: NDArray[np.float64]) -> float:
    if bits is None:
        return 0.0
    there = _at(bits, right)
    return float((inside & there).sum() / max((inside | there).sum(), 1))


def _known(truth: Any, left: Image) -> Bits:
    """(h, w) where the truth knows what becomes of a pixel of the left photograph."""
    size = left.width, left.height
    if isinstance(truth, DisparityTruth):
        return np.isfinite(read_disparity(truth.file, size, truth.scale, truth.sign))
    if isinstance(truth, DepthTruth):
        return np.isfinite(read_map(truth.files[0], size, truth.scale))
    return np.ones(size[::-1], bool)


def _boxed(view: Any, cover: Bits, size: tuple[int, int]) -> dict[int, Bits]:
    """By region, the segmenter's best mask for the box of its place."""
    rows = np.flatnonzero(cover.sum((1, 2)) >= 4)
    if not len(rows):
        return {}
    prompts = Prompts(boxes(cover[rows]).reshape(-1, 2, 2) / view.mask_scale, np.array([CORNER, OTHER_CORNER]))
    masks, found = view.predict(prompts, MaskThresholds(0.0, 0.0)), {}
    for k, row in enumerate(rows.tolist()):
        own = np.flatnonzero(masks.prompt == k)
        if len(own):
            (mask,) = view.masks(masks[own[[int(masks.score[own].argmax())]]])
            bits = np.zeros(size[::-1], bool)
            bits[mask.y0 : mask.y0 + mask.bits.shape[0], mask.x0 : mask.x0 + mask.bits.shape[1]] = mask.bits
            found[row] = bits
    return found


def is_unseen(row: dict[str, Any]) -> bool:
    """Whether it is known that the right photograph does not show a region."""
    return bool(row["seen"] <= UNSEEN and row["known"] >= KNOWN)


def summary(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median IoU and shares of the regions that are seen, and of those that are not how many were claimed."""
    seen, unseen = [r for r in rows if r["seen"] >= SEEN], [r for r in rows if is_unseen(r)]
    made: dict[str, Any] = {"name": name, "regions": len(seen)}
    for method in METHODS if seen else ():
        values = np.array([row[method] for row in seen])
        made[method] = {
            "median": round(float(np.median(values)), 3),
            "0.5": round(float((values >= 0.5).mean()), 3),
            "0.8": round(float((values >= 0.8).mean()), 3),
        }
    claimed = sum(row["status"] in ("found", "in part") for row in unseen)
    return made | {"unseen": len(unseen), "claimed": claimed}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--regions", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[""], help="parts of names of pairs")
    parser.add_argument("--rows", type=Path, help="also write a row a region, as JSON")
    parser.add_argument("--most", type=int, default=10_000, help="regions of a pair")
    options = parser.parse_args()
    settings = config.preset("default")
    segmenter = create(settings.segment, "cpu")
    rows: list[dict[str, Any]] = []
    pairs = []
    for each in open_dataset("pairs", options.root).pairs():
        pose_only = isinstance(each.truth, PoseTruth) and not isinstance(each.truth, DepthTruth)
        if each.truth is None or pose_only or not any(part in each.name for part in options.only):
            continue
        folder = options.regions / "predictions" / each.name
        own = regions_of(each, folder, options.most, segmenter, settings)
        rows += own
        pairs.append(summary(each.name, own))
        print(json.dumps(pairs[-1]), file=sys.stderr, flush=True)
        if options.rows:
            options.rows.write_text(json.dumps(rows))
    edges = [0.0, *SIZES, np.inf]
    kinds = [
        summary(f"all of {kind}", [row for row in rows if row["pair"].split("/")[0] == kind])
        for kind in dict.fromkeys(row["pair"].split("/")[0] for row in rows)
    ]
    sizes = [
        summary(f"{low:g} to {high:g} px^2", [row for row in rows if low <= row["area"] < high])
        for low, high in itertools.pairwise(edges)
    ]
    seconds = round(float(np.mean([row["seconds"] for row in rows])), 3)
    print(
        document.text(
            "zpm2-bench-carry/1", rows=[summary("all", rows), *pairs, *kinds, *sizes], seconds_a_region=seconds
        )
    )


if __name__ == "__main__":
    main()
