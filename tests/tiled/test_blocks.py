"""Polygons of a plane, matched block by block and as one small pair: the matches are the same."""

import dataclasses

import cv2
import numpy as np
import pytest
import shapely

from zpm2 import geometry
from zpm2.config import PRESETS, GuidedConfig, LocalConfig, TilesConfig, assign
from zpm2.global_match import initial_geometry, locate, search_candidates
from zpm2.guided.prior import GuidedPrior
from zpm2.local_match import MatchProblem, match_polygons
from zpm2.model import Image, PointMatches, Polygon, PolygonArrays
from zpm2.photos.source import InMemoryPhoto
from zpm2.polygons.warp import WarpedPolygons, warp_by_points
from zpm2.tiled import blocks
from zpm2.tiled.blocks import LargePair, layers, match_blocks
from zpm2.tiled.cells import cells, warped_by_cells

PITCH, COLUMNS, ROWS = 88, 10, 7
WIDTH, HEIGHT = PITCH * COLUMNS, PITCH * ROWS
SIDE = 256
BLOCKS = TilesConfig().blocks
H = np.array([[1.01, 0.03, -18.0], [-0.02, 0.99, 11.0], [1e-5, 0, 1]])
CORNER = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # to OpenCV's pixel centres at 0


@dataclasses.dataclass(eq=False)
class Recorder:
    """A source, and what was read of it."""

    source: InMemoryPhoto
    reads: list = dataclasses.field(default_factory=list)

    def __getattr__(self, name):
        return getattr(self.source, name)

    def read(self, window=None, size=None):
        self.reads.append((window, size))
        return self.source.read(window, size)


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    images: tuple
    polygons: tuple
    points: PointMatches
    truth: dict

    @property
    def sources(self):
        return tuple(Recorder(InMemoryPhoto(image)) for image in self.images)


def ring(rng, center, size):
    n = int(rng.integers(6, 12))
    angle = (np.arange(n) + rng.uniform(-0.35, 0.35, n)) * 2 * np.pi / n
    return center + size * rng.uniform(0.55, 1.0, (n, 1)) * np.c_[np.cos(angle), np.sin(angle)]


def scene(scale=1.0, seed=0, large=False):
    """`scale`: right px per left px."""
    rng = np.random.default_rng(seed)
    matrix = np.diag([scale, scale, 1.0]) @ H
    size = round(WIDTH * scale), round(HEIGHT * scale)
    texture = sum(
        cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), s) * s for s in (1.5, 3, 6)
    )
    texture = 128 + 40 * texture / texture.std()
    shrunk = cv2.GaussianBlur(texture, (0, 0), 0.6 / scale) if scale < 1 else texture
    pixel = CORNER @ matrix @ np.linalg.inv(CORNER)
    right = cv2.warpPerspective(shrunk, pixel, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    images = tuple(
        Image(np.repeat(np.clip(np.round(gray), 0, 255).astype(np.uint8)[..., None], 3, 2)) for gray in (texture, right)
    )
    rings = [
        ring(rng, PITCH * (np.array([x, y]) + 0.5), rng.uniform(0.3, 0.48) * PITCH)
        for y in range(ROWS)
        for x in range(COLUMNS)
    ]
    if large:
        rings.append(ring(rng, np.array([WIDTH, HEIGHT]) / 2, 0.45 * HEIGHT))
    moved = {k: geometry.project(matrix, r) for k, r in enumerate(rings)}
    moved = {k: r + rng.normal(0, 0.4 * scale, r.shape) for k, r in moved.items() if r.min() > 0 and (r < size).all()}
    ids = dict(zip(moved, (500 + rng.permutation(len(moved))).tolist(), strict=True))
    left = [Polygon(k, r) for k, r in enumerate(rings)]
    right = [Polygon(ids[k], moved[k]) for k in sorted(moved, key=ids.get)]
    xy = rng.uniform(0, (WIDTH, HEIGHT), (1500, 2))
    uv = geometry.project(matrix, xy) + rng.normal(0, 0.3 * scale, xy.shape)
    wrong = rng.random(len(xy)) < 0.05
    uv[wrong] = rng.uniform((0, 0), size, (int(wrong.sum()), 2))
    return Scene(images, (PolygonArrays(left), PolygonArrays(right)), PointMatches(xy, uv, np.ones(len(xy))), ids)


def whole(given, config):
    initial = initial_geometry(given.points, config.global_match, config.seed)
    locations = locate(*given.images, given.polygons[0].centers, initial, config.global_match)
    candidates = search_candidates(*given.polygons, locations, config.global_match)
    guided_prior = None
    if config.guided.direction != "off":
        warped = warp_by_points(given.polygons[0], *initial.forward(), config.local_match)
        confident = tuple(np.ones(len(side), bool) for side in given.polygons)
        guided_prior = GuidedPrior(warped, confident, tuple(~each for each in confident), config.guided)
    problem = MatchProblem(given.images, given.polygons, initial, locations, candidates, guided_prior)
    return match_polygons(problem, config.local_match)


def sized(config, side):
    return dataclasses.replace(config, tiles=dataclasses.replace(config.tiles, size=side))


def in_blocks(given, config, side=SIDE, sources=None, guided=None, warped=None, told=lambda share: None):
    left, right = given.polygons
    config = sized(config, side)
    found = list(cells(left, given.points, config))
    warped = warped or warped_by_cells(left, found, config.local_match)
    guided = guided or (np.zeros(len(left), bool), np.zeros(len(right), bool))
    return match_blocks(LargePair(sources or given.sources, (left, right), guided), found, warped, config, told)


def pairs(matches):
    return {match.left: match.right for match in matches}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_blocks_match_what_a_whole_pair_matches(preset, scale):
    given, config = scene(scale), PRESETS[preset]
    matches, expected = in_blocks(given, config), whole(given, config)
    assert len(given.truth) > 45
    assert pairs(expected) == given.truth
    assert pairs(matches) == given.truth
    assert [match.left for match in matches] == sorted(given.truth)
    costs = {m.left: m.cost for m in expected}
    off = [abs(m.cost / costs[m.left] - 1) for m in matches]
    assert np.median(off) < 0.05
    shares = [np.mean([m.stage == "global" for m in of]) for of in (matches, expected)]
    assert shares[0] >= shares[1] > 0.5  # the pyramid begins at the right places
    for match in matches:
        assert match.dsf == next(m.dsf for m in expected if m.left == match.left)


def test_a_right_photograph_of_twice_the_resolution():
    given = scene(2.0)
    sources = given.sources
    assert pairs(in_blocks(given, PRESETS["default"], sources=sources)) == given.truth
    for (own, size), (window, there) in zip(sources[0].reads, sources[1].reads, strict=True):
        reductions = (own[2] - own[0]) / size[0], (window[2] - window[0]) / there[0]
        assert 1.8 < reductions[1] / reductions[0] < 2.2  # both views show a thing as large


def test_a_large_polygon_is_compared_at_a_lower_resolution():
    given = scene(large=True)
    sources = given.sources
    matches = in_blocks(given, PRESETS["default"], sources=sources)
    assert pairs(matches) == given.truth
    assert ROWS * COLUMNS in pairs(matches)
    reduction = [round((window[2] - window[0]) / size[0]) for window, size in sources[0].reads]
    assert 256 < np.ptp(given.polygons[0].polygons[-1].exterior, axis=0).max() <= 512
    assert set(reduction) == {1, 2, 8}  # longer sides up to 64 px, up to 128, and up to 512


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_no_more_is_read_than_a_block_needs(scale):
    given = scene(scale, large=True)
    sources = given.sources
    in_blocks(given, PRESETS["default"], sources=sources)
    for source in sources:
        assert len(source.reads) > 4
        for window, size in source.reads:
            x0, y0, x1, y1 = window
            assert 0 <= x0 < x1 <= source.width
            assert 0 <= y0 < y1 <= source.height
            assert max(size) <= BLOCKS.max_window * SIDE + 2 * BLOCKS.margin + 2
            assert size != (source.width, source.height)


def test_places_that_relief_or_wrong_points_scatter_are_read_in_parts():
    narrow = assign(sized(PRESETS["paper"], SIDE), ["tiles.blocks.margin=8"])
    given = scene()
    found = list(cells(given.polygons[0], given.points, narrow))
    warped = warped_by_cells(given.polygons[0], found, LocalConfig(gamma=8))
    shapes = warped.shapes.copy()
    shapes[3] = shapely.affinity.translate(shapes[3], 540, 300)  # of one block
    huge = shapely.affinity.scale(shapes[12], 40, 40)  # near the horizon of a wrong map
    shapes[12] = huge.intersection(shapely.box(-1e4, -1e4, 1e4, 1e4))
    shapes[20] = shapely.Polygon()
    sources = given.sources
    odd = WarpedPolygons(warped.maps, shapes, warped.own)
    matches = pairs(in_blocks(given, narrow, sources=sources, warped=odd))
    for window, size in sources[1].reads:
        assert max(size) <= BLOCKS.max_window * SIDE + 2 * 8 + 2
        assert window != (0, 0, WIDTH, HEIGHT)
    others = {k: v for k, v in given.truth.items() if k not in (3, 12, 20)}
    assert {k: v for k, v in matches.items() if k not in (3, 12, 20)} == others


def test_a_polygon_has_one_partner_over_all_blocks():
    """Every left polygon twice, one copy moved by a few px, so that it falls into another cell at times."""
    given, config = scene(), PRESETS["paper"]
    left = given.polygons[0].polygons
    moved = [dataclasses.replace(p, id=1000 + p.id, exterior=p.exterior + np.array([6, 4])) for p in left]
    both = dataclasses.replace(given, polygons=(PolygonArrays([*left, *moved]), given.polygons[1]))
    matches = in_blocks(both, config)
    assert len({match.right for match in matches}) == len(matches) == len(given.truth)
    assert len({match.left for match in matches}) == len(matches)
    own = [m for m in matches if given.truth.get(m.left) == m.right]
    assert len(own) > 0.95 * len(matches)  # the copy that lies right costs less


@pytest.mark.parametrize("guided", ["off", "both"])
def test_two_geometries_in_one_cell(guided):
    """The right half of the scene moves 150 px farther: no H holds for both, but each polygon has points around it."""
    given, config = scene(), dataclasses.replace(PRESETS["default"], guided=GuidedConfig(direction=guided))
    x, jump = WIDTH / 2, np.array([0.0, 150.0])
    size = HEIGHT + int(jump[1]), WIDTH, 3
    pixels = np.zeros(size, np.uint8)
    border = round(float(geometry.project(H, np.array([[x, HEIGHT / 2]]))[0, 0]))
    pixels[:HEIGHT, :border] = given.images[1].rgb[:, :border]
    pixels[-HEIGHT:, border:] = given.images[1].rgb[:, border:]
    left, right = given.polygons
    there = PolygonArrays(
        [dataclasses.replace(p, exterior=p.exterior + (p.center[0] > border) * jump) for p in right.polygons]
    )
    away = np.where(given.points.left[:, :1] > x, jump, 0.0)
    points = PointMatches(given.points.left, given.points.right + away, given.points.score)
    around = ~shapely.contains_xy(shapely.union_all(left.shapes), points.left)
    points = points[np.flatnonzero(around)]
    odd = Scene((given.images[0], Image(pixels)), (left, there), points, given.truth)
    matches = pairs(in_blocks(odd, config, side=2048))
    clear = np.abs(left.centers[:, 0] - x) > PITCH  # of the border, which cuts polygons
    truth = {k: v for k, v in given.truth.items() if clear[k]}
    assert len(truth) > 35
    assert {k: v for k, v in matches.items() if clear[k]} == truth


def test_the_search_begins_as_wide_as_neighbours_are_wrong():
    config = PRESETS["paper"].global_match
    assert [layers(px, config) for px in (0, 17, 18, 52, 53, 157, 158, 1e9, np.inf)] == [1, 1, 2, 2, 3, 3, 4, 10, 10]
    few = dataclasses.replace(config, max_layers=2)
    assert layers(np.inf, few) == 2


def test_the_same_with_cells_of_other_sides():
    given, config = scene(seed=1), PRESETS["default"]
    assert pairs(in_blocks(given, config, side=400)) == pairs(in_blocks(given, config, side=2048)) == given.truth


def test_matches_of_what_was_asked_for_are_guided():
    given, config = scene(), PRESETS["default"]
    guided = tuple(np.zeros(len(side), bool) for side in given.polygons)
    guided[1][:5] = True
    matches = in_blocks(given, config, guided=guided)
    assert {m.right for m in matches if m.stage == "guided"} == set(given.polygons[1].ids[:5].tolist())


def test_progress_and_empty_sides():
    given, shares = scene(), []
    in_blocks(given, PRESETS["paper"], told=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    none = PolygonArrays([])
    for sides in ((none, given.polygons[1]), (given.polygons[0], none), (none, none)):
        assert in_blocks(dataclasses.replace(given, polygons=sides), PRESETS["paper"]) == []
    assert in_blocks(dataclasses.replace(given, points=PointMatches.empty()), PRESETS["paper"]) == []


def test_a_size_ratio_beyond_reason_is_not_compared(monkeypatch):
    given = scene()
    right = given.polygons[1].polygons
    small = [dataclasses.replace(p, exterior=p.center + (p.exterior - p.center) / 20) for p in right]
    odd = dataclasses.replace(given, polygons=(given.polygons[0], PolygonArrays(small)))
    monkeypatch.setattr(blocks, "_possible", lambda *_: pytest.fail("compared"))
    assert in_blocks(odd, PRESETS["paper"]) == []
