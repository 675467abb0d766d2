"""Numbers read off masks: numpy and torch tensors against plain loops.

The tensors are on the CPU, where torch computes the same: all of it runs without a GPU.
"""

import dataclasses

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2 import config
from zpm2.config import SegmentConfig
from zpm2.errors import ConfigError
from zpm2.model import Image
from zpm2.segment import automatic, device_stacks, stacks, suppression
from zpm2.segment.mask_view import MaskView, Room, predicted, settled
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts

SIZE = 78, 256  # of a decoded mask of the image below
IMAGE = Image(np.zeros((375, 1242, 3), np.uint8))


def discs(seed: int, n: int, size: tuple[int, int] = SIZE, noise: float = 3.0) -> np.ndarray:
    """(n, h, w) logits of discs with smooth, uneven borders; the last one is empty."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    logits = np.empty((n, *size), np.float32)
    for k in range(n):
        away = np.hypot(x - rng.uniform(0, size[1]), y - rng.uniform(0, size[0]))
        logits[k] = (rng.uniform(4, 60) - away) / 2 + noise * cv2.GaussianBlur(rng.normal(size=size), (0, 0), 2)
    logits[-1] = -5
    return logits


def both(seed: int, n: int) -> tuple[MaskPredictions, MaskPredictions]:
    """The same masks as an array and as a tensor, as a network would leave them."""
    logits, score = discs(seed, n), np.random.default_rng(seed).random(n).astype(np.float32)
    prompt, thresholds = np.arange(n) // 3, MaskThresholds(0.0, 0.5)
    one, other = (settled(prompt, score, each, 1.0, thresholds) for each in (logits, torch.from_numpy(logits)))
    return one, other


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.integers(8, 16))
def test_masks_that_are_stable_stay(seed: int, n: int) -> None:
    logits = discs(seed, n)
    rows = [
        k for k in range(n) if (logits[k] > 1).sum() >= 0.5 * max((logits[k] > -1).sum(), 1) and (logits[k] > 1).any()
    ]
    for found in both(seed, n):
        assert np.array_equal(found.prompt, np.array(rows, int) // 3)
        assert np.array_equal(found.bits, np.clip(logits[rows], -60, 60).astype(np.float16) > 0)
        assert np.array_equal(stacks.to_host(found.logits > 0), found.bits)
        for bits, area, (x0, y0, x1, y1) in zip(found.bits, *dataclasses.astuple(found.extent), strict=True):
            y, x = np.nonzero(bits)
            assert (area, x0, y0, x1, y1) == (len(x), x.min(), y.min(), x.max() + 1, y.max() + 1)
        unmeasured = dataclasses.replace(found, measured=None)
        assert np.array_equal(unmeasured.extent.box, found.extent.box)
        assert np.array_equal(unmeasured.extent.area, found.extent.area)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.integers(8, 16))
def test_coverage_and_the_finest_mask_around_a_point(seed: int, n: int) -> None:
    one, other = both(seed, n)
    rng = np.random.default_rng(seed + 1)
    row, column = rng.integers(0, SIZE[0], n), rng.integers(0, SIZE[1], n)
    bits = one.bits
    own = [k for k in range(len(one)) if bits[k, row[one.prompt[k]], column[one.prompt[k]]]]
    finest = {p: min((k for k in own if one.prompt[k] == p), key=lambda k: (bits[k].sum(), k)) for p in one.prompt[own]}
    smallest = np.full(SIZE, stacks.NO_MASK)
    for each in bits:
        smallest[each] = np.minimum(smallest[each], each.sum())
    for found in (one, other):
        chosen = automatic._finest_around(found, row, column)
        assert list(chosen) == [finest[p] for p in sorted(finest)]
        union, least = stacks.painted(found.logits, found.extent, chosen)
        assert np.array_equal(union, bits[chosen].any(0))
        assert np.array_equal(least, smallest)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.integers(8, 16), st.sampled_from([0.3, 0.7]))
def test_overlaps_and_suppression(seed: int, n: int, threshold: float) -> None:
    one, other = both(seed, n)
    targets, of = np.roll(discs(seed + 1, 5) > 0, 3, 1), np.random.default_rng(seed).integers(0, 5, len(one))
    common = [(mask & targets[k]).sum() for mask, k in zip(one.bits, of, strict=True)]
    rows, to = np.array([1, 3]), discs(seed + 2, 2) > 0
    limited = targets.copy()
    limited[rows] &= to
    for found in (one, other):
        for target in (targets, torch.from_numpy(targets)):
            assert list(stacks.shared(found.inside, target, of)) == common
            assert np.array_equal(stacks.to_host(stacks.limited(target, rows, to)), limited)
    assert not len(suppression.suppress_stack([one.logits], one.extent, one.score, threshold, np.arange(0)))
    for some in (np.arange(len(one)), np.arange(1, len(one), 2)):
        part = one[some]
        packed = suppression.pack(part.bits)
        reference = suppression.suppress(packed, part.extent.box, part.extent.area, part.score, threshold)
        for found in (one, other):
            for parts in ([found.logits], [found.logits[:2], found.logits[2:]]):
                kept = suppression.suppress_stack(parts, found.extent, found.score, threshold, some)
                assert np.array_equal(kept, some[reference])
    parts = [one, other, MaskPredictions.none(SIZE)]
    joined = MaskPredictions.join(parts)
    assert np.array_equal(joined.bits, np.concatenate([one.bits, one.bits]))
    count = len(one)
    for rows in ([2 * count - 1, 0, count, 3, 3], [1, 0], [count + 1, count]):
        for order in (parts, [other, MaskPredictions.none(SIZE), one]):
            chosen = MaskPredictions.chosen(order, np.array(rows, np.intp))
            assert np.array_equal(chosen.bits, joined.bits[rows])
            assert np.array_equal(chosen.extent.box, joined.extent.box[rows])


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 9))
def test_windows_of_masks(seed: int, n: int) -> None:
    """Logits of windows: without what lies beyond the image, and in their place in it."""
    rng = np.random.default_rng(seed)
    size = 30, 40
    logits = discs(seed, 2 * n, (16, 20)).reshape(n, 2, 16, 20)
    corner = np.c_[rng.integers(0, size[0], n), rng.integers(0, size[1], n)]
    left = np.array(size) - corner
    expected, placed = logits.copy(), np.full((n, *size), -stacks.MAX_LOGIT, np.float32)
    for k, ((row, column), (height, width)) in enumerate(zip(corner, left, strict=True)):
        expected[k, :, height:] = expected[k, :, :, width:] = -stacks.MAX_LOGIT
        part = logits[k, 0, :height, :width]
        placed[k, row : row + part.shape[0], column : column + part.shape[1]] = part
    for each in (logits, torch.from_numpy(logits)):
        assert np.array_equal(np.asarray(stacks.cropped(each, *left.T)), expected)
        assert np.array_equal(np.asarray(stacks.placed(each[:, 0], corner, size)), placed)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 12), st.floats(0.05, 0.9))
def test_masks_that_look_alike_inside_windows(seed: int, n: int, threshold: float) -> None:
    rng = np.random.default_rng(seed)
    low = np.c_[rng.integers(0, SIZE[1] - 20, n), rng.integers(0, SIZE[0] - 20, n)]
    window = np.c_[low, np.minimum(low + rng.integers(20, 90, (n, 2)), SIZE[::-1])]
    known, cut = discs(seed, n), np.full((n, *SIZE), -5.0, np.float32)
    for k, (x0, y0, x1, y1) in enumerate(window):
        cut[k, y0:y1, x0:x1] = np.roll(known[rng.integers(n)], rng.integers(-3, 4, 2), (0, 1))[y0:y1, x0:x1]
    (score, others_score), rows, overlaps = rng.random((2, n)).astype(np.float32), list[int](), np.zeros((n, n))
    for k, (x0, y0, x1, y1) in enumerate(window):
        mask = cut[k, y0:y1, x0:x1] > 0
        for j in range(n):
            there = known[j, y0:y1, x0:x1] > 0
            overlaps[k, j] = (mask & there).sum() / max((mask | there).sum(), 1) * (others_score[j] >= score[k])
        rows += [k] if overlaps[k].max() > threshold else []
    for one, other in ((cut, known), (torch.from_numpy(cut), torch.from_numpy(known))):
        masks = MaskPredictions(np.arange(n), score, score, one)
        others = MaskPredictions(np.arange(n), others_score, score, other)
        parts = [others[np.arange(n // 2)], MaskPredictions.none(SIZE), others[np.arange(n // 2, n)]]
        found, like = suppression.alike_inside(masks, parts, window, threshold)
        assert list(found) == rows
        assert np.array_equal(overlaps[found, like.prompt], overlaps[found].max(1))
        assert np.array_equal(like.bits, others.bits[like.prompt])


def test_bits_cross_to_a_device_packed() -> None:
    bits = np.random.default_rng(0).random((5, 101, 203)) < 0.5
    assert np.array_equal(device_stacks.on(bits, torch.device("cpu")).numpy(), bits)


def test_masks_at_the_resolution_of_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    """Within a thousandth of OpenCV's, which interpolates in steps of a 32nd px."""
    monkeypatch.setattr(device_stacks, "GATHER_PX", 50_000)  # in several parts
    view, (one, other) = MaskView(IMAGE, 1024), both(3, 40)
    found = list(zip(view.masks(one), view.masks(other), strict=True))
    assert len(found) > 20
    for host, device in found:
        assert (host.x0, host.y0, host.bits.shape, host.score) == (
            device.x0,
            device.y0,
            device.bits.shape,
            device.score,
        )
        assert (host.bits & device.bits).sum() >= 0.999 * (host.bits | device.bits).sum()


def test_squares_in_the_proportions_of_the_image() -> None:
    square = discs(1, 3, (64, 64))
    x, y = 64 / 256, 64 / 78
    made = device_stacks.resampled(torch.from_numpy(square), x, y, SIZE).numpy()
    to_square = np.array([[x, 0, x / 2 - 0.5], [0, y, y / 2 - 0.5]])
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    for one, other in zip(square, made, strict=True):
        expected = cv2.warpAffine(one, to_square, SIZE[::-1], flags=how, borderMode=cv2.BORDER_REPLICATE)
        assert np.abs(other - expected).max() < 0.1


class Full(RuntimeError):
    """As torch's, which is told by its name."""


Full.__name__ = "OutOfMemoryError"


def test_fewer_prompts_at_a_time_where_memory_ends() -> None:
    prompts, sizes, notes = Prompts.at(np.zeros((40, 2))), list[int](), list[str]()

    def answer(rows: slice, following: slice) -> MaskPredictions:
        asked = np.arange(40)[rows]
        assert following.start == rows.stop
        sizes.append(len(asked))
        if len(asked) > 5:
            raise Full
        every = np.ones(len(asked), np.float32)
        return MaskPredictions(asked, every, every, np.ones((len(asked), 8, 8), np.float16))

    room = Room(16, notes)
    found = MaskPredictions.join(predicted(prompts, room, answer, (8, 8)))
    assert list(found.prompt) == list(range(40))
    assert sizes == [16, 8, *[4] * 10]
    assert notes == ["the GPU has little free memory: prompts went to the segmenter 4 at a time"]
    room.most = 1
    with pytest.raises(ConfigError, match="too little free memory for one prompt: use --device cpu"):
        room.halve(Full())
    with pytest.raises(RuntimeError, match="another"):
        room.halve(RuntimeError("another"))


def test_a_run_without_tensors_needs_no_torch() -> None:
    import subprocess
    import sys

    code = (
        "import sys, numpy as np\nfrom zpm2.segment import automatic\n"
        "from zpm2.segment.classical import ClassicalSegmenter\nfrom zpm2.config import SegmentConfig\n"
        "from zpm2.model import Image\nrgb = np.random.default_rng(0).integers(0, 255, (60, 80, 3), np.uint8)\n"
        "ClassicalSegmenter(SegmentConfig(grid=4)).segment(Image(rgb))\nsys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_the_smallest_of_no_masks() -> None:
    nothing = MaskPredictions.none(SIZE)
    assert len(nothing.extent.area) == 0
    assert config.preset("default").segment.precision == SegmentConfig().precision == "float32"
