"""What a user is told about the geometry of a pair."""

import numpy as np
from planes import known

from zpm2.config import GlobalConfig
from zpm2.errors import Failed
from zpm2.global_match import PriorLocations, PyramidLocations
from zpm2.global_match.messages import geometry_warnings, location_notes


def located(found: list[bool], outside: list[bool]) -> PyramidLocations:
    n = len(found)
    prior = PriorLocations(np.zeros((n, 2)), np.tile(np.eye(2), (n, 1, 1)))
    return PyramidLocations(np.zeros((n, 2)), np.array(found), np.zeros(n), np.array(outside), prior)


def test_each_missing_geometry_has_its_reason() -> None:
    first, second, third = geometry_warnings(known())
    assert first.startswith("no fundamental matrix: ")
    assert second.startswith("no homography: ")
    assert "0 of 0 homologous points agree" in third
    assert isinstance(known().homography, Failed)


def test_polygons_that_the_pyramid_could_not_confirm_are_counted() -> None:
    (note,) = location_notes(located([True, False, False], [False, True, False]), GlobalConfig())
    assert note.startswith("2 of 3 left polygons stay where the geometry predicts them: 1 beyond")
    assert location_notes(located([True], [False]), GlobalConfig()) == []
    assert location_notes(located([False], [False]), GlobalConfig(search="fixed")) == []
