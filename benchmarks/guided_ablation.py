"""What guided re-detection and the quality of segment everything bring and cost.

    python benchmarks/guided_ablation.py --root DATA --scorer score_pair.py --pairs NAME ... [--torch NAME]

Every variant is run on every pair, one after the other in one process, so that their seconds compare. What guidance in
one direction gives is what a run in both directions has when it turns round: taken, with its seconds and prompts, from
there. `--torch` adds, on that one pair, the same pipeline with torch and the plain grid on both images: with the
decoder cut as here, and with it as published, where every prompt takes the whole decoder and all masks are decoded.
Data and scorer as for match_pairs.py. Prints the table to stderr and one JSON document (schema zpm2-bench-guided/1) to
stdout.
"""

import argparse
import dataclasses
import json
import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import document
import numpy as np
from match_pairs import score, totals
from numpy.typing import NDArray

from zpm2 import config
from zpm2.pipeline import PairMatcher
from zpm2.result import MatchResult
from zpm2.segment.sam import SamSegmenter
from zpm2.segment.sam_network import load_sam
from zpm2.segment.sam_torch import TorchBackend


class Published(TorchBackend):
    """The decoder as it was published: nothing computed once for an image, every mask decoded."""

    def __init__(self, model: str, device: str) -> None:
        super().__init__(model, 16, device)
        self.resident = False
        self.sam = load_sam(model).to(self.device)

    def image(self, pixels: NDArray[np.float32]) -> Any:
        with self.torch.inference_mode():
            return self.sam.image_encoder(self._to(pixels))

    def prompt(self, parts: Any, sparse: NDArray[np.float32], near: Any = None) -> tuple[Any, Any, Any]:
        with self.torch.inference_mode():
            _, dense = self.sam.prompt_encoder(None, None, None)
            dense = dense.expand(len(sparse), -1, -1, -1)
            position = self.sam.prompt_encoder.get_dense_pe()
            logits, iou = self.sam.mask_decoder.predict_masks(parts, position, self._to(sparse), dense)
        return iou.cpu().numpy(), np.zeros((*iou.shape, 1), np.float32), logits.cpu().numpy()

    def mask(self, tokens: Any, rows: NDArray[np.intp], hyper: NDArray[np.float32], size: tuple[int, int]) -> Any:
        return tokens[rows][:, -hyper.shape[1] :, : size[0], : size[1]]


class Measured:
    """A matcher of which prompts and seconds are counted, models loaded."""

    def __init__(self, settings: list[str], published: bool = False) -> None:
        chosen = config.assign(config.preset("default"), settings)
        self.segmenter = SamSegmenter(chosen.segment)
        if published:
            self.segmenter._backend = Published(chosen.segment.model, "cpu")
        self.matcher = PairMatcher(chosen, segmenter=self.segmenter)
        self.matcher.load()
        self.prompts, self.forward = 0, None
        backend, regions = self.segmenter.load(), self.matcher._regions
        asked, turned_round = backend.masks, regions.redetect

        def masks(parts: Any, prompts: Any, *more: Any) -> Any:
            self.prompts += len(prompts)
            return asked(parts, prompts, *more)

        def redetect(found: Any, matches: Any, initial: Any) -> Any:
            self.forward = (found.sides(matches, chosen.vectorize), time.perf_counter() - self.start, self.prompts)
            return turned_round(found, matches, initial)

        backend.masks, regions.redetect = masks, redetect

    def __call__(self, left: Path, right: Path) -> list[tuple[str, MatchResult, float, int]]:
        """Results with their seconds and prompts: of the whole run, and before it turned round, if it did."""
        self.prompts, self.forward, self.start = 0, None, time.perf_counter()
        result = self.matcher(left, right)
        found = [(self.matcher.config.guided.direction, result, time.perf_counter() - self.start, self.prompts)]
        if self.forward:
            (sides, matches), seconds, prompts = self.forward
            before = dataclasses.replace(result, left=sides[0], right=sides[1], matches=matches)
            found.insert(0, ("forward", before, seconds, prompts))
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--scorer", type=Path, required=True)
    parser.add_argument("--pairs", nargs="+", required=True)
    parser.add_argument("--torch")
    options = parser.parse_args()
    known = {pair["name"]: pair for pair in json.loads((options.root / "pairs.json").read_text())}
    runs = [
        (quality, ["segment.quality=" + quality, "guided.direction=" + direction], options.pairs)
        for quality in ("fast", "full")
        for direction in ("both", "off")
    ]
    if options.torch:
        plain = ["quality=full", "backend=torch", "padding=0", "vicinity=0"]
        plain = [*("segment." + each for each in plain), "guided.direction=off"]
        runs.append(("torch, full", plain, [options.torch]))
        runs.append(("torch as published, full", plain, [options.torch]))
    rows: dict[str, list[dict[str, Any]]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        for label, settings, names in runs:
            matcher = Measured(settings, label.startswith("torch as published"))
            for name in names:
                pair = known[name]
                for direction, result, seconds, prompts in matcher(
                    options.root / pair["left"], options.root / pair["right"]
                ):
                    folder = result.save(Path(temporary) / label / direction / name.replace("/", "_"))
                    row = {
                        "pair": name,
                        "prompts": prompts,
                        "seconds": round(seconds, 2),
                        "stages": {stage: round(value, 2) for stage, value in result.timings.items()},
                        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
                        "score": score(options.scorer, options.root, pair, folder / "matches.json"),
                    }
                    rows.setdefault(f"{label}, guided {direction}", []).append(row)
                    print(label, direction, json.dumps(row), file=sys.stderr, flush=True)
    table = {
        variant: {
            **totals(of),
            "prompts a pair": round(sum(row["prompts"] for row in of) / len(of)),
            "seconds a pair": round(sum(row["seconds"] for row in of) / len(of), 1),
        }
        for variant, of in rows.items()
    }
    for variant, line in table.items():
        print(variant, json.dumps(line), file=sys.stderr)
    print(document.text("zpm2-bench-guided/1", table=table, rows=rows))


if __name__ == "__main__":
    main()
