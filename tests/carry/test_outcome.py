from hypothesis import given
from hypothesis import strategies as st

from zpm2.carry.outcome import confidence
from zpm2.config import CarryConfig

CONFIG = CarryConfig()
SHARE, COUNT = st.floats(0, 1), st.integers(0, 10**6)


@given(SHARE, SHARE, COUNT, SHARE, SHARE, SHARE, COUNT, SHARE)
def test_more_evidence_is_never_less_confidence(agreement, trust, points, among, more, surer, others, amid):
    least = confidence(agreement, trust, points, among, CONFIG)
    most = confidence(max(agreement, more), max(trust, surer), max(points, others), max(among, amid), CONFIG)
    assert 0 < least <= most < 1


def test_a_pair_of_few_points_is_less_sure():
    assert confidence(0.8, 0.8, 50, 0.5, CONFIG) < 0.9 < confidence(0.8, 0.8, 2000, 0.5, CONFIG)


def test_a_region_beyond_the_points_is_less_sure():
    assert confidence(0.6, 0.5, 1000, 0.0, CONFIG) < 0.75 < 0.9 < confidence(0.6, 0.5, 1000, 1.0, CONFIG)
