"""A closer look at painted photographs whose small regions only a window shows."""

from functools import cache

import cv2
import numpy as np
import pytest
import shapely
from painted import PaintedView, Region

from zpm2 import config, geometry
from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.guided import detail, redetection, windows
from zpm2.guided.redetection import DetectedPair, Regions
from zpm2.model import Image, PointMatches, PolygonMatch
from zpm2.polygons.overlap import iou

SIDE, SHIFT = 320, (6, -4)
H = np.array([[1.0, 0, SHIFT[0]], [0, 1, SHIFT[1]], [0, 0, 1]])
CONFIG = config.assign(
    config.preset("default"),
    [
        "segment.min_area=30",
        "segment.detail.min_side=32",
        "segment.detail.auto_windows=4",
        "segment.family.max_prompts=0",
    ],
)
SMALL = [shapely.box(x, y, x + 9, y + 7) for y in range(20, 300, 28) for x in range(20, 300, 28)]
LARGE = [shapely.box(10, 10, 90, 60), shapely.box(230, 240, 310, 300)]


def painted(shapes, seed):
    rng = np.random.default_rng(seed)
    pixels = np.full((SIDE, SIDE, 3), 90, np.uint8) + rng.integers(0, 3, (SIDE, SIDE, 1), dtype=np.uint8)
    for shape in sorted(shapes, key=lambda shape: -shape.area):
        x0, y0, x1, y1 = (int(np.clip(v, 0, SIDE)) for v in shape.bounds)
        pixels[y0:y1, x0:x1] = 200 if shape.area > 100 else 20
    return Image(pixels)


class Pair:
    """Two photographs, their whole views, and windows of them. `asked` are the windows that were encoded."""

    def __init__(self, small=SMALL, large=LARGE, cut=(), at=None):
        self.shapes = [[*small, *large, *cut], [moved(shape) for shape in (*small, *large, *cut)]]
        self.images = tuple(painted([*side], seed) for seed, side in enumerate(self.shapes))
        self.whole = tuple(
            PaintedView(image, [Region(shape) for shape in side if shape.area > 100])
            for image, side in zip(self.images, self.shapes, strict=True)
        )
        at = np.random.default_rng(0).uniform(0, SIDE, (800, 2)) if at is None else at
        every = np.ones(len(at), bool)
        points = PointMatches(at, geometry.project(H, at), np.ones(len(at)))
        self.initial = InitialGeometry(points, np.zeros((3, 3)), H, every, every)
        self.asked, self.prompted = [], []  # windows, and the views of each

    def views(self, *crops):
        found = []
        for image, crop, shapes in zip(self.images, crops, self.shapes, strict=True):
            low = corner_of(crop, image)
            self.asked.append((*low, low[0] + crop.width, low[1] + crop.height))
            frame = shapely.box(0, 0, crop.width, crop.height)
            here = [shapely.transform(shape, lambda xy, low=low: xy - low) for shape in shapes]
            found.append(PaintedView(crop, [Region(s.intersection(frame)) for s in here if s.intersects(frame)]))
        self.prompted.append(found)
        return tuple(found)

    def prompts(self, side):
        """(n, 2) where the windows of one side were prompted, px of the image."""
        low = [np.array(box[:2]) for box in self.asked[side::2]]
        return np.concatenate(
            [np.reshape(v[side].asked, (-1, 2)) + at for v, at in zip(self.prompted, low, strict=True)]
        )

    def detected(self, config=CONFIG):
        return redetection.detect(self.whole, self.initial, config)

    def closer(self, config=CONFIG, match=None, pair=None):
        pair = pair or self.detected(config)
        match = match or matched
        return pair, detail.look_closer(pair, self.images, self.views, self.initial, match(pair), match, config)


@cache
def usual():
    """The usual pair before and after a closer look, for several tests."""
    return Pair().closer()


def moved(shape):
    return shapely.transform(shape, lambda xy: xy + SHIFT)


def corner_of(crop, image):
    """Where a crop was cut out."""
    difference = cv2.matchTemplate(image.rgb, crop.rgb, cv2.TM_SQDIFF)
    return np.array(cv2.minMaxLoc(difference)[2])


def matched(pair):
    """Each left polygon with the right one that shows the same."""
    found = []
    for i, polygon in enumerate(pair.left.polygons):
        shapes = np.array([other.shape for other in pair.right.polygons], object)
        overlap = iou(np.full(len(shapes), moved(polygon.shape)), shapes)
        if len(overlap) and overlap.max() > 0.5:
            found.append(PolygonMatch(i, int(overlap.argmax()), 0.9, 1.0, 5, "global"))
    return found


def test_windows_find_the_small_regions_of_both_images():
    before, after = usual()
    assert len(before.left) == len(before.right) == 2
    found = matched(after)
    assert len(found) > 0.8 * len(SMALL)
    for side, shapes in ((after.left, SMALL), (after.right, [moved(shape) for shape in SMALL])):
        assert [polygon.id for polygon in side.polygons] == list(range(len(side)))
        tree = shapely.STRtree(shapes)
        for polygon in side.polygons[2:]:
            nearest = shapes[tree.nearest(polygon.shape)]
            assert iou(np.array([polygon.shape]), np.array([nearest]))[0] > 0.6
    assert before.left.polygons == after.left.polygons[:2]  # what was known stays as it was


def test_no_region_is_found_twice():
    _, after = usual()
    for side in (after.left, after.right):
        shapes = np.array([polygon.shape for polygon in side.polygons], object)
        i, j = shapely.STRtree(shapes).query(shapes, predicate="intersects")
        assert iou(shapes[i[i < j]], shapes[j[i < j]]).max(initial=0) < CONFIG.segment.nms_iou


def test_a_window_drops_what_its_border_cuts():
    """A bar through the whole image: no window shows all of it."""
    bar = shapely.box(0, 180, SIDE, 187)
    scene = Pair(cut=[bar])
    scene.whole[0].regions.clear()
    scene.whole[0].__post_init__()
    _, after = scene.closer()
    assert len(after.left) > 0.8 * len(SMALL)
    assert all(iou(np.array([p.shape]), np.array([p.shape.intersection(bar)]))[0] < 0.5 for p in after.left.polygons)


def test_enough_coverage_needs_no_closer_look():
    scene = Pair(large=[shapely.box(10, 10, 305, 308)])
    before, after = scene.closer()
    assert after is before
    assert scene.asked == []


def test_where_scales_differ_more_coverage_is_needed():
    scene = Pair(large=[shapely.box(10, 10, 305, 270)])
    before, after = scene.closer()
    part = windows.shared_part(scene.images, scene.initial, CONFIG)
    covered = part.covered(np.array([before.left.polygons[m.left].shape for m in matched(before)], object))
    assert CONFIG.segment.detail.min_coverage < covered < CONFIG.segment.detail.zoomed_coverage
    assert after is before
    _, after = scene.closer(config.assign(CONFIG, ["segment.detail.zoom=1"]))
    assert len(matched(after)) > 0.8 * len(SMALL)


def test_level_high_looks_wherever_small_regions_are_likely():
    scene = Pair(large=[shapely.box(10, 10, 305, 308)])
    high = config.assign(CONFIG, ["segment.detail.level=high"])
    _, after = scene.closer(high)
    assert len(matched(after)) > 0.8 * len(SMALL)


def test_a_plain_image_needs_no_closer_look():
    scene = Pair(small=[], large=[])
    scene.images = tuple(Image(np.full((SIDE, SIDE, 3), 90, np.uint8)) for _ in range(2))
    before, after = scene.closer()
    assert after is before
    assert scene.asked == []


@pytest.mark.parametrize("most", [0, 1, 3])
def test_windows_keep_to_their_number(most):
    scene = Pair()
    scene.closer(config.assign(CONFIG, [f"segment.detail.auto_windows={most}"]))
    assert len(scene.asked) == 2 * most


def test_a_window_that_brings_nothing_is_the_last_one_of_its_size():
    scene = Pair()
    scene.closer(match=lambda pair: [PolygonMatch(0, 0, 0.9, 1.0, 5, "global")])
    assert len(scene.asked) == 2


def test_the_same_bytes_twice():
    first, second = usual()[1], Pair().closer()[1]
    for a, b in ((first.left, second.left), (first.right, second.right)):
        assert [p.exterior.tobytes() for p in a.polygons] == [p.exterior.tobytes() for p in b.polygons]


def test_forward_only_asks_the_right_image():
    forward = config.assign(CONFIG, ["guided.direction=forward"])
    _, after = Pair().closer(forward)
    assert not after.left.guided.any()
    assert after.right.guided.any()


def left_half():
    at = np.random.default_rng(0).uniform(0, SIDE, (800, 2))
    return at[at[:, 0] < 150]


def test_without_points_near_no_match_can_be_so_nothing_is_asked():
    scene = Pair(at=left_half())
    scene.closer()
    reach = CONFIG.segment.detail.reach * SIDE / 256  # windows are smaller than the image, and so is this there
    for side, shift in enumerate((0, SHIFT[0])):
        assert 20 < scene.prompts(side)[:, 0].max() <= 150 + shift + reach


def test_without_a_rule_on_points_all_of_the_shared_part_is_asked():
    scene = Pair(at=left_half())
    scene.closer(config.assign(CONFIG, ["segment.detail.min_points=0"]))
    assert scene.prompts(0)[:, 0].max() > 250


def test_a_region_is_asked_for_in_one_window_only():
    """A large region that has no match lies in both windows, and asks the first one."""
    scene = Pair(small=[s for s in SMALL if not s.intersects(shapely.box(150, 150, 170, 170))])
    inner = shapely.box(140, 140, 180, 175)
    scene.whole[0].regions.append(Region(inner))
    scene.whole[0].__post_init__()
    pair = scene.detected()
    lone = next(k for k, p in enumerate(pair.left.polygons) if p.shape.intersection(inner).area > 0.9 * inner.area)
    _, after = scene.closer(pair=pair)
    boxes = [shapely.box(*box) for box in scene.asked[::2]]
    assert sum(box.contains(pair.left.polygons[lone].shape) for box in boxes) > 1
    centre = np.array([[160.0, 157.5]]) + SHIFT
    assert (np.linalg.norm(scene.prompts(1) - centre, axis=1) < 4).sum() <= CONFIG.guided.points
    assert len(after.left) > len(pair.left)


def test_windows_are_asked_at_small_blobs_only():
    """The first look asks at the others."""
    scene = Pair()
    window = detail._Window(
        scene.images,
        detail.WindowPair((0, 0, 192, 192), (0, 0, SIDE, SIDE)),
        scene.whole,
        scene.initial,
        None,
        CONFIG,
        (),
    )
    assert window.segment(0).prompts.blob_sigmas == (1.5,)
    assert window.segment(1).prompts.blob_sigmas == (1.5,)
    assert window.segment(0).grid == CONFIG.segment.detail.grid


@pytest.mark.parametrize("reach", [0, 1, 1.5, 7.3, 100])
def test_pixels_within_reach(reach):
    rng = np.random.default_rng(5)
    pixels = rng.random((40, 60)) < 0.01
    row, column = np.nonzero(pixels)
    y, x = np.mgrid[:40, :60]
    distance = np.hypot(y[..., None] - row, x[..., None] - column).min(-1)
    assert np.array_equal(detail.within(reach, pixels), distance <= reach)
    assert not detail.within(reach, np.zeros((4, 5), bool)).any()


def test_points_and_h_between_windows():
    points = PointMatches(np.array([[10.0, 20.0]]), np.array([[16.0, 16.0]]), np.ones(1))
    there, h = detail.moved((points, H), (4, 5, 60, 70), (1, 2, 80, 90))
    assert there.left.tolist() == [[6, 15]]
    assert there.right.tolist() == [[15, 14]]
    assert geometry.project(h, there.left) == pytest.approx(there.right)
    assert isinstance(detail.moved((points, Failed("none")), (0, 0, 1, 1), (0, 0, 1, 1))[1], Failed)


def test_regions_of_a_window_need_a_match():
    before, after = usual()
    assert before.left.confident.all()
    assert list(after.left.confident) == [True] * 2 + [False] * (len(after.left) - 2)
    (left, right), _ = redetection.drop_unconfirmed(after, matched(before), CONFIG.vectorize)
    assert len(left) == len(right) == 2


def test_without_regions_there_is_nothing_to_compare():
    none = Regions([], *np.zeros((3, 0), bool))
    _, after = Pair().closer(pair=DetectedPair(none, none))
    assert len(after.left) > 0.8 * len(SMALL)
