"""SAM's three networks in OpenVINO, faster than torch on a CPU.

The graphs are converted once from the torch networks and kept beside the weights, in a folder whose name holds
everything that they depend on: the weights' hash, this file's `VERSION`, and the versions of openvino and torch.

Every core answers prompts by itself: what few prompts need stays in its cache, and no core waits for another one. So
what a prompt is answered does not depend on how many cores there are.
"""

import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from zpm2 import weights
from zpm2.cores import limit, usable
from zpm2.runtime import mark_networks_loaded
from zpm2.segment.sam_ahead import Ahead
from zpm2.segment.sam_backend import WEIGHTS, Array, EmbeddedPrompts, of_photograph, promising, rows_of
from zpm2.segment.sam_input import ENCODER_SIDE
from zpm2.segment.sam_padding import ThinnedTokens
from zpm2.segment.sam_vicinity import TOKEN_PX, NearTokens
from zpm2.segment.stacks import Rows

if TYPE_CHECKING:
    from openvino import CompiledModel, Core, InferRequest

Say = Callable[[str], None]
Shapes = tuple[tuple[int, ...], ...]
Answer = tuple[Array, Array | None]  # predicted IoU (M,) of a prompt's masks, and logits (M, h, w) if one is promising

VERSION = 6  # of the cut into networks; raise it when sam_network.py changes what they compute
NETWORKS = ("image", "prompt", "near", "mask")
PRECISIONS = {"float32": "f32", "float16": "f16", "bfloat16": "bf16"}  # as OpenVINO calls them
# prompts at a time on one core, that see all tokens and that see what is near: those that take the least time each
FAR_BATCH, NEAR_BATCH = 1, 2
MOST_CORES = 8  # that answer at a time: as many as 16 prompts have parts; each takes 7 to 14 MB for a network
# Cores up to which each has networks of its own, for another 20 to 40 MB each. OpenVINO runs one request at a time of a
# compiled network in the thread that asks, or several in threads of its own: those of two networks in turns leave cores
# idle.
OWN_NETWORKS = 2
MASKS, HYPER = 4, 32  # masks of a prompt, and weights of each
TOKEN_AXES = (0, 2, 1, 0, 0)  # of the parts that `sam_network.ImageNetwork` returns
ANY = -1  # image tokens that one network takes, where all are seen: a photograph's shape says how many
KEPT = 6  # networks of a graph that stay compiled; one takes some 60 MB, and 0.1 s to compile


@cache
def openvino_core() -> "Core":
    """OpenVINO's one core of this process, which is never freed.

    Its CPU plug-in gives the thread that opens it a stack for signal handlers, and unmaps that stack when the core is
    freed, also where another thread frees it. The next signal, Ctrl-C say, would then end the process with a
    segmentation fault.
    """
    import openvino

    return openvino.Core()


class _Network:
    """A graph for inputs of some shapes, and the memory that it works in: a request for each thread that runs it. It is
    compiled once for all of these, or for each its `own`."""

    def __init__(self, compiled: "Callable[[], CompiledModel]", own: bool) -> None:
        self._compiled, self._shared = compiled, None if own else compiled()
        self._idle: list[tuple[CompiledModel, InferRequest | None]] = []

    @contextmanager
    def request(self) -> "Iterator[InferRequest]":
        """What one thread runs. The outputs lie in its memory, until it runs again or rests."""
        try:
            compiled, request = self._idle.pop()
        except IndexError:
            compiled, request = self._shared if self._shared is not None else self._compiled(), None
        request = request or compiled.create_infer_request()
        try:
            yield request
        finally:
            self._idle.append((compiled, request))

    def rest(self) -> None:
        """Frees the memory that it works in, some 250 MB of an image network, while no thread runs it."""
        working = {id(compiled): compiled for compiled, request in self._idle if request is not None}
        self._idle = [(compiled, None) for compiled, _ in self._idle]
        for compiled in working.values():
            compiled.release_memory()


class OpenVinoBackend:
    """The networks converted to OpenVINO, on the CPU."""

    name = "openvino"

    def __init__(self, model: str, batch: int, say: Say, precision: str = "float32") -> None:
        import openvino

        from zpm2.segment.sam_network import PromptEmbedding

        self.batch, self.precision = batch, PRECISIONS[precision]
        folder = _converted(model, openvino.__version__, say)
        mark_networks_loaded()
        with np.load(folder / "embedding.npz") as arrays:
            self.embed = PromptEmbedding(**arrays)
        self.core = openvino_core()
        self.graphs = {name: self.core.read_model(folder / f"{name}.xml") for name in NETWORKS}  # now, as checked
        # of each graph, by the shapes that it takes (-1: any), the latest used last
        self.networks: dict[str, OrderedDict[Shapes, _Network]] = {name: OrderedDict() for name in NETWORKS}
        self._ahead: dict[str, tuple[_Answers, Ahead[Answer]]] = {}  # by the graph of the prompts

    def _network(self, name: str, *shapes: tuple[int, ...]) -> _Network:
        """The graph, compiled for these shapes."""
        kept = self.networks[name]
        if shapes not in kept:
            # the same arithmetic on every machine: without the hint, CPUs with bfloat16 units would use them
            options: dict[str, object] = {"INFERENCE_PRECISION_HINT": "f32" if name == "image" else self.precision}
            own = name != "image" and usable() <= OWN_NETWORKS
            if name == "image":
                options["PERFORMANCE_HINT"] = "LATENCY"
                if (most := limit()) is not None:
                    options["INFERENCE_NUM_THREADS"] = most
            elif own:
                options |= {"NUM_STREAMS": 0, "INFERENCE_NUM_THREADS": 1}  # in the thread that asks
            else:
                cores = min(usable(), MOST_CORES)
                options |= {"NUM_STREAMS": cores, "INFERENCE_NUM_THREADS": cores}
            graph = self.graphs[name].clone()
            graph.reshape(dict(zip(graph.inputs, shapes, strict=True)))
            kept[shapes] = _Network(partial(self.core.compile_model, graph, "CPU", options), own)
            while len(kept) > KEPT:
                kept.popitem(last=False)
        kept.move_to_end(shapes)
        return kept[shapes]

    def _rest(self, *names: str) -> None:
        for name in names:
            for network in self.networks[name].values():
                network.rest()

    def image(self, pixels: Array) -> list[Array]:
        while self._ahead:
            self._ahead.popitem()[1][1].end()
        self._rest("prompt", "near", "mask")
        network = self._network("image", pixels.shape)
        with network.request() as request:
            return [part.copy() for part in request.infer([pixels], share_inputs=True, share_outputs=True).values()]

    def thinned(self, parts: list[Array], tokens: ThinnedTokens) -> list[Array]:
        return [*(np.ascontiguousarray(part) for part in rows_of(parts[:-1], tokens.rows)), tokens.log_count]

    def tokens(self, parts: list[Array]) -> Array:
        return np.asarray(parts[0])

    def masks(
        self,
        parts: list[Array],
        asked: EmbeddedPrompts,
        least: float,
        first: int,
        size: tuple[int, int],
        soon: Callable[[], EmbeddedPrompts] | None = None,
    ) -> tuple[Rows, Array, Array]:
        self._rest("image")
        name = "prompt" if asked.near is None else "near"
        answers = self._answers(name, parts, asked, least, first, size)
        kept = self._ahead.get(name)
        if kept is not None and not answers.are_like(kept[0]):
            kept[1].end()
            kept = None
        _, ahead = self._ahead[name] = kept or (answers, Ahead(answers, answers.batch))
        found = ahead(asked, soon)
        if ahead.idle:
            del self._ahead[name]
        iou = np.array([every for every, _ in found], np.float32).reshape(len(asked), MASKS - first)
        logits = [decoded for _, decoded in found if decoded is not None]
        good = promising(iou, least)
        return good, iou[good], np.stack(logits) if logits else np.empty((0, MASKS - first, *size), np.float32)

    def _answers(
        self, name: str, parts: list[Array], asked: EmbeddedPrompts, least: float, first: int, size: tuple[int, int]
    ) -> "_Answers":
        if asked.near is None:
            batch, shapes = FAR_BATCH, _shapes(parts, ANY)
        else:
            batch = NEAR_BATCH
            shapes = [(batch, *shape) for shape in _shapes(parts, asked.near.rows.shape[1])]
        prompting = self._network(name, *shapes, (batch, *asked.sparse.shape[1:]))
        high, wide = (-(-side // TOKEN_PX) for side in size)
        decoding = self._network("mask", (1, high, wide, parts[0].shape[1]), (1, MASKS - first, HYPER))
        return _Answers(parts, least, first, size, batch, prompting, decoding)


@dataclass(frozen=True, eq=False)
class _Answers:
    """What SAM answers to prompts of one form, on one core."""

    parts: list[Array]
    least: float
    first: int
    size: tuple[int, int]
    batch: int
    prompting: _Network
    decoding: _Network

    def are_like(self, other: "_Answers") -> bool:
        """Whether both give the same."""
        same = self.parts is other.parts and self.prompting is other.prompting and self.decoding is other.decoding
        return same and (self.least, self.size) == (other.least, other.size)

    def __call__(self, asked: EmbeddedPrompts) -> list[Answer]:
        """Of at most `batch` prompts. A prompt's masks are decoded while their image tokens are in the core's cache."""
        rows = np.minimum(np.arange(self.batch), len(asked) - 1)  # the last one fills it up
        with self.prompting.request() as request:
            if asked.near is None:
                inputs = [*self.parts, asked.sparse[rows]]
            else:
                inputs = None
                _gather(self.parts, asked.near[rows], asked.sparse[rows], [each.data for each in request.input_tensors])
            found = request.infer(inputs, share_inputs=True, share_outputs=True).values()
            iou, hyper, tokens = (each[: len(asked)] for each in found)
            answers: list[Answer] = [(each.copy(), None) for each in iou[:, self.first :]]
            with self.decoding.request() as decoder:
                for row in promising(iou[:, self.first :], self.least):
                    answers[row] = answers[row][0], self._decoded(decoder, tokens[row : row + 1], hyper[row : row + 1])
        return answers

    def _decoded(self, decoder: "InferRequest", tokens: Array, hyper: Array) -> Array:
        """Of one prompt."""
        these = np.ascontiguousarray(of_photograph(tokens, self.size))
        weights = np.ascontiguousarray(hyper[:, self.first :])
        (logits,) = decoder.infer([these, weights], share_inputs=True, share_outputs=True).values()
        return np.array(logits[0, :, : self.size[0], : self.size[1]])


def _shapes(parts: list[Array], tokens: int) -> list[tuple[int, ...]]:
    """Of the parts and the counts, with so many image tokens."""
    shapes = [
        (*part.shape[:axis], tokens, *part.shape[axis + 1 :]) for part, axis in zip(parts[:-1], TOKEN_AXES, strict=True)
    ]
    return [*shapes, (tokens,)]


def _gather(parts: list[Array], near: NearTokens, sparse: Array, inputs: list[Array]) -> None:
    """Writes what each of a few prompts sees into the inputs of a network."""
    for part, axis, every in zip(parts[:-1], TOKEN_AXES, inputs[:-2], strict=True):
        for rows, into in zip(near.rows, every, strict=True):
            np.take(part, rows, axis, into, "clip")
    inputs[-2][:], inputs[-1][:] = near.log_count, sparse


def _converted(model: str, openvino_version: str, say: Say) -> Path:
    """The folder with the converted networks, which are converted now if they are not there yet."""
    from importlib.metadata import version

    name = WEIGHTS[model]
    key = f"openvino-{VERSION}-{weights.entry(name).sha256[:12]}-{openvino_version.split('-')[0]}-{version('torch')}"

    def convert(folder: Path) -> None:
        say(f"converting {name} to OpenVINO, once")
        _convert(model, folder)

    return weights.converted(name, key, convert)


def _convert(model: str, folder: Path) -> None:
    import openvino
    import torch

    from zpm2.segment import sam_network

    sam = sam_network.load_sam(model)
    with torch.inference_mode(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Converting a tensor")  # kornia's shape checks, constant for our one size
        image, prompt, mask = (
            sam_network.ImageNetwork(sam),
            sam_network.PromptNetwork(sam),
            sam_network.MaskNetwork(sam),
        )
        pixels = torch.zeros(1, 3, ENCODER_SIDE, ENCODER_SIDE)
        parts = image.eval()(pixels)
        sparse = torch.zeros(2, 2, 256)
        near = tuple(torch.stack([part, part]) for part in parts)
        _, hyper, tokens = prompt.eval()(*parts, sparse)
        graphs = (
            openvino.convert_model(image, example_input=(pixels,)),
            openvino.convert_model(prompt, example_input=(*parts, sparse)),
            openvino.convert_model(prompt, example_input=(*near, sparse)),
            openvino.convert_model(mask.eval(), example_input=(of_photograph(tokens, (8, 12)), hyper)),
        )
    for name, graph in zip(NETWORKS, graphs, strict=True):
        try:
            openvino.save_model(graph, folder / f"{name}.xml", compress_to_fp16=False)
        except RuntimeError as error:  # of a full disk
            raise OSError(" ".join(str(error).split())) from error
    embedding = sam_network.PromptEmbedding.of(sam)
    np.savez(
        folder / "embedding.npz",
        frequencies=embedding.frequencies,
        labels=embedding.labels,
        padding=embedding.padding,
    )
