"""Promptable networks that come whole, with one that paints a disc around each point."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from painted import blank

from zpm2.config import SegmentConfig
from zpm2.errors import InputError
from zpm2.segment.mask_network import Array, NetworkSegmenter, NetworkView, Sight
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedSegmenter

EVERYTHING = MaskThresholds(0.0, 0.0)
RADIUS = 20.0  # image px


@dataclasses.dataclass
class Discs:
    """Answers with an ellipse that is a disc in the photograph: of RADIUS, and of half that with a lower score."""

    sight: Sight
    masks: int  # px of a side of a mask
    scale: Any = None  # px of the square per image px, along x and y
    batch: int = 3
    calls: int = 0

    def encode(self, pixels: Array) -> Any:
        assert pixels.shape == (1, 3, self.sight.side, self.sight.side)
        assert pixels.dtype == np.float32
        return self.scale

    def decode(self, encoded: Any, points: Array, labels: NDArray[np.int64]) -> tuple[Array, Array]:
        self.calls += 1
        at = (np.arange(self.masks) + 0.5) * self.sight.side / self.masks
        x, y = ((at - points[:, 0, axis, None]) / self.scale[axis] for axis in (0, 1))  # image px
        distance = np.hypot(x[:, None, :], y[:, :, None])
        logits = np.stack([RADIUS - distance, RADIUS / 2 - distance], 1).astype(np.float32)
        return np.tile(np.float32([0.9, 0.5]), (len(points), 1)), logits


def view(stretched: bool, masks: int, width: int, height: int) -> tuple[NetworkView, Discs]:
    network, image = Discs(Sight(512, stretched), masks), blank(width, height)
    network.scale = network.sight.scale(image)
    return NetworkView(network, image, SegmentConfig(min_area=1)), network


@pytest.mark.parametrize("stretched", [True, False])
@pytest.mark.parametrize("masks", [256, 288, 128])
@pytest.mark.parametrize(("width", "height"), [(400, 300), (300, 401), (256, 256), (900, 200)])
def test_masks_lie_where_the_points_are(stretched: bool, masks: int, width: int, height: int) -> None:
    seen, _ = view(stretched, masks, width, height)
    points = np.array([[width / 2, height / 2], [width / 3, height / 2], [width - 30.0, height - 30.0]])
    found = seen.predict(Prompts.at(points), EVERYTHING)
    assert found.logits.shape[1:] == seen.size
    assert list(found.prompt) == [0, 0, 1, 1, 2, 2]
    for mask, prompt, score in zip(seen.masks(found), found.prompt, found.score, strict=True):
        radius = RADIUS if score > 0.6 else RADIUS / 2
        rows, columns = np.nonzero(mask.bits)
        centre = np.array([columns.mean() + mask.x0, rows.mean() + mask.y0]) + 0.5
        assert centre == pytest.approx(points[prompt], abs=1.0)
        assert mask.area == pytest.approx(np.pi * radius**2, rel=0.15)


def test_batches_and_thresholds() -> None:
    seen, network = view(True, 256, 400, 300)
    points = np.random.default_rng(0).uniform(60, 240, (7, 2))
    assert len(seen.predict(Prompts.at(points), MaskThresholds(0.6, 0.0))) == 7
    assert network.calls == 3
    assert len(seen.predict(Prompts.at(points), MaskThresholds(0.95, 0.0))) == 0
    stability = seen.predict(Prompts.at(points), EVERYTHING).stability
    assert ((stability > 0.5) & (stability < 1)).all()
    assert len(seen.predict(Prompts.at(points), MaskThresholds(0.0, float(stability.max())))) < len(stability)
    assert len(seen.predict(Prompts.at(np.zeros((0, 2))), EVERYTHING)) == 0


def test_the_photograph_is_normalised_and_padded() -> None:
    image = blank(200, 100)
    sight = Sight(64, stretched=False, mean=(100.0, 110.0, 120.0), std=(2.0, 3.0, 4.0))
    pixels = sight.pixels(image)
    assert (pixels[0, :, 32:] == 0).all()
    mean = image.rgb.reshape(-1, 3).mean(0)
    assert pixels[0, :, :32].mean((1, 2)) == pytest.approx((mean - [100, 110, 120]) / [2, 3, 4], abs=0.1)
    stretched = dataclasses.replace(sight, stretched=True).pixels(image)
    assert stretched.shape == (1, 3, 64, 64)
    assert (np.abs(stretched[0, :, 32:]) > 0).any()


def test_thin_photographs_are_refused() -> None:
    with pytest.raises(InputError, match="match it in tiles"):
        view(True, 256, 40, 4000)


def test_segmenter_takes_prompts_and_gives_regions() -> None:
    network, image = Discs(Sight(512, stretched=True), 256), blank(400, 300)
    network.scale = network.sight.scale(image)
    told: list[float] = []
    config = SegmentConfig(grid=4, min_stability=0.5)
    segmenter = NetworkSegmenter("discs", config, network, ["a note"], told.append)
    assert isinstance(segmenter, PromptedSegmenter)
    assert segmenter.notes == ["a note"]
    masks = segmenter.segment(image)
    assert len(masks) == 16
    assert told[-1] == 1.0


def test_a_box_reaches_the_network_as_two_corners() -> None:
    seen, network = view(True, 256, 400, 300)
    given: list[tuple[NDArray[np.float32], list[int]]] = []
    decode = network.decode
    network.decode = lambda e, p, x: (given.append((p, list(x))), decode(e, p, x))[1]  # type: ignore[method-assign]
    corners = np.array([[[100.0, 100.0], [80.0, 90.0], [120.0, 110.0]]])
    seen.predict(Prompts(corners, np.array([INSIDE, CORNER, OTHER_CORNER])), EVERYTHING)
    points, labels = given[0]
    assert labels == [1, 2, 3]
    assert points == pytest.approx(corners * network.scale)
