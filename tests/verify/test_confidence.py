import dataclasses

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import ConfidenceConfig
from zpm2.verify import Evidence, confidence

CONFIG = ConfidenceConfig()
FOR = {  # evidence that can only help: its range
    "content": st.floats(-2, 2),
    "texture": st.floats(0, 1),
    "agreement": st.floats(1e-4, 1 - 1e-4),
    "flow": st.floats(0, 1),
    "width": st.floats(0, 500),
}
AGAINST = {"motion": st.floats(0, 5)}


def chance(**values):
    return float(confidence(Evidence(**{name: np.array([value]) for name, value in values.items()}), CONFIG)[0])


@given(st.fixed_dictionaries(FOR | AGAINST), st.data())
def test_more_evidence_never_lowers_the_confidence(values, data):
    before = chance(**values)
    assert 0 < before < 1
    for name, range_ in FOR.items():
        more = max(values[name], data.draw(range_))
        assert chance(**{**values, name: more}) >= before
    assert chance(**{**values, "motion": max(values["motion"], data.draw(AGAINST["motion"]))}) <= before


def test_every_piece_counts():
    poor = {"content": 0.0, "texture": 0.1, "agreement": 0.4, "flow": 0.3, "width": 3.0, "motion": 0.3}
    better = {"content": 0.4, "texture": 0.8, "agreement": 0.80, "flow": 0.9, "width": 12.0, "motion": 0.05}
    assert all(chance(**{**poor, name: value}) > chance(**poor) for name, value in better.items())
    assert chance(**better) > 0.97
    assert chance(**{**poor, "agreement": 0.1, "content": -0.3, "motion": 0.5}) < 0.3


def test_weights_are_not_negative():
    assert all(getattr(CONFIG, field.name) >= 0 for field in dataclasses.fields(CONFIG) if field.name != "intercept")
