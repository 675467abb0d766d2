"""What every dense stereo method keeps to, on a pair whose disparities are known exactly."""

import sys

import numpy as np
import pytest
import torch
from rendered import Pair

from zpm2.config import StereoConfig
from zpm2.errors import InputError, MissingDependency
from zpm2.model import Image
from zpm2.photos.images import read_image
from zpm2.stereo.dense import StereoMatcher, stereo_matcher

HEIGHT, WIDTH, FAR, NEAR = 80, 180, 7, 12
SQUARE = (slice(20, 60), slice(70, 120))  # of the left image, nearer than the rest


def textures() -> tuple[Image, Image, np.ndarray]:
    """Left and right image of a square before a plane, and the disparities of the left one."""
    rng = np.random.default_rng(3)
    plane, square = rng.integers(0, 256, (2, HEIGHT, WIDTH + 40), np.uint8)
    left = plane[:, :WIDTH].copy()
    right = plane[:, FAR : FAR + WIDTH].copy()
    rows, columns = SQUARE
    left[SQUARE] = square[SQUARE]
    right[rows, columns.start - NEAR : columns.stop - NEAR] = square[SQUARE]
    truth = np.full((HEIGHT, WIDTH), float(FAR))
    truth[SQUARE] = NEAR
    return Image(np.dstack([left] * 3)), Image(np.dstack([right] * 3)), truth


def untrained(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random features: they tell random textures apart as well."""
    from zpm2.stereo import mc_cnn

    torch.manual_seed(0)
    network = mc_cnn.Network().eval()
    monkeypatch.setattr(mc_cnn, "load", lambda name: network)


@pytest.fixture(params=["sgbm", "mc-cnn"])
def find(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> StereoMatcher:
    if request.param == "mc-cnn":
        pytest.importorskip("c_libsgm", reason="libsgm is not installed")
        untrained(monkeypatch)
    return stereo_matcher(StereoConfig(method=request.param), "cpu")


def test_exact_disparities(find: StereoMatcher) -> None:
    left, right, truth = textures()
    found = find(left, right, 0, 20)
    assert found.shape == truth.shape
    assert found.dtype == np.float32
    hidden = np.zeros(truth.shape, bool)  # by the square, or beyond the border
    hidden[SQUARE[0], SQUARE[1].start - (NEAR - FAR) : SQUARE[1].start] = True
    hidden[:, :FAR] = True
    known = np.isfinite(found)
    assert known[~hidden].mean() > 0.9
    assert known[hidden].mean() < 0.3
    error = np.abs(found - truth)[known & ~hidden]
    assert np.median(error) < 0.1
    assert (error > 1).mean() < 0.03  # the square is too wide by a part of a patch


def test_the_range_is_kept(find: StereoMatcher) -> None:
    left, right, _ = textures()
    found = find(left, right, 5, 9)
    assert np.nanmin(found) >= 5
    assert np.nanmax(found) < 21  # OpenCV searches groups of 16


def test_one_disparity_is_a_range(find: StereoMatcher) -> None:
    left, right, truth = textures()
    found = find(left, right, FAR, FAR)
    assert (np.abs(found - truth)[truth == FAR] < 1).mean() > 0.6


def test_negative_disparities(find: StereoMatcher) -> None:
    left, right, _ = textures()
    found = find(right, left, -20, 0)  # the right image as the left one
    known = np.isfinite(found)
    assert known.mean() > 0.7
    assert np.isin(np.round(found[known]), (-FAR, -NEAR)).mean() > 0.97


def test_no_data_has_no_disparity_and_no_partner(find: StereoMatcher) -> None:
    left, right, _ = textures()
    gap = np.zeros((HEIGHT, WIDTH), bool)
    gap[30:50, 80:110] = True
    without = [Image(np.where(gap[..., None], 0, x.rgb).astype(np.uint8), valid=~gap) for x in (left, right)]
    found = find(without[0], right, 0, 20)
    assert np.isnan(found[gap]).all()
    assert np.isfinite(found[~gap]).mean() > 0.7
    found = find(left, without[1], 0, 20)
    assert np.isnan(found[32:48, 80 + NEAR : 110 + FAR]).mean() > 0.95


def test_without_any_data_nothing_is_known(find: StereoMatcher) -> None:
    left, right, _ = textures()
    nothing = Image(left.rgb, valid=np.zeros((HEIGHT, WIDTH), bool))
    assert np.isnan(find(nothing, right, 0, 20)).all()


def test_the_same_bytes_twice(find: StereoMatcher) -> None:
    left, right, _ = textures()
    assert find(left, right, 0, 20).tobytes() == find(left, right, 0, 20).tobytes()


def test_disparities_that_no_file_holds_are_refused(find: StereoMatcher) -> None:
    left, right, _ = textures()
    with pytest.raises(InputError, match="at most 2000 px are searched"):
        find(left, right, 0, 2001)


def test_without_libsgm_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "c_libsgm", None)
    with pytest.raises(MissingDependency, match=r'pip install "zpm2\[stereo\]"'):
        stereo_matcher(StereoConfig(method="mc-cnn"), "cpu")


@pytest.mark.weights
@pytest.mark.parametrize("weights", ["middlebury", "aerial"])
def test_the_published_weights_on_the_rendered_pair(pair: Pair, weights: str) -> None:
    pytest.importorskip("c_libsgm", reason="libsgm is not installed")
    truth = pair.scene.disparity
    low, high = int(truth.min()) - 4, int(truth.max()) + 4
    find = stereo_matcher(StereoConfig(method="mc-cnn", weights=weights), "cpu")
    found = find(read_image(pair.left), read_image(pair.right), low, high)
    known = np.isfinite(found)
    error = np.abs(found - truth)[known]
    assert known.mean() > 0.6
    assert np.median(error) < 0.25
    assert (error > 2).mean() < 0.05
