"""Mask sets: packing, boxes, suppression against a plain reference."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.segment import suppression


def rectangles(draw_seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(draw_seed)
    bits = np.zeros((n, 16, 16), bool)
    for k in range(n):
        (x0, x1), (y0, y1) = np.sort(rng.choice(17, 2, replace=False)), np.sort(rng.choice(17, 2, replace=False))
        bits[k, y0:y1, x0:x1] = rng.random((y1 - y0, x1 - x0)) < 0.9
        bits[k, y0, x0] = True
    return bits


def suppress_reference(bits: np.ndarray, score: np.ndarray, threshold: float) -> list[int]:
    keep: list[int] = []
    for i in sorted(range(len(bits)), key=lambda k: -score[k]):
        ious = [(bits[i] & bits[k]).sum() / (bits[i] | bits[k]).sum() for k in keep]
        if all(iou <= threshold for iou in ious):
            keep.append(i)
    return keep


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 25), st.sampled_from([0.3, 0.5, 0.7, 0.9]))
def test_suppress_equals_reference(seed: int, n: int, threshold: float) -> None:
    bits = rectangles(seed, n)
    score = np.random.default_rng(seed + 1).permutation(n).astype(np.float32)
    kept = suppression.suppress(suppression.pack(bits), suppression.boxes(bits), bits.sum((1, 2)), score, threshold)
    assert list(kept) == suppress_reference(bits, score, threshold)


@given(st.integers(0, 10_000))
def test_boxes_hold_the_mask_tightly(seed: int) -> None:
    bits = rectangles(seed, 3)
    for mask, (x0, y0, x1, y1) in zip(bits, suppression.boxes(bits), strict=True):
        rows, columns = np.nonzero(mask)
        assert (x0, y0, x1, y1) == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)


@given(st.integers(0, 10_000))
def test_packed_words_count_pixels(seed: int) -> None:
    bits = rectangles(seed, 2)
    words = suppression.pack(bits)
    assert np.bitwise_count(words[0] & words[1]).sum() == (bits[0] & bits[1]).sum()
