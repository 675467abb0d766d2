import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage

from zpm2.config import VectorizeConfig
from zpm2.model import Mask
from zpm2.polygons.nest import with_parents
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.shapes import from_shape, rings_of
from zpm2.polygons.trace import pieces, trace
from zpm2.polygons.vectorize import vectorize

EXACT = VectorizeConfig(tolerance=0.0)
SIZE = (200, 200)
masks = arrays(bool, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=14))
diagonal = np.array([[1, 0], [0, 1]], bool)
pinched = np.array([[1, 1, 1, 1], [1, 0, 1, 1], [1, 1, 0, 1], [1, 1, 1, 1]], bool)
open_pinch = np.array([[1, 1, 1, 0], [1, 0, 1, 1], [1, 1, 0, 1], [0, 1, 1, 1]], bool)
corner_hole = np.array([[0, 1, 1], [1, 0, 1], [1, 1, 1]], bool)


def reference_rings(bits):
    """Rings (lists of pixel corners) of one 4-connected piece: walk the directed pixel edges that have the piece on one
    side only, and where two diagonal pixels of the piece meet go on along the same background pixel."""
    h, w = bits.shape
    inside = {(x, y) for y in range(h) for x in range(w) if bits[y, x]}
    following = {}
    for x, y in inside:
        for neighbor, a, b in (
            ((x, y - 1), (x, y), (x + 1, y)),
            ((x + 1, y), (x + 1, y), (x + 1, y + 1)),
            ((x, y + 1), (x + 1, y + 1), (x, y + 1)),
            ((x - 1, y), (x, y + 1), (x, y)),
        ):
            if neighbor not in inside:
                following.setdefault(a, []).append(b)
    rings = []
    while following:
        start = next(iter(following))
        ring, here, step = [], start, None
        while True:
            ways = following[here]
            if step is None or len(ways) == 1:
                there = ways.pop()
            else:
                there = ways.pop(ways.index((here[0] + step[1], here[1] - step[0])))
            if not ways:
                del following[here]
            ring.append(here)
            here, step = there, (there[0] - here[0], there[1] - here[1])
            if here == start:
                break
        rings.append(ring)
    return rings


def reference(bits):
    labels, n = ndimage.label(bits)
    found = []
    for k in range(1, n + 1):
        shapes = [shapely.Polygon(ring) for ring in reference_rings(labels == k)]
        exterior = max(shapes, key=lambda s: s.area)
        found.append(shapely.Polygon(exterior.exterior, [s.exterior for s in shapes if s is not exterior]))
    return found


def ring_areas(shape):
    return [shapely.Polygon(shape.exterior).area, *sorted(shapely.Polygon(hole).area for hole in shape.interiors)]


def shoelace(ring):
    x, y = ring.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


@given(masks)
@example(diagonal)
@example(pinched)
@example(open_pinch)
@example(corner_hole)
@settings(max_examples=300, deadline=None)
def test_trace_equals_a_walk_along_pixel_edges(bits):
    ours, plain = trace(bits), reference(bits)
    assert len(ours) == len(plain)
    assert all(shape.is_valid for shape in ours)
    assert sorted(map(ring_areas, ours)) == sorted(map(ring_areas, plain))
    assert shapely.union_all(ours).symmetric_difference(shapely.union_all(plain)).area == 0


@given(masks)
@settings(max_examples=200, deadline=None)
def test_area_is_the_number_of_pixels_and_no_vertex_is_needless(bits):
    shapes = trace(bits)
    assert sum(s.area for s in shapes) == bits.sum()
    for shape in shapes:
        for ring in (shape.exterior, *shape.interiors):
            steps = np.diff(shapely.get_coordinates(ring), axis=0)
            horizontal = steps[:, 0] != 0
            assert (horizontal != (steps[:, 1] != 0)).all()
            assert (horizontal != np.roll(horizontal, 1)).all()


@given(masks, st.integers(0, 60), st.integers(0, 60), st.floats(0, 3))
@settings(max_examples=100, deadline=None)
def test_a_shifted_mask_gives_the_shifted_polygon(bits, x0, y0, tolerance):
    config = VectorizeConfig(tolerance)
    here, there = (vectorize([Mask(x, y, bits)], config, 0, SIZE) for x, y in ((0, 0), (x0, y0)))
    assert len(here) == len(there)
    shift = np.array([x0, y0])
    for a, b in zip(here, there, strict=True):
        assert np.array_equal(a.exterior + shift, b.exterior)
        assert len(a.holes) == len(b.holes)
        assert all(np.array_equal(p + shift, q) for p, q in zip(a.holes, b.holes, strict=True))


@given(masks, st.integers(-9, 9), st.integers(-9, 9))
@settings(max_examples=100, deadline=None)
def test_rasterize_undoes_trace(bits, x0, y0):
    for shape, piece in zip(trace(bits, x0, y0), pieces(Mask(x0, y0, bits)), strict=True):
        mask = rasterize(shape)
        assert (mask.x0, mask.y0) == (piece.x0, piece.y0)
        assert np.array_equal(mask.bits, piece.bits)


@given(st.lists(st.tuples(st.floats(-5, 20), st.floats(-5, 20)), min_size=3, max_size=6))
@settings(max_examples=100, deadline=None)
def test_rasterize_takes_the_pixel_centres_inside(vertices):
    shape = shapely.MultiPoint(vertices).convex_hull
    if shape.geom_type != "Polygon" or shape.area < 0.5:
        return
    mask = rasterize(shape)
    y, x = np.mgrid[: mask.bits.shape[0], : mask.bits.shape[1]] + 0.5
    centres = shapely.points(x + mask.x0, y + mask.y0)
    clear = shapely.distance(shape.exterior, centres) > 1e-9
    assert np.array_equal(mask.bits[clear], shapely.contains(shape, centres)[clear])


@given(masks, st.floats(0, 4), st.floats(0, 12))
@settings(max_examples=200, deadline=None)
def test_polygons_keep_their_promises(bits, tolerance, min_area):
    mask = Mask(3, 5, bits)
    for polygon in vectorize([mask], VectorizeConfig(tolerance), min_area, SIZE):
        (filled,) = (p.shape for p in vectorize([mask], EXACT, min_area, SIZE))
        assert polygon.shape.is_valid
        assert polygon.area >= min_area
        assert 0.8 <= polygon.area / filled.area <= 1.2
        assert shoelace(polygon.exterior) > 0
        assert all(shoelace(hole) < 0 for hole in polygon.holes)
        assert polygon.shape.exterior.is_ccw
        assert not np.array_equal(polygon.exterior[0], polygon.exterior[-1])
        assert polygon.shape.hausdorff_distance(filled) <= tolerance + 1e-9


def test_a_3_by_4_mask_has_area_12():
    (polygon,) = vectorize([Mask(10, 20, np.ones((3, 4), bool), 0.75, "roof")], EXACT, 0, SIZE)
    assert polygon.area == 12
    assert polygon.bounds == (10, 20, 14, 23)
    assert (polygon.id, polygon.score, polygon.label, polygon.parent) == (0, 0.75, "roof", None)


def test_pixels_that_touch_at_a_corner_are_two_pieces():
    assert [s.area for s in trace(diagonal)] == [1, 1]
    (polygon,) = vectorize([Mask(0, 0, diagonal)], EXACT, 0, SIZE)
    assert polygon.area == 1


def test_holes_that_touch_at_a_corner_are_two_holes():
    (polygon,) = vectorize([Mask(0, 0, pinched)], EXACT, 0, SIZE)
    assert polygon.shape.is_valid
    assert [abs(shoelace(h)) / 2 for h in polygon.holes] == [1, 1]
    assert polygon.area == 14


def test_the_largest_piece_stands_for_a_mask():
    bits = np.zeros((20, 20), bool)
    bits[1:4, 1:4] = bits[8:18, 8:18] = True
    (polygon,) = vectorize([Mask(0, 0, bits)], EXACT, 0, SIZE)
    assert polygon.bounds == (8, 8, 18, 18)


def test_small_holes_are_filled_and_small_masks_dropped():
    ring = np.ones((9, 9), bool)
    ring[4, 4] = False
    ring[1:3, 1:4] = False
    (polygon,) = vectorize([Mask(0, 0, ring), Mask(0, 0, np.ones((1, 3), bool))], EXACT, 4, SIZE)
    assert len(polygon.holes) == 1
    assert polygon.area == 81 - 6
    filled = vectorize([Mask(0, 0, ring)], EXACT, 80, SIZE)
    assert [p.area for p in filled] == [81]
    assert vectorize([Mask(0, 0, ring)], EXACT, 82, SIZE) == []


def test_ids_count_the_polygons_not_the_masks():
    square, dot = np.ones((5, 5), bool), np.ones((1, 1), bool)
    found = vectorize([Mask(0, 0, dot), Mask(9, 9, square, 0.5), Mask(30, 0, square, 0.6)], EXACT, 4, SIZE)
    assert [(p.id, p.score) for p in found] == [(0, 0.5), (1, 0.6)]


@pytest.mark.parametrize("shape", [(1, 40), (40, 1)])
def test_a_line_one_pixel_wide_keeps_its_area(shape):
    (polygon,) = vectorize([Mask(5, 5, np.ones(shape, bool))], VectorizeConfig(3.0), 0, SIZE)
    assert polygon.area == 40


def test_a_thin_staircase_is_not_simplified_away():
    bits = np.eye(60, dtype=bool) | np.eye(60, k=1, dtype=bool)
    for tolerance in (1.0, 2.0, 5.0):
        (polygon,) = vectorize([Mask(0, 0, bits)], VectorizeConfig(tolerance), 0, SIZE)
        assert polygon.area >= 0.8 * bits.sum()


def test_simplification_takes_staircases_away():
    y, x = np.mgrid[:100, :100]
    disc = (x - 50) ** 2 + (y - 50) ** 2 < 45**2
    exact, simple = (vectorize([Mask(0, 0, disc)], VectorizeConfig(t), 0, SIZE)[0] for t in (0.0, 1.0))
    assert len(simple.exterior) < len(exact.exterior) / 3
    assert simple.area == pytest.approx(exact.area, rel=0.03)


def test_a_mask_as_large_as_the_image_and_one_that_leaves_it():
    full = vectorize([Mask(0, 0, np.ones((30, 50), bool))], VectorizeConfig(), 0, (50, 30))
    assert full[0].bounds == (0, 0, 50, 30)
    assert len(full[0].exterior) == 4
    beyond = vectorize([Mask(-4, 25, np.ones((30, 60), bool))], VectorizeConfig(), 0, (50, 30))
    assert beyond[0].bounds == (0, 25, 50, 30)
    assert vectorize([Mask(60, 0, np.ones((5, 5), bool))], VectorizeConfig(), 0, (50, 30)) == []


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (4, 4)])
def test_an_empty_mask_gives_nothing(shape):
    assert trace(np.zeros(shape, bool)) == []
    assert vectorize([Mask(0, 0, np.zeros(shape, bool))], VectorizeConfig(), 0, SIZE) == []
    assert vectorize([], VectorizeConfig(), 0, SIZE) == []


def plain_parents(polygons):
    found = []
    for a in polygons:
        around = [b for b in polygons if b.area > a.area and b.shape.intersection(a.shape).area >= 0.95 * a.area]
        found.append(min(around, key=lambda b: b.area).id if around else None)
    return found


@given(st.lists(st.tuples(*[st.integers(0, 30)] * 2, *[st.integers(1, 25)] * 2), min_size=1, max_size=12))
@settings(max_examples=100, deadline=None)
def test_parent_is_the_smallest_polygon_around(boxes):
    polygons = [from_shape(shapely.box(x, y, x + w, y + h), 7 * k) for k, (x, y, w, h) in enumerate(boxes)]
    areas = {p.id: p.area for p in polygons}
    for polygon, plain in zip(with_parents(polygons, EXACT), plain_parents(polygons), strict=True):
        assert (polygon.parent is None) == (plain is None)
        assert polygon.parent is None or areas[polygon.parent] == areas[plain]


def test_a_polygon_in_the_hole_of_another_has_no_parent():
    frame = np.ones((20, 20), bool)
    frame[5:15, 5:15] = False
    inner = Mask(6, 6, np.ones((5, 5), bool))
    assert [p.parent for p in vectorize([Mask(0, 0, frame), inner], EXACT, 0, SIZE)] == [None, None]
    assert [p.parent for p in vectorize([Mask(0, 0, np.ones((20, 20), bool)), inner], EXACT, 0, SIZE)] == [None, 0]


@given(
    st.lists(st.tuples(st.integers(0, 24), st.integers(0, 24)), min_size=4, max_size=14, unique=True), st.floats(0, 1)
)
@settings(max_examples=100, deadline=None)
def test_rasterized_neighbours_share_no_pixel_and_leave_none_out(points, shift):
    """A triangulation, drawn triangle by triangle, its corners on pixel edges and between them."""
    corners = shapely.MultiPoint(np.array(points, float) + shift)
    if corners.convex_hull.geom_type != "Polygon":
        return
    count = np.zeros((30, 30), int)
    for triangle in shapely.delaunay_triangles(corners).geoms:
        mask = rasterize(triangle)
        count[mask.y0 : mask.y0 + mask.bits.shape[0], mask.x0 : mask.x0 + mask.bits.shape[1]] += mask.bits
    assert count.max() <= 1
    hull = rasterize(corners.convex_hull)
    assert count.sum() == hull.bits.sum()


def test_rings_turn_one_way_and_holes_the_other():
    square, hole = shapely.box(0, 0, 9, 9), shapely.box(2, 2, 4, 4)
    for shape in (square.difference(hole), square.difference(hole).reverse()):
        (exterior, inner), (alone,) = rings_of([shape, hole])
        assert signed_area(exterior) == 81
        assert signed_area(inner) == -4
        assert signed_area(alone) == 4
        assert len(exterior) == len(inner) == len(alone) == 4
    assert rings_of([]) == []


def signed_area(ring):
    x, y = ring.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2


def test_no_more_pieces_than_asked_for_and_the_largest_first():
    bits = np.zeros((5, 20), bool)
    for start, width in ((0, 2), (4, 5), (11, 3)):
        bits[:, start : start + width] = True
    assert [piece.x0 for piece in pieces(Mask(0, 0, bits))] == [4, 11, 0]
    assert [piece.x0 for piece in pieces(Mask(0, 0, bits), most=2)] == [4, 11]
    assert [piece.x0 for piece in pieces(Mask(0, 0, bits), min_area=15)] == [4, 11]
    assert pieces(Mask(0, 0, np.zeros((0, 3), bool))) == []
