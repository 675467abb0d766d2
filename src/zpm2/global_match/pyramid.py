"""Bidirectional-pyramid matching (paper 3.3.2, Algorithm 1), for all polygons of a level at once.

Both images become Gaussian pyramids with factor 3 whose top level has a side of at most 200 px. At the top, H maps the
centre of each left polygon. From there, level by level downwards, normalised cross-correlation searches for a 15 x 15
template around the centre in a window of the right image, within a band around the epipolar line. The window found at
one level, mapped down, is the next level's search window. Where the paper leaves a choice:

- tau = 25 is read as half a side, so that the first search window has the printed initial search range of 50 x 50.
- The template is not cut out of the left image but sampled from it by the local affine part of H (3.3(3), geometric
  rectification), so that a rotated or scaled pair correlates.
- The epipolar constraint is a distance in px of the level. It restricts the positions that are searched, instead of
  rejecting the best one afterwards.
- If the template has no texture, the search window lies outside the right image, or the band misses the window, the
  centre stays where the level above (or H) put it, and `PyramidLocations.found` is False.

`reference.py` implements the same in plain loops, for reading and for tests.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft

from zpm2 import geometry
from zpm2.config import GlobalConfig
from zpm2.errors import Failed
from zpm2.global_match.initial import InitialGeometry, PriorLocations
from zpm2.model import Image
from zpm2.photos import sampling
from zpm2.photos.sampling import bilinear

Array = NDArray[np.float64]
CORRELATION_CHUNK = 64  # polygons at a time: more do not fit into the processor's cache


@dataclass(frozen=True, eq=False)
class PyramidLocations:
    """Where the pyramid puts each of n left polygons in the right image."""

    centers: Array  # (n, 2) px of the right image, sub-pixel; NaN where H has no image of a centre
    found: NDArray[np.bool_]  # (n,) confirmed by correlation at full resolution
    correlation: Array  # (n,) NCC at the finest level that correlated, -1..1; 0 where none did
    outside: NDArray[np.bool_]  # (n,) the prior location is not in the right image
    prior: PriorLocations  # where the search began

    @staticmethod
    def join(first: "PyramidLocations", second: "PyramidLocations") -> "PyramidLocations":
        """Those of some polygons, then those of others, in the same two images."""
        prior = PriorLocations(
            np.concatenate([first.prior.centers, second.prior.centers]),
            np.concatenate([first.prior.linear, second.prior.linear]),
        )
        return PyramidLocations(
            np.concatenate([first.centers, second.centers]),
            np.concatenate([first.found, second.found]),
            np.concatenate([first.correlation, second.correlation]),
            np.concatenate([first.outside, second.outside]),
            prior,
        )

    def maps(self, centers: Array, rows: NDArray[np.int64]) -> Array:
        """(c, 3, 3) maps right ~ map @ left of the polygons `rows` (c,): from their centre, of all (n, 2) `centers`, to
        their location, with the local affine part of the prior (paper 3.4.1)."""
        center, jacobian = centers[rows], self.prior.linear[rows]
        matrices = np.zeros((len(rows), 3, 3))
        matrices[:, :2, :2] = jacobian
        matrices[:, :2, 2] = self.centers[rows] - np.einsum("nij,nj->ni", jacobian, center)
        matrices[:, 2, 2] = 1.0
        return matrices


def level_count(width: int, height: int, config: GlobalConfig) -> int:
    """How often an image is downsampled: until its width or its height is at most `top_size` px, or there are
    `max_layers` layers."""
    count, side = 0, float(min(width, height))
    while side > config.top_size and count + 1 < config.max_layers:
        side, count = side / config.factor, count + 1
    return count


def locate(
    left: Image,
    right: Image,
    centers: Array,
    initial: InitialGeometry,
    config: GlobalConfig,
    prior: PriorLocations | None = None,
) -> PyramidLocations:
    """The right image's locations of left polygons with (n, 2) `centers`, image px, by Algorithm 1. The search starts
    at `prior`; without one, where H maps the centres."""
    n = len(centers)
    prior = initial.prior_locations(centers) if prior is None else prior
    predicted, jacobian = prior.centers.copy(), prior.linear
    outside = np.logical_not((predicted >= 0).all(1) & (predicted < [right.width, right.height]).all(1))
    found, correlation = np.zeros(n, bool), np.zeros(n)
    if config.search == "fixed":
        return PyramidLocations(predicted, found, correlation, outside, prior)
    levels = level_count(left.width, left.height, config)
    left_levels, right_levels = (sampling.levels(image, levels, config.factor) for image in (left, right))
    lines = None
    if not isinstance(initial.fundamental, Failed):
        lines = geometry.epipolar_lines(initial.fundamental, centers)
    active = np.flatnonzero(np.isfinite(predicted).all(1) & np.isfinite(jacobian).all((1, 2)))
    window = 2 * config.tau
    for level in range(levels, -1, -1):
        scale = float(config.factor) ** level
        for start in range(0, len(active), CORRELATION_CHUNK):
            rows = active[start : start + CORRELATION_CHUNK]
            line = None if lines is None else lines[rows] / [1, 1, scale]  # a x + b y + c, in px of this level
            template = sample_templates(left_levels[level], centers[rows] / scale, jacobian[rows], config.phi)
            moved, score, ok = _search(right_levels[level], template, predicted[rows] / scale, line, window, config)
            predicted[rows] = np.where(ok[:, None], moved * scale, predicted[rows])
            correlation[rows] = np.where(ok, score, correlation[rows])
            found[rows] = ok
        window = config.phi * config.factor
    return PyramidLocations(predicted, found, correlation, outside, prior)


def _search(
    right: NDArray[np.float32],
    template: NDArray[np.float32],
    predicted: Array,
    lines: Array | None,
    window: int,
    config: GlobalConfig,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """One level: searches for the templates (m, phi, phi) in `window` x `window` px around `predicted` (m, 2).

    Returns locations (m, 2), their NCC (m,) and whether one was found (m,). Everything in px of the level.
    """
    phi = config.phi
    textured = np.asarray(template.std((1, 2)) >= config.min_contrast)
    window += 1 - window % 2  # odd, so that the predicted pixel is the middle one
    pixel = np.floor(predicted).astype(np.int64)  # that holds the predicted location
    offset = np.arange(window) - window // 2
    rows, columns = pixel[:, 1:] + offset, pixel[:, :1] + offset
    inside_y, inside_x = (rows >= 0) & (rows < right.shape[0]), (columns >= 0) & (columns < right.shape[1])
    area = right[
        np.clip(rows, 0, right.shape[0] - 1)[:, :, None], np.clip(columns, 0, right.shape[1] - 1)[:, None]
    ]  # m, window, window
    score = correlate(area, template)
    full_y = sliding_window_view(inside_y, phi, axis=1).min(-1)
    full_x = sliding_window_view(inside_x, phi, axis=1).min(-1)
    allowed = full_y[:, :, None] & full_x[:, None] & textured[:, None, None]
    shift = np.arange(window - phi + 1) - (window - phi) // 2
    if lines is not None:
        x = (pixel[:, :1] + shift + 0.5)[:, None]
        y = (pixel[:, 1:] + shift + 0.5)[:, :, None]
        a, b, c = lines.T[:, :, None, None]
        allowed &= np.abs(a * x + b * y + c) <= config.band
    score = np.where(allowed, score, -2.0)
    peak, value = subpixel_peaks(score)
    ok = value > 0
    found = pixel + 0.5 + peak - (window - phi) // 2
    return found, np.where(ok, value, 0.0), ok


def sample_templates(image: NDArray[np.float32], centers: Array, jacobian: Array, phi: int) -> NDArray[np.float32]:
    """(m, phi, phi) templates of the left image as the right image should show them: the grid of offsets is mapped back
    by `jacobian` (m, 2, 2). `centers` (m, 2) in px of the level; outside the image, its border is repeated."""
    offset = np.arange(phi) - phi // 2
    grid = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)  # x, y
    determinant = np.linalg.det(jacobian)
    invertible = np.abs(determinant) > 1e-3
    inverse = np.linalg.inv(np.where(invertible[:, None, None], jacobian, np.eye(2)))
    at = centers[:, None] - 0.5 + grid @ inverse.transpose(0, 2, 1)  # pixel centres at 0
    return bilinear(image, at[..., 0], at[..., 1]).reshape(-1, phi, phi)


def correlate(area: NDArray[np.float32], template: NDArray[np.float32]) -> Array:
    """Normalised cross-correlation (Eq. R) of each template with each position of its own search area.

    (m, s, s) and (m, t, t) -> (m, s - t + 1, s - t + 1), -1..1; 0 where an area has no texture. By FFT, after each
    area's mean is subtracted, for the precision of float32.
    """
    t = template.shape[-1]
    positions = area.shape[-1] - t + 1
    levelled = area - area.mean((1, 2), keepdims=True)
    centred = template - template.mean((1, 2), keepdims=True)
    size = fft.next_fast_len(area.shape[-1], real=True)
    product = fft.rfft2(levelled, (size, size)) * np.conj(fft.rfft2(centred, (size, size)))
    numerator = fft.irfft2(product, (size, size))[:, :positions, :positions]
    total, squares = _box_sums(levelled, t)
    energy = np.maximum(squares - total**2 / t**2, 0.0) * (centred**2).sum((1, 2))[:, None, None]
    least = (t * t) ** 2 * 1e-6  # rounding errors: standard deviations whose product is a thousandth
    return np.clip(np.where(energy > least, numerator / np.sqrt(np.maximum(energy, least)), 0.0), -1.0, 1.0)


def _box_sums(values: NDArray[np.float32], t: int) -> tuple[Array, Array]:
    """Sums of the values and of their squares in each t x t box of (m, s, s) areas.

    All areas are filtered as one picture; boxes that lie across the border of two areas are dropped.
    """
    m, s, _ = values.shape
    picture, n = values.reshape(m * s, s), s - t + 1
    total, squares = (
        np.asarray(each(picture, cv2.CV_64F, (t, t), anchor=(0, 0), normalize=False)).reshape(m, s, s)[:, :n, :n]
        for each in (cv2.boxFilter, cv2.sqrBoxFilter)
    )
    return total, squares


def subpixel_peaks(score: Array) -> tuple[Array, Array]:
    """(m, 2) x, y of the highest value of each (m, p, p) map, refined by a parabola through its neighbours, and the
    value.

    There is no refinement at the border of the map, or beside positions that are not allowed (values below -1).
    """
    m, p, _ = score.shape
    best = score.reshape(m, -1).argmax(1)
    y, x = np.divmod(best, p)
    row = np.arange(m)
    value = score[row, y, x]

    def shift(before: Array, after: Array, usable: NDArray[np.bool_]) -> Array:
        usable = usable & (before > -1.5) & (after > -1.5)
        curvature = np.where(usable, before - 2 * value + after, -1.0)
        return np.where(usable & (curvature < -1e-9), 0.5 * (before - after) / np.minimum(curvature, -1e-9), 0.0)

    dx = shift(score[row, y, np.maximum(x - 1, 0)], score[row, y, np.minimum(x + 1, p - 1)], (x > 0) & (x < p - 1))
    dy = shift(score[row, np.maximum(y - 1, 0), x], score[row, np.minimum(y + 1, p - 1), x], (y > 0) & (y < p - 1))
    return np.c_[x + np.clip(dx, -0.5, 0.5), y + np.clip(dy, -0.5, 0.5)], value
