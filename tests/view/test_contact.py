import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.model import Image
from zpm2.view.contact import BRIGHT, CAPTION, GAP, SEAM, Crop, contact_sheet, crop_window
from zpm2.view.panel import DARK

SIDE = 100


def _crop(width=50, height=50, low=(10, 10), high=(40, 30), hole=None, value=120):
    def ring(a, b):
        return np.array([[a[0], a[1]], [b[0], a[1]], [b[0], b[1]], [a[0], b[1]]], float)

    rings = [ring(low, high)] + ([] if hole is None else [ring(*hole)[::-1]])
    return Crop(Image(np.full((height, width, 3), value, np.uint8)), rings)


def _squares(sheet, k=0, columns=1):
    """The left and the right square of cell k, and the strip below them."""
    x = GAP + k % columns * (2 * SIDE + SEAM + GAP)
    y = GAP + k // columns * (SIDE + CAPTION + GAP)
    right = x + SIDE + SEAM
    below = sheet[y + SIDE : y + SIDE + CAPTION, x : right + SIDE]
    return *(sheet[y : y + SIDE, a : a + SIDE].astype(int) for a in (x, right)), below.astype(int)


def _bright(pixels):
    return np.abs(pixels.astype(int) - BRIGHT).max(axis=2) < 90


def _dark(pixels):
    return np.abs(pixels.astype(int) - DARK).max(axis=2) < 30


def test_outlines_lie_where_they_should_and_nothing_is_filled():
    left, right, _ = _squares(contact_sheet([(_crop(), _crop(low=(5, 20), high=(20, 45)))], [""], SIDE))
    for square, (x0, y0, x1, y1) in ((left, (20, 20, 80, 60)), (right, (10, 40, 40, 90))):
        rows, columns = np.nonzero(_bright(square))
        box = columns.min(), rows.min(), columns.max(), rows.max()
        assert box == pytest.approx((x0, y0, x1, y1), abs=1)
        assert (square[y0 + 4 : y1 - 4, x0 + 4 : x1 - 4] == 120).all()
        assert (square[: y0 - 4] == 120).all()
        across = square[(y0 + y1) // 2, x0 - 3 : x0 + 3][None]
        assert _bright(across).any()
        assert (across.max(axis=2) < 90).any()  # the halo


def test_holes_are_drawn():
    left, right, _ = _squares(contact_sheet([(_crop(hole=((20, 15), (30, 25))), _crop())], [""], SIDE))
    extra = _bright(left) & ~_bright(right)
    rows, columns = np.nonzero(extra)
    assert (columns.min(), rows.min(), columns.max(), rows.max()) == pytest.approx((40, 30, 60, 50), abs=1)


@pytest.mark.parametrize(("width", "height"), [(400, 100), (30, 90), (7, 300), (1, 1)])
def test_the_aspect_is_kept_in_a_dark_square(width, height):
    crop = Crop(Image(np.full((height, width, 3), 200, np.uint8)), [])
    left, _, _ = _squares(contact_sheet([(crop, crop)], [""], SIDE))
    rows, columns = np.nonzero((left == 200).all(axis=2))
    size = np.ptp(columns) + 1, np.ptp(rows) + 1
    assert max(size) == SIDE
    assert size == pytest.approx(np.array([width, height]) * SIDE / max(width, height), abs=0.51)
    assert _dark(left).sum() == SIDE * SIDE - len(rows)
    assert abs(columns.min() + columns.max() - SIDE + 1) <= 1  # in the middle
    assert abs(rows.min() + rows.max() - SIDE + 1) <= 1


@pytest.mark.parametrize(
    ("count", "columns", "shape"), [(1, 5, (1, 1)), (7, 3, (3, 3)), (6, 3, (2, 3)), (4, 1, (4, 1))]
)
def test_there_is_a_cell_for_each_match(count, columns, shape):
    sheet = contact_sheet(
        [(_crop(value=100 + 9 * k), _crop(value=101 + 9 * k)) for k in range(count)], ["x"] * count, SIDE, columns
    )
    lines, across = shape
    assert sheet.dtype == np.uint8
    assert sheet.shape == (lines * (SIDE + CAPTION + GAP) + GAP, across * (2 * SIDE + SEAM + GAP) + GAP, 3)
    for k in range(count):
        left, right, below = _squares(sheet, k, across)
        assert (left[0] == 100 + 9 * k).all()
        assert (right[0] == 101 + 9 * k).all()
        assert not _dark(below).all()
    for k in range(count, lines * across):
        assert all(_dark(part).all() for part in _squares(sheet, k, across))


@pytest.mark.parametrize("caption", ["17-23  0.93", "a caption that is much too long for a cell of such a width " * 3])
def test_captions_stay_below_their_crops(caption):
    pair = _crop(), _crop()
    sheet = contact_sheet([pair] * 4, [caption, "", "", ""], SIDE, 2)
    empty = contact_sheet([pair] * 4, [""] * 4, SIDE, 2)
    rows, columns = np.nonzero((sheet != empty).any(axis=2))
    assert len(rows) > 100
    assert GAP + SIDE <= rows.min() <= rows.max() < GAP + SIDE + CAPTION
    assert GAP <= columns.min() <= columns.max() < GAP + 2 * SIDE + SEAM
    assert columns.min() + columns.max() == pytest.approx(2 * (GAP + SIDE) + SEAM, abs=6)  # in the middle


def test_no_matches():
    sheet = contact_sheet([], [])
    assert sheet.shape[0] < 300
    assert sheet.shape[1] < 400
    assert not _dark(sheet).all()


def test_the_same_input_gives_the_same_picture_and_stays_as_it_is():
    rng = np.random.default_rng(2)
    image = Image(rng.integers(0, 256, (SIDE, SIDE, 3), np.uint8))  # fills its square: nothing to resize
    before = image.rgb.copy()
    rows = [(Crop(image, _crop(hole=((20, 15), (30, 25))).rings), Crop(image, []))] * 3
    first = contact_sheet(rows, ["a", "b", "c"], SIDE)
    assert np.array_equal(first, contact_sheet(rows, ["a", "b", "c"], SIDE))
    assert np.array_equal(image.rgb, before)


def test_captions_and_rows_go_together():
    with pytest.raises(ValueError, match="zip"):
        contact_sheet([(_crop(), _crop())], [])


def test_windows():
    assert crop_window((400, 300, 500, 350), 1000, 1000) == (340, 215, 560, 435)  # 60 px on each side of the longer
    assert crop_window((400, 300, 410, 310), 1000, 1000) == (384, 284, 426, 326)  # at least 16 px
    assert crop_window((0, 300, 100, 350), 1000, 1000) == (0, 215, 220, 435)  # moved in from the border
    assert crop_window((900, 950, 1000, 1000), 1000, 1000) == (780, 780, 1000, 1000)
    assert crop_window((400, 100, 500, 150), 1000, 160) == (340, 0, 560, 160)  # the image is too low for a square
    assert crop_window((0, 0, 100, 100), 50, 40, 1.0) == (0, 0, 50, 40)
    assert crop_window((400, 300, 500, 350), 1000, 1000, 0.0) == (384, 259, 516, 391)


@given(
    st.tuples(st.floats(-50, 300), st.floats(-50, 300)),
    st.tuples(st.floats(0, 200), st.floats(0, 200)),
    st.integers(1, 300),
    st.integers(1, 300),
    st.floats(0, 2),
)
def test_windows_lie_in_the_image_and_hold_what_is_there(low, size, width, height, margin):
    bounds = (*low, low[0] + size[0], low[1] + size[1])
    x0, y0, x1, y1 = crop_window(bounds, width, height, margin)
    assert 0 <= x0 < x1 <= width
    assert 0 <= y0 < y1 <= height
    assert x1 - x0 == y1 - y0 or x1 - x0 == width or y1 - y0 == height
    assert x0 <= min(max(bounds[0], 0), width - 1)
    assert y1 >= max(min(bounds[3], height), 1)
