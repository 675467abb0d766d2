import dataclasses

import numpy as np
import shapely
from shapes import arrays, square

from zpm2.config import DetailConfig, GuidedConfig
from zpm2.global_match import Candidates
from zpm2.guided.prior import GuidedPrior
from zpm2.polygons.warp import WarpedPolygons

CONFIG = GuidedConfig(min_match_overlap=0.5)


def guided_prior():
    shapes = np.array([shapely.box(0, 0, 10, 10), shapely.box(20, 0, 30, 10), shapely.Polygon()], object)
    warped = WarpedPolygons(np.tile(np.eye(3), (3, 1, 1)), shapes, np.zeros(3, np.int64))
    return GuidedPrior(
        warped,
        confident=(np.array([True, False, True]), np.array([True, True, False])),
        guided=(np.array([False, False, True]), np.array([False, True, False])),
        config=CONFIG,
    )


def pairs(*rows):
    return Candidates(*np.array(rows, np.int64).T)


def test_only_doubtful_pairs_need_agreement():
    asked = pairs((0, 0), (1, 0), (1, 0), (1, 0), (0, 2))
    overlap = np.array([0.36, 0.9, 0.49, 0.9, 0.6])
    agreement = np.array([0.0, 0.9, 0.9, CONFIG.min_agreement - 0.01, CONFIG.min_agreement])
    least = guided_prior().least_overlap(asked, agreement, np.zeros(5, int))
    assert list(overlap >= least) == [True, True, False, False, True]
    assert list(np.isinf(least)) == [False, False, False, True, False]


def test_what_a_closer_look_found_must_fit_better_and_share_points():
    closer = np.array([True, False, False]), np.zeros(3, bool)
    detail = DetailConfig(min_overlap=0.6, min_points=1)
    asked = pairs((0, 0), (0, 0), (0, 0), (2, 0))
    overlap = np.array([0.7, 0.59, 0.7, 0.5])
    prior = dataclasses.replace(guided_prior(), closer=closer, detail=detail)
    least = prior.least_overlap(asked, np.ones(4), np.array([1, 9, 0, 0]))
    assert list(overlap >= least) == [True, False, False, True]


def test_found_by_asking():
    assert list(guided_prior().is_guided(pairs((0, 0), (0, 1), (2, 0), (2, 1)))) == [False, True, True, True]


def test_what_carried_polygons_meet_becomes_a_candidate():
    right = arrays([square(5, 5, 15, 15), square(25, 2, 28, 4), square(100, 100, 110, 110)])
    found = guided_prior().candidates(pairs((0, 2), (0, 0)), right)
    assert list(zip(found.left, found.right, strict=True)) == [(0, 0), (0, 2), (1, 1)]
