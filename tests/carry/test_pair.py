"""Regions of one painted photograph in another one of the same plane."""

import cv2
import numpy as np
import pytest
import shapely
from painted import PaintedSegmenter, PaintedView, Region

from zpm2 import config, geometry
from zpm2.carry import pair
from zpm2.carry.outcome import confidence
from zpm2.global_match import initial_geometry
from zpm2.model import Image, PointMatches
from zpm2.polygons.overlap import iou
from zpm2.polygons.rasterize import rasterize_stack

CONFIG = config.preset("default")
H = np.array([[1.02, 0.05, -14.0], [-0.04, 0.98, 9.0], [0, 0, 1]])
SIZE = 256
CELLS = [
    shapely.Polygon([(x, y), (x + 36, y + 3), (x + 30, y + 38), (x - 2, y + 30)])
    for y in range(20, 220, 50)
    for x in range(20, 220, 50)
]


def moved(shape, matrix=H):
    return shapely.transform(shape, lambda xy: geometry.project(matrix, xy))


def points(matrix=H, count=600, inside=None):
    at = np.random.default_rng(0).uniform(0, SIZE, (count, 2))
    if inside is not None:
        at = at[shapely.contains_xy(inside, *at.T)]
    return PointMatches(at, geometry.project(matrix, at), np.ones(len(at)))


def geometry_of(known=None):
    return initial_geometry(points() if known is None else known, CONFIG.global_match, CONFIG.seed)


def flat():
    """Two photographs without texture: nothing tells whether they agree."""
    return tuple(Image(np.full((SIZE, SIZE, 3), value, np.uint8)) for value in (100, 120))


def textured(gone=None):
    """A surface of texture, and the same moved by H; where the region `gone` was is another texture."""
    rough = np.random.default_rng(1).uniform(0, 255, (2, SIZE, SIZE, 3)).astype(np.float32)
    surface, other = (
        np.clip(128 + 4 * (cv2.GaussianBlur(each, (0, 0), 2) - 128), 0, 255).astype(np.uint8) for each in rough
    )
    right = cv2.warpPerspective(surface, H, (SIZE, SIZE))
    if gone is not None:
        (inside,) = rasterize_stack(np.array([moved(gone)], object), (SIZE, SIZE))
        right[inside] = other[inside]
    return Image(surface), Image(right)


def carried(given, right_regions, known=None, names=None, images=None, chosen=CONFIG):
    images = images or flat()
    segmenter = PaintedSegmenter([PaintedView(images[1], right_regions)])
    names = names or [str(k) for k in range(len(given))]
    return pair.carry(images, np.array(given, object), names, geometry_of(known), segmenter, chosen)


def test_each_region_is_found_where_the_points_put_it():
    found = carried(CELLS, [Region(moved(shape)) for shape in CELLS])
    assert {each.status for each in found} == {"found"}
    overlap = iou(np.array([each.shape for each in found], object), np.array([moved(s) for s in CELLS], object))
    assert overlap.min() > 0.9
    assert all(each.visible > 0.9 and each.points >= 3 and each.sigma < 0.5 for each in found)
    assert all(0.9 < each.confidence <= 1 for each in found)


def test_what_nobody_sees_there_is_hidden_and_no_other_region_is_taken_for_it():
    gone = 5
    found = carried(CELLS, [Region(moved(shape)) for k, shape in enumerate(CELLS) if k != gone])
    assert found[gone].status == "hidden"
    assert found[gone].shape is None
    assert found[gone].confidence == 0
    assert "hidden, changed or gone" in found[gone].reason
    assert sum(each.status == "found" for each in found) == len(CELLS) - 1


def test_a_region_that_the_photograph_shows_and_nobody_outlines_keeps_its_own_outline():
    found = carried(CELLS, [Region(moved(shape)) for k, shape in enumerate(CELLS) if k != 5], images=textured())
    assert {each.status for each in found} == {"found"}
    assert found[5].reason == "points tell its place: outline moved, not snapped"
    assert iou(np.array([found[5].shape], object), np.array([moved(CELLS[5])], object))[0] > 0.9


def test_where_the_photograph_shows_something_else_no_outline_is_only_moved():
    others = [Region(moved(shape)) for k, shape in enumerate(CELLS) if k != 5]
    found = carried(CELLS, others, images=textured(CELLS[5]))
    assert found[5].status == "hidden"
    assert found[5].shape is None


def test_of_one_plane_an_outline_only_moved_is_more_exact_than_a_loose_answer():
    grown = moved(CELLS[5]).buffer(1.5)
    (found,) = carried([CELLS[5]], [Region(grown)], images=textured())
    assert iou(np.array([found.shape], object), np.array([grown], object))[0] < 0.9
    (found,) = carried([CELLS[5]], [Region(grown)])
    assert iou(np.array([found.shape], object), np.array([grown], object))[0] > 0.9


def test_a_region_whose_place_is_beyond_the_border_is_outside():
    away = np.array([[1.0, 0, 200.0], [0, 1, 0], [0, 0, 1]])
    found = carried(CELLS, [Region(moved(CELLS[0], away))], points(away))
    assert found[0].status == "found"
    assert found[3].status == "outside"
    assert found[3].place[0] > SIZE


def test_a_region_that_is_partly_hidden_is_found_in_part():
    x0, y0, x1, y1 = moved(CELLS[5]).bounds
    seen = moved(CELLS[5]).intersection(shapely.box(x0, y0, x0 + 0.7 * (x1 - x0), y1))
    (found,) = carried([CELLS[5]], [Region(seen)])
    assert found.status == "in part"
    assert found.visible == pytest.approx(seen.area / moved(CELLS[5]).area, abs=0.05)
    assert "partly hidden" in found.reason


def test_two_regions_never_claim_one_place():
    rival = shapely.affinity.scale(CELLS[5], 0.8, 0.8)
    found = carried([CELLS[5], rival], [Region(moved(CELLS[5]))], names=["roof", "other"])
    assert found[0].status == "found"
    assert found[1].status == "not found"
    assert "region roof" in found[1].reason


def test_neighbours_that_were_disjoint_stay_disjoint():
    left, right = shapely.box(40, 40, 100, 100), shapely.box(100, 40, 160, 100)
    wide = [shapely.box(38, 40, 106, 100), shapely.box(96, 40, 162, 100)]  # as a segmenter would answer
    found = carried([left, right], [Region(moved(shape)) for shape in wide])
    assert [each.status for each in found] == ["found", "found"]
    assert found[0].shape.intersection(found[1].shape).area == pytest.approx(0, abs=1e-6)


def test_a_thing_that_moves_on_its_own_is_found_by_its_own_points():
    thing, own = CELLS[5], np.array([[1.0, 0.1, 60.0], [-0.1, 1, 40.0], [0, 0, 1]])
    outside = shapely.box(0, 0, SIZE, SIZE).difference(thing)
    both = PointMatches.join([points(inside=outside), points(own, inside=thing)])
    (found,) = carried([thing], [Region(moved(thing, own))], both)
    assert found.status == "found"
    assert iou(np.array([found.shape], object), np.array([moved(thing, own)], object))[0] > 0.9


def test_without_points_and_likeness_nothing_is_claimed():
    (found,) = carried([CELLS[5]], [Region(moved(CELLS[5]))], PointMatches.empty())
    assert found.status == "not found"
    assert "no points tell its place" in found.reason


def test_a_region_of_two_parts_keeps_both():
    parts = shapely.MultiPolygon([CELLS[0], CELLS[1]])
    both = shapely.MultiPolygon([moved(CELLS[0]), moved(CELLS[1])])
    (found,) = carried([parts], [Region(both)])
    assert found.shape.geom_type == "MultiPolygon"
    assert len(found.shape.geoms) == 2


def test_an_outline_that_is_more_likely_wrong_than_right_is_no_find():
    few = points(count=12)
    regions = [Region(moved(shape)) for shape in CELLS]
    kept = carried(CELLS, regions, few, chosen=config.assign(CONFIG, ["carry.min_confidence=0"]))
    found = carried(CELLS, regions, few)
    doubtful = [k for k, each in enumerate(kept) if each.shape is not None and each.confidence < 0.5]
    assert doubtful
    for k in doubtful:
        assert (found[k].status, found[k].shape, found[k].confidence) == ("not found", None, 0)
        assert found[k].reason.endswith(f"the best outline is {kept[k].confidence:.2f} sure")
        assert found[k].alternatives[0] == (*kept[k].shape.centroid.coords[0], kept[k].agreement)
        assert found[k].alternatives[1:] == kept[k].alternatives
    for k in set(range(len(CELLS))) - set(doubtful):
        assert (found[k].status, found[k].confidence) == (kept[k].status, kept[k].confidence)


def test_rigid_outlines_keep_their_form():
    turned = np.array([[0.0, -2.0, 230.0], [2.0, 0.0, 20.0], [0, 0, 1]])
    found = pair.moved_only((SIZE, SIZE), np.array(CELLS[:1], object), geometry_of(points(turned)), CONFIG, None)
    shape = found[0].shape
    assert found[0].status in ("found", "in part")
    assert shape.area == pytest.approx(4 * CELLS[0].area, rel=1e-3)
    assert shape.centroid.distance(moved(CELLS[0], turned).centroid) < 0.1
    sides = [np.linalg.norm(np.diff(shapely.get_coordinates(s), axis=0), axis=1) for s in (CELLS[0], shape)]
    assert np.allclose(sides[1] / sides[0], 2, rtol=1e-3)
    assert found[0].sigma < 0.1


def test_the_same_input_gives_the_same_outcome():
    regions = [Region(moved(shape)) for shape in CELLS]
    first, second = carried(CELLS, regions), carried(CELLS, regions)
    assert [(a.status, a.confidence, a.shape.wkb) for a in first] == [
        (b.status, b.confidence, b.shape.wkb) for b in second
    ]


def test_a_region_beyond_the_points_is_less_sure_than_one_among_them():
    middle, border = shapely.box(100, 100, 140, 140), shapely.box(200, 100, 240, 140)
    known = points(inside=shapely.box(0, 0, 220, SIZE))
    among, half = carried([middle, border], [Region(moved(middle)), Region(moved(border))], known)
    assert among.surrounded == 1
    assert half.surrounded == pytest.approx(0.5, abs=0.05)
    model = CONFIG.carry
    for each in (among, half):
        evidence = (each.agreement, each.trust, each.pair_points)
        assert each.confidence == confidence(*evidence, each.surrounded, model) >= confidence(*evidence, 0.0, model)
    assert among.confidence > half.confidence
