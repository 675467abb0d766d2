"""Which polygon is which, once the map between the layers is known."""

import numpy as np
import pytest
import shapely
from towns import houses, moved, shapes

from zpm2.config import LinkConfig
from zpm2.linking import links as linking
from zpm2.linking.fit import Fit, first_fit
from zpm2.linking.layer import Shapes
from zpm2.linking.links import link_polygons
from zpm2.linking.similarity import Similarity, Uncertainty

CONFIG = LinkConfig()


def still(left: Shapes, sigma: float = 0.5) -> Fit:
    """The layers lie on each other."""
    none = Similarity(np.zeros(2), np.zeros(2), 0.0)
    return Fit(none, Uncertainty(0.0, 0.0, 0.0, sigma), left.centers, sigma)


def of_boxes(*boxes: tuple[float, float, float, float]) -> Shapes:
    return Shapes.of(np.arange(len(boxes)), np.array([shapely.box(*box) for box in boxes], object))


def test_all_houses_find_themselves_and_what_is_gone_has_no_link():
    corners = houses(120)
    order = np.random.default_rng(3).permutation(120)
    left, right = shapes(corners), shapes(moved(corners, (8.0, -9.0), 3.0, 0.3)[order][:90])
    found = link_polygons(left, right, first_fit(left, right, CONFIG), CONFIG)
    assert (order[found.right] == found.left).all()
    assert len(found.left) >= 88
    assert found.confidence.min() > 0.5
    assert np.median(found.confidence) > 0.98
    assert set(found.unmatched[0]) == set(range(120)) - set(found.left.tolist())
    assert set(found.unmatched[1]) == set(range(90)) - set(found.right.tolist())


def test_a_neighbour_does_not_take_the_place_of_a_house_that_is_gone():
    left = of_boxes((0, 0, 10, 10), (14, 0, 24, 10))
    right = of_boxes((14.2, 0.1, 24.2, 10.1))
    found = link_polygons(left, right, still(left), CONFIG)
    assert list(zip(found.left, found.right, strict=True)) == [(1, 0)]
    assert found.unmatched[0] == {0: linking.UNLIKE}


def test_each_reason():
    left = of_boxes((0, 0, 10, 10), (60, 0, 70, 10), (1000, 0, 1010, 10), (2.5, 2.5, 12.5, 12.5))
    right = of_boxes((0, 0, 10, 10), (90, 0, 91, 1))
    found = link_polygons(left, right, still(left, sigma=2.0), CONFIG)
    assert list(zip(found.left, found.right, strict=True)) == [(0, 0)]
    assert found.unmatched[0] == {1: linking.NOTHING, 2: linking.OUTSIDE, 3: linking.TAKEN}
    assert found.confidence[0] < 0.999  # the other one claims the same place


def test_a_house_that_is_two_in_the_other_layer():
    left = of_boxes((0, 0, 20, 10), (40, 0, 50, 10))
    right = of_boxes((0, 0, 9.9, 10), (10, 0, 20, 10), (40, 0, 50, 10))
    found = link_polygons(left, right, still(left), CONFIG)
    assert found.parts == ({0: [0, 1]}, {})
    assert (1, 2) in list(zip(found.left, found.right, strict=True))
    assert all(found.unmatched[1].get(part, linking.PART) == linking.PART for part in (0, 1))
    back = link_polygons(right, left, still(right), CONFIG)
    assert back.parts == ({}, {0: [0, 1]})


def test_of_two_at_one_distance_the_shape_decides():
    left = of_boxes((0, 0, 6, 6))
    right = of_boxes((-5, 0, 1, 6), (5, -3, 11, 9))
    found = link_polygons(left, right, still(left, sigma=3.0), CONFIG)
    assert found.right.tolist() == [0]
    assert found.same_shape == pytest.approx([1.0])


def test_the_assignment_is_the_best_of_all():
    """Sums of log-odds over all ways to pair five by five polygons."""
    rng = np.random.default_rng(5)
    left = of_boxes(*((x, y, x + 6, y + 6) for x, y in rng.uniform(0, 25, (5, 2))))
    right = of_boxes(*((x, y, x + 6, y + 6) for x, y in rng.uniform(0, 25, (5, 2))))
    fit = still(left, sigma=4.0)
    config = LinkConfig(max_distance=100.0)
    moved_ = linking._moved(left, fit)
    pairs = linking._candidates(moved_, fit.places, right, config)
    distance = np.hypot(*(right.centers[pairs.right] - fit.places[pairs.left]).T)
    alike = linking._same_shape(moved_[pairs.left], fit.places[pairs.left], right, pairs.right)
    overlap = linking._overlap(moved_[pairs.left], right.shapes[pairs.right])
    odds = dict(
        zip(
            zip(pairs.left.tolist(), pairs.right.tolist(), strict=True),
            linking._log_odds(pairs, distance, alike, overlap, fit, right, config).tolist(),
            strict=True,
        )
    )

    def best(i: int, free: frozenset[int]) -> float:
        if i == 5:
            return 0.0
        return max(best(i + 1, free), *(odds[i, j] + best(i + 1, free - {j}) for j in free), -np.inf)

    found = link_polygons(left, right, fit, config)
    total = sum(odds[i, j] for i, j in zip(found.left.tolist(), found.right.tolist(), strict=True))
    assert total == pytest.approx(best(0, frozenset(range(5))))


def test_rings_that_cross_have_an_area_in_common():
    cross = np.array([shapely.Polygon([(0, 0), (4, 4), (4, 0), (0, 4)])], object)
    box = np.array([shapely.box(0, 0, 4, 1)], object)
    with pytest.raises(shapely.errors.GEOSException):
        shapely.intersection(cross, box)
    assert linking._common(cross, box) == pytest.approx([1.0])
