"""Two-view geometry: F, H and E from homologous points, and distances and maps by them.

Points are (n, 2) float64 image px with pixel centres at +0.5; F and H are in the same coordinates: p_right^T F p_left
= 0 and p_right ~ H p_left. OpenCV's estimators work for any origin, so points need no shift.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from zpm2.config import MagsacConfig
from zpm2.errors import Failed

Array = NDArray[np.float64]
Estimator = Callable[[Array, Array, "cv2.UsacParams"], tuple[Array | None, NDArray[np.uint8] | None]]
HALF_PIXEL: Array = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])  # from centres at 0
DEFAULTS = MagsacConfig()


def homogeneous(points: Array) -> Array:
    """(n, 2) -> (n, 3) with a last column of ones."""
    return np.c_[points, np.ones(len(points))]


def project(homography: Array, points: Array) -> Array:
    """(n, 2) points mapped by a 3 x 3 homography; NaN for points on or behind its horizon.

    Its sign says which side is which: points in front have a positive third coordinate.
    """
    p = homogeneous(points) @ (homography / np.abs(homography).max()).T
    w = p[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(w > 1e-12, p[:, :2] / w, np.nan)


def turn_image(width: int, height: int, angle: float) -> tuple[Array, tuple[int, int]]:
    """(3, 3) map that turns an image by `angle` radians from x to y, px to px of the result, and the (width, height) px
    of the smallest result that contains all of it."""
    c, s = np.cos(angle).round(12), np.sin(angle).round(12)
    wide, high = int(np.ceil(width * abs(c) + height * abs(s))), int(np.ceil(width * abs(s) + height * abs(c)))
    matrix = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    matrix[:2, 2] = np.array([wide, high]) / 2 - matrix[:2, :2] @ [width / 2, height / 2]
    return matrix, (wide, high)


def for_opencv(matrix: Array) -> Array:
    """(3, 3) map between px with centres at +0.5 -> the same between px with centres at 0, as OpenCV warps."""
    return np.asarray(np.linalg.inv(HALF_PIXEL) @ matrix @ HALF_PIXEL)


def homography_jacobian(homography: Array, points: Array) -> Array:
    """(n, 2, 2) derivative of `project` at each point: the local affine part of a homography."""
    return linearised(np.broadcast_to(homography, (len(points), 3, 3)), points)[1]


def linearised(homographies: Array, points: Array) -> tuple[Array, Array]:
    """(n, 2) points, each mapped by its own of (n, 3, 3) homographies, and (n, 2, 2) the derivatives there."""
    p = np.einsum("nij,nj->ni", homographies, homogeneous(points))
    w = p[:, 2:]
    at = p[:, :2] / w
    return at, (homographies[:, :2, :2] - at[:, :, None] * homographies[:, 2:, :2]) / w[:, :, None]


def epipolar_lines(fundamental: Array, left: Array) -> Array:
    """(n, 3) lines a x + b y + c = 0 in the right image, with a^2 + b^2 = 1, of (n, 2) left points."""
    lines = homogeneous(left) @ fundamental.T
    norm = np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    return np.asarray(lines / np.maximum(norm, 1e-300))


def turn_rays(rotation: Array, rays: Array) -> Array:
    """(n, 2) rays x / z, y / z in a frame turned by `rotation` (3, 3); NaN where they point backwards there."""
    p = homogeneous(rays) @ rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(p[:, 2:] > 1e-6, p[:, :2] / p[:, 2:], np.nan)


def sight_angles(points: Array, first: Array, second: Array) -> Array:
    """(n,) degrees between the lines to points (n, 3) from two centres (3,)."""
    a, b = points - first, points - second
    cosine = np.einsum("ni,ni->n", a, b) / (np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def epipolar_distance(fundamental: Array, left: Array, right: Array) -> Array:
    """(n,) px: distance of each right point to the epipolar line of its left point."""
    return np.abs(np.einsum("ni,ni->n", epipolar_lines(fundamental, left), homogeneous(right)))


def sampson_distance(fundamental: Array, left: Array, right: Array) -> Array:
    """(n,) px: first-order distance of a pair to the epipolar constraint, both images counted
    (Hartley and Zisserman, Multiple View Geometry, 2nd ed., Eq. 11.9, square root)."""
    return np.abs(signed_sampson_distance(fundamental, left, right))


def signed_sampson_distance(fundamental: Array, left: Array, right: Array) -> Array:
    """(n,) `sampson_distance` with the sign of the algebraic error, so that it has a derivative at 0."""
    l2 = homogeneous(left) @ fundamental.T
    l1 = homogeneous(right) @ fundamental
    e = np.einsum("ni,ni->n", homogeneous(right), l2)
    return np.asarray(e / np.sqrt(np.maximum((l2[:, :2] ** 2).sum(1) + (l1[:, :2] ** 2).sum(1), 1e-300)))


def sampson_table(fundamental: Array, left: Array, right: Array) -> Array:
    """(n, m) `sampson_distance` of each of n left points with each of m right points."""
    l2 = homogeneous(left) @ fundamental.T
    l1 = homogeneous(right) @ fundamental
    squares = (l2[:, :2] ** 2).sum(1)[:, None] + (l1[:, :2] ** 2).sum(1)
    return np.asarray(np.abs(l2 @ homogeneous(right).T) / np.sqrt(np.maximum(squares, 1e-300)))


def fundamental_matrix(
    left: Array, right: Array, threshold: float, seed: int = 0, config: MagsacConfig = DEFAULTS
) -> tuple[Array, NDArray[np.bool_]] | Failed:
    """F (3 x 3, norm 1) by MAGSAC++ (OpenCV's USAC) and its (n,) inliers, or why there is none.

    `threshold` in px.
    """
    if len(left) < config.min_fundamental:
        return Failed(f"a fundamental matrix needs {config.min_fundamental} homologous points, there are {len(left)}")
    matrix, mask = _usac(cv2.findFundamentalMat, left, right, threshold, seed, config)
    if matrix is None or matrix.shape[0] < 3 or not np.isfinite(matrix).all():
        return Failed("no fundamental matrix fits the homologous points")
    matrix = matrix[:3]  # OpenCV may return several solutions, stacked, the best one first
    inliers = epipolar_inliers(matrix, left, right, threshold) if mask is None else mask.ravel().astype(bool)
    if inliers.sum() < config.min_fundamental:
        return Failed(f"only {int(inliers.sum())} of {len(left)} homologous points agree on a fundamental matrix")
    return matrix / np.linalg.norm(matrix), inliers


def epipolar_inliers(fundamental: Array, left: Array, right: Array, threshold: float) -> NDArray[np.bool_]:
    """(n,) whether a pair lies within `threshold` px (Sampson) of the epipolar constraint."""
    return sampson_distance(fundamental, left, right) <= threshold


def homography(
    left: Array, right: Array, threshold: float, seed: int = 0, config: MagsacConfig = DEFAULTS
) -> tuple[Array, NDArray[np.bool_]] | Failed:
    """H (3 x 3) by MAGSAC++ and its (n,) inliers, or why there is none. `threshold` in px.

    H[2, 2] is 1, or -1 where the left image's corner (0, 0) lies behind the horizon of H: as `project` wants it, its
    inliers lie in front.
    """
    if len(left) < config.min_homography:
        return Failed(f"a homography needs {config.min_homography} homologous points, there are {len(left)}")
    matrix, mask = _usac(cv2.findHomography, left, right, threshold, seed, config)
    if (
        matrix is None
        or mask is None
        or not np.isfinite(matrix).all()
        or abs(np.linalg.det(matrix)) < 1e-9
        or not matrix[2, 2]
    ):
        return Failed("no homography fits the homologous points")
    inliers = mask.ravel().astype(bool)
    if inliers.sum() < config.min_homography:
        return Failed(f"only {int(inliers.sum())} of {len(left)} homologous points agree on a homography")
    depth = np.median(homogeneous(left[inliers]) @ matrix[2])
    return matrix * np.sign(depth) / abs(matrix[2, 2]), inliers


def essential_matrix(
    left: Array, right: Array, threshold: float, seed: int = 0, config: MagsacConfig = DEFAULTS
) -> tuple[Array, NDArray[np.bool_]] | Failed:
    """E (3 x 3) and the (n,) inliers, or why there is none: r_right^T E r_left = 0.

    By the five-point algorithm in MAGSAC++. Homologous rays (n, 2) are x / z, y / z of each camera, `threshold` is in
    the same units (px / focal length).
    """
    matrix, mask = _usac(
        lambda a, b, params: cv2.findEssentialMat(a, b, np.eye(3), np.eye(3), None, None, params),
        *(left, right, threshold, seed, config),
    )
    if matrix is None or mask is None or matrix.shape[0] < 3 or not np.isfinite(matrix).all():
        return Failed("no essential matrix fits the homologous points")
    return matrix[:3], mask.ravel().astype(bool)


def in_front(rotation: Array, translation: Array, left: Array, right: Array) -> NDArray[np.bool_]:
    """(n,) whether homologous rays (n, 2) meet in front of both cameras."""
    a, b = homogeneous(left) @ rotation.T, homogeneous(right)
    # depths from s a + t = z b in the least-squares sense
    aa, bb, ab = (a * a).sum(1), (b * b).sum(1), (a * b).sum(1)
    at, bt = a @ translation, b @ translation
    scale = aa * bb - ab**2
    return np.asarray((ab * bt - bb * at > 0) & (aa * bt - ab * at > 0) & (scale > 0))


def eight_points(left: Array, right: Array) -> Array:
    """F (3 x 3, norm 1, rank 2) of (n, 2) points, n >= 8, all of them inliers: the normalised eight-point algorithm
    (Hartley, PAMI 1997)."""
    moves = []
    for points in (left, right):
        middle = points.mean(0)
        scale = np.sqrt(2) / max(float(np.linalg.norm(points - middle, axis=1).mean()), 1e-300)
        moves.append(np.array([[scale, 0, -scale * middle[0]], [0, scale, -scale * middle[1]], [0, 0, 1.0]]))
    a, b = (homogeneous(points) @ move.T for points, move in zip((left, right), moves, strict=True))
    rows = (b[:, :, None] * a[:, None, :]).reshape(-1, 9)
    matrix = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    u, singular, v = np.linalg.svd(matrix)
    matrix = moves[1].T @ (u @ np.diag([singular[0], singular[1], 0.0]) @ v) @ moves[0]
    return np.asarray(matrix / np.linalg.norm(matrix))


def cross_matrix(vector: Array) -> Array:
    """(3, 3) [v]x: its product with w is the cross product of v (3,) and w."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _usac(
    estimate: Estimator, left: Array, right: Array, threshold: float, seed: int, config: MagsacConfig
) -> tuple[Array | None, NDArray[np.uint8] | None]:
    """Runs one of OpenCV's robust estimators with MAGSAC++ scoring; None if it fails."""
    params = cv2.UsacParams()
    params.score = cv2.SCORE_METHOD_MAGSAC
    params.sampler = cv2.SAMPLING_UNIFORM
    params.loMethod = cv2.LOCAL_OPTIM_SIGMA
    params.final_polisher = cv2.MAGSAC
    params.final_polisher_iterations = config.polish_iterations
    params.loIterations = config.local_iterations
    params.loSampleSize = config.local_samples
    params.neighborsSearch = cv2.NEIGH_GRID
    params.isParallel = False
    params.confidence = config.confidence
    params.maxIterations = config.max_iterations
    params.threshold = threshold
    params.randomGeneratorState = seed
    try:
        return estimate(np.ascontiguousarray(left), np.ascontiguousarray(right), params)
    except cv2.error:
        return None, None
