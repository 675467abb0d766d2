import numpy as np
import pytest
from blobs import blobs, box, pixels
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.evaluate.label_raster import polygon_pixels, rasterize_labels
from zpm2.model import Polygon

WIDTH, HEIGHT = 90, 60


def stack(polygons):
    """(n, h, w) the masks that `LabelRaster` does without."""
    return np.array([pixels(polygon, WIDTH, HEIGHT) for polygon in polygons]).reshape(-1, HEIGHT, WIDTH)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_cells_are_the_masks(seed, n):
    rng = np.random.default_rng(seed)
    polygons = blobs(rng, n, (WIDTH, HEIGHT))
    masks, cells = stack(polygons), rasterize_labels(polygons, WIDTH, HEIGHT)
    assert np.array_equal(cells.members.toarray()[:, cells.labels].astype(bool), masks)
    assert np.array_equal(cells.pixels, masks.sum((1, 2)))
    assert cells.sizes.sum() == WIDTH * HEIGHT
    some = np.flatnonzero(rng.random(n) < 0.4)
    assert cells.sizes[cells.union(some)].sum() == masks[some].any(0).sum()


def test_a_window_is_the_full_image_cut():
    for polygon in blobs(np.random.default_rng(5), 50, (WIDTH, HEIGHT)):
        full = np.zeros((HEIGHT, WIDTH), bool)
        window, inside = polygon_pixels(polygon, WIDTH, HEIGHT)
        full[window] = inside
        assert np.array_equal(full, stack([polygon])[0])


def test_the_area_of_a_polygon_along_pixel_edges_is_its_number_of_pixels():
    assert rasterize_labels([box(0, 10, 20, 14, 23)], WIDTH, HEIGHT).pixels.tolist() == [
        12
    ]  # 4 x 3; cv2.fillPoly takes 20
    touching = [box(0, 10, 10, 21, 21), box(1, 21, 10, 32, 21)]
    cells = rasterize_labels(touching, WIDTH, HEIGHT)
    assert cells.pixels.tolist() == [121, 121]
    assert len(cells.sizes) == 3  # neither, one, the other: no pixel is in both


def test_a_small_round_polygon_has_about_its_area():
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    for k in range(10):
        ring = np.array([40 + k / 10, 30 - k / 7]) + 7 * np.c_[np.cos(angles), np.sin(angles)]
        polygon = Polygon(0, ring)
        assert rasterize_labels([polygon], WIDTH, HEIGHT).pixels[0] == pytest.approx(polygon.area, rel=0.04)


def test_outside_of_the_image_there_are_no_pixels():
    away = Polygon(0, np.array([[-50, 5], [-20, 5], [-20, 30.0]]))
    cells = rasterize_labels([away, box(1, 10, 10, 20, 20)], WIDTH, HEIGHT)
    assert cells.pixels[0] == 0
    assert cells.pixels[1] >= 100


def test_a_polygon_may_reach_farther_than_memory():
    far = 1e9
    polygons = [
        box(0, 10, 10, far, 30),
        box(1, -far, -far, far, far, [np.array([[0, 0], [0, 60], [90, 60], [90, 0.0]])]),
    ]
    assert rasterize_labels(polygons, WIDTH, HEIGHT).pixels.tolist() == [80 * 20, 0]


def test_points_beyond_the_border_count_to_the_pixel_next():
    cells = rasterize_labels([box(0, 80, 0, 90, 60)], WIDTH, HEIGHT)
    points = np.array([[90.0, 60.0], [85.5, 3.5], [-0.2, 4.0]])
    assert cells.at(points).tolist() == [1, 1, 0]
    assert cells.union(np.array([], int)).sum() == 0


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 2, 0]])
def test_rows_are_those_of_the_list(order):
    polygons = [box(7, 0, 0, 40, 40), box(3, 10, 10, 20, 20), box(9, 30, 30, 70, 50)]
    cells = rasterize_labels([polygons[k] for k in order], WIDTH, HEIGHT)
    assert np.array_equal(cells.pixels, stack([polygons[k] for k in order]).sum((1, 2)))
