"""Whole runs on a painted plane: regions are told from the ground by colour, points are ORB's: they are quick."""

import dataclasses
from functools import cache

import cv2
import numpy as np
import PIL.Image
import pytest
import shapely
from painted import PaintedView, Region

from zpm2 import config as configuration
from zpm2 import features, geometry
from zpm2.api import Matcher
from zpm2.config import PointsConfig
from zpm2.errors import ConfigError, OutputError
from zpm2.formats import geojson
from zpm2.local_match.unmatched import REASONS
from zpm2.model import Image, Mask, PointMatches
from zpm2.polygons.trace import trace
from zpm2.result import MatchResult
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.tiled import windows

H = np.array([[0.99, 0.05, 40.0], [-0.04, 1.01, 55.0], [-6e-6, 4e-6, 1]])
CORNER = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # to OpenCV's pixel centres at 0
TURNED = {0: None, 90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180}
SETTINGS = ["device=cpu", "tiles.mode=on", "tiles.size=512", "guided.direction=off", "points.escalate.on=false"]


class ColourSegmenter:
    """Every patch of orange is a region."""

    name = "colour"

    def __init__(self):
        self.sizes = []

    def segment(self, image):
        self.sizes.append((image.width, image.height))
        _, labels, stats, _ = cv2.connectedComponentsWithStats(orange(image).astype(np.uint8), connectivity=4)
        found = []
        for k, (x, y, w, h, area) in enumerate(stats[1:].tolist(), 1):
            if area >= 60:
                found.append(Mask(x, y, labels[y : y + h, x : x + w] == k, 0.95))
        return found


class AskedSegmenter(ColourSegmenter):
    """The same, to be asked about places. On the right some regions answer only to a box around them."""

    def view(self, image):
        regions = [max(trace(mask.bits, mask.x0, mask.y0), key=lambda s: s.area) for mask in self.segment(image)]
        return PaintedView(image, [Region(shape) for shape in regions])


class OrbPoints:
    """Turned photographs do not trouble it."""

    name = "orb"

    def match(self, left, right):
        orb = cv2.ORB_create(1000, fastThreshold=10)
        (a, first), (b, second) = (orb.detectAndCompute(np.uint8(image.gray), None) for image in (left, right))
        if min(len(a), len(b)) < 2:
            return PointMatches.empty()
        near = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(first, second, k=2)
        good = [m for m, n in near if m.distance < 0.8 * n.distance]
        xy, uv = ([p.pt for p in points] for points in ([a[m.queryIdx] for m in good], [b[m.trainIdx] for m in good]))
        return PointMatches(np.reshape(xy, (-1, 2)) + 0.5, np.reshape(uv, (-1, 2)) + 0.5, np.ones(len(good)))


def orange(image):
    rgb = image.rgb.astype(np.int16)
    return rgb[..., 0] - rgb[..., 2] > 60


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    left: np.ndarray  # (h, w, 3)
    right: np.ndarray
    shapes: list  # the regions, left px
    matrix: np.ndarray  # right ~ matrix @ left


def blob(rng, center, radius):
    n = 16
    angle = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * np.pi / n
    passing = radius * (1 + 0.2 * np.sin(2 * angle + rng.uniform(0, 6)) + 0.08 * rng.uniform(-1, 1, n))
    return shapely.Polygon(np.asarray(center) + passing[:, None] * np.c_[np.cos(angle), np.sin(angle)])


@cache
def scene(width=1100, height=820, turn=0, pitch=110, seed=0, matrix=None, wide=True):
    """Blobs in a grid, one of them wider than a tile where `wide`; the right photograph is a plane's view of them."""
    rng = np.random.default_rng(seed)
    shapes = [
        blob(rng, (x, y), rng.uniform(0.2, 0.4) * pitch)
        for y in range(pitch // 2, height - pitch // 2, pitch)
        for x in range(pitch // 2, width - pitch // 2, pitch)
    ]
    if wide:
        lake = shapely.box(0.2 * width, 0.45 * height, 0.85 * width, 0.6 * height).buffer(20)
        shapes = [shape for shape in shapes if not shape.buffer(8).intersects(lake)] + [lake]
    noise = np.zeros((height, width), np.float32)
    for step in (3, 6, 12, 30):  # px
        coarse = rng.standard_normal((height // step + 2, width // step + 2)).astype(np.float32)
        noise += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    gray = np.clip(115 + 28 * noise / noise.std(), 40, 190)
    painted = np.zeros((height, width), np.uint8)
    for shape in shapes:
        ring = np.round((shapely.get_coordinates(shape.exterior) - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(painted, [ring], 1, shift=4)
    left = np.round(gray[..., None] + painted[..., None] * np.array([60.0, 0, -40.0])).astype(np.uint8)
    matrix = H if matrix is None else np.array(matrix)
    pixel = CORNER @ matrix @ np.linalg.inv(CORNER)
    right = cv2.warpPerspective(left, pixel, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    if turn:
        right = cv2.rotate(right, TURNED[turn])
        about = {90: [[0, -1, height], [1, 0, 0]], 180: [[-1, 0, width], [0, -1, height]]}[turn]
        matrix = np.array([*about, [0, 0, 1]], float) @ matrix
    return Scene(left, np.ascontiguousarray(right), shapes, matrix)


def config(*settings):
    return configuration.assign(configuration.preset("default"), [*SETTINGS, *settings])


def matcher(*settings, segmenter=None, points=None, **options):
    segmenter, points = segmenter or ColourSegmenter(), points or OrbPoints()
    return Matcher(config(*settings), segmenter=segmenter, points=points, **options)


NAMED = ["segment.model=test_tiled_matcher:colours", "points.methods=test_tiled_matcher:OrbPoints"]
COLOURS = ColourSegmenter()


def colours():
    """The segmenter of `NAMED`; forgets what it saw."""
    COLOURS.sizes.clear()
    return COLOURS


def named(*settings, **options):
    """The same matcher, with methods of the configuration, as tiles are kept of these alone."""
    return Matcher(config(*NAMED, *settings), **options)


def visible(given):
    """The shapes that both photographs show whole, and clear of the borders."""
    frames = [shapely.box(3, 3, side.shape[1] - 3, side.shape[0] - 3) for side in (given.left, given.right)]
    return [s for s in given.shapes if frames[0].covers(s) and frames[1].covers(warped(s, given.matrix))]


def warped(shape, matrix):
    return shapely.transform(shape, lambda xy: geometry.project(matrix, xy))


def iou(a, b):
    shared = a.intersection(b).area if a.intersects(b) else 0.0
    return shared / max(a.area + b.area - shared, 1e-9)


def check(result, given, share=0.97, exact=0.9):
    """Matches are right, regions are the scene's and none is a tile's, and whatever has no partner says why."""
    left, right = ({p.id: p.shape for p in side.polygons} for side in (result.left, result.right))
    frames = [shapely.box(0, 0, side.shape[1], side.shape[0]) for side in (given.left, given.right)]
    for match in result.matches:
        there = warped(left[match.left], given.matrix).intersection(frames[1])
        here = right[match.right].intersection(warped(frames[0], given.matrix))  # mirrored ground beyond
        assert iou(there, here) > 0.8
    assert len({m.left for m in result.matches}) == len({m.right for m in result.matches}) == len(result.matches)
    wanted = visible(given)
    found = sum(max((iou(s, left[m.left]) for m in result.matches), default=0) > exact for s in wanted)
    assert found >= share * len(wanted) > 10
    truth = shapely.STRtree(given.shapes)
    for shape in left.values():
        near = [given.shapes[k].intersection(frames[0]) for k in truth.query(shape)]
        assert max((iou(shape, s) for s in near), default=0) > exact  # also of those without a partner
    matched = {m.left for m in result.matches}, {m.right for m in result.matches}
    for side, ids in zip((result.left, result.right), matched, strict=True):
        assert set(side.unmatched) == {p.id for p in side.polygons} - ids
        assert set(side.unmatched.values()) <= set(REASONS)


def content(result):
    """All of a result that must not depend on the run."""
    values = result.to_dict()
    return {name: values[name] for name in ("left", "right", "matches", "points", "fundamental", "homography")}


@cache
def plain():
    """The usual pair, matched once for several tests."""
    segmenter = ColourSegmenter()
    return matcher(segmenter=segmenter)(scene().left, scene().right), segmenter.sizes


def test_a_pair_in_tiles():
    result, sizes = plain()
    check(result, scene())
    assert max(max(size) for size in sizes) <= 512 * 1.75  # no view is much larger than a tile
    assert (result.left.width, result.left.height) == (1100, 820)
    assert result.config == config().to_dict()
    assert {"tiles", "match"} - set(result.timings) == {"tiles"}
    wide = max(result.left.polygons, key=lambda p: p.area)
    assert wide.shape.bounds[2] - wide.shape.bounds[0] > 700  # wider than a tile, and one
    assert wide.id in {match.left for match in result.matches}
    where = geometry.project(scene().matrix, result.points.left)
    assert len(result.points) > 500
    assert np.median(np.linalg.norm(where - result.points.right, axis=1)) < 1.0
    assert np.quantile(np.linalg.norm(where - result.points.right, axis=1), 0.9) < 3.0


def test_with_points_of_the_method_itself():
    given = scene(470, 400, pitch=70, wide=False)
    sift = features.create(PointsConfig(methods=("sift",), max_keypoints=1500))
    check(matcher("tiles.size=256", points=sift)(given.left, given.right), given, share=0.9, exact=0.8)


def test_two_runs_give_the_same():
    again = matcher()(scene().left, scene().right)
    assert content(again) == content(plain()[0])
    assert list(again.warnings) == list(plain()[0].warnings)


@pytest.mark.parametrize("turn", [90, 180])
def test_a_right_photograph_that_is_turned(turn):
    check(matcher()(scene(turn=turn).left, scene(turn=turn).right), scene(turn=turn))


def test_a_large_pair_of_three_levels():
    given = scene(2430, 1700, pitch=200, seed=1)
    assert len(windows.levels(2430, 1700, config().tiles)) == 3
    segmenter = ColourSegmenter()
    result = matcher(segmenter=segmenter)(given.left, given.right)
    check(result, given, share=0.95)
    assert isinstance(result.left.image, Image)
    assert (result.left.image.width, result.left.width) == (2400, 2430)  # pixels to look at
    assert result.plot(400).width <= 900
    assert max(max(size) for size in segmenter.sizes) <= 512 * 1.75


def test_guided_tiles():
    """Regions are asked for in the other photograph."""
    given = scene(470, 400, pitch=70, wide=False)
    settings = "tiles.size=256", "guided.direction=both", "segment.grid=8"
    result = matcher(*settings, segmenter=AskedSegmenter())(given.left, given.right)
    check(result, given, share=0.9, exact=0.75)  # painted masks have the decoder's resolution
    assert any(match.stage == "guided" for match in result.matches)


def test_polygons_that_were_brought_along(tmp_path):
    given = scene()
    sides = given.shapes, [warped(shape, given.matrix) for shape in given.shapes]
    segmenters = []
    for k, shapes in enumerate(sides):
        frame = shapely.box(0, 0, given.left.shape[1], given.left.shape[0])
        inside = [(n, s.intersection(frame)) for n, s in enumerate(shapes) if s.intersection(frame).area > 500]
        features_ = [
            {"type": "Feature", "id": 100 + n, "properties": {}, "geometry": shapely.geometry.mapping(shape)}
            for n, shape in inside
        ]
        geojson.write(tmp_path / f"{k}.geojson", {"type": "FeatureCollection", "features": features_})
        segmenters.append(PrecomputedSegmenter(tmp_path / f"{k}.geojson"))
    result = matcher(segmenter=tuple(segmenters))(given.left, given.right)
    assert all(match.left == match.right for match in result.matches)
    ids = {100 + given.shapes.index(shape) for shape in visible(given)}
    assert len(ids & {match.left for match in result.matches}) > 0.97 * len(ids)
    first = result.left.polygons[0]
    assert np.allclose(first.shape.area, given.shapes[first.id - 100].area)  # no tile touched it


# --- interrupted runs


class Interrupt:
    """Stops a run after some tiles."""

    def __init__(self, after):
        self.after, self.calls = after, 0

    def __call__(self, stage, share):
        if stage == "tiles":
            self.calls += 1
            if self.calls > self.after:
                raise KeyboardInterrupt


def test_an_interrupted_run_goes_on_where_it_was(tmp_path):
    given, kept = scene(), tmp_path / "tiles"
    sides = tmp_path / "a.png", tmp_path / "b.png"
    for pixels, path in zip((given.left, given.right), sides, strict=True):
        PIL.Image.fromarray(pixels).save(path)
    with pytest.raises(KeyboardInterrupt):
        named(progress=Interrupt(5), kept=kept)(*sides)
    (folder,) = kept.iterdir()
    assert len(list(folder.iterdir())) == 5
    said = []
    result = named(kept=kept, say=said.append)(*sides)
    seen = len(COLOURS.sizes)
    assert [text for text in said if text.startswith("5 of") and text.endswith("earlier run")]
    before, after = content(named()(given.left, given.right)), content(result)
    for side, path in zip(("left", "right"), sides, strict=True):
        assert (before[side].pop("path"), after[side].pop("path")) == (None, str(path))
    assert before == after
    assert 0 < seen == len(COLOURS.sizes) - 2 * 5
    again = named(kept=kept)(*sides)
    assert content(again) == content(result)
    assert COLOURS.sizes == []  # all of them are there


@pytest.mark.parametrize("own", [{"segmenter": ColourSegmenter()}, {"points": OrbPoints()}])
def test_tiles_are_kept_of_methods_that_have_a_name(tmp_path, own):
    with pytest.raises(ConfigError, match="kept tiles cannot take a segmenter or point"):
        Matcher(config(), kept=tmp_path, **own)


def test_tiles_of_another_pair_or_configuration_are_not_taken(tmp_path):
    kept, given = tmp_path / "tiles", scene()
    for settings, right in ((), given.right), (("segment.min_area=130",), given.right), ((), given.right[::-1]):
        with pytest.raises(KeyboardInterrupt):
            named(*settings, progress=Interrupt(1), kept=kept)(given.left, np.ascontiguousarray(right))
    assert len(list(kept.iterdir())) == 3


def test_a_folder_for_tiles_that_cannot_be_made(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match="taken"):
        named(kept=tmp_path / "taken")(scene().left, scene().right)


# --- modes


def test_small_pairs_are_matched_as_a_whole_unless_tiles_are_asked_for():
    given = scene(470, 400, pitch=70, wide=False)
    results = {}
    for mode in ("off", "auto", "on"):
        segmenter = ColourSegmenter()
        results[mode] = matcher(f"tiles.mode={mode}", "tiles.size=256", segmenter=segmenter)(given.left, given.right)
        whole = segmenter.sizes == [(470, 400)] * 2
        assert whole == (mode != "on")
        check(results[mode], given, share=0.9, exact=0.8)
    assert content(results["off"]) == content(results["auto"])
    segmenter = ColourSegmenter()
    options = "tiles.mode=auto", f"raster.large_px={470 * 400 - 1}", "tiles.size=256"
    large = matcher(*options, segmenter=segmenter)(given.left, given.right)
    assert (470, 400) not in segmenter.sizes
    assert content(large) == content(results["on"])


def test_a_pair_that_fits_in_one_tile_is_one():
    given = scene(470, 400, pitch=70, wide=False)
    segmenter = ColourSegmenter()
    result = matcher("tiles.size=1024", segmenter=segmenter)(given.left, given.right)
    assert segmenter.sizes == [(470, 400)] * 2
    check(result, given, share=0.9, exact=0.8)


# --- what only one of the photographs shows


def test_photographs_of_different_scenes_match_nothing():
    one, other = scene(seed=0, wide=False), scene(seed=7, wide=False)
    result = matcher()(one.left, other.left)
    assert list(result.matches) == []
    assert "no polygons were matched" in result.warnings
    assert len(result.left.polygons) > 0.9 * len(one.shapes)
    assert len(result.right.polygons) > 0.9 * len(other.shapes)
    for side in (result.left, result.right):
        assert set(side.unmatched) == {p.id for p in side.polygons}


def test_nothing_to_see():
    gray = np.full((820, 1100, 3), 127, np.uint8)
    result = matcher()(gray, gray)
    assert (list(result.matches), list(result.left.polygons), list(result.right.polygons)) == ([], [], [])
    assert "no regions were found in the left image" in result.warnings
    assert "no polygons were matched" in result.warnings
    assert len(result.points) == 0
    one_sided = matcher()(scene().left, gray)
    assert list(one_sided.matches) == []
    assert set(one_sided.left.unmatched.values()) == {"no candidate"}


def test_half_of_the_scene_in_each():
    """The right photograph begins where the left one's middle is, and is as wide: what it does not share is ground of
    its own, which only tiles that no left tile leads to can find."""
    whole = scene(1620, 820, wide=False)
    sides = whole.left[:, :1100], whole.left[:, 520:]
    result = matcher()(*map(np.ascontiguousarray, sides))
    both = [s for s in whole.shapes if s.bounds[0] > 525 and s.bounds[2] < 1095]
    left = {p.id: p.shape for p in result.left.polygons}
    found = sum(max(iou(s, left[m.left]) for m in result.matches) > 0.9 for s in both)
    assert found > 0.95 * len(both)
    gone = [i for i, why in result.left.unmatched.items() if why == "outside overlap"]
    assert len(gone) > 10
    assert all(left[i].centroid.x < 560 for i in gone)
    right = {p.id: p.shape for p in result.right.polygons}
    own = [shapely.affinity.translate(s, -520) for s in whole.shapes if s.bounds[0] > 1120]
    seen = sum(max(iou(s, r) for r in right.values()) > 0.85 for s in own)
    assert len(own) > 20
    assert seen > 0.9 * len(own)
    beyond = [why for i, why in result.right.unmatched.items() if right[i].bounds[0] > 620]
    assert beyond.count("outside overlap") > 0.8 * len(beyond)


# --- georeferenced rasters


def write(path, pixels, corner=(691_000, 5_300_000), gsd=0.5, valid=None):
    rasterio = pytest.importorskip("rasterio")
    height, width = pixels.shape[:2]
    options = {"driver": "GTiff", "width": width, "height": height, "count": 3, "dtype": "uint8"}
    transform = rasterio.transform.Affine(gsd, 0, corner[0], 0, -gsd, corner[1])
    with (
        rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
        rasterio.open(path, "w", crs="EPSG:32632", transform=transform, photometric="RGB", **options) as file,
    ):
        file.write(np.moveaxis(pixels, 2, 0))
        if valid is not None:
            file.write_mask(valid)
    return path


def test_georeferenced_photographs_keep_their_place_on_the_ground(tmp_path):
    given = scene()
    left = write(tmp_path / "a.tif", given.left)
    right = write(tmp_path / "b.tif", given.right, corner=(691_020, 5_299_990))
    result = matcher("raster.min_area_m2=600")(left, right)
    for side, corner in ((result.left, (691_000, 5_300_000)), (result.right, (691_020, 5_299_990))):
        assert side.geo.crs == "EPSG:32632"
        assert np.allclose(side.geo.to_world(np.zeros((1, 2))), [corner])
        assert side.geo.gsd == pytest.approx(0.5, rel=1e-3)
    areas = {p.id: p.area for side in (result.left,) for p in side.polygons}
    assert min(areas.values()) >= 2390  # px^2 of 0.25 m^2
    large = [s for s in visible(given) if s.area > 2500]
    assert len(large) < len(visible(given)) - 5
    found = {p.id: p.shape for p in result.left.polygons}
    right_ones = {p.id: p.shape for p in result.right.polygons}
    for m in result.matches:
        assert iou(warped(found[m.left], given.matrix), right_ones[m.right]) > 0.8
    assert sum(max(iou(s, found[m.left]) for m in result.matches) > 0.9 for s in large) > 0.95 * len(large)
    saved = MatchResult.load(result.save(tmp_path / "out"))
    assert saved.left.geo.crs == "EPSG:32632"
    assert saved.left.unmatched == result.left.unmatched


def test_no_region_lies_where_there_is_no_data(tmp_path):
    given = scene()
    valid = np.ones(given.left.shape[:2], bool)
    valid[:300, :450] = False
    result = matcher()(write(tmp_path / "a.tif", given.left, valid=valid), write(tmp_path / "b.tif", given.right))
    hole = shapely.box(0, 0, 450, 300)
    assert len(result.left.polygons) > 20
    for polygon in result.left.polygons:
        assert polygon.shape.intersection(hole).area < 0.02 * polygon.area
    column, row = np.floor(result.points.left).astype(int).T
    assert valid[np.clip(row, 0, 819), np.clip(column, 0, 1099)].all()
    lost = [p.id for p in result.right.polygons if warped(hole.buffer(-5), given.matrix).covers(p.shape)]
    assert len(lost) > 3
    assert {result.right.unmatched[i] for i in lost} == {"outside overlap"}


def test_a_small_photograph_of_a_part_of_a_large_one(tmp_path):
    """Where the georeferences say that, only that part is compared, at its own resolution."""
    given = scene(1620, 820, wide=False)
    left = write(tmp_path / "a.tif", given.left[300:700, 600:1000], corner=(691_300, 5_299_850))
    right = write(tmp_path / "b.tif", given.left)
    result = matcher("tiles.size=256", "tiles.outside=false")(left, right)
    inside = [s for s in given.shapes if shapely.box(605, 305, 995, 695).covers(s)]
    found = {p.id: p.shape for p in result.left.polygons}
    others = {p.id: p.shape for p in result.right.polygons}
    assert len(inside) > 5
    for match in result.matches:
        there = shapely.affinity.translate(found[match.left], 600, 300)
        assert iou(there, others[match.right].intersection(shapely.box(600, 300, 1000, 700))) > 0.8
    shown = [shapely.affinity.translate(found[m.left], 600, 300) for m in result.matches]
    assert all(max(iou(s, t) for t in shown) > 0.85 for s in inside)


def test_georeferenced_photographs_of_different_places(tmp_path):
    given = scene(470, 400, pitch=70, wide=False)
    other = scene(470, 400, pitch=70, wide=False, seed=5)
    left = write(tmp_path / "a.tif", given.left)
    right = write(tmp_path / "b.tif", other.left, corner=(791_000, 5_200_000))
    segmenter = ColourSegmenter()
    result = matcher("tiles.size=256", segmenter=segmenter)(left, right)
    assert list(result.matches) == []
    assert "no polygons were matched" in result.warnings
    assert len(segmenter.sizes) == 2 + 2 * 4  # all of each, and its four tiles
    segmenter.sizes.clear()
    matcher("tiles.size=256", "tiles.outside=false", segmenter=segmenter)(left, right)
    assert len(segmenter.sizes) == 2
    assert len(result.left.polygons) > 0.9 * len(given.shapes)
    assert len(result.right.polygons) > 0.9 * len(other.shapes)


def test_a_least_area_in_square_metres_needs_the_size_of_a_pixel():
    given = scene(470, 400, pitch=70, wide=False)
    for mode in ("on", "off"):
        with pytest.raises(ConfigError, match="gsd"):
            matcher("raster.min_area_m2=300", f"tiles.mode={mode}")(given.left, given.right)


@pytest.mark.parametrize("mode", ["on", "off"])
def test_smaller_polygons_are_left_out(mode):
    given = scene(470, 400, pitch=70, wide=False)
    settings = f"tiles.mode={mode}", "tiles.size=256"
    automatic_masks = matcher(*settings)(given.left, given.right)
    result = matcher("raster.min_area_m2=300", "raster.gsd=0.5,0.4", *settings)(given.left, given.right)
    for side, least in ((result.left, 300 / 0.25), (result.right, 300 / 0.16)):
        assert min(p.area for p in side.polygons) >= least
        assert len(side.polygons) > 3
    assert len(result.left.polygons) < len(automatic_masks.left.polygons)
    assert sum(p.area >= 1200 for p in automatic_masks.left.polygons) == len(result.left.polygons)
    ids = [{p.id for p in side.polygons} for side in (result.left, result.right)]
    for match in result.matches:
        assert match.left in ids[0]
        assert match.right in ids[1]
    assert set(result.left.unmatched) == ids[0] - {m.left for m in result.matches}
    assert set(result.right.unmatched) == ids[1] - {m.right for m in result.matches}
