import dataclasses
import importlib

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from zpm2.errors import InputError
from zpm2.model import Image, ImagePolygons, Polygon, PolygonMatch
from zpm2.view import overlay, unmatched
from zpm2.view.overlay import GAP, HEADER, OTHER_REASON, _layout, _places
from zpm2.view.palette import COMPARE_ALL, distinct_colors
from zpm2.view.panel import CROWD, dashes


def _box(index, x0, y0, x1, y1, hole=None):
    ring = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)
    return Polygon(index, ring, () if hole is None else (_box(0, *hole).exterior[::-1],))


def _match(left, right):
    return PolygonMatch(left, right, confidence=0.9, cost=1.0, dsf=5, stage="global")


def _gray(width, height):
    return Image(np.full((height, width, 3), 120, np.uint8))


def _side(image, polygons, size=None, unmatched=None):
    width, height = size or (image.width, image.height)
    return ImagePolygons(width, height, polygons, image=image, unmatched=unmatched or {})


def _panels(left, right, left_polygons, right_polygons, matches):
    """Both panels of a side-by-side overlay of two 800 x 600 images, each at twice the size."""
    picture = overlay(_side(left, left_polygons), _side(right, right_polygons), matches, max_width=3200 + GAP)
    assert picture.shape == (HEADER + 1200, 3200 + GAP, 3)
    return picture[HEADER:, :1600].astype(int), picture[HEADER:, 1600 + GAP :].astype(int)


def _tinted(panel):
    return np.ptp(panel, axis=2) > 10


def test_a_match_has_one_colour_in_both_images_and_lies_where_it_should():
    box = _box(7, 100, 200, 300, 350, hole=(150, 250, 200, 300))
    a, b = _panels(_gray(800, 600), _gray(800, 600), [box], [_box(3, 400, 50, 500, 150)], [_match(7, 3)])
    assert np.array_equal(a[410, 210], b[110, 810])
    assert _tinted(a)[410, 210]
    rows, columns = np.nonzero(_tinted(a))
    # the outline is 2 px wide, half of it outside
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == pytest.approx((399, 700, 199, 600), abs=2)
    assert not _tinted(a)[510:590, 310:390].any()  # the hole
    assert not _tinted(a)[:390].any()


def test_unmatched_polygons_are_outlines():
    a, b = _panels(_gray(800, 600), _gray(800, 600), [_box(1, 100, 200, 300, 350)], [], [])
    assert not _tinted(a).any()
    assert np.array_equal(a[500, 400], a[1000, 1000])
    assert (a[500, 198:203].max(axis=0) > a[1000, 1000] + 40).all()
    assert np.array_equal(b[500, 200], a[1000, 1000])


def test_a_nested_polygon_shows_on_its_parent():
    outer, inner = _box(1, 50, 50, 750, 550), _box(2, 300, 200, 400, 300)
    for polygons in ([outer, inner], [inner, outer]):
        a, _ = _panels(_gray(800, 600), _gray(800, 600), polygons, polygons, [_match(1, 1), _match(2, 2)])
        parent, child = a[150, 150], a[420, 620]
        assert np.abs(parent - child).max() > 40
        assert np.ptp(child) > np.ptp(parent)  # the small one is less transparent


def test_the_same_input_gives_the_same_picture():
    rng = np.random.default_rng(1)
    image = Image(rng.integers(0, 256, (90, 160, 3), np.uint8))
    polygons = [_box(k, 10 * k, 5 * k, 10 * k + 30, 5 * k + 20) for k in range(10)]
    matches = [_match(k, 9 - k) for k in range(8)]
    first = overlay(_side(image, polygons), _side(image, polygons), matches)
    assert np.array_equal(first, overlay(_side(image, polygons), _side(image, polygons), matches))


@pytest.mark.parametrize(
    ("left", "right", "stacked"),
    [
        ((960, 540), (960, 540), False),
        ((1242, 375), (1242, 375), True),
        ((3000, 4000), (3000, 4000), False),
        ((640, 480), (4000, 3000), False),
        ((4000, 200), (100, 100), True),
    ],
)
def test_layout(left, right, stacked):
    (a, b), above = _layout(left, right, 2400)
    assert above == stacked
    assert a[0] == b[0] if stacked else a[1] == b[1]
    for (width, height), source in ((a, left), (b, right)):
        assert width / height == pytest.approx(source[0] / source[1], rel=0.02)


@given(st.tuples(st.integers(32, 9000), st.integers(32, 9000)), st.tuples(st.integers(32, 9000), st.integers(32, 9000)))
def test_no_side_is_longer_than_asked(left, right):
    ((wa, ha), (wb, hb)), stacked = _layout(left, right, 1000)
    width, height = (max(wa, wb), ha + hb + GAP) if stacked else (wa + wb + GAP, max(ha, hb))
    assert width <= 1000
    assert height + HEADER <= 1000


@settings(max_examples=20)
@given(st.integers(2, 12), st.integers(2, 12))
def test_neighbours_have_different_colours(columns, rows):
    boxes = [
        _box(k, k % columns * 10, k // columns * 10, k % columns * 10 + 10, k // columns * 10 + 10)
        for k in range(columns * rows)
    ]
    grid = np.array(distinct_colors(*_places(boxes))).reshape(rows, columns, 3)
    for step in (np.diff(grid, axis=0), np.diff(grid, axis=1)):
        assert (np.linalg.norm(step, axis=2) > 60).all()


def test_polygons_that_leave_the_image_and_empty_results():
    image = _gray(100, 100)
    away = [_box(0, 300, 300, 400, 400), _box(1, -50, -50, 20, 20), _box(2, 99.9, 99.9, 140, 140)]
    matches = [_match(k, k) for k in range(3)]
    assert overlay(_side(image, away), _side(image, away), matches).shape[2] == 3
    assert overlay(_side(image, []), _side(image, []), []).shape[2] == 3


def test_misuse_is_named():
    image = _gray(100, 100)
    box = _box(0, 10, 10, 50, 50)
    with pytest.raises(InputError, match="match 0 - 5"):
        overlay(_side(image, [box]), _side(image, [box]), [_match(0, 5)])
    with pytest.raises(InputError, match="two left polygons"):
        overlay(_side(image, [box, box]), _side(image, [box]), [])
    for draw in (overlay, unmatched):
        with pytest.raises(InputError, match="without its pixels"):
            draw(_side(image, [box]), ImagePolygons(100, 100, [box]), [])


def test_polygons_of_larger_photographs_are_scaled_to_their_reduced_versions():
    box, other = _box(7, 100, 200, 300, 350, hole=(150, 250, 200, 300)), _box(3, 400, 50, 500, 150)
    large = [_box(7, 400, 1000, 1200, 1750, hole=(600, 1250, 800, 1500))], [_box(3, 800, 150, 1000, 450)]
    image = Image(np.random.default_rng(3).integers(0, 256, (600, 800, 3), np.uint8))
    expected = overlay(_side(image, [box]), _side(image, [other]), [_match(7, 3)])
    sides = [_side(image, p, size) for p, size in zip(large, ((3200, 3000), (1600, 1800)), strict=True)]
    assert np.array_equal(overlay(*sides, [_match(7, 3)]), expected)


def _crowd(size, step):
    """Squares of `size` px every `step` px of an 800 x 600 image, as many matches, and a large one around all."""
    places = [(x, y) for y in range(20, 580, step) for x in range(20, 780, step)]
    return [_box(k, x, y, x + size, y + size) for k, (x, y) in enumerate(places)]


def _white(panel):
    return (panel > 245).all(axis=2)


def test_in_a_crowd_only_what_has_room_has_a_number():
    small, big = _crowd(3, 20), _box(9999, 701, 501, 779, 579)
    polygons = [p for p in small if p.bounds[0] < 690 or p.bounds[1] < 490] + [big]
    matches = [_match(p.id, p.id) for p in polygons]
    assert len(matches) > CROWD
    a, b = _panels(_gray(800, 600), _gray(800, 600), polygons, polygons, matches)
    for panel in (a, b):
        rows, columns = np.nonzero(_white(panel)[40:, :])  # not the panel's name
        assert 1402 < columns.min() < columns.max() < 1558
        assert 1002 < rows.min() + 40 < rows.max() + 40 < 1158
        assert _tinted(panel)[43, 43]  # but a colour
    few, _ = _panels(_gray(800, 600), _gray(800, 600), polygons, polygons, matches[: CROWD - 1])
    assert _white(few)[40:500].any()


def test_a_number_in_a_crowd_is_in_both_photographs_or_in_none():
    polygons = [*_crowd(3, 20), _box(9999, 301, 301, 379, 379)]
    right = [*polygons[:-1], _box(9999, 301, 301, 304, 304)]
    matches = [_match(p.id, p.id) for p in polygons]
    a, b = _panels(_gray(800, 600), _gray(800, 600), polygons, right, matches)
    assert not _white(a)[40:].any()
    assert not _white(b)[40:].any()


def test_small_regions_of_a_crowd_are_no_blots():
    polygons = _crowd(3, 20)  # 6 px in the picture
    a, _ = _panels(_gray(800, 600), _gray(800, 600), polygons, polygons, [_match(p.id, p.id) for p in polygons])
    changed = (np.abs(a - a[100, 60]).max(axis=2) > 5)[30:90, 30:90]
    rows, columns = np.nonzero(changed[:30, :30])
    assert np.ptp(rows) <= 8
    assert np.ptp(columns) <= 8


def test_very_many_unmatched_outlines_are_faint():
    image = _gray(800, 600)
    polygons = [
        _box(k, 8 * (k % 95) + 10, 8 * (k // 95) + 10, 8 * (k % 95) + 14, 8 * (k // 95) + 14) for k in range(6500)
    ]
    few, _ = _panels(image, image, polygons[:100], [], [])
    many, _ = _panels(image, image, polygons, [], [])
    lift = [int(panel[20, 984].max() - panel[10, 984].max()) for panel in (many, few)]
    assert 20 < lift[0] < lift[1] - 20


def test_neighbours_of_a_crowd_have_different_colours():
    columns, rows = 60, 40
    assert columns * rows > COMPARE_ALL
    boxes = [
        _box(k, k % columns * 10, k // columns * 10, k % columns * 10 + 10, k // columns * 10 + 10)
        for k in range(columns * rows)
    ]
    grid = np.array(distinct_colors(*_places(boxes))).reshape(rows, columns, 3)
    for step in (np.diff(grid, axis=0), np.diff(grid, axis=1)):
        assert (np.linalg.norm(step, axis=2) > 60).all()


def test_large_neighbours_have_different_colours_among_many_small_ones():
    large = [_box(k, k * 200, 0, k * 200 + 200, 200) for k in range(12)]
    rng = np.random.default_rng(4)
    small = [_box(99, x, y, x + 2, y + 2) for x, y in rng.uniform(0, (2400, 200), (3000, 2))]
    colors = np.array(distinct_colors(*_places([*small, *large])), float)
    assert (np.linalg.norm(np.diff(colors[-12:], axis=0), axis=1) > 60).all()
    home = np.clip([int(p.exterior[:, 0].mean() // 200) for p in small], 0, 11)
    assert (np.linalg.norm(colors[:3000] - colors[3000 + home], axis=1) > 40).mean() > 0.98


def test_many_things_in_one_place_have_colours():
    assert len(distinct_colors(np.zeros((1500, 2)), np.zeros(1500))) == 1500


def test_a_match_carries_its_id(monkeypatch):
    written = []
    module = importlib.import_module("zpm2.view.overlay")  # `zpm2.view.overlay` is the function
    monkeypatch.setattr(module, "write", lambda panel, labels: written.append(labels) or panel)
    left = [_box(4, 5, 5, 60, 60), _box(57, 70, 20, 140, 90)]
    overlay(_side(_gray(160, 120), left), _side(_gray(160, 120), [_box(9, 60, 20, 130, 90)]), [_match(57, 9)])
    assert [{label.text for label in side} for side in written] == [{"left", "57"}, {"right", "57"}]


def test_where_fills_stack_a_pixel_has_the_colour_of_the_topmost_region_alone():
    outer, middle, inner = _box(1, 50, 50, 750, 550), _box(2, 200, 150, 600, 450), _box(3, 300, 200, 400, 300)
    stack = [outer, middle, inner]
    matches = [_match(k, k) for k in (1, 2, 3)]
    a, b = _panels(_gray(800, 600), _gray(800, 600), stack, stack, matches)
    beside = [outer, middle, _box(3, 0, 0, 100, 100)]
    _, free = _panels(_gray(800, 600), _gray(800, 600), stack, beside, matches)
    assert np.array_equal(a[450, 640], b[450, 640])
    assert np.array_equal(a[450, 640], free[150, 150])  # on nothing as on two others


def test_the_photograph_shows_through():
    image = Image(np.random.default_rng(0).integers(0, 256, (600, 800, 3), np.uint8))
    box = _box(1, 50, 50, 750, 550)
    a, _ = _panels(image, image, [box], [box], [_match(1, 1)])
    assert a[300:900, 300:900].std(axis=(0, 1)).min() > 15


def test_outlines_tell_how_sure_a_match_is():
    boxes = [_box(k, 100 + 200 * k, 100, 250 + 200 * k, 400) for k in range(3)]
    matches = [dataclasses.replace(_match(k, k), confidence=c) for k, c in enumerate((0.95, 0.8, 0.4))]
    a, _ = _panels(_gray(800, 600), _gray(800, 600), boxes, boxes, matches)
    edges = [_tinted(a[260:740, 2 * x - 2 : 2 * x + 2]).any(axis=1) for x in (100, 300, 500)]
    assert edges[0].all()
    assert 0.4 < edges[1].mean() < 0.85
    changes = [int(np.abs(np.diff(edge.astype(int))).sum()) for edge in edges]
    assert changes[0] < changes[1] < changes[2]


@given(
    st.integers(3, 30).flatmap(
        lambda n: st.lists(st.tuples(st.floats(0, 500), st.floats(0, 500)), min_size=n, max_size=n)
    ),
    st.floats(0.5, 20),
    st.floats(0.5, 20),
)
def test_dashes_lie_on_the_line_and_are_their_share_of_it(points, drawn, left_out):
    ring = np.array(points)
    pieces = dashes(ring, (drawn, left_out))
    closed = shapely.LinearRing(ring)
    assume(closed.length > 1)
    total = np.linalg.norm(np.diff(pieces, axis=1), axis=2).sum()
    assert total == pytest.approx(closed.length * drawn / (drawn + left_out), rel=1e-6, abs=1e-6)
    if len(pieces):
        assert shapely.distance(shapely.points(pieces.reshape(-1, 2)), closed).max() < 1e-6


def test_unmatched_polygons_have_the_colour_of_their_reason(monkeypatch):
    module = importlib.import_module("zpm2.view.overlay")
    said = []
    assemble = module._assemble
    monkeypatch.setattr(module, "_assemble", lambda *given: said.append(given) or assemble(*given))
    left = [_box(k, 20 + 150 * k, 100, 120 + 150 * k, 300) for k in range(5)]
    right = [_box(7, 20, 100, 120, 300), _box(8, 200, 100, 300, 300)]
    why = {1: "rejected", 2: "rejected", 3: "occluded", 4: "of another kind"}, {8: "rejected"}
    sides = _side(_gray(800, 600), left, unmatched=why[0]), _side(_gray(800, 600), right, unmatched=why[1])
    picture = unmatched(*sides, [_match(0, 7)], max_width=3200 + GAP)
    a, b = picture[HEADER:, :1600].astype(int), picture[HEADER:, 1600 + GAP :].astype(int)
    inside = [a[230, 2 * (40 + 150 * k)] for k in range(5)]
    assert np.array_equal(inside[1], inside[2])
    assert np.array_equal(inside[1], b[230, 420])
    assert np.array_equal(inside[0], a[1100, 1500])  # matched: no fill
    assert len({tuple(color) for color in inside}) == 4
    (_, _, legend, _), *_ = said
    assert legend.title == "4 of 5 left and 1 of 2 right polygons without a partner"
    assert legend.subject == "reason"
    assert [key.text for key in legend.keys] == [
        "occluded: 1 left, 0 right",
        "rejected: 2 left, 1 right",
        "of another kind: 1 left, 0 right",
    ]
    for key in legend.keys:
        assert (picture[:HEADER] == key.color).all(axis=2).any()


def test_a_polygon_without_a_reason_says_so():
    picture = unmatched(_side(_gray(100, 100), [_box(1, 5, 5, 60, 60)]), _side(_gray(100, 100), []), [])
    assert (picture[:HEADER] == OTHER_REASON).all(axis=2).any()
