"""The way into a network and back."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import PointsConfig
from zpm2.features.frame import STRIDE, frame
from zpm2.model import Image

sides = st.integers(1, 150)


def noise(width: int, height: int) -> Image:
    return Image(np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8))


def upto(max_size: int) -> PointsConfig:
    """Without the check of a whole configuration, which refuses very small sizes."""
    return PointsConfig(max_size=max_size)


@given(sides, sides, st.integers(1, 200), st.sampled_from([0.6, 1.0, 1.3]))
def test_corners_come_back(width: int, height: int, max_size: int, zoom: float) -> None:
    shot = frame(noise(width, height), upto(max_size), "cpu", zoom)
    assert shot.pixels.shape[2] % STRIDE == 0
    assert shot.pixels.shape[3] % STRIDE == 0
    content = np.round(shot.scale * [width, height])
    assert np.allclose(content, shot.scale * [width, height])
    assert max(content) <= max(1, round(zoom * min(max_size, max(width, height))))
    corners = torch.tensor(np.array([[0, 0], content]) - 0.5)
    assert np.allclose(shot.to_image(corners), [[0, 0], [width, height]])


@pytest.mark.parametrize("max_size", [400, 200, 150, 90])
def test_a_place_keeps_its_brightness(max_size: int) -> None:
    """A ramp is the same ramp after resizing only if no half pixel is lost."""
    ramp = np.broadcast_to((np.arange(240) + 0.5)[None, :, None], (120, 240, 3))
    shot = frame(Image(ramp.astype(np.uint8)), upto(max_size), "cpu")
    columns = np.arange(5, round(240 * shot.scale[0]) - 5)
    places = shot.to_image(torch.tensor(np.c_[columns, np.full(len(columns), 20)], dtype=torch.float64))
    seen = shot.pixels[0, 0, 20, columns].double().numpy() * 255
    assert np.abs((seen + 0.5) - places[:, 0]).mean() < 0.35  # of a grey level; rounding to 8 bits costs a quarter
    assert abs(((seen + 0.5) - places[:, 0]).mean()) < 0.3


def test_never_enlarged() -> None:
    image = noise(64, 32)
    shot = frame(image, PointsConfig(), "cpu")
    assert np.array_equal((shot.pixels[0].permute(1, 2, 0) * 255).round().byte().numpy(), image.rgb)


def test_useful_is_on_the_image_and_not_in_the_blank() -> None:
    rgb = np.full((60, 100, 3), 200, np.uint8)
    rgb[:, :40] = noise(40, 60).rgb
    shot = frame(Image(rgb), PointsConfig(), "cpu")
    points = torch.tensor(
        [[20.0, 30.0], [80.0, 30.0], [20.0, 59.4], [20.0, 59.6], [-0.6, 30.0], [20.0, 70.0], [20.0, 900]]
    )
    assert shot.is_useful(points).tolist() == [True, False, True, False, False, False, False]
