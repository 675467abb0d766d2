"""What runs SAM fastest on a CPU: torch as published, torch cut into three networks, ONNX Runtime, OpenVINO.

    python benchmarks/segmenter_backends.py [--model mobile_sam] [--repeat 5]

Seconds for one image, and per prompt for a batch of 16 point prompts (all masks decoded); the median of the repeats,
the candidates taking turns, so that a change of the machine's speed touches all of them. ONNX Runtime is measured where
`onnx`, `onnxscript` and `onnxruntime` are installed; zpm2 itself does not use it. Prints JSON (schema
zpm2-bench-backends/1) with the largest difference of mask logits and the share of differing mask pixels against
kornia's own decoder.
"""

import argparse
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import document
import numpy as np
import torch

from zpm2.segment import sam_network
from zpm2.segment.sam_backend import EmbeddedPrompts
from zpm2.segment.sam_network import load_sam
from zpm2.segment.sam_openvino import OpenVinoBackend
from zpm2.segment.sam_torch import TorchBackend

PROMPTS = 16


class Kornia:
    """The networks as published, none of them cut."""

    def __init__(self, model: str) -> None:
        self.sam = load_sam(model)

    def image(self, pixels: np.ndarray) -> Any:
        with torch.inference_mode():
            return self.sam.image_encoder(torch.from_numpy(pixels))

    def decode(self, embedding: Any, points: np.ndarray) -> np.ndarray:
        with torch.inference_mode():
            prompts = torch.from_numpy(points).float() - 0.5
            sparse, dense = self.sam.prompt_encoder((prompts, torch.ones(len(points), 1)), None, None)
            position = self.sam.prompt_encoder.get_dense_pe()
            return self.sam.mask_decoder.predict_masks(embedding, position, sparse, dense)[0].numpy()


class Cut:
    """One of zpm2's back ends."""

    def __init__(self, backend: Any) -> None:
        self.backend, self.image = backend, backend.image

    def decode(self, parts: Any, points: np.ndarray) -> np.ndarray:
        asked = EmbeddedPrompts(self.backend.embed(points, np.array([1])))
        return self.backend.masks(parts, asked, -np.inf, 0, (256, 256))[2]


class OnnxBackend:
    """The cut networks in ONNX Runtime."""

    def __init__(self, model: str, folder: Path) -> None:
        import onnxruntime

        sam = load_sam(model)
        self.embed = sam_network.PromptEmbedding.of(sam)
        image, prompt, mask = (
            network(sam).eval()
            for network in (sam_network.ImageNetwork, sam_network.PromptNetwork, sam_network.MaskNetwork)
        )
        with torch.inference_mode():
            pixels, sparse = torch.zeros(1, 3, 1024, 1024), torch.zeros(PROMPTS, 2, 256)
            parts = image(pixels)
            _, hyper, tokens = prompt(*parts, sparse)
            examples = (
                (image, (pixels,)),
                (prompt, (*parts, sparse)),
                (mask, (tokens.reshape(-1, 64, 64, 256), hyper)),
            )
            for k, (network, example) in enumerate(examples):
                torch.onnx.export(network, example, folder / f"{k}.onnx", dynamo=False, opset_version=17)
        self.sessions = [onnxruntime.InferenceSession(folder / f"{k}.onnx") for k in range(3)]

    def _run(self, k: int, inputs: list[np.ndarray]) -> list[np.ndarray]:
        session = self.sessions[k]
        return session.run(None, {spec.name: value for spec, value in zip(session.get_inputs(), inputs, strict=True)})

    def image(self, pixels: np.ndarray) -> list[np.ndarray]:
        return self._run(0, [pixels])

    def masks(
        self, parts: list[np.ndarray], asked: EmbeddedPrompts, least: float, first: int, size: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        iou, hyper, tokens = self._run(1, [*parts, asked.sparse])
        logits = self._run(2, [tokens.reshape(-1, 64, 64, 256), hyper])[0]
        return np.arange(len(iou)), iou[:, first:], logits[:, first:, : size[0], : size[1]]


def seconds(action: Callable[[], Any]) -> tuple[float, Any]:
    start = perf_counter()
    result = action()
    return perf_counter() - start, result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="mobile_sam")
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    pixels = torch.nn.functional.interpolate(
        torch.from_numpy(rng.standard_normal((1, 3, 32, 32)).astype(np.float32)), size=(1024, 1024), mode="bicubic"
    ).numpy()
    points = rng.uniform(0, 1024, (PROMPTS, 1, 2))
    with tempfile.TemporaryDirectory() as folder:
        candidates: dict[str, Any] = {
            "torch, as published": Kornia(options.model),
            "torch, cut": Cut(TorchBackend(options.model, 16, "cpu")),
            "OpenVINO, cut": Cut(OpenVinoBackend(options.model, 16, print)),
        }
        if all(find_spec(name) for name in ("onnx", "onnxscript", "onnxruntime")):
            candidates["ONNX Runtime, cut"] = Cut(OnnxBackend(options.model, Path(folder)))
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in candidates}
        masks: dict[str, np.ndarray] = {}
        for _ in range(options.repeat + 1):  # the first round warms up
            for name, candidate in candidates.items():
                image_time, parts = seconds(lambda c=candidate: c.image(pixels))
                prompt_time, masks[name] = seconds(lambda c=candidate, p=parts: c.decode(p, points))
                times[name].append((image_time, prompt_time / PROMPTS))
    reference = masks["torch, as published"]
    rows = {
        name: {
            "image_s": round(median(t[0] for t in times[name][1:]), 4),
            "prompt_s": round(median(t[1] for t in times[name][1:]), 4),
            "largest_logit_difference": round(float(np.abs(masks[name] - reference).max()), 5),
            "differing_pixels": float(((masks[name] > 0) != (reference > 0)).mean()),
        }
        for name in candidates
    }
    print(document.text("zpm2-bench-backends/1", rows=rows))


if __name__ == "__main__":
    main()
