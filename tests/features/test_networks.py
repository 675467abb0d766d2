"""The networks that are written or read here, with random weights or made-up maps: no file is needed."""

import numpy as np
import pytest
import torch
from kornia.feature import ALIKED, LightGlue
from kornia.feature.aliked.aliked import DeformableConv2d
from kornia.feature.lightglue import filter_matches
from torch import nn

from zpm2.config import PointsConfig
from zpm2.features import superpoint_network, xfeat_network
from zpm2.features.aliked_network import AlikedNetwork, DeformableConvolution
from zpm2.features.lightglue import SETTINGS, FusedCrossAttention, LeanAssignment, published_names

THRESHOLD = PointsConfig().superpoint_threshold
LAYERS = ["1a", "1b", "2a", "2b", "3a", "3b", "4a", "4b", "Pa", "Pb", "Da", "Db"]


def test_superpoint_has_the_published_layers() -> None:
    network = superpoint_network.SuperPoint()
    state = network.state_dict()
    assert set(state) == {f"conv{layer}.{kind}" for layer in LAYERS for kind in ("weight", "bias")}
    assert state["conv1a.weight"].shape == (64, 1, 3, 3)
    assert state["conv4b.weight"].shape == (128, 128, 3, 3)
    assert state["convPb.weight"].shape == (65, 256, 1, 1)
    assert state["convDb.weight"].shape == (256, 256, 1, 1)
    with pytest.raises(RuntimeError, match="convDb"):
        network.load_state_dict({k: v for k, v in state.items() if not k.startswith("convDb")}, strict=True)


def test_superpoint_shapes() -> None:
    torch.manual_seed(0)
    network = superpoint_network.SuperPoint().eval()
    with torch.inference_mode():
        gray = torch.rand(1, 1, 64, 96)
        probability, descriptors = network(gray)
        ((points, read, scores),) = superpoint_network.extract(network, gray, 20, THRESHOLD)
    assert probability.shape == (1, 64, 96)
    assert descriptors.shape == (1, 256, 8, 12)
    assert points.shape == (20, 2)
    assert read.shape == (20, 256)
    assert torch.allclose(read.norm(dim=1), torch.ones(20))
    assert (scores[:-1] >= scores[1:]).all()
    assert ((points >= 4) & (points < torch.tensor([92, 60]))).all()


class Maps(nn.Module):
    """Answers with maps that were made up."""

    def __init__(self, *maps: torch.Tensor) -> None:
        super().__init__()
        self.maps = maps

    def forward(self, pixels: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return self.maps


def ramp(channels: int, rows: int, columns: int) -> torch.Tensor:
    """Channel 0 and 1 hold the place, in image px, of the centre of each cell of 8 px; channel 2 is 100."""
    maps = torch.zeros(1, channels, rows, columns)
    maps[0, 0] = 8.0 * torch.arange(columns) + 4
    maps[0, 1] = (8.0 * torch.arange(rows) + 4)[:, None]
    maps[0, 2] = 100
    return maps


def test_superpoint_points_lie_where_the_probability_and_the_descriptor_say() -> None:
    probability = torch.zeros(1, 64, 96)
    probability[0, 21, 37], probability[0, 22, 38], probability[0, 2, 50] = 0.5, 0.4, 0.9  # a neighbour and a border
    network = Maps(probability, ramp(256, 8, 12))
    ((points, read, scores),) = superpoint_network.extract(network, torch.zeros(1, 1, 64, 96), 10, THRESHOLD)
    assert points.tolist() == [[37, 21]]
    assert scores.tolist() == [0.5]
    assert torch.allclose(read[0, :2] / read[0, 2] * 100, torch.tensor([37.5, 21.5]), atol=1e-3)


def test_xfeat_points_are_moved_to_the_centre_of_mass() -> None:
    logits = torch.full((1, 65, 8, 12), -20.0)
    logits[0, 64] = 0.0
    for y, x, value in ((21, 37, 0.0), (21, 38, -1.0)):
        logits[0, y % 8 * 8 + x % 8, y // 8, x // 8] = value
    reliability = torch.full((1, 1, 8, 12), 0.5)
    network = Maps(ramp(64, 8, 12), logits, reliability)
    ((points, read, scores),) = xfeat_network.extract(network, torch.zeros(1, 3, 64, 96), 10)
    share = np.exp(-1) / (1 + np.exp(-1))
    assert torch.allclose(points, torch.tensor([[37 + share, 21.0]], dtype=torch.float32), atol=1e-4)
    assert np.isclose(scores.item(), 0.5 / (2 + np.exp(-1)))
    assert read.shape == (1, 64)


@pytest.mark.parametrize("name", ["xfeat_lighterglue", "disk_lightglue"])
def test_lightglue_takes_every_published_key(name: str) -> None:
    """A file of the first release, and LighterGlue's with its prefix: after renaming, strict loading must succeed."""
    network = LightGlue(None, **SETTINGS[name])
    state = {k: v for k, v in network.state_dict().items() if k != "confidence_thresholds"}
    if name == "xfeat_lighterglue":
        published = {f"matcher.{k}": v for k, v in state.items()} | {"extractor.model.net.x": torch.zeros(1)}
    else:
        published = {"log_assignment.0.r": torch.zeros(1)}
        for key, value in state.items():
            parts = key.split(".")
            old = [parts[2], parts[1], *parts[3:]] if parts[0] == "transformers" else parts
            published[".".join(old)] = value
        assert "self_attn.3.Wqkv.weight" in published
    assert set(published_names(published)) == set(state)
    with pytest.raises(RuntimeError, match="unheard_of"):
        network.load_state_dict(published_names(published | {"unheard_of": torch.zeros(1)}), strict=True)


@pytest.mark.parametrize("name", ["xfeat_lighterglue", "disk_lightglue"])
@pytest.mark.parametrize("masked", [False, True])
def test_fused_cross_attention_is_that_of_kornia(name: str, masked: bool) -> None:
    torch.manual_seed(0)
    block = LightGlue(None, **SETTINGS[name]).transformers[0].cross_attn.eval()
    size = block.to_qk.in_features
    first, second = torch.randn(1, 70, size), torch.randn(1, 41, size)
    mask = torch.rand(1, 1, 70, 41) > 0.3 if masked else None
    with torch.inference_mode():
        for ours, theirs in zip(
            FusedCrossAttention(block)(first, second, mask), block(first, second, mask), strict=True
        ):
            torch.testing.assert_close(ours, theirs, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", ["xfeat_lighterglue", "disk_lightglue"])
@pytest.mark.parametrize(("m", "n"), [(300, 41), (1, 520), (5, 3)])
def test_lean_assignment_is_that_of_kornia(name: str, m: int, n: int) -> None:
    torch.manual_seed(0)
    head = LightGlue(None, **SETTINGS[name]).log_assignment[0].eval()
    size = head.final_proj.in_features
    first, second = torch.randn(1, m, size), torch.randn(1, n, size)
    lean = LeanAssignment(head)
    with torch.inference_mode():
        ours, theirs = lean(first, second)[0], head(first, second)[0]
        assert torch.equal(lean.get_matchability(first), head.get_matchability(first))
        assert lean(first[:, :0], second[:, :0])[0].shape == (1, 1, 1)  # all points pruned
    torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-5)
    for a, b in zip(filter_matches(ours, 0.0), filter_matches(theirs, 0.0), strict=True):
        torch.testing.assert_close(a, b)


@pytest.mark.parametrize("model", ["aliked-n16", "aliked-n16rot", "aliked-n32"])
def test_aliked_gives_the_numbers_of_kornia(model: str) -> None:
    torch.manual_seed(0)
    published, ours = ALIKED(model).eval(), AlikedNetwork(model).eval()
    ours.load_state_dict(published.state_dict(), strict=True)
    image = torch.rand(2, 3, 96, 128)
    with torch.inference_mode():
        maps = zip(ours.extract_dense_map(image), published.extract_dense_map(image), strict=True)
        found, expected = ours(image), published(image)
    for a, b in maps:
        torch.testing.assert_close(a, b, atol=5e-7, rtol=0)
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a.keypoints, b.keypoints, atol=1e-4, rtol=0)
        torch.testing.assert_close(a.descriptors, b.descriptors, atol=5e-7, rtol=0)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 5), (21, 29)])
def test_deformable_convolution_is_that_of_kornia(height: int, width: int) -> None:
    torch.manual_seed(0)
    published = DeformableConv2d(6, 10)
    published.offset_conv.weight.data *= 30  # offsets of many px, also out of the image
    ours = DeformableConvolution.like(published)
    images = torch.randn(3, 6, height, width)
    with torch.inference_mode():
        torch.testing.assert_close(ours(images), published(images), atol=1e-5, rtol=1e-5)
