import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import square

from zpm2.config import ExclusiveConfig
from zpm2.local_match.exclusive import exclusive
from zpm2.model import Polygon
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.shapes import from_shape
from zpm2.polygons.trace import trace

WIDTH, HEIGHT = 22, 16
SIZES = (WIDTH, HEIGHT), (WIDTH, HEIGHT)
CONFIG = ExclusiveConfig()
LEAST = 3.0  # px, of a piece


def shift(dx=0, dy=0):
    return np.array([[1, 0, dx], [0, 1, dy], [0, 0, 1]], float)


def flatten(pairs, confidence, maps=None, min_area=LEAST, sizes=SIZES):
    maps = np.tile(shift(), (len(pairs), 1, 1)) if maps is None else maps
    return exclusive(pairs, np.array(confidence, float), maps, sizes, min_area, CONFIG)


def box(id, x0, y0, x1, y1, **more):
    return Polygon(id, square(x0, y0, x1, y1), **more)


def both(*polygons):
    """The same polygons in both images."""
    return [(polygon, polygon) for polygon in polygons]


def pixels(polygon):
    mask = rasterize(polygon.shape)
    return {(x + mask.x0, y + mask.y0) for y, x in np.argwhere(mask.bits).tolist()}


def reference(pairs, confidence, shifts, min_area):
    """The rule, pixel by pixel; maps are shifts by whole pixels. (left, right) sets of pixels, or None."""
    sides = [[pixels(pair[k]) for pair in pairs] for k in range(2)]
    n = len(pairs)
    size = [len(sides[0][k]) * len(sides[1][k]) for k in range(n)]

    def inside(a, b):
        return size[a] < size[b] and any(
            0 < len(side[a]) < len(side[b]) and len(side[a] & side[b]) > CONFIG.min_part * len(side[a])
            for side in sides
        )

    def sure(k):
        return max([confidence[k], *(sure(whole) for whole in range(n) if inside(k, whole))])

    waiting, taken, result = set(range(n)), [set(), set()], [None] * n
    while waiting:
        ready = [b for b in waiting if not any(inside(a, b) for a in waiting)]
        k = min(ready, key=lambda k: (-sure(k), -confidence[k], pairs[k][0].id))
        waiting.remove(k)
        kept = keep([side[k] for side in sides], taken, shifts[k], min_area)
        if kept is not None:
            result[k] = kept
            taken = [taken[0] | kept[0], taken[1] | kept[1]]
    return result


def keep(whole, taken, by, min_area):
    parts = []
    for own, gone in zip(whole, taken, strict=True):
        found = sorted(connected(own - gone), key=lambda piece: -len(piece))
        parts.append([piece for piece in found if not own & gone or len(piece) >= min_area])
    if not parts[0] or not parts[1]:
        return None
    left, right = max(((a, b) for a in parts[0] for b in parts[1]), key=lambda pair: len(moved(pair[0], by) & pair[1]))
    if [len(left), len(right)] == [len(own) for own in whole]:
        return left, right
    enough = min(CONFIG.min_overlap, CONFIG.min_kept * overlap(*whole, by))
    return (left, right) if overlap(left, right, by) >= enough else None


def moved(piece, by):
    return {(x + by[0], y + by[1]) for x, y in piece}


def in_image(piece):
    return {(x, y) for x, y in piece if 0 <= x < WIDTH and 0 <= y < HEIGHT}


def overlap(left, right, by):
    shared = len(moved(left, by) & right)
    seen = [len(in_image(side)) for side in (moved(left, by), moved(right, (-by[0], -by[1])))]
    return 1 / (seen[0] / shared + seen[1] / shared - 1) if shared else 0.0


def connected(area):
    """4-connected pieces, in the order of their first pixels."""
    found, left = [], set(area)
    for start in sorted(area, key=lambda p: (p[1], p[0])):
        if start not in left:
            continue
        piece, border = {start}, [start]
        left.remove(start)
        while border:
            x, y = border.pop()
            for p in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if p in left:
                    left.remove(p)
                    piece.add(p)
                    border.append(p)
        found.append(piece)
    return found


def random_region(rng):
    bits = np.zeros((HEIGHT, WIDTH), bool)
    for _ in range(int(rng.integers(1, 4))):
        x0, y0 = rng.integers(0, WIDTH - 3), rng.integers(0, HEIGHT - 3)
        bits[y0 : y0 + rng.integers(2, 11), x0 : x0 + rng.integers(2, 14)] = True
    if rng.random() < 0.4:
        x0, y0 = rng.integers(1, WIDTH - 3), rng.integers(1, HEIGHT - 3)
        bits[y0 : y0 + 3, x0 : x0 + 3] = False
    return bits if bits.any() else np.ones_like(bits)


def random_matches(seed, n):
    """Pairs, confidence with ties, and the whole pixels by which each is shifted: mostly alike regions in both."""
    rng = np.random.default_rng(seed)
    pairs, shifts = [], []
    for k in range(n):
        bits = random_region(rng)
        dx, dy = (int(v) for v in rng.integers(-3, 4, 2))
        other = np.zeros_like(bits)
        y, x = np.nonzero(bits)
        seen = (x + dx >= 0) & (x + dx < WIDTH) & (y + dy >= 0) & (y + dy < HEIGHT)
        other[y[seen] + dy, x[seen] + dx] = True
        if rng.random() < 0.3 or not other.any():
            other = random_region(rng)
        left, right = (from_shape(trace(b)[0], id) for b, id in ((bits, 10 + k), (other, 50 - k)))
        pairs.append((left, right))
        shifts.append((dx, dy))
    return pairs, rng.choice([0.3, 0.6, 0.6, 0.9], n), shifts


cases = st.tuples(st.integers(0, 10**6), st.integers(0, 9))


def run(case, min_area=LEAST):
    pairs, confidence, shifts = random_matches(*case)
    maps = np.array([shift(*s) for s in shifts]).reshape(-1, 3, 3)
    return pairs, confidence, shifts, maps, flatten(pairs, confidence, maps, min_area)


def kept_pixels(kept):
    return [None if pair is None else tuple(pixels(polygon) for polygon in pair) for pair in kept]


@given(cases, st.sampled_from([0.0, 3.0, 12.0]))
def test_exclusive_is_the_reference(case, min_area):
    pairs, confidence, shifts, _, kept = run(case, min_area)
    assert kept_pixels(kept) == reference(pairs, confidence, shifts, min_area)


@given(cases)
def test_regions_exclude_each_other_and_lie_in_their_polygons(case):
    pairs, _, _, _, kept = run(case)
    for k in range(2):
        owned = [pixels(pair[k]) for pair in kept if pair is not None]
        assert sum(map(len, owned)) == len(set().union(*owned))
        for before, after in zip(pairs, kept, strict=True):
            if after is not None:
                assert pixels(after[k]) <= pixels(before[k])
                assert after[k].area == len(pixels(after[k]))
                assert after[k].shape.is_valid
                assert after[k].id == before[k].id
                assert len(connected(pixels(after[k]))) == 1


@given(cases)
def test_pixels_go_to_nobody_only_where_nobody_could_keep_them(case):
    """What adjoins a region within its old polygon belongs to another match."""
    pairs, _, _, _, kept = run(case)
    for k in range(2):
        taken = set().union(*(pixels(pair[k]) for pair in kept if pair is not None))
        for before, after in zip(pairs, kept, strict=True):
            if after is not None:
                piece = pixels(after[k])
                beside = {p for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)) for p in moved(piece, (dx, dy))}
                assert (beside & pixels(before[k])) - piece <= taken


@given(cases)
def test_again_changes_nothing(case):
    pairs, confidence, _, maps, kept = run(case)
    rows = [k for k in range(len(pairs)) if kept[k] is not None]
    again = flatten([kept[k] for k in rows], confidence[rows], maps[rows])
    for k, pair in zip(rows, again, strict=True):
        assert pair is not None
        for one, two in zip(kept[k], pair, strict=True):
            assert np.array_equal(one.exterior, two.exterior)
            assert len(one.holes) == len(two.holes)


@given(cases, st.randoms(use_true_random=False))
def test_the_order_of_the_matches_does_not_matter(case, random):
    pairs, confidence, _, maps, kept = run(case)
    rows = list(range(len(pairs)))
    random.shuffle(rows)
    shuffled = flatten([pairs[k] for k in rows], confidence[rows], maps[rows])
    assert kept_pixels(shuffled) == [kept_pixels(kept)[k] for k in rows]


def test_a_part_lies_on_its_whole_however_unsure_it_is():
    kept = flatten(both(box(0, 0, 0, 20, 14), box(1, 4, 4, 9, 9)), [0.9, 0.1])
    for k in range(2):
        assert kept[1][k].area == 25
        assert kept[0][k].area == 20 * 14 - 25
        assert len(kept[0][k].holes) == 1


def test_of_two_that_cross_the_surer_one_wins_in_both_images():
    wide, high = box(0, 0, 5, 20, 9), box(1, 8, 0, 12, 14)
    for confidence in ([0.9, 0.8], [0.8, 0.9]):
        kept = flatten(both(wide, high), confidence)
        first, second = (0, 1) if confidence[0] > confidence[1] else (1, 0)
        for k in range(2):
            assert kept[first][k].area == (wide, high)[first].area
            assert kept[second][k].area < (wide, high)[second].area


def test_a_part_is_as_sure_as_its_whole():
    """Otherwise the whole would wait for its part, behind what crosses both."""
    whole, part, across = box(0, 0, 0, 16, 10), box(1, 10, 2, 15, 8), box(2, 12, 0, 20, 14)
    kept = flatten(both(whole, part, across), [0.9, 0.3, 0.8])
    assert [pair[0].area for pair in kept] == [160 - 30, 30, 8 * 14 - 4 * 10]


def test_where_the_images_disagree_on_what_lies_in_what_the_smaller_one_comes_first():
    small, large = box(0, 4, 4, 8, 8), box(1, 0, 0, 20, 14)
    pairs = [(small, large), (box(2, 0, 0, 20, 12), box(2, 4, 4, 9, 9))]
    kept = flatten(pairs, [0.1, 0.9], min_area=1)
    assert kept[0] is not None  # 16 x 280 px; the other one has 240 x 25
    assert kept[0][0].area == 16


def test_a_torn_match_keeps_the_pieces_that_correspond():
    """The bar is torn in both images, with the longer end on different sides."""
    pole = [(box(0, 12, 0, 14, 14), box(0, 9, 0, 11, 14))]
    bar = [(box(1, 2, 5, 22, 8), box(1, 0, 5, 19, 8))]
    maps = np.stack([shift(-3), shift(-3)])
    kept = flatten(pole + bar, [0.9, 0.5], maps)
    assert kept[1][0].bounds == (2, 5, 12, 8)
    assert kept[1][1].bounds == (0, 5, 9, 8)


def test_sides_that_lost_different_parts_go():
    top, bottom = box(0, 0, 0, 20, 8), box(0, 0, 7, 20, 15)
    pairs = [(top, bottom), (box(1, 0, 0, 20, 15), box(1, 0, 0, 20, 15))]
    kept = flatten(pairs, [0.9, 0.5], np.stack([shift(0, 7), shift()]))
    assert kept[0] is not None
    assert kept[1] is None


def test_what_the_other_image_does_not_show_does_not_count():
    """Half of the left polygon lies beyond the right image; what was taken of the rest is the same."""
    part = box(0, 12, 0, 17, 7)
    pairs = [(part, box(0, 1, 0, 6, 7)), (box(1, 0, 0, 20, 8), box(1, 0, 0, 9, 8))]
    kept = flatten(pairs, [0.9, 0.5], np.tile(shift(-11), (2, 1, 1)), sizes=((22, 16), (9, 16)))
    assert kept[1] is not None
    assert kept[1][0].area == 160 - 35


def test_pixels_of_a_match_that_goes_are_for_the_next():
    """The middle one keeps too little; the last one gets that too."""
    first, second, third = box(0, 0, 0, 20, 9), box(1, 0, 4, 10, 14), box(2, 5, 5, 20, 14)
    kept = flatten(both(first, second, third), [0.9, 0.8, 0.7], min_area=51)
    assert kept[1] is None
    assert kept[2][0].area == 15 * 5
    kept = flatten(both(first, second, third), [0.9, 0.8, 0.7], min_area=50)
    assert kept[1][0].area == 50
    assert kept[2][0].area == 10 * 5


def test_a_small_match_that_nobody_touches_stays():
    kept = flatten(both(box(0, 0, 0, 20, 9), box(1, 3, 12, 5, 14)), [0.9, 0.8], min_area=100)
    assert kept[1][0].area == 4


def test_polygons_between_the_pixels():
    """Pixels belong by their centres; what has none goes."""
    slanted = Polygon(
        0, np.array([[0.2, 0.3], [9.7, 0.6], [9.2, 7.9], [0.4, 7.2]]), score=0.7, parent=4, label="roof", source_id="a"
    )
    sliver = Polygon(1, np.array([[12.6, 0], [12.9, 0], [12.9, 9], [12.6, 9]]))
    kept = flatten(both(slanted, sliver), [0.9, 0.9])
    assert kept[1] is None
    found = kept[0][0]
    assert (found.score, found.parent, found.label, found.source_id) == (0.7, 4, "roof", "a")
    assert pixels(found) == pixels(slanted)
    assert found.area == len(pixels(slanted))


def test_twice_the_same_region_and_no_match():
    kept = flatten(both(box(3, 0, 0, 9, 9), box(2, 0, 0, 9, 9)), [0.5, 0.5])
    assert kept[0] is None
    assert kept[1][0].area == 81
    assert flatten([], []) == []


@pytest.mark.parametrize("by", [(-30, 0), (500, 400)])
def test_polygons_beyond_the_image_do_no_harm(by):
    boxes = [dataclasses.replace(p, exterior=p.exterior + by) for p in (box(0, 0, 0, 9, 9), box(1, 5, 0, 14, 9))]
    kept = flatten(both(*boxes), [0.9, 0.5], min_area=10)
    assert kept[0][0].area == 81
    assert kept[1] is None or kept[1][0].area == 45
