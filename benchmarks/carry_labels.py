"""Objects that have the same number in the label images of two photographs: each carried, against where it is.

    python benchmarks/carry_labels.py --root DATA > carry_labels.json

`DATA/labels.json` lists the pairs: `left` and `right`, and under `gt` the label images `file` and `file1` with the
numbers `ids`. J is the IoU of masks and F the agreement of outlines within 0.8 % of the diagonal (Perazzi et al. 2016).
Each object is also looked for in the right photograph of the next pair, another scene, which does not show it.
Prints one JSON document (schema zpm2-bench-carry-labels/1): a row a pair, their mean by set, and how many objects were
claimed to be where they are not.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import document
import numpy as np
from numpy.typing import NDArray

from zpm2 import config
from zpm2.api import Matcher
from zpm2.polygons.rasterize import rasterize_stack

BOUND = 0.008  # of the diagonal, within which two outlines agree
Bits = NDArray[np.bool_]


def objects_of(matcher: Matcher, root: Path, each: dict[str, Any]) -> list[dict[str, Any]]:
    """A row for each object of a pair."""
    result = matcher.carry(root / each["left"], root / each["right"], root / each["gt"]["file"])
    labels = cv2.imread(str(root / each["gt"]["file1"]), cv2.IMREAD_UNCHANGED)
    labels = labels[..., 0] if labels.ndim == 3 else labels
    rows = []
    for region, outcome in zip(result.regions, result.outcomes, strict=True):
        if int(region.source_id) not in each["gt"]["ids"]:
            continue
        true, found = labels == int(region.source_id), np.zeros(labels.shape, bool)
        if outcome.shape is not None:
            (found,) = rasterize_stack(np.array([outcome.shape], object), labels.shape[::-1])
        rows.append(
            {
                "pair": each["name"],
                "area": int(true.sum()),
                "seen": float(true.any()),
                "known": 1.0,
                "status": outcome.status,
                "confidence": outcome.confidence,
                "agreement": outcome.agreement,
                "trust": outcome.trust,
                "points": outcome.pair_points,
                "surrounded": outcome.surrounded,
                "carried": float((found & true).sum() / max((found | true).sum(), 1)),
                "outline": outline_agreement(found, true),
            }
        )
    return rows


def claims(matcher: Matcher, root: Path, each: dict[str, Any], other: str) -> list[dict[str, Any]]:
    """A row for each object of a pair that is claimed to be in another scene's photograph."""
    result = matcher.carry(root / each["left"], root / other, root / each["gt"]["file"])
    found = zip(result.regions, result.outcomes, strict=True)
    claimed = [outcome for region, outcome in found if int(region.source_id) in each["gt"]["ids"] and outcome.shape]
    return [{"pair": each["name"], "in": other, "confidence": round(o.confidence, 3)} for o in claimed]


def outline_agreement(found: Bits, true: Bits) -> float:
    """F of two outlines, 0..1."""
    reach = int(np.ceil(BOUND * np.hypot(*true.shape)))
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    edges = [mask.astype(np.uint8) & ~_eroded(mask) for mask in (found, true)]
    near = [edge & cv2.dilate(other, disk) for edge, other in (edges, edges[::-1])]
    precision, recall = (int(n.sum()) / max(int(e.sum()), 1) for n, e in zip(near, edges, strict=True))
    return 2 * precision * recall / max(precision + recall, 1e-9)


def _eroded(mask: Bits) -> NDArray[np.uint8]:
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1), np.uint8)


def summary(name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean J and F."""
    j, f = (float(np.mean([row[key] for row in rows])) for key in ("carried", "outline"))
    return {"name": name, "objects": len(rows), "J": round(j, 3), "F": round(f, 3), "J&F": round((j + f) / 2, 3)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[""], help="parts of names of pairs")
    parser.add_argument("--rows", type=Path, help="also write a row an object, as JSON")
    options = parser.parse_args()
    matcher = Matcher(config.preset("default"))
    by_pair: dict[str, list[dict[str, Any]]] = {}
    elsewhere: list[dict[str, Any]] = []
    pairs = json.loads((options.root / "labels.json").read_text())
    for each, other in zip(pairs, [*pairs[1:], *pairs[:1]], strict=True):
        if any(part in each["name"] for part in options.only):
            by_pair[each["name"]] = objects_of(matcher, options.root, each)
            elsewhere += claims(matcher, options.root, each, other["right"])
            print(json.dumps(summary(each["name"], by_pair[each["name"]])), file=sys.stderr, flush=True)
    rows = [row for own in by_pair.values() for row in own]
    if options.rows:
        options.rows.write_text(json.dumps(rows))
    kinds = dict.fromkeys(name.split("/")[0] for name in by_pair)
    found = [summary(name, own) for name, own in by_pair.items()]
    found += [summary(f"all of {kind}", [row for row in rows if row["pair"].startswith(kind)]) for kind in kinds]
    absent = {"objects": len(rows), "claimed": len(elsewhere), "rows": elsewhere}
    print(document.text("zpm2-bench-carry-labels/1", rows=found, elsewhere=absent))


if __name__ == "__main__":
    main()
