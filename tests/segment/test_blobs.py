"""Places that stand out, on pictures of which they are known."""

import cv2
import numpy as np
import pytest

from zpm2.config import PromptConfig
from zpm2.model import Image
from zpm2.segment.blobs import DISC_RADIUS, Blobs, blobs, has_data

CONFIG = PromptConfig()
SIZE = 128, 256  # of a decoded mask


def picture(discs: list[tuple[int, int, float, int]], scale: int = 4) -> np.ndarray:
    """Discs (x, y, radius in px of the mask, brightness) on grey."""
    pixels = np.full((SIZE[0] * scale, SIZE[1] * scale, 3), 90, np.uint8)
    for x, y, radius, brightness in discs:
        cv2.circle(pixels, (x * scale, y * scale), round(radius * scale), (brightness,) * 3, -1)
    return pixels


def found_on(image: Image) -> Blobs:
    return blobs(image, has_data(image, SIZE), CONFIG)


@pytest.mark.parametrize("sigma", CONFIG.blob_sigmas)
def test_a_disc_stands_out_at_its_middle_and_scale(sigma: float) -> None:
    found = found_on(Image(picture([(100, 60, DISC_RADIUS * sigma, 200)])))
    assert found.points[0] == pytest.approx([100, 60], abs=1)
    assert np.sqrt(found.area[0] / np.pi) == pytest.approx(DISC_RADIUS * sigma)


def test_the_most_different_one_comes_first() -> None:
    found = found_on(Image(picture([(50, 30, 6, 130), (100, 60, 6, 250), (200, 90, 6, 10)])))
    order = [tuple(np.round(p / 10).astype(int)) for p in found.points]
    first = [order.index(place) for place in ((10, 6), (20, 9), (5, 3))]
    assert first == sorted(first)


def test_colour_alone_stands_out() -> None:
    pixels = picture([])
    cv2.circle(pixels, (400, 240), 24, (150, 60, 60), -1)
    assert found_on(Image(pixels)).points[0] == pytest.approx([100, 60], abs=1)


def test_nothing_stands_out_beside_what_holds_no_data() -> None:
    pixels = picture([(60, 60, 6, 200)])
    valid = np.ones(pixels.shape[:2], bool)
    valid[:, 600:], pixels[:, 600:] = False, 0
    points = found_on(Image(pixels, valid=valid)).points
    assert points[0] == pytest.approx([60, 60], abs=1)
    assert (points[:, 0] < 150).all()


def test_nothing_stands_out_where_all_is_the_same() -> None:
    for pixels in (picture([]), np.full((1, 1, 3), 7, np.uint8)):
        assert len(found_on(Image(pixels))) == 0
