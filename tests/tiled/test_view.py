import math

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from zpm2.config import TilesConfig
from zpm2.model import Image, Polygon
from zpm2.photos.source import InMemoryPhoto
from zpm2.tiled.view import applied_turn, read_view, reduced_size

WIDTH, HEIGHT = 400, 300
TURNS = [math.radians(degrees) for degrees in (-170, -90, -45, 30, 90, 180)]


def smooth(x, y):
    """(n, 3) a picture that is known between the pixels too."""
    waves = [128 + 100 * np.sin(x / a) * np.cos(y / b) for a, b in ((17, 23), (29, 19), (37, 31))]
    return np.stack(waves, axis=-1)


def photograph(valid=None):
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    return InMemoryPhoto(Image(np.round(smooth(x, y)).astype(np.uint8), "a.png", ("a note",), valid))


def centres(image):
    x, y = np.meshgrid(np.arange(image.width) + 0.5, np.arange(image.height) + 0.5)
    return np.c_[x.ravel(), y.ravel()]


def inner(bits):
    """Pixels whose neighbours are seen too."""
    return cv2.erode(np.pad(bits, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0


@given(
    st.tuples(st.integers(0, 300), st.integers(0, 200), st.integers(40, 100), st.integers(40, 100)),
    st.floats(1, 8),
    st.floats(-math.pi, math.pi),
)
def test_px_there_and_back(box, reduction, turn):
    x0, y0, width, height = box
    window = x0, y0, x0 + width, y0 + height
    seen = read_view(
        InMemoryPhoto(Image(np.zeros((HEIGHT, WIDTH, 3), np.uint8))), window, reduced_size(window, reduction), turn
    )
    corners = np.array([[x0, y0], [x0 + width, y0], [x0 + width, y0 + height], [x0, y0 + height]], float)
    inside = seen.points(np.c_[corners, np.ones(4)][:, :2])  # any points: only their way matters
    assert np.allclose(np.c_[inside, np.ones(4)] @ seen.from_px.T, np.c_[corners, np.ones(4)], atol=1e-6)
    framed = (np.c_[corners, np.ones(4)] @ seen.from_px.T)[:, :2]
    assert (framed > -1e-6).all()
    assert (framed < [seen.image.width + 1e-6, seen.image.height + 1e-6]).all()
    scale = math.sqrt(abs(np.linalg.det(seen.to_px[:2, :2])))
    assert scale == pytest.approx(reduction, rel=0.6 / (min(width, height) / reduction))


@pytest.mark.parametrize("reduction", [1.0, 2.0])
@pytest.mark.parametrize("turn", [0.0, *TURNS])
def test_the_pixels_are_those_of_the_place_that_they_map_to(turn, reduction):
    seen = read_view(photograph(), (40, 20, 260, 180), reduced_size((40, 20, 260, 180), reduction), turn)
    points = seen.points(centres(seen.image))
    bits = np.ones((seen.image.height, seen.image.width), bool) if seen.image.valid is None else seen.image.valid
    bits = inner(bits).ravel()
    assert bits.sum() > 0.9 * 220 * 160 / reduction**2
    assert ((points[bits] > [39, 19]) & (points[bits] < [261, 181])).all()
    off = np.abs(seen.image.rgb.reshape(-1, 3)[bits] - smooth(*points[bits].T))
    assert off.max() < 3.0


@pytest.mark.parametrize("turn", TURNS)
def test_the_corners_that_a_turn_leaves_empty_are_no_data(turn):
    seen = read_view(photograph(), (40, 20, 260, 180), reduced_size((40, 20, 260, 180), 1.0), turn)
    points = seen.points(centres(seen.image))
    outside = ((points < [39.4, 19.4]) | (points > [260.6, 180.6])).any(1)
    assert not seen.image.valid.ravel()[outside].any()
    assert not seen.image.rgb.reshape(-1, 3)[((points < [38, 18]) | (points > [262, 182])).any(1)].any()
    assert seen.image.valid.sum() == pytest.approx(220 * 160, rel=0.02)
    assert (seen.image.path, seen.image.notes) == ("a.png", ("a note",))


@pytest.mark.parametrize("degrees", [0, 20, -20, 7])
def test_a_small_turn_leaves_the_pixels_as_they_are(degrees):
    source, window = photograph(), (40, 20, 260, 180)
    turn = applied_turn(math.radians(degrees), TilesConfig())
    assert applied_turn(math.radians(21), TilesConfig()) == math.radians(21)
    assert applied_turn(math.radians(7), TilesConfig(min_turn=5)) == math.radians(7)
    seen = read_view(source, window, reduced_size(window, 1.0), turn)
    assert np.array_equal(seen.image.rgb, source.image.rgb[20:180, 40:260])
    assert seen.image.valid is None
    assert np.array_equal(seen.to_px, [[1, 0, 40], [0, 1, 20], [0, 0, 1]])


def test_a_photograph_is_not_enlarged():
    seen = read_view(photograph(), (40, 20, 260, 180), reduced_size((40, 20, 260, 180), 0.5))
    assert (seen.image.width, seen.image.height) == (220, 160)


@pytest.mark.parametrize("turn", [0.0, math.pi / 2, math.pi])
def test_pixels_without_data_stay_so(turn):
    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[:, 100:150] = False
    seen = read_view(photograph(valid), (40, 20, 260, 180), reduced_size((40, 20, 260, 180), 1.0), turn)
    points = seen.points(centres(seen.image))
    x, y = points.T
    gap, rest = (x > 101) & (x < 149), ((x < 99) | (x > 151)) & (x > 41) & (x < 259) & (y > 21) & (y < 179)
    assert not seen.image.valid.ravel()[gap].any()
    assert seen.image.valid.ravel()[rest].all()


@pytest.mark.parametrize("turn", [0.0, *TURNS])
def test_a_polygon_comes_back_with_all_that_is_known_of_it(turn):
    seen = read_view(photograph(), (40, 20, 260, 180), reduced_size((40, 20, 260, 180), 2.0), turn)
    ring, hole = np.array([[30, 30], [60, 30], [60, 60], [30, 60]], float), np.array([[40, 40], [40, 50], [50, 50]])
    polygon = Polygon(7, ring, (hole.astype(float),), 0.75, 3, "roof", "way/1", {"name": "Hof"})
    moved = seen.polygon(polygon, 5)
    assert (moved.id, moved.score, moved.parent, moved.label) == (5, 0.75, None, "roof")
    assert (moved.source_id, moved.properties) == ("way/1", {"name": "Hof"})
    assert moved.area == pytest.approx(4 * polygon.area)
    assert shapely.is_ccw(moved.shape.exterior) == shapely.is_ccw(polygon.shape.exterior)
    wanted = shapely.Polygon(seen.points(ring), [seen.points(hole)])
    assert moved.shape.symmetric_difference(wanted).area < 1e-6


def test_no_points():
    assert read_view(photograph(), (40, 20, 260, 180), (110, 80)).points(np.zeros((0, 2))).shape == (0, 2)
