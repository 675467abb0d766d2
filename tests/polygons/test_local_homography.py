import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import arrays, square, star

from zpm2 import geometry
from zpm2.config import HomographyConfig
from zpm2.errors import Failed
from zpm2.global_match import Candidates, InitialGeometry, PyramidLocations
from zpm2.model import PointMatches
from zpm2.polygons.local_homography import fit_homographies
from zpm2.polygons.overlap import iou
from zpm2.polygons.transform import transform_polygons

seeds = st.integers(0, 10**6)


def random_map(rng, center, size):
    """A homography of a region of `size` px around `center`, and its affine part there."""
    linear = np.eye(2) + rng.uniform(-0.2, 0.2, (2, 2))
    local = np.eye(3)
    local[:2, :2] = linear
    local[2, :2] = rng.uniform(-0.1, 0.1, 2) / size
    to, back = np.eye(3), np.eye(3)
    to[:2, 2], back[:2, 2] = -center, center + rng.uniform(-60, 60, 2)
    matrix = back @ local @ to
    jacobian = geometry.homography_jacobian(matrix, center[None])[0]
    affine = np.eye(3)
    affine[:2, :2] = jacobian
    affine[:2, 2] = mapped(matrix, center[None])[0] - jacobian @ center
    return matrix, affine


def mapped(matrix, points):
    p = geometry.homogeneous(points) @ matrix.T
    return p[:, :2] / p[:, 2:]


def regions(seed, count, groups=3):
    """`groups` regions with `count` exact points each."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform(100, 2000, (groups, 2))
    truth, prior = zip(*[random_map(rng, c, 60.0) for c in centers], strict=True)
    left = [c + rng.uniform(-60, 60, (count, 2)) for c in centers]
    right = [mapped(m, p) for m, p in zip(truth, left, strict=True)]
    return truth, np.stack(prior), np.concatenate(left), np.concatenate(right), np.repeat(np.arange(groups), count)


def fit(left, right, group, prior, **config):
    points = PointMatches(left, right, np.ones(len(left)))
    return fit_homographies(points, np.arange(len(left)), group, prior, HomographyConfig(**config))


@given(seeds, st.integers(12, 60), st.booleans())
@settings(max_examples=25, deadline=None)
def test_exact_points_give_the_exact_map_and_that_of_opencv(seed, count, with_prior):
    truth, prior, left, right, group = regions(seed, count)
    weights = {} if with_prior else {"affine_prior": 0.0, "projective_prior": 0.0}
    matrices = fit(left, right, group, prior, **weights)
    near = 0.4 if with_prior else 1e-3  # px; the prior pulls a strong perspective a little
    for g, matrix in enumerate(matrices):
        mine = group == g
        opencv, _ = cv2.findHomography(left[mine], right[mine], 0)
        assert mapped(matrix, left[mine]) == pytest.approx(right[mine], abs=near)
        assert mapped(matrix, left[mine]) == pytest.approx(mapped(opencv, left[mine]), abs=near)
        center = left[mine].mean(0)
        assert matrix[2] @ [*center, 1] == pytest.approx(1)
        assert mapped(matrix, center[None]) == pytest.approx(mapped(truth[g], center[None]), abs=near)


@pytest.mark.parametrize("count", [15, 30, 60])
def test_one_point_in_five_may_be_wrong(count):
    errors = []
    for seed in range(60):
        _, prior, left, right, group = regions(seed, count)
        rng = np.random.default_rng(seed)
        noisy = right + rng.normal(0, 0.2, right.shape)
        wrong = np.arange(len(left)) % 5 == 0
        angle = rng.uniform(0, 2 * np.pi, len(left))
        noisy[wrong] += (rng.uniform(15, 80, len(left))[:, None] * np.c_[np.cos(angle), np.sin(angle)])[wrong]
        for g, matrix in enumerate(fit(left, noisy, group, prior)):
            mine = (group == g) & ~wrong
            errors.append(np.median(np.linalg.norm(mapped(matrix, left[mine]) - right[mine], axis=1)))
    assert np.median(errors) < 0.2
    assert np.quantile(errors, 0.95) < 0.4


@given(seeds, st.sampled_from([1, 2, 3, "collinear", "one place"]))
@settings(max_examples=30, deadline=None)
def test_what_the_points_leave_open_is_the_prior(seed, kind):
    rng = np.random.default_rng(seed)
    center = rng.uniform(100, 2000, 2)
    _, prior = random_map(rng, center, 60.0)
    if kind == "collinear":
        left = center + rng.uniform(-50, 50, (12, 1)) * [[0.6, 0.8]]
    elif kind == "one place":
        left = np.tile(center, (12, 1))
    else:
        left = center + rng.uniform(-50, 50, (kind, 2))
    matrix = fit(left, mapped(prior, left), np.zeros(len(left), int), prior[None])[0]
    around = center + star(rng, 8, size=60)
    assert np.isfinite(matrix).all()
    assert mapped(matrix, around) == pytest.approx(mapped(prior, around), abs=0.05)


@given(seeds, st.integers(1, 3))
@settings(max_examples=30, deadline=None)
def test_few_noisy_points_stay_near_the_prior(seed, count):
    rng = np.random.default_rng(seed)
    center = rng.uniform(100, 2000, 2)
    _, prior = random_map(rng, center, 60.0)
    left = center + rng.uniform(-40, 40, (count, 2))
    shift = rng.uniform(-5, 5, 2)
    matrix = fit(left, mapped(prior, left) + shift, np.zeros(count, int), prior[None])[0]
    assert mapped(matrix, left) == pytest.approx(mapped(prior, left) + shift, abs=0.1)
    assert mapped(matrix, center[None]) == pytest.approx(mapped(prior, center[None]) + shift, abs=1.0)


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_a_noisy_small_region_far_from_the_corner_is_not_lost(seed):
    rng = np.random.default_rng(seed)
    center, shift = np.array([3500.0, 2200.0]), np.array([30.0, -4.0])
    left = center + rng.uniform(-12, 12, (8, 2))
    prior = np.eye(3)
    prior[:2, 2] = shift
    matrix = fit(left, left + shift + rng.normal(0, 0.7, left.shape), np.zeros(8, int), prior[None])[0]
    polygon = arrays([center + star(rng, 10, size=10)])
    moved = transform_polygons(polygon, np.zeros(1, np.int64), matrix[None])[0]
    assert iou(np.array([moved]), np.array([shapely.affinity.translate(polygon.shapes[0], *shift)]))[0] > 0.4


def test_groups_do_not_influence_each_other():
    _, prior, left, right, group = regions(4, 15)
    together = fit(left, right, group, prior)
    for g in range(len(prior)):
        mine = group == g
        alone = fit(left[mine], right[mine], np.zeros(mine.sum(), int), prior[g : g + 1])
        assert alone[0] == pytest.approx(together[g], rel=1e-6, abs=1e-9)


def test_placed_maps_put_the_centre_to_its_place():
    rng = np.random.default_rng(3)
    polygons = arrays([star(rng, 8, (100, 80), 30), star(rng, 8, (300, 200), 30)])
    homography, _ = random_map(rng, np.array([200.0, 150.0]), 900.0)
    homography /= homography[2, 2]
    places = np.array([[90.0, 77.0], [310.0, 190.0]])
    each = Candidates(np.arange(2), np.arange(2))
    for h in (homography, Failed("none")):
        initial = InitialGeometry(PointMatches.empty(), Failed("none"), h, np.zeros(0, bool), np.zeros(0, bool))
        expected_by_h = initial.prior_locations(polygons.centers)
        placement = PyramidLocations(places, np.ones(2, bool), np.ones(2), np.zeros(2, bool), expected_by_h)
        matrices = placement.maps(polygons.centers, each.left)
        for k in range(2):
            center = polygons.centers[k]
            assert mapped(matrices[k], center[None])[0] == pytest.approx(places[k])
            expected = np.eye(2) if h is not homography else geometry.homography_jacobian(h, center[None])[0]
            assert matrices[k][:2, :2] == pytest.approx(expected)


def test_rectified_shapes_move_holes_and_drop_what_lies_beyond_the_horizon():
    polygons = arrays([square(0, 0, 10, 10), square(20, 0, 40, 10)], [(square(4, 4, 6, 6),), ()])
    shift, horizon = np.eye(3), np.eye(3)
    shift[:2, 2] = 5, 7
    horizon[2, 0] = -1 / 30
    moved = transform_polygons(polygons, np.array([0, 1, 1]), np.stack([shift, shift, horizon]))
    assert moved[0].equals(shapely.Polygon(square(5, 7, 15, 17), [square(9, 11, 11, 13)]))
    assert moved[1].equals(shapely.Polygon(square(25, 7, 45, 17)))
    assert moved[2].is_empty
    assert polygons.shapes[0].bounds == (0, 0, 10, 10)
    assert len(transform_polygons(polygons, np.zeros(0, np.int64), np.zeros((0, 3, 3)))) == 0


def test_overlaps():
    first = np.array([shapely.box(0, 0, 10, 10)] * 4 + [shapely.Polygon()])
    second = np.array(
        [
            shapely.box(0, 0, 10, 10),
            shapely.box(5, 0, 15, 10),
            shapely.box(20, 0, 30, 10),
            shapely.Polygon(),
            shapely.Polygon(),
        ]
    )
    assert iou(first, second) == pytest.approx([1, 1 / 3, 0, 0, 0])


def test_a_shape_whose_rings_cross_keeps_its_larger_part():
    touching = np.array([(4, 1), (7, 7), (6, 5), (5, 1), (6, 0), (7, 7)], float)
    for ring in (touching, touching[::-1]):
        (found,) = transform_polygons(arrays([ring]), np.array([0]), np.diag([2.0, 3, 1])[None])
        assert found.is_valid
        assert found.area == pytest.approx(5 * 2 * 3)


def reference(points, point, group, prior, config):
    """`fit_homographies`, one group and one pair of points after the other."""
    found = []
    for k, start in enumerate(prior):
        x, u = points.left[point[group == k]], points.right[point[group == k]]
        (x_mean, x_size), (u_mean, u_size) = (
            (xy.mean(0), max(np.sqrt((xy - xy.mean(0)).var(0).sum()), 1)) for xy in (x, u)
        )
        x, u = (x - x_mean) / x_size, (u - u_mean) / u_size
        to = np.array([[1 / x_size, 0, -x_mean[0] / x_size], [0, 1 / x_size, -x_mean[1] / x_size], [0, 0, 1]])
        back = np.array([[u_size, 0, u_mean[0]], [0, u_size, u_mean[1]], [0, 0, 1]])
        start = np.linalg.inv(back) @ start @ np.linalg.inv(to)
        start = start / start[2, 2]
        held = np.array([config.affine_prior] * 6 + [config.projective_prior] * 2) + 1e-9
        held[[2, 5]] = 1e-9
        h = start
        for iteration in range(config.iterations):
            p = geometry.homogeneous(x) @ h.T
            depth = np.maximum(p[:, 2], 1e-3)
            residual = np.linalg.norm(p[:, :2] / depth[:, None] - u, axis=1) * u_size
            wide = iteration < config.wide_iterations
            scale = max(config.residual, np.sort(residual)[(len(x) - 1) // 2] if wide else 0)
            weight = 1 / (1 + (residual / scale) ** 2) / depth**2
            normal, target = np.diag(held), held * start.ravel()[:8]
            for (a, b), (c, d), w in zip(x, u, weight, strict=True):
                for row, value in (([a, b, 1, 0, 0, 0, -c * a, -c * b], c), ([0, 0, 0, a, b, 1, -d * a, -d * b], d)):
                    normal = normal + w * np.outer(row, row)
                    target = target + w * np.array(row) * value
            h = np.append(np.linalg.solve(normal, target), 1).reshape(3, 3)
        found.append(back @ h @ to)
    return np.array(found)


@given(seeds, st.integers(1, 20))
@settings(max_examples=10, deadline=None)
def test_all_groups_at_once_are_as_one_after_the_other(seed, count):
    _, prior, left, right, group = regions(seed, count)
    noisy = right + np.random.default_rng(seed).normal(0, 1.0, right.shape)
    asked = PointMatches(left, noisy, np.ones(len(left))), np.arange(len(left)), group, prior, HomographyConfig()
    np.testing.assert_allclose(fit_homographies(*asked), reference(*asked), rtol=1e-6, atol=1e-6)
