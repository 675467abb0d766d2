"""The cut SAM networks against kornia's own decoder, and the back ends against each other."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import torch
from kornia.models.sam import Sam

from zpm2.segment import sam_network
from zpm2.segment.sam_backend import EmbeddedPrompts
from zpm2.segment.sam_network import load_sam
from zpm2.segment.sam_openvino import OpenVinoBackend
from zpm2.segment.sam_torch import TorchBackend

POINTS = np.array([[100.5, 200.25], [512.0, 300.0], [3.0, 1020.0]])[:, None]


def pixels(seed: int) -> torch.Tensor:
    """A smooth random picture, already normalised."""
    coarse = torch.randn(1, 3, 24, 24, generator=torch.Generator().manual_seed(seed))
    return torch.nn.functional.interpolate(coarse, size=(1024, 1024), mode="bicubic")


def decode(sam: Sam, embedding: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """kornia's decoder. Its points count pixel centres from 0 and ours from 0.5."""
    prompts = torch.from_numpy(POINTS).float() - 0.5
    sparse, dense = sam.prompt_encoder(points=(prompts, torch.ones(len(prompts), 1)), boxes=None, masks=None)
    return sam.mask_decoder.predict_masks(embedding, sam.prompt_encoder.get_dense_pe(), sparse, dense)


class FakeEncoder(torch.nn.Module):
    """Stands for the image encoder, which the cut leaves as it is."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.avg_pool2d(image, 16).repeat(1, 86, 1, 1)[:, :256]


def test_cut_equals_kornia_for_random_weights() -> None:
    torch.manual_seed(0)
    sam = Sam.from_name("mobile_sam").eval()
    sam.image_encoder = FakeEncoder()
    with torch.inference_mode():
        picture = pixels(1)
        masks, iou = decode(sam, sam.image_encoder(picture))
        parts = sam_network.ImageNetwork(sam)(picture)
        sparse = torch.from_numpy(sam_network.PromptEmbedding.of(sam)(POINTS, np.array([1])))
        ours_iou, hyper, tokens = sam_network.PromptNetwork(sam)(*parts, sparse)
        network = sam_network.MaskNetwork(sam)
        ours = network(tokens.reshape(3, 64, 64, -1), hyper)
        part = network(tokens.reshape(3, 64, 64, -1)[:, :20, :33], hyper)
    torch.testing.assert_close(ours_iou, iou, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(ours, masks, atol=1e-3, rtol=1e-3)
    torch.testing.assert_close(part, masks[:, :, :80, :132], atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize("labels", [[1], [1, 0], [2, 3], [2, 3, 1, 0]])
def test_prompt_embedding_equals_kornia(labels: list[int]) -> None:
    torch.manual_seed(0)
    sam = Sam.from_name("mobile_sam").eval()
    at = np.random.default_rng(0).uniform(0, 1024, (2, len(labels), 2))
    shifted, kinds = torch.from_numpy(at).float() - 0.5, np.array(labels)
    inner = torch.from_numpy(kinds[kinds < 2]).expand(2, -1)
    with torch.inference_mode():
        theirs, _ = sam.prompt_encoder(
            points=(shifted[:, kinds < 2], inner) if inner.numel() else None,
            boxes=shifted[:, kinds >= 2].reshape(2, 4) if (kinds >= 2).any() else None,
            masks=None,
        )
    ours = torch.from_numpy(sam_network.PromptEmbedding.of(sam)(at, kinds))
    if (kinds >= 2).any():  # kornia puts points first
        order = np.r_[np.flatnonzero(kinds < 2), np.flatnonzero(kinds >= 2)]
        ours = ours[:, order]
    torch.testing.assert_close(ours, theirs, atol=2e-5, rtol=0)


@pytest.mark.weights
@pytest.mark.skipif(find_spec("openvino") is None, reason="openvino is not installed")
def test_openvino_gives_the_masks_of_torch_and_kornia() -> None:
    """Stated tolerance: predicted IoU within 1e-3, at most 1 pixel in 10,000 on the other side of the mask's edge."""
    picture = pixels(2)
    with torch.inference_mode():
        sam = load_sam("mobile_sam")
        masks, iou = decode(sam, sam.image_encoder(picture))
    for backend in (TorchBackend("mobile_sam", 16, "cpu"), OpenVinoBackend("mobile_sam", 16, print)):
        parts = backend.image(picture.numpy())
        asked = EmbeddedPrompts(backend.embed(POINTS, np.array([1])))
        for height, width in ((256, 256), (78, 256), (256, 101)):
            rows, ours_iou, logits = backend.masks(parts, asked, -np.inf, 0, (height, width))
            assert rows.tolist() == list(range(len(POINTS)))
            np.testing.assert_allclose(ours_iou, iou.numpy(), atol=1e-3)
            assert ((logits > 0) != (masks[:, :, :height, :width].numpy() > 0)).mean() < 1e-4
        best = iou[:, 1:].max(1).values.numpy()
        least = float(np.sort(best)[-2:].mean())  # which only the surest prompt reaches
        rows, ours_iou, logits = backend.masks(parts, asked, least, 1, (78, 256))
        assert rows.tolist() == [int(best.argmax())]
        np.testing.assert_allclose(ours_iou, iou[rows, 1:].numpy(), atol=1e-3)
        assert ((logits > 0) != (masks[rows, 1:, :78, :256].numpy() > 0)).mean() < 1e-4
        rows, ours_iou, logits = backend.masks(parts, asked, 2.0, 1, (78, 256))
        assert (rows.shape, ours_iou.shape, logits.shape) == ((0,), (0, 3), (0, 3, 78, 256))


@pytest.mark.weights
@pytest.mark.skipif(find_spec("openvino") is None, reason="openvino is not installed")
def test_networks_in_openvino_keep_to_the_cores_that_they_are_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    backend = OpenVinoBackend("mobile_sam", 16, print)
    parts = backend.image(pixels(2).numpy())
    tasks = Path("/proc/self/task")
    before = set(tasks.iterdir()) if tasks.exists() else set()
    backend.masks(parts, EmbeddedPrompts(backend.embed(POINTS, np.array([1]))), -np.inf, 0, (256, 256))
    assert not tasks.exists() or set(tasks.iterdir()) == before  # prompts are answered in the thread that asks
    networks = [network for kept in backend.networks.values() for network in kept.values()]
    every = [compiled for network in networks for compiled, _ in network._idle]
    of_their_own = [int(each.get_property("INFERENCE_NUM_THREADS")) for each in every]
    assert of_their_own == [1, 0, 0]


FREED_ELSEWHERE = """
import signal, threading
import numpy as np
from openvino import Model, opset8
from zpm2.segment.sam_openvino import openvino_core

x = opset8.parameter([1], np.float32)
networks = [openvino_core().compile_model(Model([opset8.relu(x)], [x]), "CPU")]
freeing = threading.Thread(target=networks.clear)
freeing.start()
freeing.join()
signal.signal(signal.SIGTERM, lambda *_: print("handled"))
signal.raise_signal(signal.SIGTERM)
"""


@pytest.mark.skipif(find_spec("openvino") is None, reason="openvino is not installed")
def test_signals_are_handled_after_another_thread_freed_the_networks() -> None:
    command = [sys.executable, "-X", "faulthandler", "-c", FREED_ELSEWHERE]
    assert subprocess.run(command, check=True, capture_output=True, text=True).stdout == "handled\n"


def test_a_gpu_gets_the_same_in_its_own_order(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    sam = Sam.from_name("mobile_sam").eval()
    parts = tuple(torch.randn(shape, generator=torch.manual_seed(3)) for shape in ((4096, 256), (8, 16, 4096)))
    shapes = (8, 4096, 16), (4096, 128), (4096, 256), (4096,)
    parts += tuple(torch.randn(shape, generator=torch.manual_seed(4)) for shape in shapes)
    sparse = torch.randn(2, 3, 256, generator=torch.manual_seed(5))
    network = sam_network.PromptNetwork(sam).eval()
    with torch.inference_mode():
        expected = network(*parts, sparse)
        monkeypatch.setattr(sam_network, "_on_gpu", lambda tensor: True)
        for one, other in zip(expected, network(*parts, sparse), strict=True):
            torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-3)
