"""A photograph's regions, cut by windows as tiles cut them, and put together again."""

import dataclasses

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.config import Config, SegmentConfig, StitchConfig, VectorizeConfig
from zpm2.polygons.overlap import iou
from zpm2.polygons.shapes import from_shape
from zpm2.tiled import stitch as stitching
from zpm2.tiled.stitch import RegionPieces, suppress
from zpm2.tiled.windows import grid

SIZE = 3000, 2000  # width, height
LEAST = 100.0  # px^2
SIDE, OVERLAP = 512, 0.125
BORDER = StitchConfig().border
TOLERANCE = 2.0  # px, of the windows' borders: BORDER of 512 px is 3


def stitch(pieces, size, nms_iou, tolerance, min_area):
    config = Config(segment=SegmentConfig(nms_iou=nms_iou), vectorize=VectorizeConfig(tolerance=tolerance))
    return stitching.stitch(pieces, size, config, min_area)


def cut_by_window(polygons, window, size):
    return stitching.cut_by_window(polygons, window, size, StitchConfig())


def blob(rng, center, radius, n=24):
    """A polygon that is no half of anything: bulges, but no spikes that a border would cut off."""
    angle = np.sort(np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * np.pi / n
    reach = radius * (1 + 0.15 * np.sin(2 * angle + rng.uniform(0, 6)) + 0.06 * rng.uniform(-1, 1, n))
    return shapely.Polygon(np.asarray(center) + reach[:, None] * np.c_[np.cos(angle), np.sin(angle)])


def country(seed, cell=250, smallest=20, largest=100):
    """Disjoint polygons all over the canvas."""
    rng = np.random.default_rng(seed)
    found = []
    for y in range(0, SIZE[1] - cell + 1, cell):
        for x in range(0, SIZE[0] - cell + 1, cell):
            radius = rng.uniform(smallest, largest)
            room = cell / 2 - 1.25 * radius - 2
            assert room > 0 or radius > 95
            found.append(blob(rng, np.array([x, y]) + cell / 2 + rng.uniform(-1, 1, 2) * max(room, 0), radius))
    return found


def seen(shapes, window):
    """What a window shows of each polygon: its largest part, none where that is too small."""
    box = shapely.box(*window)
    found = []
    for shape in shapes:
        parts = [p for p in shapely.get_parts(shapely.intersection(shape, box)) if isinstance(p, shapely.Polygon)]
        part = max(parts, key=lambda p: p.area, default=shapely.Polygon())
        if part.area >= LEAST:
            found.append(part)
    return found


def pieces_of(given, size=SIZE):
    """`given`: (window, level, shapes) each; scores are distinct."""
    polygons, tile, cut = [], [], []
    for k, (window, _, shapes) in enumerate(given):
        own = [from_shape(shape, n) for n, shape in enumerate(shapes)]
        polygons += own
        tile += [k] * len(own)
        cut.append(cut_by_window(own, window, size))
    scores = 0.5 + 0.5 * np.random.default_rng(0).random(len(polygons))
    polygons = [from_shape(p.shape, k, float(s)) for k, (p, s) in enumerate(zip(polygons, scores, strict=True))]
    return RegionPieces(
        polygons,
        np.array(tile, np.int64),
        np.concatenate(cut) if cut else np.zeros(0, bool),
        np.zeros(len(polygons), bool),
        [window for window, _, _ in given],
        np.array([level for _, level, _ in given], np.int64),
    )


def tiled(shapes, side=SIDE, overlap=OVERLAP, level=1, size=SIZE):
    return [(window, level, seen(shapes, window)) for window in grid(*size, side, overlap)]


def put_together(given, size=SIZE, tolerance=1.0, least=LEAST, nms_iou=0.7):
    return stitch(pieces_of(given, size), size, nms_iou, tolerance, least)


def agreement(found, wanted):
    """(n,) best IoU of each wanted shape."""
    shapes = np.array([polygon.shape for polygon in found.polygons], object)
    return np.array([iou(np.full(len(shapes), w, object), shapes).max(initial=0) for w in wanted])


def seams(found, wanted, windows, size=SIZE):
    """How much longer any outline runs along an inner border of a window than the true one does, in tolerances."""
    worst = 0.0
    truth = np.array(wanted, object)
    for polygon in found.polygons:
        shape = polygon.shape
        true = truth[iou(np.full(len(truth), shape, object), truth).argmax()]
        for x0, y0, x1, y1 in windows:
            tolerance = max(2.0, BORDER * max(x1 - x0, y1 - y0))
            if not shape.intersects(shapely.box(x0 - 3, y0 - 3, x1 + 3, y1 + 3)):
                continue
            sides = {"left": (x0, y0, x0, y1), "top": (x0, y0, x1, y0), "right": (x1, y0, x1, y1)}
            sides["bottom"] = (x0, y1, x1, y1)
            inner = {"left": x0 > 0, "top": y0 > 0, "right": x1 < size[0], "bottom": y1 < size[1]}
            for name, (a, b, c, d) in sides.items():
                if inner[name]:
                    strip = shapely.box(a - tolerance, b - tolerance, c + tolerance, d + tolerance)
                    more = shape.boundary.intersection(strip).length - true.boundary.intersection(strip).length
                    worst = max(worst, more / tolerance)
    return worst


def box(x0, y0, x1, y1):
    return shapely.box(x0, y0, x1, y1)


# --- no seam


@pytest.mark.parametrize("overlap", [0.0625, 0.125, 0.3])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_grid_of_windows_leaves_no_trace(seed, overlap):
    wanted = country(seed)
    given = tiled(wanted, overlap=overlap)
    assert sum(len(shapes) for _, _, shapes in given) > 1.3 * len(wanted)
    found = put_together(given)
    assert found.united > (5 if overlap < 0.3 else -1)
    assert len(found.polygons) == len(wanted)
    assert agreement(found, wanted).min() > 0.98
    assert seams(found, wanted, [window for window, _, _ in given]) < 3
    assert found.incomplete == 0
    assert [p.id for p in found.polygons] == list(range(len(wanted)))
    assert all(p.shape.is_valid for p in found.polygons)


def test_outlines_that_differ_from_tile_to_tile_and_are_ragged_at_the_borders():
    """Each tile sees each outline a bit differently, and fades out or bulges in the last px before a border."""
    wanted = country(2)
    rng = np.random.default_rng(0)
    given = []
    for window, level, _ in tiled(wanted):
        moved = []
        for shape in wanted:
            xy = shapely.get_coordinates(shape)[:-1]
            moved.append(shapely.Polygon(xy + rng.normal(0, 0.7, xy.shape)))
        short = np.array(window) + rng.integers(0, 3, 4) * [1, 1, -1, -1] * (np.array(window) % SIZE[0] > 0)
        given.append((window, level, seen(moved, short)))
    found = put_together(given)
    assert len(found.polygons) == len(wanted)
    assert agreement(found, wanted).min() > 0.94
    assert seams(found, wanted, [window for window, _, _ in given]) < 4


def test_outlines_that_flare_at_the_borders_are_taken_from_the_neighbour():
    """In the last 6 px before a border each piece is 4 px wider than the thing."""
    wanted = country(3)
    given = []
    for window, level, shapes in tiled(wanted):
        rim = box(*window).difference(box(*window).buffer(-6, join_style="mitre"))
        flared = [shapely.union(s, s.intersection(rim).buffer(4).intersection(rim)) for s in shapes]
        given.append((window, level, [s for s in flared if isinstance(s, shapely.Polygon)]))
    found = put_together(given)
    assert found.united > 5
    assert len(found.polygons) > 0.95 * len(wanted)  # small ones may differ too much there
    for polygon in found.polygons:
        near = max(wanted, key=lambda s, own=polygon.shape: s.intersection(own).area)
        assert polygon.shape.hausdorff_distance(near) < 2.5


@pytest.mark.parametrize("seed", range(6))
def test_where_tiles_missed_things_no_outline_is_theirs(seed):
    """Of what is left nothing ends at a border, nor do pieces that two windows with the same border share."""
    wanted = country(seed + 10)
    rng = np.random.default_rng(seed)
    given = [(w, level, [s for s in shapes if rng.random() > 0.2]) for w, level, shapes in tiled(wanted)]
    found = put_together(given)
    truth = np.array(wanted, object)
    best = [iou(np.full(len(truth), p.shape, object), truth).max() for p in found.polygons]
    assert min(best) > 0.95  # a small piece with a corner of it may be missing
    assert seams(found, wanted, [window for window, _, _ in given]) < 3
    assert 0.6 * len(wanted) < len(found.polygons) < len(wanted)
    assert found.incomplete > 0


def test_two_pieces_that_end_at_one_border_do_not_vouch_for_each_other():
    size, shape = (960, 1000), box(456, 300, 504, 600)  # where the upper two windows overlap
    upper = [((x, 0, x + 512, 512), 1) for x in (0, 448)]
    found = put_together([(w, level, seen([shape], w)) for w, level in upper], size)
    assert (found.polygons, found.incomplete) == ([], 2)
    lower = [((x, 448, x + 512, 960), 1) for x in (0, 448)]
    found = put_together([(w, level, seen([shape], w)) for w, level in upper + lower], size)
    assert agreement(found, [shape]).min() > 0.98


def test_three_levels_give_what_one_gives():
    wanted = country(3, cell=500, smallest=30, largest=190)
    levels = [((0, 0, *SIZE), 0, [s for s in seen(wanted, (0, 0, *SIZE)) if s.area > 10_000])]
    levels += [(w, 1, [s for s in shapes if s.area > 2_000]) for w, _, shapes in tiled(wanted, 1536)]
    found = put_together([*levels, *tiled(wanted, level=2)])
    assert len(found.polygons) == len(wanted)
    assert agreement(found, wanted).min() > 0.98
    assert seams(found, wanted, grid(*SIZE, SIDE, OVERLAP) + grid(*SIZE, 1536, OVERLAP)) < 3
    assert found.incomplete == 0


def test_straight_edges_of_the_scene_stay_even_on_a_border():
    """A roof that ends where a window does is cut as far as that window knows; its neighbour shows it whole."""
    windows = grid(*SIZE, SIDE, OVERLAP)
    x1 = windows[0][2]  # the right border of the first window
    roof = box(x1 - 60, 100, x1, 200)
    found = put_together(tiled([roof]))
    assert agreement(found, [roof]) == pytest.approx([1.0])
    assert len(found.polygons) == 1


# --- whole somewhere


def test_what_is_wider_than_any_tile_stays_as_the_coarser_level_has_it():
    lake = blob(np.random.default_rng(0), (1500, 1000), 700, n=60)
    coarse = shapely.simplify(lake, 8)
    given = [((0, 0, *SIZE), 0, [coarse]), *tiled([lake])]
    assert any(shape.equals(box(*window)) for window, _, shapes in given[1:] for shape in shapes)  # all lake
    found = put_together(given)
    assert len(found.polygons) == 1
    assert (found.incomplete, found.united) == (0, 0)
    assert found.polygons[0].shape.equals(coarse)


def test_of_two_levels_the_finer_one_stays():
    fine = blob(np.random.default_rng(1), (200, 200), 80)
    coarse = shapely.affinity.scale(fine, 0.97, 1.02)
    window = grid(*SIZE, SIDE, OVERLAP)[0]
    found = put_together([((0, 0, *SIZE), 0, [coarse]), (window, 1, [fine])])
    assert [p.shape.equals(fine) for p in found.polygons] == [True]
    apart = put_together([((0, 0, *SIZE), 0, [coarse]), (window, 1, [box(300, 300, 400, 400)])])
    assert len(apart.polygons) == 2


def test_what_neighbours_unite_is_finer_than_what_the_coarser_level_shows_whole():
    """Pieces of what is whole are explained by it, at whatever level that is."""
    shape = blob(np.random.default_rng(2), (450, 400), 110)
    found = put_together([((0, 0, *SIZE), 0, [shape]), *tiled([shape])])
    assert len(found.polygons) == 1
    assert agreement(found, [shape]).min() > 0.98


def test_nested_polygons_stay_both():
    yard, house = box(100, 100, 300, 300), box(150, 150, 200, 220)
    found = put_together(tiled([yard, house]))
    parents = {round(p.area): p.parent for p in found.polygons}
    big = next(p.id for p in found.polygons if round(p.area) == 40_000)
    assert parents == {40_000: None, 3_500: big}


def test_nested_polygons_that_borders_cut_stay_both():
    yard, house = box(340, 100, 620, 300), box(400, 150, 560, 220)
    found = put_together(tiled([yard, house]))
    assert len(found.polygons) == 2
    assert agreement(found, [yard, house]).min() > 0.98
    assert sorted(p.parent is None for p in found.polygons) == [False, True]


def test_a_part_of_a_piece_that_is_whole_does_not_stand_for_it():
    yard, house = box(340, 100, 620, 300), box(350, 120, 430, 280)  # of which the first window shows all
    found = put_together(tiled([yard, house]))
    assert (len(found.polygons), found.united, found.incomplete) == (2, 1, 0)
    assert agreement(found, [yard, house]).min() > 0.98


# --- nowhere whole


@pytest.mark.parametrize(
    ("center", "radius", "tiles"), [((480, 250), 110, 2), ((482, 465), 130, 4), ((1400, 1000), 420, 9)]
)
def test_pieces_of_what_is_nowhere_whole_are_united(center, radius, tiles):
    shape = blob(np.random.default_rng(3), center, radius, n=40)
    given = tiled([shape])
    assert sum(len(shapes) for _, _, shapes in given) >= tiles
    found = put_together(given)
    assert (len(found.polygons), found.united, found.incomplete) == (1, 1, 0)
    assert agreement(found, [shape]).min() > 0.98
    assert seams(found, [shape], [window for window, _, _ in given]) < 3
    scores = [p.score for p in pieces_of(given).polygons]
    assert found.polygons[0].score == min(scores)


def test_windows_that_share_less_than_their_rims():
    left, right, shape = (0, 0, 512, 512), (500, 0, 1012, 512), box(300, 100, 700, 200)
    found = put_together([(w, 1, seen([shape], w)) for w in (left, right)], (1012, 512))
    assert (len(found.polygons), found.incomplete) == (1, 0)
    assert agreement(found, [shape]).min() > 0.999


def test_a_hole_that_a_border_cuts():
    ring = box(350, 100, 650, 400).difference(box(440, 200, 520, 300))
    found = put_together(tiled([ring]))
    assert len(found.polygons) == 1
    assert iou(np.array([found.polygons[0].shape]), np.array([ring]))[0] > 0.98
    assert len(found.polygons[0].holes) == 1


def test_a_piece_whose_neighbour_is_missing_goes():
    shape = blob(np.random.default_rng(3), (480, 250), 110)
    given = tiled([shape])
    without = [(window, level, shapes if k != 1 else []) for k, (window, level, shapes) in enumerate(given)]
    found = put_together(without)
    assert (found.polygons, found.incomplete) == ([], 1)


def test_a_union_that_still_ends_at_a_border_goes():
    strip = box(100, 200, 1500, 300)  # over four windows, of which the last one did not find it
    given = [(w, k, [] if w[0] > 1100 else shapes) for w, k, shapes in tiled([strip])]
    found = put_together(given)
    assert found.polygons == []
    assert found.incomplete == sum(len(shapes) for _, _, shapes in given)


def test_pieces_that_do_not_agree_are_not_united():
    left, right = (0, 0, 512, 512), (448, 0, 960, 512)
    found = put_together([(left, 1, [box(300, 100, 512, 200)]), (right, 1, [box(448, 180, 700, 280)])], (960, 512))
    assert (found.polygons, found.incomplete) == ([], 2)


def test_two_things_of_one_window_are_never_one():
    """A house and its yard look alike in the strip to the left of the border, and the neighbour saw one thing only."""
    left, right = (0, 0, 512, 512), (448, 0, 960, 512)
    yard, house = box(200, 100, 512, 300), box(400, 110, 512, 290)
    given = [(left, 1, [yard, house]), (right, 1, [box(448, 100, 700, 300)])]
    found = put_together(given, (960, 512))
    assert (len(found.polygons), found.united, found.incomplete) == (1, 1, 1)
    assert agreement(found, [box(200, 100, 700, 300)]).min() > 0.98


def test_neighbours_side_by_side_stay_apart():
    """Two long houses with a narrow gap, cut by the same border."""
    one, two = box(300, 100, 700, 150), box(300, 152, 700, 202)
    found = put_together(tiled([one, two]))
    assert len(found.polygons) == 2
    assert agreement(found, [one, two]).min() > 0.98


def test_pieces_of_different_levels_are_not_united():
    left, right = (0, 0, 512, 512), (448, 0, 960, 512)
    shape = box(300, 100, 700, 200)
    given = [(left, 1, seen([shape], left)), (right, 2, seen([shape], right))]
    assert put_together(given, (960, 512)).polygons == []


# --- the rest


def test_what_is_too_small_goes_and_labels_and_guidance_stay():
    given = pieces_of(tiled([box(10, 10, 40, 40), box(100, 100, 200, 200), box(340, 300, 660, 400)]))
    named = [dataclasses.replace(p, label="roof", source_id=f"way/{p.id}") for p in given.polygons]
    guided = np.zeros(len(named), bool)
    guided[np.argmax(given.cut)] = True  # one piece of the long one
    found = stitch(
        RegionPieces(named, given.tile, given.cut, guided, given.windows, given.levels), SIZE, 0.7, 1.0, 1000.0
    )
    assert sorted((round(p.area, -3), p.label, bool(g)) for p, g in zip(found.polygons, found.guided, strict=True)) == [
        (10_000, "roof", False),
        (32_000, None, True),
    ]
    assert [p.source_id for p in found.polygons if p.label] == [named[1].source_id]


def test_nothing():
    empty = pieces_of([((0, 0, *SIZE), 0, [])])
    found = stitch(empty, SIZE, 0.7, 1.0, 100.0)
    assert (found.polygons, found.united, found.incomplete, len(found.guided)) == ([], 0, 0, 0)


@given(st.randoms(use_true_random=False))
@settings(max_examples=6)
def test_the_order_of_the_pieces_does_not_matter(random):
    wanted = [*country(4)[:30], box(900, 300, 1500, 420)]
    lake = blob(np.random.default_rng(5), (2000, 1300), 400, n=40)
    given = pieces_of([((0, 0, *SIZE), 0, [lake, wanted[0]]), *tiled([*wanted, lake])])
    order = list(range(len(given.polygons)))
    random.shuffle(order)
    moved = RegionPieces(
        [given.polygons[k] for k in order],
        given.tile[order],
        given.cut[order],
        given.guided[order],
        given.windows,
        given.levels,
    )
    one, two = (stitch(pieces, SIZE, 0.7, 1.0, LEAST) for pieces in (given, moved))
    assert (len(one.polygons), one.united, one.incomplete) == (len(two.polygons), two.united, two.incomplete)
    assert agreement(two, [p.shape for p in one.polygons]).min() > 0.999
    assert sorted(p.score for p in one.polygons) == sorted(p.score for p in two.polygons)


def test_only_inner_borders_cut():
    at = [box(0, 50, 30, 80), box(482, 50, 512, 80), box(50, 0, 80, 30), box(50, 482, 80, 512), box(200, 200, 230, 230)]
    polygons = [from_shape(shape, k) for k, shape in enumerate(at)]
    window = (0, 0, 512, 512)
    assert cut_by_window(polygons, window, (512, 512)).tolist() == [False] * 5
    assert cut_by_window(polygons, window, (960, 512)).tolist() == [False, True, False, False, False]
    assert cut_by_window(polygons, window, (960, 960)).tolist() == [False, True, False, True, False]
    moved = [from_shape(shapely.affinity.translate(shape, 400, 300), k) for k, shape in enumerate(at)]
    assert cut_by_window(moved, (400, 300, 912, 812), (2000, 2000)).tolist() == [True] * 4 + [False]
    assert cut_by_window([], window, (960, 960)).shape == (0,)


def test_near_a_border_is_at_it():
    near, off = (from_shape(box(400, 100, x, 200), 0) for x in (510.1, 508.9))
    assert cut_by_window([near, off], (0, 0, 512, 512), (960, 512)).tolist() == [True, False]
    wide = 2560  # of which a 256th and a half are 15 px
    near, off = (from_shape(box(400, 100, x, 200), 0) for x in (2546, 2544))
    assert cut_by_window([near, off], (0, 0, wide, wide), (4000, wide)).tolist() == [True, False]


def plain_suppress(shapes, order, threshold):
    stays = []
    for row in order:
        shape = shapes[row]
        rivals = (shapes[k] for k in stays)
        if all(shape.intersection(r).area <= threshold * shape.union(r).area for r in rivals):
            stays.append(int(row))
    return stays


@given(st.integers(0, 10_000), st.floats(0.2, 0.9))
@settings(max_examples=60)
def test_suppress_equals_plain_loops(seed, threshold):
    rng = np.random.default_rng(seed)
    shapes = []
    for _ in range(8):
        center, radius = rng.uniform(0, 120, 2), rng.uniform(20, 50)
        family = blob(rng, center, radius)
        for _ in range(4):
            like = shapely.affinity.scale(family, *rng.uniform(0.7, 1.2, 2))
            shapes.append(shapely.affinity.translate(like, *rng.normal(0, 6, 2)))
    shapes = np.array(shapes, object)
    order = rng.permutation(len(shapes))
    assert suppress(shapes, order, threshold).tolist() == plain_suppress(shapes, order, threshold)


def test_what_was_removed_removes_nothing():
    a, b, c = box(0, 0, 100, 10), box(20, 0, 120, 10), box(40, 0, 140, 10)  # 0.67, 0.67, 0.43
    assert suppress(np.array([a, b, c], object), np.arange(3), 0.6).tolist() == [0, 2]
    assert suppress(np.array([a, a], object), np.array([1, 0]), 0.6).tolist() == [1]
    assert suppress(np.zeros(0, object), np.zeros(0, np.intp), 0.6).tolist() == []
