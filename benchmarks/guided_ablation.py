"""What guided re-detection and the quality of segment everything bring and cost.

    python benchmarks/guided_ablation.py --root DATA --scorer score_pair.py --pairs NAME ... [--torch NAME]

Every variant is run on every pair, one after the other in one process, so that their seconds compare. `--torch` adds, on
that one pair, the same pipeline with the torch networks and the plain grid on both images. Data and scorer as for
match_pairs.py. Prints the table to stderr and one JSON document (schema zpm2-bench-guided/1) to stdout.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from match_pairs import environment, score, totals

from zpm2 import PolygonMatcher, config
from zpm2.detect.sam import SamSegmenter

VARIANTS = [(quality, direction) for quality in ("full", "fast") for direction in ("off", "forward", "both")]


class Counted:
    """A matcher that counts the prompts of its segmenter."""

    def __init__(self, settings: list[str]) -> None:
        chosen = config.assign(config.preset("default"), settings)
        self.segmenter = SamSegmenter(chosen.segment)
        self.matcher = PolygonMatcher(chosen, segmenter=self.segmenter)
        self.prompts = 0
        backend = self.segmenter.load()
        asked = backend.prompt

        def prompt(parts: Any, sparse: Any) -> Any:
            self.prompts += len(sparse)
            return asked(parts, sparse)

        backend.prompt = prompt  # type: ignore[method-assign]

    def __call__(self, left: Path, right: Path) -> tuple[Any, float, int]:
        """The result, its seconds with the models loaded, and its prompts."""
        self.matcher._load_points()
        before, start = self.prompts, time.perf_counter()
        result = self.matcher(left, right)
        return result, time.perf_counter() - start, self.prompts - before


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--scorer", type=Path, required=True)
    parser.add_argument("--pairs", nargs="+", required=True)
    parser.add_argument("--torch")
    options = parser.parse_args()
    known = {pair["name"]: pair for pair in json.loads((options.root / "pairs.json").read_text())}
    runs = [
        (f"{quality}, {direction}", [f"segment.quality={quality}", f"guided.direction={direction}"], options.pairs)
        for quality, direction in VARIANTS
    ]
    if options.torch:
        runs.append(
            (
                "torch, full, off",
                ["segment.quality=full", "guided.direction=off", "segment.backend=torch"],
                [options.torch],
            )
        )
    rows: list[dict[str, Any]] = []
    table = {}
    with tempfile.TemporaryDirectory() as temporary:
        for label, settings, names in runs:
            counted = Counted(settings)
            of_variant = []
            for name in names:
                pair = known[name]
                result, seconds, prompts = counted(options.root / pair["left"], options.root / pair["right"])
                folder = result.save(Path(temporary) / label / name.replace("/", "_"))
                row = {
                    "variant": label,
                    "pair": name,
                    "prompts": prompts,
                    "seconds": round(seconds, 2),
                    "stages": {stage: round(value, 2) for stage, value in result.timings.items()},
                    "score": score(options.scorer, options.root, pair, folder / "matches.json"),
                }
                of_variant.append(row)
                print(json.dumps(row), file=sys.stderr, flush=True)
            rows += of_variant
            table[label] = {
                **totals(of_variant),
                "prompts a pair": round(sum(row["prompts"] for row in of_variant) / len(of_variant)),
                "seconds a pair": round(sum(row["seconds"] for row in of_variant) / len(of_variant), 1),
            }
            print(label, json.dumps(table[label]), file=sys.stderr, flush=True)
    print(
        json.dumps(
            {"schema": "zpm2-bench-guided/1", "environment": environment(), "table": table, "rows": rows}, indent=1
        )
    )


if __name__ == "__main__":
    main()
