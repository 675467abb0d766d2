import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import TilesConfig
from zpm2.tiled.windows import area, common, grid, levels, side

sides = st.integers(32, 20_000)
shares = st.floats(0, 0.5)


@given(sides, sides, st.integers(256, 4096), shares)
def test_every_level_covers_the_photograph_with_windows_of_its_side(width, height, size, overlap):
    found = levels(width, height, TilesConfig(size=size, overlap=overlap))
    assert found[0] == [(0, 0, width, height)]
    wanted = [size * 3**k for k in range(len(found) - 1)][::-1]
    assert all(1.25 * each <= max(width, height) for each in wanted)
    assert 1.25 * size * 3 ** len(wanted) > max(width, height)  # no level is missing
    for each, windows in zip(wanted, found[1:], strict=True):
        assert len(set(windows)) == len(windows)
        xs, ys = sorted({w[0] for w in windows}), sorted({w[1] for w in windows})
        assert windows == [(x, y, min(x + each, width), min(y + each, height)) for y in ys for x in xs]
        for starts, length in ((xs, width), (ys, height)):
            assert starts[0] == 0
            assert starts[-1] + min(each, length) == length
            assert max(np.diff(starts), default=0) <= each * (1 - overlap) + 1  # rounded to whole px
            assert max(np.diff(starts), default=0) - min(np.diff(starts), default=0) <= 1


@given(sides, st.integers(256, 4096), shares)
def test_there_are_no_more_windows_than_needed(length, size, overlap):
    windows = grid(length, 32, size, overlap)
    if len(windows) > 1:
        reach = size + (len(windows) - 2) * size * (1 - overlap)  # of one window less
        assert reach < length + 1e-6


def test_a_photograph_of_24_megapixels():
    found = levels(6000, 4000, TilesConfig(size=1024, overlap=0.125))
    assert [len(windows) for windows in found] == [1, 6, 35]
    assert {side(window) for window in found[1]} == {3072}
    assert found[2][0] == (0, 0, 1024, 1024)
    assert found[2][-1] == (4976, 2976, 6000, 4000)


@pytest.mark.parametrize(("longest", "count"), [(639, 1), (640, 2), (1919, 2), (1920, 3)])
def test_a_level_comes_where_its_tiles_are_well_smaller_than_the_photograph(longest, count):
    assert len(levels(longest, 300, TilesConfig(size=512))) == count


def test_a_strip_that_is_narrower_than_a_tile():
    _, tiles = levels(1000, 200, TilesConfig(size=512, overlap=0.0))
    assert tiles == [(0, 0, 512, 200), (488, 0, 1000, 200)]


def test_what_two_windows_share():
    assert common((0, 0, 10, 10), (6, 7, 20, 30)) == (6, 7, 10, 10)
    assert area(common((0, 0, 10, 10), (6, 7, 20, 30))) == 12
    assert area(common((0, 0, 10, 10), (11, 11, 20, 30))) == 0
    assert area((5, 5, 5, 9)) == 0
    assert side((3, 4, 10, 30)) == 26
