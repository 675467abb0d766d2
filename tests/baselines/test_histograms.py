"""Log-polar bins, the chi-square cost as a matrix product, and the comparison of all with all."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rings import generators

from zpm2.baselines import InnerDistance, ShapeContext, histograms
from zpm2.baselines.histograms import chi_square, compare, log_polar
from zpm2.errors import ConfigError


def counts_of(rng, n, bins, total):
    """(n, bins) random counts with the sum `total`, many of them 0."""
    return rng.multinomial(total, rng.dirichlet(np.full(bins, 0.2)), size=n).astype(np.uint16)


def chi_square_as_printed(first, second):
    g, h = first[:, None] / first[0].sum(), second[None] / second[0].sum()
    return ((g - h) ** 2 / np.where(g + h > 0, g + h, 1)).sum(2) / 2


def test_bins_by_hand():
    distance = np.array([[0, 1, 1, 30], [1, 0, 2, 4], [1, 2, 0, 8], [30, 4, 8, 0]], float)  # mean 46 / 6 = 7.67
    angle = np.radians([[0, 0, 14, 16], [180, 0, -14, -16], [90, 91, 0, 359], [720, 270, -90, 0]])
    found = log_polar(distance, angle, 5, 12).reshape(4, 5, 12)
    expected = np.zeros((4, 5, 12), int)
    for row, ring, sector in [
        *[(0, 1, 0), (0, 1, 0), (0, 4, 1)],
        *[(1, 1, 6), (1, 2, 0), (1, 3, 11)],
        *[(2, 1, 3), (2, 2, 3), (2, 4, 0)],
        *[(3, 4, 0), (3, 3, 9), (3, 4, 9)],
    ]:
        expected[row, ring, sector] += 1
    assert np.array_equal(found, expected)


@settings(deadline=None)
@given(generators, st.integers(3, 60), st.integers(1, 8), st.integers(1, 16))
def test_every_other_point_is_counted_once(rng, n, rings, sectors):
    x = rng.normal(size=(n, 2))
    away = x[None] - x[:, None]
    angle = np.arctan2(away[..., 1], away[..., 0]) - rng.uniform(-4, 4, (n, 1))
    found = log_polar(np.hypot(away[..., 0], away[..., 1]), angle, rings, sectors)
    assert found.shape == (n, rings * sectors)
    assert (found.sum(1) == n - 1).all()


@settings(deadline=None)
@given(generators, st.sampled_from([2, 7, 99, 999]), st.integers(1, 96))
def test_chi_square_is_the_printed_one(rng, total, bins):
    first, second = counts_of(rng, 5, bins, total), counts_of(rng, 7, bins, total)
    found = chi_square(first, second)
    assert np.allclose(found, chi_square_as_printed(first, second), atol=1e-5)
    assert np.allclose(found, chi_square(second, first).T, atol=1e-6)
    assert np.allclose(np.diag(chi_square(first, first)), 0, atol=1e-5)
    assert found.min() >= 0


def test_histograms_that_share_no_bin_cost_1():
    assert np.array_equal(chi_square(np.array([[9, 0, 0]], np.uint16), np.array([[0, 4, 5]], np.uint16)), [[1.0]])


@pytest.mark.parametrize("block", [1, 300, 2**20])
@pytest.mark.parametrize("method", [ShapeContext(samples=12), InnerDistance(samples=12)])
def test_blocks_of_pairs_change_nothing(method, block, monkeypatch):
    rng = np.random.default_rng(1)
    left, right = (counts_of(rng, p * 12, 60, 11).reshape(p, 12, 60) for p in (4, 7))
    shares = []
    monkeypatch.setattr(histograms, "COSTS_AT_ONCE", block)
    found = compare(left, right, method.align, shares.append)
    expected = [[method.align(chi_square(a, b)[None])[0] for b in right] for a in left]
    assert np.allclose(found, expected, atol=1e-6)
    assert shares == sorted(shares)
    assert shares[-1] == 1


def test_nothing_to_compare():
    method = ShapeContext()
    some = np.zeros((3, 100, 60), np.uint16)
    assert compare(some[:0], some, method.align).shape == (0, 3)
    assert compare(some, some[:0], method.align).shape == (3, 0)


@pytest.mark.parametrize("settings", [{"samples": 2}, {"rings": 0}, {"sectors": 0}, {"limit": 0.0}, {"limit": 1.5}])
@pytest.mark.parametrize("method", [ShapeContext, InnerDistance])
def test_settings_that_cannot_be_used(method, settings):
    with pytest.raises(ConfigError, match="a shape descriptor needs"):
        method(**settings)
