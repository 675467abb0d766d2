"""Algorithm 1 (paper 3.3.2) in plain loops, one polygon at a time: for reading, and to test `pyramid.py` with.

Where the paper leaves a choice, it is made as `pyramid.py` states. Clear rather than fast.
"""

import math

import numpy as np
from numpy.typing import NDArray

from zpm2 import geometry
from zpm2.config import GlobalConfig
from zpm2.errors import Failed
from zpm2.global_match.initial import InitialGeometry
from zpm2.global_match.pyramid import PyramidLocations, level_count
from zpm2.model import Image
from zpm2.photos.sampling import pyramid

Array = NDArray[np.float64]
Gray = NDArray[np.float32]


def locate(
    left: Image, right: Image, centers: Array, initial: InitialGeometry, config: GlobalConfig
) -> PyramidLocations:
    """The right image's locations of left polygons with (n, 2) centres, image px."""
    levels = level_count(left.width, left.height, config)
    x_pyramid, y_pyramid = pyramid(left.gray, levels, config.factor), pyramid(right.gray, levels, config.factor)
    n = len(centers)
    start = initial.prior_locations(centers)
    result = PyramidLocations(np.zeros((n, 2)), np.zeros(n, bool), np.zeros(n), np.zeros(n, bool), start)
    for i, c in enumerate(centers):
        at, jacobian = _predict(c, initial)
        result.outside[i] = not (0 <= at[0] < right.width and 0 <= at[1] < right.height)
        if np.isfinite(at).all() and config.search == "pyramid":
            size = 2 * config.tau  # W_tau at the top (line 4), W_phi of the level above later on (line 7)
            for k in range(levels, -1, -1):
                scale = config.factor**k
                template = cut_template(x_pyramid[k], c / scale, jacobian, config.phi)  # lines 1 and 2
                line = _epipolar_line(c, initial, scale)
                peak, score = _search(y_pyramid[k], template, at / scale, size, line, config)  # lines 8 and 9
                result.found[i] = score > 0
                if score > 0:
                    at, result.correlation[i] = peak * scale, score  # line 10
                size = config.phi * config.factor
        result.centers[i] = at
    return result


def cut_template(image: Gray, center: Array, jacobian: Array, phi: int) -> Array:
    """(phi, phi) values around `center`, px of the level, as the right image should show them."""
    back = np.linalg.inv(jacobian)
    half = phi // 2
    template = np.zeros((phi, phi))
    for row in range(phi):
        for column in range(phi):
            x, y = center + back @ [column - half, row - half]
            template[row, column] = _value(image, x - 0.5, y - 0.5)
    return template


def ncc(first: Array, second: Array) -> float:
    """R of Eq. (R) for two patches of the same size; 0 where one has no texture."""
    a, b = first - first.mean(), second - second.mean()
    energy = (a**2).sum() * (b**2).sum()
    return float((a * b).sum() / math.sqrt(energy)) if energy > a.size**2 * 1e-6 else 0.0


def _predict(c: Array, initial: InitialGeometry) -> tuple[Array, Array]:
    """c' = H c and the local affine part of H there."""
    if isinstance(initial.homography, Failed):
        return c, np.eye(2)
    at, jacobian = (f(initial.homography, c[None])[0] for f in (geometry.project, geometry.homography_jacobian))
    return at, jacobian


def _epipolar_line(c: Array, initial: InitialGeometry, scale: int) -> Array | None:
    """a, b, c of the epipolar line of `c`, in px of the level, a^2 + b^2 = 1."""
    if isinstance(initial.fundamental, Failed):
        return None
    a, b, offset = initial.fundamental @ [c[0], c[1], 1.0]
    return np.array([a, b, offset / scale]) / math.hypot(a, b)


def _search(
    image: Gray, template: Array, at: Array, size: int, line: Array | None, config: GlobalConfig
) -> tuple[Array, float]:
    """c'' and its NCC: the best position of the template in the window of `size` px around `at`; -2 where there is
    none."""
    half, middle = (size // 2 * 2 + 1 - config.phi) // 2, np.floor(at).astype(int)
    scores = {}
    if template.std() >= config.min_contrast:
        for dy in range(-half, half + 1):
            for dx in range(-half, half + 1):
                x, y = middle[0] + dx, middle[1] + dy
                if _allowed(image, x, y, line, config):
                    r = config.phi // 2
                    scores[dx, dy] = ncc(image[y - r : y + r + 1, x - r : x + r + 1].astype(np.float64), template)
    if not scores:
        return at, -2.0
    dx, dy = max(scores, key=lambda position: scores[position])
    best = scores[dx, dy]
    shift_x = _parabola(scores.get((dx - 1, dy)), best, scores.get((dx + 1, dy)))
    shift_y = _parabola(scores.get((dx, dy - 1)), best, scores.get((dx, dy + 1)))
    return middle + 0.5 + [dx + shift_x, dy + shift_y], best


def _allowed(image: Gray, x: int, y: int, line: Array | None, config: GlobalConfig) -> bool:
    """Whether the template fits into the image around pixel (x, y) and that pixel lies near the epipolar line."""
    r = config.phi // 2
    if not (r <= x < image.shape[1] - r and r <= y < image.shape[0] - r):
        return False
    return line is None or bool(abs(line @ [x + 0.5, y + 0.5, 1.0]) <= config.band)


def _parabola(before: float | None, peak: float, after: float | None) -> float:
    """Where the parabola through three equidistant values has its maximum; 0 where a neighbour is missing."""
    if before is None or after is None or before - 2 * peak + after >= -1e-9:
        return 0.0
    return min(max(0.5 * (before - after) / (before - 2 * peak + after), -0.5), 0.5)


def _value(image: Gray, x: float, y: float) -> float:
    """Bilinear value, pixel centres at 0, the border repeated."""
    h, w = image.shape
    x, y = min(max(x, 0.0), w - 1.0), min(max(y, 0.0), h - 1.0)
    x0, y0 = int(x), int(y)
    x1, y1 = min(x0 + 1, w - 1), min(y0 + 1, h - 1)
    top = image[y0, x0] * (x0 + 1 - x) + image[y0, x1] * (x - x0)
    bottom = image[y1, x0] * (x0 + 1 - x) + image[y1, x1] * (x - x0)
    return float(top * (y0 + 1 - y) + bottom * (y - y0))
