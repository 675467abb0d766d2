"""The levels of quality of segment everything: prompts, seconds, and how much of the full grid's masks they find.

    python benchmarks/segment_quality.py IMAGE [IMAGE ...]

A mask of the full grid is found if a mask of the faster level overlaps it by the IoU named. The levels take turns on an
image, which is encoded once. Prints a table to stderr and one JSON document (schema zpm2-bench-quality/1) to stdout.
"""

import argparse
import dataclasses
import json
import sys
import time
from typing import Any

import document
import numpy as np

from zpm2.config import SegmentConfig
from zpm2.photos.images import read_image
from zpm2.segment.automatic import automatic_masks
from zpm2.segment.sam import SamSegmenter

LEVELS = ("full", "balanced", "fast")


def best_overlaps(wanted: Any, found: Any) -> Any:
    """(n,) of each wanted mask the IoU with the found one that overlaps it most; masks (n, h, w)."""
    a, b = (bits.reshape(len(bits), -1).astype(np.float32) for bits in (wanted, found))
    shared = a @ b.T
    return (shared / np.maximum(a.sum(1)[:, None] + b.sum(1)[None] - shared, 1)).max(1, initial=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", nargs="+")
    options = parser.parse_args()
    segmenter = SamSegmenter(SegmentConfig())
    backend, count = segmenter.load(), [0]
    asked = backend.masks

    def masks(parts: Any, prompts: Any, *more: Any) -> Any:
        count[0] += len(prompts)
        return asked(parts, prompts, *more)

    backend.masks = masks  # type: ignore[method-assign]
    rows: dict[str, list[dict[str, float]]] = {level: [] for level in LEVELS}
    for path in options.images:
        view = segmenter.view(read_image(path, "image"))
        full = None
        for level in LEVELS:
            count[0], start = 0, time.perf_counter()
            found = automatic_masks(view, dataclasses.replace(segmenter.config, quality=level)).bits
            seconds = time.perf_counter() - start
            full = found if full is None else full
            overlap = best_overlaps(full, found)
            area = full.sum((1, 2))
            row = {
                "prompts": count[0],
                "seconds": seconds,
                "masks": len(found),
                "recall at 0.7": float((overlap >= 0.7).mean()),
                "recall at 0.8": float((overlap >= 0.8).mean()),
                "area found": float((overlap * area).sum() / area.sum()),
            }
            rows[level].append(row)
            print(path, level, json.dumps(row), file=sys.stderr, flush=True)
    table = {level: {name: float(np.mean([r[name] for r in of])) for name in of[0]} for level, of in rows.items()}
    print(json.dumps(table, indent=1), file=sys.stderr)
    print(document.text("zpm2-bench-quality/1", table=table, rows=rows))


if __name__ == "__main__":
    main()
