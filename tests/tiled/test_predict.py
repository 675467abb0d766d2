import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import TilesConfig
from zpm2.model import Image, PointMatches
from zpm2.photos.raster import open_raster
from zpm2.photos.source import InMemoryPhoto
from zpm2.tiled import predict
from zpm2.tiled.predict import PartnerWindow, square_view

WINDOW = (400, 300, 900, 700)
TILES = TilesConfig()


def affine(points, window, noise):
    return predict.affine_map(points, window, noise, TILES.partner)


def by_georeference(window, left, right):
    return predict.affine_by_georeference(window, left, right, TILES.partner)


def coherent(points, noise):
    return predict.coherent_points(points, noise, TILES.partner)


def partner(window, matrix, points, size, margin):
    return predict.partner_window(window, matrix, points, size, margin, TILES.partner)


def similar(degrees=0.0, scale=1.0, shift=(0.0, 0.0)):
    """(2, 3)"""
    c, s = scale * math.cos(math.radians(degrees)), scale * math.sin(math.radians(degrees))
    return np.array([[c, -s, shift[0]], [s, c, shift[1]]])


def through(matrix, xy):
    return xy @ matrix[:, :2].T + matrix[:, 2]


def matched(n, matrices, wrong=0.0, seed=0, noise=1.0, low=(0, 0), high=(1600, 1200)):
    """Points that move by one map each, chosen by their place from left to right; some do not. Which ones do."""
    rng = np.random.default_rng(seed)
    left = rng.uniform(low, high, (n, 2))
    which = (left[:, 0] * len(matrices) / 1600).astype(int)
    right = np.stack([through(m, left) for m in matrices])[which, np.arange(n)] + rng.normal(0, noise, (n, 2))
    true = rng.random(n) >= wrong
    right[~true] = rng.uniform(right.min(0), right.max(0), (int((~true).sum()), 2))
    return PointMatches(left, right, np.ones(n)), true


def kept(points, some):
    rows = {tuple(row) for row in np.c_[some.left, some.right]}
    return np.array([tuple(row) in rows for row in np.c_[points.left, points.right]])


@pytest.mark.parametrize(
    "matrices",
    [
        [similar()],
        [similar(180, 1, (1600, 1200))],
        [similar(90, 0.5, (700, 0))],
        [similar(3, 4, (50, -300))],
        [similar(0, 1, (0, 40)), similar(170, 1.1, (1500, 900))],  # a mosaic of two photographs
        [similar(), similar(-90, 1, (0, 1500)), similar(20, 1, (300, 300))],
    ],
)
def test_points_that_move_with_their_neighbours(matrices):
    points, true = matched(1200, matrices, wrong=0.3)
    stays = kept(points, coherent(points, 20.0))
    assert stays[true].mean() > (0.95 if len(matrices) == 1 else 0.92)  # along the seams of a mosaic some go
    assert stays[~true].mean() < (0.05 if len(matrices) < 3 else 0.1)


def test_relief_is_coherent():
    points, _ = matched(1200, [similar()])
    points.right[:, 0] += 60 * np.sin(points.left[:, 0] / 150)
    assert len(coherent(points, 10.0)) > 0.98 * len(points)


@pytest.mark.parametrize("n", [1, 8])
def test_few_points_have_no_neighbours_to_compare_with(n):
    points, _ = matched(n, [similar()], wrong=1.0)
    assert len(coherent(points, 1.0)) == n
    assert len(coherent(PointMatches.empty(), 1.0)) == 0


def test_points_in_one_place():
    same = PointMatches(np.full((20, 2), 5.0), np.full((20, 2), 7.0), np.ones(20))
    assert len(coherent(same, 1.0)) == 20


@pytest.mark.parametrize("wrong", [0.0, 0.5])
@pytest.mark.parametrize("matrix", [similar(33, 1.5, (200, -70)), np.array([[1.2, 0.3, 5], [-0.1, 0.7, 60]])])
def test_an_affine_map_from_the_points_of_a_window(matrix, wrong):
    points, _ = matched(1500, [matrix], wrong)
    found = affine(points, WINDOW, 5.0)
    corners = np.array([[400, 300], [900, 300], [900, 700], [400, 700]], float)
    assert np.abs(through(found, corners) - through(matrix, corners)).max() < 4.0
    assert np.array_equal(found, affine(points, WINDOW, 5.0))


def test_only_the_points_of_the_window_count_where_they_are_enough():
    matrices = [similar(0, 1, (0, 40)), similar(90, 1, (900, 0))]
    points, _ = matched(3000, matrices)
    for matrix, window in zip(matrices, [(100, 100, 700, 700), (900, 100, 1500, 700)], strict=True):
        corners = np.array([[window[0], window[1]], [window[2], window[3]]], float)
        assert np.abs(through(affine(points, window, 5.0), corners) - through(matrix, corners)).max() < 4.0


def test_a_window_without_points_takes_the_nearest_ones():
    near, _ = matched(60, [similar(5, 1, (30, 0))], low=(950, 300), high=(1200, 700))
    far, _ = matched(500, [similar(80, 1, (0, 0))], low=(1300, 0), high=(1600, 1200), seed=1)
    found = affine(PointMatches.join([far, near]), WINDOW, 5.0)
    corner = np.array([[900.0, 500.0]])
    assert np.abs(through(found, corner) - through(similar(5, 1, (30, 0)), corner)).max() < 4.0


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (matched(11, [similar()])[0], "too few"),
        (PointMatches.empty(), "none"),
        (matched(500, [similar()], wrong=1.0)[0], "contradicting"),
        (matched(500, [np.array([[-1.0, 0, 1600], [0, 1, 0]])])[0], "mirrored"),
        (matched(500, [similar(0, 9)], noise=0.1)[0], "too much larger"),
        (matched(500, [similar(0, 0.1)], noise=0.1)[0], "too much smaller"),
        (PointMatches(np.full((50, 2), 500.0), np.full((50, 2), 500.0), np.ones(50)), "all one"),
    ],
)
def test_no_map(points, why):
    assert affine(points, WINDOW, 5.0) is None, why


@pytest.mark.parametrize("degrees", [0, 10, 90, 180, -120])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
def test_the_partner_holds_all_of_the_window_and_little_more(degrees, scale):
    matrix = similar(degrees, scale, (2500, 2500))
    found = partner(WINDOW, matrix, PointMatches.empty(), (6000, 6000), 0.125)
    ends = through(matrix, np.array([[400, 300], [900, 300], [900, 700], [400, 700]], float))
    low, high = ends.min(0), ends.max(0)
    x0, y0, x1, y1 = found.window
    rim = 0.125 * (high - low)
    assert np.allclose([x0, y0], low - rim, atol=2)
    assert np.allclose([x1, y1], high + rim, atol=2)
    assert found.scale == pytest.approx(scale)
    assert math.cos(found.turn - math.radians(degrees)) == pytest.approx(1)
    cut = partner(WINDOW, matrix, PointMatches.empty(), (round(low[0] + 200 * scale), 6000), 0.125)
    assert cut.window == (x0, y0, round(low[0] + 200 * scale), y1)


@pytest.mark.parametrize("shift", [(-2000, 0), (0, 5000), (-895, 0)])
def test_no_partner_beyond_the_right_photograph(shift):
    assert partner(WINDOW, similar(0, 1, shift), PointMatches.empty(), (1600, 1200), 0.125) is None
    assert partner(WINDOW, None, PointMatches.empty(), (1600, 1200), 0.125) is None


def test_relief_widens_the_partner_but_wrong_points_do_not():
    flat = partner(WINDOW, similar(), PointMatches.empty(), (3000, 3000), 0.0).window
    points, _ = matched(400, [similar()], noise=0.0, low=(400, 300), high=(900, 700))
    high = points.left[:, 0] > 800  # of 900: a tower
    points.right[high, 0] += 100
    x0, y0, x1, y1 = partner(WINDOW, similar(), points, (3000, 3000), 0.0).window
    assert (x0, y0, y1) == (flat[0], flat[1], flat[3])
    assert 975 < x1 <= 1001
    points.right[:40] = 2900  # one in ten is nowhere near
    x0, y0, x1, y1 = partner(WINDOW, similar(), points, (3000, 3000), 0.0).window
    assert x1 - x0 <= 1.5 * 500 + 2
    assert y1 - y0 <= 1.5 * 400 + 2


spans = st.tuples(st.integers(0, 2000), st.integers(1, 1500))


@given(spans, spans, st.floats(1, 3), st.floats(0.3, 3), st.integers(64, 700))
def test_a_square_view_holds_the_window_and_has_few_sizes(across, down, reduction, scale, tile):
    size = 3600, 3500
    window = across[0], down[0], sum(across), sum(down)
    (x0, y0, x1, y1), (width, height) = square_view(
        PartnerWindow(window, scale, 0.0), reduction, size, TilesConfig(size=tile)
    )
    assert 0 <= x0 <= window[0]
    assert 0 <= y0 <= window[1]
    assert window[2] <= x1 <= size[0]
    assert window[3] <= y1 <= size[1]
    ratio = max(
        1.0, reduction * (scale if not 1 / TILES.partner.same_scale < scale < TILES.partner.same_scale else 1.0)
    )
    for side, shown, length in ((x1 - x0, width, size[0]), (y1 - y0, height, size[1])):
        assert side == length or (shown % (tile // TILES.partner.side_steps) == 0 and shown >= 1.25 * tile)
        assert shown <= side
        assert shown == pytest.approx(side / ratio, abs=1)
    if x1 - x0 < size[0] and y1 - y0 < size[1]:
        assert width == height


# --- georeferences


def raster(path, crs, transform, size=(400, 300)):
    rasterio = pytest.importorskip("rasterio")
    values = np.random.default_rng(0).integers(0, 255, (3, size[1], size[0]), np.uint8)
    options = {"driver": "GTiff", "width": size[0], "height": size[1], "count": 3, "dtype": "uint8"}
    with rasterio.open(path, "w", crs=crs, transform=rasterio.transform.Affine(*transform.ravel()), **options) as file:
        file.write(values)
    return open_raster(path)


def ground(degrees, gsd, corner):
    """(2, 3) px to metres, north up but for a turn."""
    return similar(degrees, gsd, corner) @ np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]])


def test_the_map_between_two_georeferenced_photographs(tmp_path):
    first, second = ground(0, 0.5, (691_000, 5_300_000)), ground(35, 0.8, (691_050, 5_299_990))
    with raster(tmp_path / "a.tif", "EPSG:32632", first) as left, raster(tmp_path / "b.tif", "EPSG:32632", second) as b:
        found = by_georeference((0, 0, 400, 300), left, b)
    world, back = np.vstack([first, [0, 0, 1]]), np.linalg.inv(np.vstack([second, [0, 0, 1]]))
    assert np.allclose(found, (back @ world)[:2], atol=1e-3)


def test_of_different_reference_systems(tmp_path):
    warp = pytest.importorskip("rasterio.warp")
    first = ground(10, 0.5, (691_000, 5_300_000))
    center = np.array(warp.transform("EPSG:32632", "EPSG:32633", [691_050], [5_299_950])).ravel()[:2]
    second = ground(-20, 0.5, center + np.array([-120, 40]))
    with raster(tmp_path / "a.tif", "EPSG:32632", first) as left, raster(tmp_path / "b.tif", "EPSG:32633", second) as b:
        found = by_georeference((50, 50, 250, 200), left, b)
    spots = np.array([[50, 50], [250, 50], [250, 200], [50, 200], [150, 100]], float)
    x, y = warp.transform("EPSG:32632", "EPSG:32633", *through(first, spots).T)
    wanted = (np.c_[x, y] - second[:, 2]) @ np.linalg.inv(second[:, :2]).T
    assert np.abs(through(found, spots) - wanted).max() < 0.05
    turn = math.degrees(math.atan2(found[1, 0], found[0, 0]))
    assert 25 < abs(turn) < 35  # 30 degrees between the files, and the meridians' convergence


def test_without_a_place_on_the_ground_there_is_no_map(tmp_path):
    nowhere = InMemoryPhoto(Image(np.zeros((300, 400, 3), np.uint8)))
    placed = raster(tmp_path / "a.tif", "EPSG:32632", ground(0, 0.5, (691_000, 5_300_000)))
    with placed:
        assert by_georeference((0, 0, 400, 300), placed, nowhere) is None
        assert by_georeference((0, 0, 400, 300), nowhere, placed) is None
        assert by_georeference((0, 0, 400, 300), placed, placed) is not None


def test_photographs_of_different_continents(tmp_path):
    left = raster(tmp_path / "a.tif", "EPSG:32632", ground(0, 0.5, (691_000, 5_300_000)))
    right = raster(tmp_path / "b.tif", "EPSG:32756", ground(0, 0.5, (334_000, 6_250_000)))
    with left, right:
        found = by_georeference((0, 0, 400, 300), left, right)
        assert partner((0, 0, 400, 300), found, PointMatches.empty(), (400, 300), 0.5) is None
