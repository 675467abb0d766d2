import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from zpm2.formats.properties import OURS, PREFIX, polygon_properties, prefixed, unprefixed
from zpm2.model import Counterpart, Polygon

SQUARE = np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]])
words = st.sampled_from([*sorted(OURS), "Label", "AREA", "id", "name", ""])
names = st.builds(lambda times, word: PREFIX * times + word, st.integers(0, 3), words)


@given(st.dictionaries(names, st.integers()))
def test_given_properties_come_back_whatever_their_names(properties):
    ours = polygon_properties(Polygon(3, SQUARE, source_id="way/7"), None, None)
    together = {**ours, **prefixed(properties, OURS)}
    assert len(together) == len(ours) + len(properties)
    assert unprefixed(together, OURS) == properties


def test_our_members():
    found = polygon_properties(Polygon(3, SQUARE, (), 0.5, 1, "roof"), Counterpart(2, 9, 0.75), None)
    assert found == {
        "area": 16.0,
        "score": 0.5,
        "parent": 1,
        "label": "roof",
        "match": 9,
        "match_id": 2,
        "confidence": 0.75,
        "unmatched": None,
    }
    alone = polygon_properties(Polygon(3, SQUARE, source_id="a"), None, "occluded")
    assert set(alone) == OURS - {"area_m2"}
    assert (alone["source_id"], alone["unmatched"], alone["match"], alone["match_id"]) == ("a", "occluded", None, None)


def test_only_names_that_are_ours_are_changed():
    given = {"name": "Hof", "id": 7, "area": 3, "source": "survey", "source_id": "x", "source_date": 2020}
    assert prefixed(given, OURS) == {
        "name": "Hof",
        "id": 7,
        "source_area": 3,
        "source": "survey",
        "source_source_id": "x",
        "source_date": 2020,
    }
