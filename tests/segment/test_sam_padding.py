"""The empty part of SAM's square, told by few of its tokens."""

from collections import OrderedDict

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from kornia.models.sam import Sam
from rendered import Pair

from zpm2.config import SegmentConfig, preset
from zpm2.model import Image
from zpm2.segment import sam_network
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskThresholds, Prompts
from zpm2.segment.sam import SamSegmenter
from zpm2.segment.sam_openvino import OpenVinoBackend
from zpm2.segment.sam_padding import GRID, STEP, thinned
from zpm2.segment.sam_torch import TorchBackend
from zpm2.segment.sam_view import SamView


@given(st.integers(1, GRID), st.integers(1, 2000))
def test_all_of_the_photograph_and_some_for_the_rest(height: int, least: int) -> None:
    tokens = thinned((height, GRID), least)
    if tokens is None:
        assert height * GRID + least > GRID * GRID - STEP
        return
    first = height * GRID
    assert np.array_equal(tokens.rows[:first], np.arange(first))
    assert len(np.unique(tokens.rows)) == len(tokens.rows)
    assert len(tokens.rows) % STEP == 0
    assert len(tokens.rows) >= first + least
    assert (tokens.log_count[:first] == 0).all()
    assert np.exp(tokens.log_count).sum() == pytest.approx(GRID * GRID, rel=1e-4)


def test_those_that_stand_for_others_are_all_over_the_empty_part() -> None:
    tokens = thinned((GRID, 20), 128)
    assert tokens is not None
    row, column = np.divmod(tokens.rows[20 * GRID :], GRID)
    assert column.min() >= 20
    counted = np.histogram2d(row, column, bins=(8, 4), range=((0, GRID), (20, GRID)))[0]
    assert counted.min() >= counted.mean() / 2


def test_a_token_that_stands_for_equal_ones_changes_nothing() -> None:
    """The reference: all tokens. Those of the empty part are equal here, so few of them say as much."""
    torch.manual_seed(0)
    network = sam_network.PromptNetwork(Sam.from_name("mobile_sam")).eval()
    tokens = thinned((10, GRID), 100)
    assert tokens is not None
    empty = torch.from_numpy(np.setdiff1d(np.arange(GRID * GRID), np.arange(10 * GRID)))
    keys, k, v = torch.randn(4096, 256), torch.randn(8, 16, 4096), torch.randn(8, 4096, 16)
    q, position = torch.randn(4096, 128), torch.randn(4096, 256)
    for part in (keys, v.transpose(0, 1), k.permute(2, 0, 1), q, position):
        part[empty] = part[empty[0]].clone()
    sparse, backend = torch.randn(2, 3, 256), TorchBackend.__new__(TorchBackend)
    backend.device, backend.dtype, backend.torch = torch.device("cpu"), torch.float32, torch
    parts = (keys, k, v, q, position, torch.zeros(4096))
    with torch.inference_mode():
        iou, hyper, image = network(*parts, sparse)
        fewer_iou, fewer_hyper, fewer_image = network(*backend.thinned(parts, tokens), sparse)
    torch.testing.assert_close(fewer_iou, iou, atol=1e-4, rtol=1e-3)
    torch.testing.assert_close(fewer_hyper, hyper, atol=1e-4, rtol=1e-3)
    torch.testing.assert_close(fewer_image, image[:, torch.from_numpy(tokens.rows)], atol=1e-4, rtol=1e-3)


@pytest.mark.weights
def test_masks_of_a_photograph_stay(pair: Pair) -> None:
    """Stated tolerance: of the good masks, a median IoU of 0.98 with those of all tokens, nine of ten at least 0.9."""
    image = Image(np.ascontiguousarray(pair.scene.left[: pair.scene.left.shape[1] // 3]))
    assert preset("paper").segment.padding == 0
    backend = SamSegmenter(SegmentConfig()).load()
    views = [SamView(backend, image, SegmentConfig(padding=each)) for each in (0, 128)]
    at = np.random.default_rng(0).uniform(5, [image.width - 5, image.height - 5], (8, 2))
    overlaps = []
    for prompts in (
        Prompts.at(at),
        Prompts(np.stack([at, at - 30, at + 30], axis=1), np.array([INSIDE, CORNER, OTHER_CORNER])),
    ):
        every, few = (view.predict(prompts, MaskThresholds(0.0, 0.0)) for view in views)
        assert np.array_equal(every.prompt, few.prompt)
        good = every.passing(MaskThresholds(0.88, 0.95))
        both, either = (every.bits & few.bits).sum((1, 2)), (every.bits | few.bits).sum((1, 2))
        overlaps.append((both / np.maximum(either, 1))[good])
    overlap = np.concatenate(overlaps)
    assert len(overlap) > 10
    assert np.median(overlap) >= 0.98
    assert np.quantile(overlap, 0.1) >= 0.9
    assert views[1].embedding().shape == views[0].embedding().shape
    assert np.array_equal(views[1].embedding(), views[0].embedding())


class Graph:
    """A network with one input, compiled for any shape."""

    inputs = (0,)

    def clone(self) -> "Graph":
        return self

    def reshape(self, shapes: dict[int, tuple[int, ...]]) -> None:
        self.shape = shapes[0]


def test_networks_for_the_sizes_used_last_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = list[tuple[int, ...]]()

    class Core:
        def compile_model(self, graph: Graph, *_: object) -> "Core":
            compiled.append(graph.shape)
            return self

        def create_infer_request(self) -> object:
            return object()

    monkeypatch.setattr("zpm2.segment.sam_openvino.KEPT", 3)
    backend = OpenVinoBackend.__new__(OpenVinoBackend)
    backend.precision, backend.core = "f32", Core()  # type: ignore[assignment]
    backend.graphs, backend.networks = {"prompt": Graph()}, {"prompt": OrderedDict()}
    for size in (4096, 4096, 1536, 4096, 2560, 3072, 1536):
        with backend._network("prompt", (size,)).request():
            pass
    assert compiled == [(4096,), (1536,), (2560,), (3072,), (1536,)]
    assert list(backend.networks["prompt"]) == [((2560,),), ((3072,),), ((1536,),)]


def test_photographs_that_do_not_fit_together_are_encoded_one_by_one_and_that_is_told() -> None:
    class OutOfMemoryError(RuntimeError):
        pass

    class Full(TorchBackend):
        batch, resident = 16, True

        def __init__(self) -> None:
            pass

        def images(self, reduced):
            raise OutOfMemoryError

        def image(self, pixels):
            return ()

    said = list[str]()
    segmenter = SamSegmenter(SegmentConfig(), say=said.append)
    segmenter._backend = Full()
    images = [Image(np.zeros((64, 64, 3), np.uint8))] * 2
    for _ in range(2):
        assert len(segmenter.views_together(images)) == 2
    assert segmenter.notes == said == ["the GPU has little free memory: photographs were encoded one at a time"]
