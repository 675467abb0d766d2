"""What runs SAM's three networks: torch (the reference, and what a GPU uses) or OpenVINO (faster on a CPU).

OpenVINO's graphs are converted once from the torch networks and kept beside the weights, in a folder whose name holds
everything that they depend on: the weights' hash, this file's `VERSION`, and the versions of openvino and torch.
"""

import warnings
from collections import OrderedDict
from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.errors import ConfigError, MissingDependency
from zpm2.runtime import mark_networks_loaded
from zpm2.segment.sam_input import ENCODER_SIDE, MEAN, STD
from zpm2.segment.sam_padding import GRID, ThinnedTokens
from zpm2.segment.sam_vicinity import TOKEN_PX, NearTokens
from zpm2.segment.stacks import Stack

if TYPE_CHECKING:
    from kornia.models.sam import Sam
    from openvino import CompiledModel, Core, InferRequest
    from torch import Tensor

Array = NDArray[np.float32]
Say = Callable[[str], None]
Opaque = Any  # what a backend returns and only that backend reads: torch's tensors or arrays
Tokens = TypeVar("Tokens", "Tensor", Array)

VERSION = 5  # of the cut into networks; raise it when sam_network.py changes what they compute
WEIGHTS = {"mobile_sam": "mobile_sam", "vit_b": "sam_vit_b", "vit_l": "sam_vit_l", "vit_h": "sam_vit_h"}
NETWORKS = ("image", "prompt", "near", "mask")
PRECISIONS = {"float32": "f32", "float16": "f16", "bfloat16": "bf16"}  # as OpenVINO calls them
MASK_NETWORKS = 8  # sizes of masks whose networks stay compiled; one has 15 MB and takes 0.1 s to compile
FEW = 4  # prompts at a time, where a batch on a CPU would mostly be filled up; a prompt then takes a seventh longer
# image tokens of all prompt networks that are kept, in about 2 GB: two photographs of any shapes; and of all networks
# for what is near, in a quarter of that
KEPT_TOKENS = 8192


class SamBackend(Protocol):
    """The three networks of `sam_network`, arrays in and arrays out. Only `prompt` and `tokens` read what `image`
    returns."""

    name: str
    batch: int  # prompts at a time, at most; each takes 4 MB of image tokens
    few: int  # prompts at a time where batches are filled up, and fewer are left; 0: they are not

    def embed(self, points: NDArray[np.float64], labels: NDArray[np.int64]) -> Array:
        """`sam_network.PromptEmbedding`."""

    def image(self, pixels: Array) -> Opaque:
        """(1, 3, 1024, 1024) -> the parts that do not depend on the prompt."""

    def thinned(self, parts: Opaque, tokens: ThinnedTokens) -> Opaque:
        """What `image` returned, of some of the image tokens."""

    def tokens(self, parts: Opaque) -> Array:
        """What `image` returned -> (N, 256) image tokens: the encoder's embedding, off by the vector of "no mask"."""

    def prompt(self, parts: Opaque, sparse: Array, near: NearTokens | None = None) -> tuple[Array, Stack, Opaque]:
        """Embedded prompts (B, P, 256) -> predicted IoU (B, 4), mask weights (B, 4, 32), opaque image tokens: all that
        the view has, or those that are `near` each prompt."""

    def mask(self, tokens: Opaque, rows: NDArray[np.intp], hyper: Stack, size: tuple[int, int]) -> Stack:
        """Image tokens of the prompts `rows` and their mask weights (b, M, 32) -> logits (b, M, height, width), of
        `size` (height, width) px of a decoded mask; the padding beyond it is not decoded."""


def open_backend(config: SegmentConfig, device: str, say: Say, download: weights.Progress | None = None) -> SamBackend:
    """The configured backend ("auto": openvino on a CPU where it is installed, else torch).

    `say` receives a line when networks are converted, which takes half a minute once.
    """
    model, backend = config.model, config.backend
    if backend == "openvino" and device != "cpu":
        raise ConfigError(f"segment.backend openvino runs on the CPU only, the device is {device}; use --device cpu")
    installed = find_spec("openvino") is not None
    if backend == "openvino" and not installed:
        raise MissingDependency("segment.backend openvino needs openvino: pip install openvino")
    weights.get(WEIGHTS[model], progress=download)
    if device == "cpu" and installed and backend != "torch":
        return OpenVinoBackend(model, config.cpu_batch, say, config.precision)
    batch = config.cpu_batch if device == "cpu" else config.gpu_batch
    return TorchBackend(model, batch, device, config.precision)


def load_sam(model: str) -> "Sam":
    """kornia's `Sam` of that name with its released weights, in evaluation mode."""
    from kornia.models.sam import Sam

    sam = Sam.from_name(model)
    sam.load_state_dict(weights.load_state_dict(WEIGHTS[model]), strict=True)
    return sam.eval().requires_grad_(False)


class TorchBackend:
    """The networks in torch. Where they run on a GPU (`resident`), masks and what belongs to them stay there.

    `precision` is that of the prompt and the mask network.
    """

    name = "torch"
    few = 0

    def __init__(self, model: str, batch: int, device: str, precision: str = "float32") -> None:
        import torch

        from zpm2.segment import sam_network
        from zpm2.segment.device_stacks import to_host

        self.to_host = to_host
        self.torch, self.device, self.dtype = torch, torch.device(device), getattr(torch, precision)
        self.batch, self.resident = batch, self.device.type != "cpu"
        sam = load_sam(model)
        self.embed = sam_network.PromptEmbedding.of(sam)
        self.encoder = sam_network.ImageNetwork(sam).eval().to(self.device)
        if precision != "float32":  # layers that two networks share stay single in the encoder
            sam.mask_decoder = deepcopy(sam.mask_decoder)
        self.prompter = sam_network.PromptNetwork(sam).eval().to(self.device, self.dtype)
        self.decoder = sam_network.MaskNetwork(sam).eval().to(self.device, self.dtype)

    def _to(self, array: NDArray[np.generic]) -> "Tensor":
        from zpm2.segment.device_stacks import on

        return on(array, self.device)

    def _out(self, tensor: "Tensor") -> Stack:
        return tensor if self.resident else tensor.float().numpy()

    def image(self, pixels: Array) -> "tuple[Tensor, ...]":
        with self.torch.inference_mode():
            return self._in_half(self.encoder(self._to(pixels)))

    def images(self, reduced: Sequence[NDArray[np.uint8]]) -> "list[tuple[Tensor, ...]]":
        """`image` of several photographs (h, w, 3), reduced to fit the square, in one batch."""
        with self.torch.inference_mode():
            squares = self.torch.zeros(len(reduced), 3, ENCODER_SIDE, ENCODER_SIDE, device=self.device)
            mean, std = self._to(MEAN), self._to(STD)
            for square, rgb in zip(squares, reduced, strict=True):
                normal = (self._to(rgb).float() - mean) / std
                square[:, : rgb.shape[0], : rgb.shape[1]] = normal.permute(2, 0, 1)
            return [self._in_half(self.encoder.parts(each)) for each in self.encoder.encoder(squares)]

    def _in_half(self, parts: "tuple[Tensor, ...]") -> "tuple[Tensor, ...]":
        return tuple(part.to(self.dtype) for part in parts)

    def thinned(self, parts: "tuple[Tensor, ...]", tokens: ThinnedTokens) -> "tuple[Tensor, ...]":
        counts = self._to(tokens.log_count).to(self.dtype)
        return *(part.contiguous() for part in _rows(parts[:-1], self._to(tokens.rows))), counts

    def tokens(self, parts: "tuple[Tensor, ...]") -> Array:
        return np.asarray(parts[0].float().cpu().numpy())

    def prompt(
        self, parts: "tuple[Tensor, ...]", sparse: Array, near: NearTokens | None = None
    ) -> "tuple[Array, Stack, Tensor]":
        with self.torch.inference_mode():
            if near is not None:
                keys, k, v, *others = _rows(parts[:-1], self._to(near.rows))
                counts = self._to(near.log_count).to(self.dtype)
                parts = (keys, k.permute(2, 0, 1, 3), v.permute(1, 0, 2, 3), *others, counts)
            iou, hyper, tokens = self.prompter(*parts, self._to(sparse).to(self.dtype))
            return np.asarray(self.to_host(iou.float())[0], np.float32), self._out(hyper), tokens

    def mask(self, tokens: "Tensor", rows: NDArray[np.intp], hyper: Stack, size: tuple[int, int]) -> Stack:
        weights = self._to(hyper).to(self.dtype) if isinstance(hyper, np.ndarray) else hyper
        with self.torch.inference_mode():
            logits = self.decoder(of_photograph(tokens[self._to(rows)], size), weights)
        return self._out(logits[:, :, : size[0], : size[1]])


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
    """A compiled network, and the memory that it works in, which it keeps until it rests."""

    def __init__(self, compiled: "CompiledModel") -> None:
        self.compiled = compiled
        self._request: InferRequest | None = None

    def __call__(self, inputs: list[Array]) -> list[Array]:
        """The outputs lie in the network's own memory, until it runs again or rests."""
        if self._request is None:
            self._request = self.compiled.create_infer_request()
        return list(self._request.infer(inputs, share_inputs=True, share_outputs=True).values())

    def rest(self) -> None:
        """Frees the memory that it works in, some 250 MB of an image or a prompt network."""
        if self._request is not None:
            self._request = None
            self.compiled.release_memory()


class OpenVinoBackend:
    """The networks converted to OpenVINO, on the CPU."""

    name = "openvino"

    def __init__(self, model: str, batch: int, say: Say, precision: str = "float32") -> None:
        import openvino

        from zpm2.segment.sam_network import PromptEmbedding

        self.batch, self.few, self.precision = batch, FEW if batch > FEW else 0, PRECISIONS[precision]
        folder = _converted(model, openvino.__version__, say)
        mark_networks_loaded()
        with np.load(folder / "embedding.npz") as arrays:
            self.embed = PromptEmbedding(**arrays)
        self.core = openvino_core()
        self.graphs = {name: self.core.read_model(folder / f"{name}.xml") for name in NETWORKS}  # now, as checked
        self.image_network = self._compile("image")
        # by number of image tokens, the latest used last; of each, by number of prompts and of tokens of each prompt
        self.prompt_networks: OrderedDict[int, dict[tuple[int, ...], _Network]] = OrderedDict()
        self.near_networks: OrderedDict[int, dict[tuple[int, ...], _Network]] = OrderedDict()
        self._gathered: list[Array] | None = None  # what `_near` returned last
        # by number of masks and of rows and columns of tokens, the latest used last
        self.mask_networks: OrderedDict[tuple[int, ...], _Network] = OrderedDict()

    def _compile(self, name: str, shapes: list[tuple[int, ...]] | None = None) -> _Network:
        # the same arithmetic on every machine: without the hint, CPUs with bfloat16 units would use them
        options = {
            "INFERENCE_PRECISION_HINT": "f32" if name == "image" else self.precision,
            "PERFORMANCE_HINT": "LATENCY",
        }
        graph = self.graphs[name].clone()
        if shapes:
            graph.reshape(dict(zip(graph.inputs, shapes, strict=True)))
        return _Network(self.core.compile_model(graph, "CPU", options))

    def image(self, pixels: Array) -> list[Array]:
        for networks in (*self.prompt_networks.values(), *self.near_networks.values()):
            for network in networks.values():
                network.rest()
        return [part.copy() for part in self.image_network([pixels])]

    def thinned(self, parts: list[Array], tokens: ThinnedTokens) -> list[Array]:
        return [*(np.ascontiguousarray(part) for part in _rows(parts[:-1], tokens.rows)), tokens.log_count]

    def tokens(self, parts: list[Array]) -> Array:
        return np.asarray(parts[0])

    def prompt(self, parts: list[Array], sparse: Array, near: NearTokens | None = None) -> tuple[Array, Array, Array]:
        """In batches of a fixed size, filled up with zeros: a fifth faster than networks for any size."""
        self.image_network.rest()
        if near is None:
            return self._prompt("prompt", parts, sparse, self.few if len(sparse) <= self.few else self.batch)
        batch, number = self.few or self.batch, near.rows.shape[1]
        tokens = np.empty((len(sparse), number, parts[0].shape[1]), np.float32)
        answers = list[tuple[Array, Array]]()
        for start in range(0, len(sparse), batch):
            part = slice(start, start + batch)
            iou, hyper, tokens[part] = self._prompt("near", self._near(parts, near[part], batch), sparse[part], batch)
            answers.append((iou.copy(), hyper.copy()))
        iou, hyper = (np.concatenate(each) for each in zip(*answers, strict=True))
        return iou, hyper, tokens

    def _near(self, parts: list[Array], near: NearTokens, batch: int) -> list[Array]:
        """The parts of each prompt of a batch, which is filled up with the last one. Always in the same memory."""
        near = near[np.minimum(np.arange(batch), len(near.rows) - 1)]
        axes, number = (0, 2, 1, 0, 0), near.rows.shape[1]
        if self._gathered is None or self._gathered[0].shape[:2] != (batch, number):
            sides = [(*p.shape[:axis], number, *p.shape[axis + 1 :]) for p, axis in zip(parts[:-1], axes, strict=True)]
            self._gathered = [np.empty((batch, *each), np.float32) for each in sides]
        for part, axis, every in zip(parts[:-1], axes, self._gathered, strict=True):
            for rows, into in zip(near.rows, every, strict=True):
                np.take(part, rows, axis, into, "clip")
        return [*self._gathered, near.log_count]

    def _prompt(self, name: str, parts: list[Array], sparse: Array, batch: int) -> tuple[Array, Array, Array]:
        """The answers lie in the network's own memory, until it runs again."""
        given = len(sparse)
        full = np.zeros((batch, *sparse.shape[1:]), np.float32)
        full[:given] = sparse
        size, key = parts[0].shape[-2], full.shape[:2]
        kept = self.prompt_networks if name == "prompt" else self.near_networks
        networks = kept.setdefault(size, {})
        kept.move_to_end(size)
        while sum(kept) > KEPT_TOKENS:
            kept.popitem(last=False)
        if key not in networks:
            networks[key] = self._compile(name, [part.shape for part in (*parts, full)])
        iou, hyper, tokens = networks[key]([*parts, full])
        return iou[:given], hyper[:given], tokens[:given]

    def mask(self, tokens: Array, rows: NDArray[np.intp], hyper: Stack, size: tuple[int, int]) -> Array:
        """One prompt at a time: as fast as together, and the image tokens (4 MB each) are not copied."""
        assert isinstance(hyper, np.ndarray)
        logits = np.empty((len(rows), hyper.shape[1], *size), np.float32)
        for k, row in enumerate(rows):
            part, weights = np.ascontiguousarray(of_photograph(tokens[row : row + 1], size)), hyper[k : k + 1]
            key = (*weights.shape, *part.shape)
            if key not in self.mask_networks:
                self.mask_networks[key] = self._compile("mask", [part.shape, weights.shape])
                while len(self.mask_networks) > MASK_NETWORKS:
                    self.mask_networks.popitem(last=False)
            self.mask_networks.move_to_end(key)
            logits[k] = self.mask_networks[key]([part, weights])[0][0, :, : size[0], : size[1]]
        return logits


def _rows(parts: "Sequence[Tokens]", rows: Any) -> "list[Tokens]":
    """What `ImageNetwork` returns of each image token, of some of them."""
    keys, k, v, q, position = parts
    return [keys[rows], k[:, :, rows], v[:, rows], q[rows], position[rows]]


def of_photograph(tokens: Tokens, size: tuple[int, int]) -> Tokens:
    """Image tokens (B, N, C) -> those (B, h, w, C) under the first `size` (height, width) px of a decoded mask."""
    height, width = (-(-side // TOKEN_PX) for side in size)
    if tokens.shape[1] < GRID * GRID:  # thinned: those of the photograph are the first
        return tokens[:, : height * width].reshape(len(tokens), height, width, -1)
    return tokens.reshape(len(tokens), GRID, GRID, -1)[:, :height, :width]


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

    sam = load_sam(model)
    with torch.inference_mode(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Converting a tensor")  # kornia's shape checks, constant for our one size
        image, prompt, mask = (
            sam_network.ImageNetwork(sam),
            sam_network.PromptNetwork(sam),
            sam_network.MaskNetwork(sam),
        )
        pixels = torch.zeros(1, 3, sam_network.ENCODER_SIDE, sam_network.ENCODER_SIDE)
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
