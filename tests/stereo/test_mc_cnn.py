"""The learned cost: its network and weights, costs and paths against plain loops, strips and memory."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from test_matchers import textures, untrained

from zpm2 import memory
from zpm2.config import StereoConfig
from zpm2.errors import InputError, WeightsError
from zpm2.model import Image
from zpm2.stereo import cost_volume, mc_cnn
from zpm2.stereo.dense import stereo_matcher
from zpm2.weights import Entry, entry

NAME = "mccnn_middlebury"


@pytest.mark.parametrize(("low", "high"), [(-5, 20), (3, 9), (-20, -4), (0, 0), (200, 350)])
def test_costs_are_products_of_features(low: int, high: int) -> None:
    torch.manual_seed(1)
    left, right = torch.randn(2, 8, 3, 300)
    found = cost_volume.costs(left, right, low, high)
    assert found.shape == (3, 300, high - low + 1)
    for k, disparity in enumerate(range(high, low - 1, -1)):
        expected = np.zeros((3, 300), np.float32)
        for x in range(max(0, disparity), min(300, 300 + disparity)):
            expected[:, x] = -(left[:, :, x] * right[:, :, x - disparity]).sum(0)
        assert found[..., k] == pytest.approx(expected, abs=1e-5)


def test_aggregation_against_the_recursion_of_the_paper() -> None:
    """Hirschmueller 2008, (13): along each path, from its beginning at the border."""
    pytest.importorskip("c_libsgm", reason="libsgm is not installed")
    rng = np.random.default_rng(0)
    volume = rng.uniform(-1, 1, (6, 7, 5)).astype(np.float32)
    grey = rng.uniform(-1, 1, (6, 7)).astype(np.float32)
    config = StereoConfig(small_cost=0.2, large_cost=0.7, edge=0.5)
    total = np.zeros(volume.shape)
    for dy, dx in cost_volume.PATHS:
        path = volume.astype(float)
        for y in range(6) if dy >= 0 else range(5, -1, -1):
            for x in range(7) if dx >= 0 else range(6, -1, -1):
                if not (0 <= y - dy < 6 and 0 <= x - dx < 7):
                    continue
                before = path[y - dy, x - dx]
                divisor = 4.0 if abs(grey[y, x] - grey[y - dy, x - dx]) >= 0.5 else 1.0
                for d in range(5):
                    ways = [before[d], before.min() + 0.7 / divisor]
                    ways += [before[e] + 0.2 / divisor for e in (d - 1, d + 1) if 0 <= e < 5]
                    path[y, x, d] += min(ways) - before.min()
        total += path
    found = cost_volume.cheapest(volume, 10, grey, config)
    assert found == pytest.approx(cost_volume.least(total.astype(np.float32), 10), abs=1e-3)


def test_the_least_cost_of_a_parabola_is_between_the_pixels() -> None:
    disparities = np.arange(9, 2, -1)
    volume = ((disparities - np.array([5.3, 6.0, 2.0, 11.0])[:, None]) ** 2)[None].astype(np.float32)
    assert cost_volume.least(volume, 9) == pytest.approx(np.array([[5.3, 6.0, 3.0, 9.0]]), abs=1e-5)
    assert cost_volume.least(np.zeros((2, 2, 1), np.float32), 4) == pytest.approx(4.0)


def test_features_are_those_of_the_patch_around_a_pixel() -> None:
    torch.manual_seed(0)
    network = mc_cnn.Network().eval()
    grey = torch.randn(31, 41)
    with torch.inference_mode():
        whole, one = network(grey), network(grey[7:18, 12:23])
    assert whole.shape == (64, 21, 31)
    assert whole.norm(dim=0) == pytest.approx(1, abs=1e-5)
    assert whole[:, 7, 12] == pytest.approx(one[:, 0, 0], abs=1e-5)


def test_standardised_over_what_has_data() -> None:
    rng = np.random.default_rng(0)
    rgb = np.dstack([rng.integers(0, 256, (30, 40), np.uint8)] * 3)
    valid = np.ones((30, 40), bool)
    valid[:10] = False
    rgb[~valid] = 255
    found = mc_cnn.standardised(Image(rgb, valid=valid))
    assert (found[~valid] == 0).all()
    assert [found[valid].mean(), found[valid].std()] == pytest.approx([0, 1], abs=1e-5)
    assert (mc_cnn.standardised(Image(np.full((4, 4, 3), 9, np.uint8))) == 0).all()


@given(st.integers(1, 3000), st.integers(1, 10**7), st.integers(0, 40), st.integers(1, 10**9))
def test_strips_are_all_rows_once(height: int, row: int, overlap: int, most: int) -> None:
    config = StereoConfig(strip_costs=most, strip_overlap=overlap)
    parts = mc_cnn.strips(height, row, config)
    assert [y for _, _, kept in parts for y in range(kept.start, kept.stop)] == list(range(height))
    for first, last, kept in parts:
        assert first == max(0, kept.start - overlap) or len(parts) == 1
        assert last == min(height, kept.stop + overlap) or len(parts) == 1
        assert (last - first) * row <= most or last - first <= max(4 * overlap, 1)


def test_strips_agree_with_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("c_libsgm", reason="libsgm is not installed")
    untrained(monkeypatch)
    left, right, _ = textures()
    whole = stereo_matcher(StereoConfig(method="mc-cnn"), "cpu")(left, right, 0, 20)
    config = StereoConfig(method="mc-cnn", strip_costs=40 * 180 * 21, strip_overlap=8)
    strips = stereo_matcher(config, "cpu")(left, right, 0, 20)
    assert len(mc_cnn.strips(80, 180 * 21, config)) == 4
    both = np.isfinite(whole) & np.isfinite(strips)
    assert both.mean() > 0.95 * np.isfinite(whole).mean()
    assert (np.abs(whole - strips)[both] < 0.25).mean() > 0.98


def test_what_does_not_fit_into_the_memory_is_refused_before(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("c_libsgm", reason="libsgm is not installed")
    untrained(monkeypatch)
    left, right, _ = textures()
    find = stereo_matcher(StereoConfig(method="mc-cnn"), "cpu")
    with memory.within("500MB"), pytest.raises(InputError, match=r"80 rows of 180 px at 21 .*stereo\.strip_costs"):
        find(left, right, 0, 20)
    wide = Image(np.zeros((200, 9000, 3), np.uint8))
    with memory.within("none"), pytest.raises(InputError, match="more than 2147483647 costs"):
        stereo_matcher(StereoConfig(method="mc-cnn", strip_overlap=64), "cpu")(wide, wide, 0, 1999)


def _file(folder: Path, state: object, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A weights file that the manifest lists."""
    path = folder / entry(NAME).file
    torch.save(state, path)
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    item = Entry(NAME, path.name, len(content), digest, "none", "tests", "nowhere", ())
    for module in ("zpm2.weights", "zpm2.weights.manifest", "zpm2.weights.store"):
        monkeypatch.setattr(f"{module}.MANIFEST", (item,))
    monkeypatch.setenv("ZPM2_WEIGHTS", str(folder))
    monkeypatch.setenv("ZPM2_CACHE", str(folder / "cache"))
    return path


def _training(state: dict[str, torch.Tensor]) -> dict[str, object]:
    return {"model": state, "optimizer": {"state": {}}, "scheduler": {"step_size": 1}, "epoch": 13}


def test_the_model_of_a_training_is_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(5)
    state = mc_cnn.Network().state_dict()
    _file(tmp_path, _training(state), monkeypatch)
    found = mc_cnn.load(NAME).state_dict()
    assert all(torch.equal(found[name], state[name]) for name in state)


def test_only_exactly_its_tensors_are_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state = mc_cnn.Network().state_dict()
    renamed = {name.replace("conv_blocks.0", "conv_blocks.1"): value for name, value in state.items()}
    smaller = {name: value[:32] for name, value in state.items()}
    for wrong in (renamed, smaller, dict(list(state.items())[:-1]), state | {"more": torch.zeros(1)}):
        _file(tmp_path, _training(wrong), monkeypatch)
        with pytest.raises(WeightsError, match="holds no weights of MC-CNN fast"):
            mc_cnn.load(NAME)
    for other in ({"optimizer": {}, "epoch": 1}, {"model": 3, "optimizer": {}}, [1]):
        _file(tmp_path, other, monkeypatch)
        with pytest.raises(WeightsError, match="something other than named tensors"):
            mc_cnn.load(NAME)


def test_a_truncated_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = _file(tmp_path, _training(mc_cnn.Network().state_dict()), monkeypatch)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(WeightsError, match=path.name):
        mc_cnn.load(NAME)


def test_nothing_beyond_the_range_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("c_libsgm", reason="libsgm is not installed")
    untrained(monkeypatch)
    left, right, _ = textures()
    found = stereo_matcher(StereoConfig(method="mc-cnn"), "cpu")(left, right, 5, 9)
    assert np.nanmin(found) >= 5
    assert np.nanmax(found) <= 9
