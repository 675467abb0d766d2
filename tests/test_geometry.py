import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from zpm2 import geometry
from zpm2.config import MagsacConfig
from zpm2.errors import Failed
from zpm2.polygons.repair import largest, polygons_in, repaired

K = np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]])
seeds = st.integers(0, 10**6)


def rotation(axis_angle):
    angle = np.linalg.norm(axis_angle)
    x, y, z = axis_angle / max(angle, 1e-12)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def cameras(seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    return rotation(rng.normal(0, 0.05, 3)), 0.6 * direction / np.linalg.norm(direction), rng


def scene(seed, n=60):
    """Left and right projections of n points in space, and the exact F."""
    r, t, rng = cameras(seed)
    space = np.c_[rng.uniform(-2, 2, n), rng.uniform(-1.5, 1.5, n), rng.uniform(4, 9, n)]
    left, right = space @ K.T, (space @ r.T + t) @ K.T
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    f = np.linalg.inv(K).T @ cross @ r @ np.linalg.inv(K)
    return left[:, :2] / left[:, 2:], right[:, :2] / right[:, 2:], f / np.linalg.norm(f)


def plane(seed, n=60):
    """Left and right projections of n points of a plane, and the exact H."""
    r, t, rng = cameras(seed)
    normal = np.array([*rng.uniform(-0.3, 0.3, 2), 1.0])
    h = K @ (r + np.outer(t, normal) / 6.0) @ np.linalg.inv(K)
    left = rng.uniform((0, 0), (640, 480), (n, 2))
    right = np.c_[left, np.ones(n)] @ h.T
    return left, right[:, :2] / right[:, 2:], h / h[2, 2]


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_fundamental_matrix_of_exact_points(seed):
    left, right, truth = scene(seed)
    matrix, inliers = geometry.fundamental_matrix(left, right, 1.0)
    assert inliers.dtype == bool
    assert inliers.sum() >= 0.95 * len(left)
    assert np.linalg.norm(matrix) == pytest.approx(1)
    assert np.median(geometry.sampson_distance(matrix, left, right)) < 0.05
    assert geometry.sampson_distance(truth, left, right).max() < 1e-6


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_homography_of_exact_points(seed):
    left, right, truth = plane(seed)
    matrix, inliers = geometry.homography(left, right, 1.0)
    assert inliers.all()
    assert matrix[2, 2] == pytest.approx(1)
    assert np.abs(geometry.project(matrix, left) - right).max() < 0.01
    assert np.abs(geometry.project(matrix, left) - geometry.project(truth, left)).max() < 0.01


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_wrong_points_are_found_out(seed):
    left, right, _ = plane(seed, 100)
    rng = np.random.default_rng(seed + 1)
    right[60:] += np.where(rng.random((40, 2)) < 0.5, -1, 1) * rng.uniform(40, 150, (40, 2))
    _, inliers = geometry.homography(left, right, 2.0)
    assert inliers[:60].all()
    assert not inliers[60:].any()

    left, right, truth = scene(seed, 100)
    lines = geometry.epipolar_lines(truth, left[60:])
    right[60:] += lines[:, :2] * rng.uniform(40, 150, (40, 1))
    _, inliers = geometry.fundamental_matrix(left, right, 1.0)
    assert inliers[:60].mean() > 0.9
    assert inliers[60:].mean() < 0.2


def test_the_search_for_a_model_is_configured():
    left, right, _ = scene(2, 100)
    right[40:] = np.random.default_rng(0).uniform(0, 500, (60, 2))
    found = geometry.fundamental_matrix(left, right, 1.0)
    assert not isinstance(found, Failed)
    assert found[1][:40].mean() > 0.9
    short = geometry.fundamental_matrix(left, right, 1.0, config=MagsacConfig(max_iterations=1))
    assert isinstance(short, Failed) or short[1][:40].mean() < 0.9
    many = MagsacConfig(min_fundamental=101, min_homography=102)
    for estimate, count in ((geometry.fundamental_matrix, 101), (geometry.homography, 102)):
        refused = estimate(left, right, 1.0, config=many)
        assert isinstance(refused, Failed)
        assert f"needs {count} homologous points, there are 100" in refused.reason


def test_noise_moves_the_estimate_a_little():
    left, right, truth = scene(4, 300)
    rng = np.random.default_rng(0)
    matrix, inliers = geometry.fundamental_matrix(
        left + rng.normal(0, 0.3, left.shape), right + rng.normal(0, 0.3, right.shape), 2.0
    )
    assert inliers.mean() > 0.95
    assert np.median(geometry.epipolar_distance(matrix, left, right)) < 0.3
    assert min(np.abs(matrix - truth).max(), np.abs(matrix + truth).max()) < 0.01


@pytest.mark.parametrize("estimate", [geometry.fundamental_matrix, geometry.homography])
def test_one_seed_gives_one_answer(estimate):
    left, right, _ = scene(7, 200)
    right[120:] = np.random.default_rng(1).uniform(0, 480, (80, 2))
    a, b = estimate(left, right, 3.0, seed=5), estimate(left, right, 3.0, seed=5)
    assert a
    assert b
    assert a[0].tobytes() == b[0].tobytes()
    assert a[1].tobytes() == b[1].tobytes()


same = np.full((20, 2), 50.0)
line = np.c_[np.arange(20.0), 2 * np.arange(20.0)]


@pytest.mark.parametrize(
    ("left", "right"),
    [(same, same), (line, line), (same, line), (np.full((20, 2), np.nan),) * 2, (np.zeros((0, 2)),) * 2],
    ids=["one point", "one line", "point to line", "not a number", "no points"],
)
@pytest.mark.parametrize("estimate", [geometry.fundamental_matrix, geometry.homography])
def test_points_that_determine_nothing(estimate, left, right):
    result = estimate(left, right, 1.0)
    assert isinstance(result, Failed)
    assert result.reason


@pytest.mark.parametrize(("estimate", "needed"), [(geometry.fundamental_matrix, 8), (geometry.homography, 6)])
def test_too_few_points_say_how_many_are_needed(estimate, needed):
    left, right, _ = plane(2, needed - 1)
    reason = str(estimate(left, right, 1.0))
    assert f"{needed} homologous points" in reason
    assert f"there are {needed - 1}" in reason


def test_points_without_a_common_geometry():
    rng = np.random.default_rng(0)
    result = geometry.homography(rng.uniform(0, 500, (40, 2)), rng.uniform(0, 500, (40, 2)), 1.0)
    assert isinstance(result, Failed)
    assert "of 40 homologous points agree" in result.reason


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_epipolar_distances_against_plain_formulas(seed):
    left, right, f = scene(seed, 10)
    right = right + np.random.default_rng(seed).normal(0, 5, right.shape)
    lines = geometry.epipolar_lines(f, left)
    distance, sampson = geometry.epipolar_distance(f, left, right), geometry.sampson_distance(f, left, right)
    for k in range(len(left)):
        p, q = np.array([*left[k], 1.0]), np.array([*right[k], 1.0])
        a, b, c = f @ p
        assert np.allclose(lines[k], np.array([a, b, c]) / np.hypot(a, b))
        assert distance[k] == pytest.approx(abs(q @ f @ p) / np.hypot(a, b))
        back = f.T @ q
        assert sampson[k] == pytest.approx(abs(q @ f @ p) / np.sqrt(a**2 + b**2 + back[0] ** 2 + back[1] ** 2))
    assert (sampson <= distance + 1e-12).all()
    assert np.array_equal(geometry.epipolar_inliers(f, left, right, 2.0), sampson <= 2.0)


@given(seeds, st.floats(0.1, 30))
@settings(max_examples=30, deadline=None)
def test_a_point_off_its_line_is_that_far_away(seed, offset):
    left, right, f = scene(seed, 10)
    moved = right + offset * geometry.epipolar_lines(f, left)[:, :2]
    assert geometry.epipolar_distance(f, left, moved) == pytest.approx(offset, rel=1e-6)


def test_the_epipole_has_no_line_and_gives_no_nan():
    f = np.array([[0.0, 1, -2], [-1, 0, 3], [2, -3, 0]])  # pure translation: the epipole is (3, 2) in both images
    epipole = np.array([[3.0, 2.0]])
    assert np.array_equal(geometry.epipolar_lines(f, epipole), np.zeros((1, 3)))
    assert geometry.sampson_distance(f, epipole, epipole).tolist() == [0]


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_project_and_back(seed):
    left, right, h = plane(seed, 20)
    assert np.allclose(geometry.project(h, left), right)
    assert np.allclose(geometry.project(np.linalg.inv(h), right), left)
    assert np.allclose(geometry.project(3 * h, left), right)
    assert np.isnan(geometry.project(-h, left)).all()


def test_nothing_is_seen_on_or_behind_the_horizon():
    h = np.array([[1, 0, 0], [0, 1, 0], [-0.02, 0, 1.0]])  # horizon: x = 50
    points = np.array([[25.0, 10], [50, 10], [60, 10]])
    assert geometry.project(h, points)[0] == pytest.approx([50, 20])
    assert np.isnan(geometry.project(h, points)[1:]).all()


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_points_lie_before_their_own_homography_where_the_corner_does_not(seed):
    """A camera moves forward over the ground: what lies at the bottom, y > 400, is behind it then. Where photographs
    are stored upside down, their corner (0, 0) is there."""
    left = np.random.default_rng(seed).uniform((0, 0), (640, 300), (60, 2))
    right = np.c_[left, np.ones(60)] @ np.array([[1, 0.02, 5], [0.01, 1, 3], [0, -0.0025, 1.0]]).T
    right = right[:, :2] / right[:, 2:]
    for a, b in ((left, right), ([640, 480] - left, [640, 480] - right)):
        matrix, inliers = geometry.homography(a, b, 1.0)
        assert inliers.all()
        assert abs(matrix[2, 2]) == 1
        assert np.allclose(geometry.project(matrix, a), b, atol=1e-3)
        assert np.allclose(geometry.project(np.linalg.inv(matrix), b), a, atol=1e-3)


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_jacobian_against_finite_differences(seed):
    left, _, h = plane(seed, 10)
    jacobian = geometry.homography_jacobian(h, left)
    assert jacobian.shape == (10, 2, 2)
    step = 1e-3
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        slope = (geometry.project(h, left + shift) - geometry.project(h, left - shift)) / (2 * step)
        assert np.allclose(jacobian[:, :, axis], slope, atol=1e-5)


@given(st.floats(-100, 100), st.floats(-100, 100), st.floats(0.1, 3), st.floats(-3, 3))
def test_jacobian_of_a_similarity_is_its_linear_part(x, y, scale, angle):
    assume(abs(angle) > 1e-3)
    linear = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    h = np.eye(3)
    h[:2, :2], h[:2, 2] = linear, (5, -7)
    assert np.allclose(geometry.homography_jacobian(h, np.array([[x, y]]))[0], linear)


def test_empty_arrays_pass_through():
    none = np.zeros((0, 2))
    assert geometry.project(np.eye(3), none).shape == (0, 2)
    assert geometry.homography_jacobian(np.eye(3), none).shape == (0, 2, 2)
    assert geometry.epipolar_lines(np.eye(3), none).shape == (0, 3)
    assert geometry.epipolar_distance(np.eye(3), none, none).shape == (0,)
    assert geometry.sampson_distance(np.eye(3), none, none).shape == (0,)
    assert np.array_equal(geometry.homogeneous(np.array([[1.0, 2.0]])), [[1, 2, 1]])


def two_cameras(seed: int = 0, n: int = 300) -> tuple[np.ndarray, ...]:
    """Points of a scene seen by two different cameras: K, K', R, t, left and right px."""
    rng = np.random.default_rng(seed)
    k, k2 = (
        np.array([[800, 0, 500.5], [0, 790, 400.5], [0, 0, 1]]),
        np.array([[600, 0, 300.5], [0, 610, 200], [0, 0, 1]]),
    )
    turn = rotation(rng.normal(0, 0.1, 3))
    translation = rng.normal(0, 1, 3)
    world = rng.uniform([-3, -3, 6], [3, 3, 14], (n, 3))
    left, right = world @ k.T, (world @ turn.T + translation) @ k2.T
    return k, k2, turn, translation, left[:, :2] / left[:, 2:], right[:, :2] / right[:, 2:]


def rays_of(k: np.ndarray, points: np.ndarray) -> np.ndarray:
    return (geometry.homogeneous(points) @ np.linalg.inv(k).T)[:, :2]


@pytest.mark.parametrize("seed", range(3))
def test_essential_matrix_and_which_points_lie_before_both_cameras(seed: int) -> None:
    k, k2, turn, translation, left, right = two_cameras(seed)
    a, b = rays_of(k, left), rays_of(k2, right)
    found = geometry.essential_matrix(a, b, 1 / 700)
    assert not isinstance(found, Failed)
    assert found[1].mean() > 0.95
    truth = geometry.cross_matrix(translation) @ turn
    assert geometry.sampson_distance(truth, a, b).max() < 1e-12
    assert geometry.sampson_distance(found[0], a, b).max() < 1e-4
    assert geometry.in_front(turn, translation, a, b).all()
    assert not geometry.in_front(turn, -translation, a, b).any()


@pytest.mark.parametrize("seed", range(3))
def test_eight_points_fit_exact_ones(seed: int) -> None:
    k, k2, turn, translation, left, right = two_cameras(seed)
    truth = np.linalg.inv(k2).T @ geometry.cross_matrix(translation) @ turn @ np.linalg.inv(k)
    found = geometry.eight_points(left, right)
    truth = truth / np.linalg.norm(truth)
    assert min(np.abs(found - truth).max(), np.abs(found + truth).max()) < 1e-8
    assert abs(np.linalg.det(found)) < 1e-15


@pytest.mark.parametrize(
    ("ring", "area"),
    [
        ([(4, 1), (7, 7), (6, 5), (5, 1), (6, 0), (7, 7)], 5.0),  # touches itself: buffer(0) keeps nothing
        ([(1, 6), (7, 6), (3, 6), (1, 6), (0, 2), (7, 6)], 12.0),  # runs back on itself: likewise
        ([(0, 0), (30, 30), (30, -10), (0, 20)], 400.0),  # a bow tie of 400 and 100
        ([(3, 2), (4, 4), (1, 7), (5, 0), (2, 7)], 4.2423),  # encloses a part twice: make_valid keeps 0.7
    ],
)
def test_a_crossed_ring_keeps_its_larger_piece(ring: list[tuple[int, int]], area: float) -> None:
    for way in (ring, ring[::-1]):
        found = repaired(shapely.Polygon(way))
        assert found.is_valid
        assert found.area == pytest.approx(area, abs=1e-3)


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=3, max_size=9))
@settings(max_examples=200, deadline=None)
def test_any_ring_becomes_a_valid_polygon_of_what_it_encloses(ring: list[tuple[int, int]]) -> None:
    shape = shapely.Polygon(ring)
    found = repaired(shape)
    assert found.geom_type == "Polygon"
    assert found.is_valid
    for way in (shapely.make_valid(shape), shape.buffer(0)):
        assert found.area >= max((piece.area for piece in polygons_in(way)), default=0.0)
    assert found.difference(shape.convex_hull.buffer(1e-9)).area == 0


def test_polygons_of_collections_of_collections() -> None:
    box = shapely.box(0, 0, 3, 3)
    inner = shapely.MultiPolygon([box, shapely.box(5, 5, 6, 6)])
    both = shapely.GeometryCollection([shapely.Point(0, 0), inner, shapely.LineString([(0, 0), (1, 1)])])
    assert [part.area for part in polygons_in(both)] == [9, 1]
    assert largest(both).equals(box)
    assert largest(shapely.Point(0, 0)).is_empty
