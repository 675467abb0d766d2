"""Guided re-detection between two painted photographs of one plane."""

import dataclasses

import numpy as np
import pytest
import shapely
from painted import PaintedView, Region, blank
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from zpm2 import config, geometry
from zpm2.global_match import InitialGeometry
from zpm2.guided import redetection
from zpm2.model import PointMatches, PolygonArrays, PolygonMatch
from zpm2.polygons.overlap import iou

H = np.array([[1.02, 0.05, -14.0], [-0.04, 0.98, 9.0], [0, 0, 1]])
CONFIG = config.assign(config.preset("default"), ["segment.grid=16", "segment.min_area=30"])
CELLS = [(x, y) for y in range(20, 220, 50) for x in range(20, 220, 50)]  # 16 regions, well inside of both images


def cell(x, y):
    return shapely.Polygon([(x, y), (x + 36, y + 3), (x + 30, y + 38), (x - 2, y + 30)])


def moved(shape):
    return shapely.transform(shape, lambda xy: geometry.project(H, xy))


def scene(left_hidden=(), right_hidden=(), points=600, size=256):
    """16 regions in both images; only prompts with their boxes find the `hidden` ones."""
    shapes = [cell(x, y) for x, y in CELLS]
    left = PaintedView(blank(size, size, 1), [Region(s, prompt_only=k in left_hidden) for k, s in enumerate(shapes)])
    right = PaintedView(
        blank(size, size, 2), [Region(moved(s), prompt_only=k in right_hidden) for k, s in enumerate(shapes)]
    )
    at = np.random.default_rng(0).uniform(0, 256, (points, 2))
    known = PointMatches(at, geometry.project(H, at), np.ones(points))
    consistent = np.ones(points, bool)
    return (left, right), InitialGeometry(known, np.zeros((3, 3)), H, consistent, consistent)


def match(left, right):
    return PolygonMatch(left, right, 0.9, 1.0, 5, "global")


def test_the_second_image_is_asked_about_the_regions_of_the_first():
    views, initial = scene(right_hidden=range(16))
    pair = redetection.detect(views, initial, CONFIG)
    assert len(pair.left) == len(pair.right) == 16
    assert not pair.left.guided.any()
    assert pair.right.guided.all()
    assert pair.left.confident.all()
    assert pair.right.confident.all()
    guided_prior = redetection.guided_prior(pair, PolygonArrays(pair.left.polygons), initial, CONFIG)
    best = [iou(np.full(16, s), PolygonArrays(pair.right.polygons).shapes).max() for s in guided_prior.warped.shapes]
    assert min(best) > 0.9


def test_regions_that_only_the_second_image_shows_are_filled_in_by_its_grid():
    views, initial = scene()
    views[0].regions.clear()
    pair = redetection.detect(views, initial, CONFIG)
    assert (len(pair.left), len(pair.right)) == (0, 16)
    assert not pair.right.guided.any()


def test_the_first_image_is_asked_about_the_unmatched_regions_of_the_second():
    views, initial = scene(left_hidden=range(10))
    pair = redetection.detect(views, initial, CONFIG)
    assert (len(pair.left), len(pair.right)) == (6, 16)
    found = {p.id: q for p in pair.left.polygons for q in [nearest(p, pair)]}
    matches = [match(i, j) for i, j in found.items()]
    asked = len(views[0].asked)
    both = redetection.redetect(pair, matches, initial, CONFIG)
    assert len(both.left) == 16
    assert list(both.left.guided) == [False] * 6 + [True] * 10
    assert [p.id for p in both.left.polygons] == list(range(16))
    assert len(views[0].asked) - asked == 10  # one prompt for each that has no partner
    assert both.left.predictions.logits.shape[0] == 16


def nearest(polygon, pair):
    target = moved(polygon.shape)
    return max(range(len(pair.right)), key=lambda k: pair.right.polygons[k].shape.intersection(target).area)


def test_what_is_a_region_already_is_not_found_again():
    views, initial = scene()
    pair = redetection.detect(views, initial, CONFIG)
    again = redetection.redetect(pair, [], initial, CONFIG)
    assert len(again.left) == len(pair.left) == 16
    assert not again.left.guided.any()


def test_an_answer_that_does_not_agree_is_refused():
    views, initial = scene(right_hidden=range(16))
    views[1].regions[:] = [dataclasses.replace(r, shape=r.shape.buffer(5)) for r in views[1].regions]
    views[1].__post_init__()
    strict = config.assign(CONFIG, ["guided.min_checked_overlap=0.7"])
    wide = redetection.detect(views, initial, strict)
    assert len(wide.right) == 0
    tolerant = config.assign(CONFIG, ["guided.min_overlap=0.4"])
    assert len(redetection.detect(views, initial, tolerant).right) == 16


def test_an_answer_that_agrees_less_must_lead_back():
    views, initial = scene(right_hidden=range(16))
    views[1].regions[:] = [dataclasses.replace(r, shape=r.shape.buffer(5)) for r in views[1].regions]
    views[1].__post_init__()
    asked = redetection.detect(views, initial, CONFIG)
    assert len(asked.right) == 16
    views[0].regions[:] = views[0].regions[:5]  # the left image answers nothing about the others any more
    views[0].__post_init__()
    accepted = redetection.accepted_masks(views[1], asked.left, initial.forward(), initial.backward(), CONFIG)
    assert len(accepted.predictions) == 5


def test_a_region_cut_by_the_border_is_found_by_its_visible_part():
    """The right photograph shows what lies further to the right: 66 px of a region that goes on for 110 px there."""
    away = np.array([[1, 0, -180.0], [0, 1, 0], [0, 0, 1]])
    region = shapely.box(190, 60, 300, 160)
    left = PaintedView(blank(256, 256, 1), [Region(shapely.intersection(region, shapely.box(0, 0, 256, 256)))])
    right = PaintedView(blank(256, 256, 2), [Region(shapely.transform(region, lambda xy: xy - [180, 0]))])
    at = np.random.default_rng(0).uniform(0, 256, (600, 2))
    known = PointMatches(at, geometry.project(away, at), np.ones(600))
    initial = InitialGeometry(known, np.zeros((3, 3)), away, np.ones(600, bool), np.ones(600, bool))
    strict = config.assign(CONFIG, ["guided.min_checked_overlap=0.7"])
    whole = config.assign(strict, ["local_match.visible.on=false"])
    assert redetection.detect((left, right), initial, whole).right.guided.sum() == 0
    assert redetection.detect((left, right), initial, strict).right.guided.sum() == 1


def test_without_points_the_way_back_must_lead_home():
    """The points all lie in the left half. The right half moves further than they say, onto regions that look alike."""
    views, initial = scene(right_hidden=range(16))
    near = initial.points.left[:, 0] < 100
    initial = dataclasses.replace(initial, points=initial.points[near], consistent=np.ones(near.sum(), bool))
    pair = redetection.detect(views, initial, CONFIG)
    assert len(pair.right) == 16  # a plane: the way there and back is right for all of them
    elsewhere = [r for r in views[0].regions if r.shape.centroid.x < 100]
    asked = pair.left
    views[0].regions[:] = elsewhere
    views[0].__post_init__()  # the left image answers nothing about its right half any more
    there, back = initial.forward(), initial.backward()
    proposals = redetection.accepted_masks(views[1], asked, there, back, CONFIG)
    assert {asked.polygons[k].center[0] < 100 for k in proposals.predictions.prompt} == {True}
    assert len(proposals.predictions) == len(elsewhere)


def test_what_the_other_image_does_not_show_is_not_asked_about():
    views, initial = scene()
    away = np.array([[1, 0, -130.0], [0, 1, 0], [0, 0, 1]])
    points = PointMatches(initial.points.left, geometry.project(away, initial.points.left), initial.points.score)
    initial = dataclasses.replace(initial, points=points, homography=away)
    asked = redetection.detect(views, initial, CONFIG).left
    before = len(views[1].asked)
    once = config.assign(CONFIG, ["guided.points=1"])
    redetection.accepted_masks(views[1], asked, initial.forward(), initial.backward(), once)
    visible = sum(
        shapely.box(0, 0, 256, 256).intersection(shapely.transform(p.shape, lambda xy: geometry.project(away, xy))).area
        >= CONFIG.guided.min_visible * p.area
        for p in asked.polygons
    )
    assert abs(len(views[1].asked) - before - visible) <= 1


def test_regions_without_enough_points_of_their_own_are_not_asked_about():
    views, initial = scene(points=20)
    asked = redetection.everything(views[0], CONFIG)
    there, back = initial.forward(), initial.backward()
    inside = shapely.contains(PolygonArrays(asked.polygons).shapes[:, None], shapely.points(there[0].left)).sum(1)
    accepted = redetection.accepted_masks(views[1], asked, there, back, CONFIG, own_points=1)
    assert 0 < (inside == 0).sum() < 16
    assert sorted(accepted.predictions.prompt) == np.flatnonzero(inside).tolist()


def test_doubtful_regions_stay_only_if_they_are_matched():
    views, initial = scene()
    doubt = {1, 4, 9}
    views[0].regions[:] = [
        dataclasses.replace(r, score=0.75 if k in doubt else 0.95) for k, r in enumerate(views[0].regions)
    ]
    pair = redetection.detect(views, initial, CONFIG)
    assert pair.left.confident.sum() == 13
    doubtful = np.flatnonzero(~pair.left.confident)
    partner = nearest(pair.left.polygons[doubtful[0]], pair)
    (left, right), matches = redetection.drop_unconfirmed(pair, [match(int(doubtful[0]), partner)], CONFIG.vectorize)
    assert (len(left), len(right), len(matches)) == (14, 16, 1)
    assert [p.id for p in left] == list(range(14))
    assert np.array_equal(left[matches[0].left].exterior, pair.left.polygons[doubtful[0]].exterior)
    assert matches[0].right == partner
    assert all(p.parent is None for p in left)


def test_a_mask_below_the_doubtful_floor_is_never_a_region():
    views, initial = scene()
    views[0].regions[:] = [
        dataclasses.replace(r, score=CONFIG.guided.min_predicted_iou - 0.01) for r in views[0].regions
    ]
    assert len(redetection.detect(views, initial, CONFIG).left) == 0


@pytest.mark.parametrize("seed", range(4))
def test_prompts_lie_deep_inside_their_box(seed):
    rng = np.random.default_rng(seed)
    shapes = [shapely.Point(rng.uniform(60, 200, 2)).buffer(rng.uniform(5, 40)) for _ in range(6)]
    shapes.append(shapely.box(20, 20, 120, 120).difference(shapely.box(30, 20, 120, 110)))  # its centre is not inside
    cover = PaintedView(blank(), []).cover(np.array(shapes, object))
    asked = redetection.prompts(cover, 0.5)
    for bits, points in zip(cover, asked.points * 0.5, strict=True):
        (x, y), mask_scale, high = points
        rows, columns = np.nonzero(bits)
        assert list(mask_scale) == [columns.min(), rows.min()]
        assert list(high) == [columns.max() + 1, rows.max() + 1]
        outside = np.argwhere(~bits)[:, ::-1] + 0.5
        depth, _ = cKDTree(outside).query(np.c_[columns, rows] + 0.5)
        assert np.hypot(*(outside - [x, y]).T).min() == pytest.approx(depth.max(), abs=0.3)


def spread(bits, count):
    """Points one after the other: each as far as can be from those before it, and half as far from the outline."""
    pixels = np.argwhere(bits)[:, ::-1] + 0.5
    outside = np.argwhere(~np.pad(bits, 1))[:, ::-1] - 0.5
    depth = np.rint(cKDTree(outside).query(pixels)[0] ** 2)
    chosen = [pixels[np.argmax(depth)]]
    while len(chosen) < count:
        apart = np.min([((pixels - point) ** 2).sum(1) for point in chosen], axis=0)
        value = np.minimum(apart, 4 * depth)
        chosen.append(pixels[np.argmax(value)] if value.any() else chosen[-1])
    return np.array(chosen)


@pytest.mark.parametrize("seed", range(3))
def test_several_points_are_spread_over_thin_and_bent_shapes(seed):
    rng = np.random.default_rng(seed)
    ring = shapely.Point(120, 120).buffer(80).difference(shapely.Point(120, 120).buffer(70))
    shapes = [ring, shapely.box(20, 20, 200, 30), shapely.box(*rng.uniform(20, 90, 2), *rng.uniform(100, 200, 2))]
    cover = PaintedView(blank(), []).cover(np.array(shapes, object))
    for bits, points in zip(cover, redetection.prompts(cover, 1.0, 4).points, strict=True):
        assert points[:4].tolist() == spread(bits, 4).tolist()
        column, row = points[:4].astype(int).T
        assert bits[row, column].all()
    first = redetection.prompts(cover, 1.0, 1)
    assert np.array_equal(first.points[:, 0], redetection.prompts(cover, 1.0, 4).points[:, 0])


def test_a_shape_of_fewer_pixels_than_points_repeats_them():
    cover = np.zeros((1, 9, 9), bool)
    cover[0, 4, 3:5] = True
    assert redetection.prompts(cover, 1.0, 4).points[0, :4].tolist() == [[3.5, 4.5], [4.5, 4.5], [4.5, 4.5], [4.5, 4.5]]


def test_a_region_that_one_point_does_not_find_is_asked_for_with_several():
    views, initial = scene(right_hidden=range(16))
    asked = redetection.detect(views, initial, CONFIG).left
    views[1].regions.clear()
    views[1].__post_init__()
    counts = {}
    for points in (1, 3):
        before = len(views[1].asked)
        once = config.assign(CONFIG, [f"guided.points={points}"])
        redetection.accepted_masks(views[1], asked, initial.forward(), initial.backward(), once)
        counts[points] = len(views[1].asked) - before
    assert counts == {1: 16, 3: 32}


@pytest.mark.parametrize(("quality", "share"), [("fast", 1 / 8), ("balanced", 1 / 4)])
def test_each_image_has_its_own_number_of_prompts_at_blobs(quality, share):
    views, initial = scene()
    for view in views:  # dots everywhere, and no region
        view.regions.clear()
        view.image.rgb[6::12, 6::12] = 255
    few = [f"segment.prompts.{quality}_blobs={share}", f"segment.prompts.{quality}_uncovered=0"]
    for left, right in ((0.5, 2), (1, 1), (2, 100)):
        factors = [f"guided.left_blobs={left}", f"guided.right_blobs={right}"]
        settings = config.assign(CONFIG, [*few, *factors, f"segment.quality={quality}", "segment.prompts.first=0"])
        for view in views:
            view.asked.clear()
        redetection.detect(views, initial, settings)
        blobs = [min(256, times * share * 256) for times in (left, right)]
        assert [len(view.asked) - 2 for view in views] == blobs  # one prompt of each other kind


def test_progress_runs_through_both_images():
    views, initial = scene()
    shares: list[float] = []
    redetection.detect(views, initial, CONFIG, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_of_equally_deep_pixels_the_first_is_asked_wherever_the_shape_lies_in_memory():
    rng = np.random.default_rng(3)
    row, column = np.mgrid[:80, :120]
    for _ in range(40):
        a, b = rng.integers(8, 38), rng.integers(8, 58)
        shape = ((row - 40) / a) ** 2 + ((column - 60) / b) ** 2 <= 1  # has several deepest pixels
        depth = distance_transform_edt(shape)
        deepest = np.unravel_index(np.argmax(np.rint(depth**2)), shape.shape)
        for shift in (0, 1, 7, 24):
            bits = np.zeros(shape.size + 64, bool)[shift : shift + shape.size].reshape(shape.shape)
            bits[...] = shape
            point = redetection.prompts(bits[None], 1.0).points[0, 0]
            assert point.tolist() == [deepest[1] + 0.5, deepest[0] + 0.5]
