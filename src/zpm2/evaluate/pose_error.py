"""Errors of relative poses, and how many pairs stay below them: the protocol of ScanNet1500.

After SuperGlue (Sarlin et al., CVPR 2020, section 5.2 and its published evaluation), which LoFTR, LightGlue and MESA
follow: angles of rotation and of the direction of translation, the larger counts, area under its cumulative curve.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

AUC_DEGREES = (5.0, 10.0, 20.0)  # degrees


def pose_error(rotation: Array, translation: Array | None, truth: Array) -> tuple[float, float]:
    """Degrees between an estimated and the true relative pose: of rotation (0..180), and of translation (0..90).

    rotation: 3 x 3; translation: (3,), of any length, None where there is none; both from left to right camera, X_right
    = R X_left + t. truth: 3 x 4 or 4 x 4, [R t]. The sign of the translation does not count: an essential matrix leaves
    it open, and the protocol takes min(angle, 180 - angle). Where the cameras did not move there is no direction to
    miss: 0. An estimate that is not finite, or has no direction where there is one, is a failure: infinity for both.
    """
    translation = np.zeros(3) if translation is None else np.ravel(translation)
    baseline = np.asarray(truth)[:3, 3]
    moved = bool(np.any(baseline))
    if not (np.isfinite(rotation).all() and np.isfinite(translation).all()) or (moved and not translation.any()):
        return float("inf"), float("inf")
    chord = float(np.sum((rotation - np.asarray(truth)[:3, :3]) ** 2))  # 8 sin^2 of half the angle
    turned = 2 * np.degrees(np.arctan2(np.sqrt(chord), np.sqrt(max(8 - chord, 0.0))))
    if not moved:
        return float(turned), 0.0
    off = np.degrees(np.arctan2(np.linalg.norm(np.cross(translation, baseline)), translation @ baseline))
    return float(turned), float(min(off, 180 - off))


def pose_auc(errors: ArrayLike, thresholds: Sequence[float] = AUC_DEGREES) -> tuple[float, ...]:
    """Area under the cumulative error curve up to each threshold, as a share of the threshold: 0..1, 1 is perfect.

    errors: degrees, (n, 2) as `pose_error` gives them, of which the larger counts, or (n,) already so; infinity or NaN
    for a pair without a pose. The curve joins (0, 0) and (k-th smallest error, k / n) by straight lines and is flat
    from the last error below the threshold on; the area is exact (trapezoids). 0 for no pairs.
    """
    values = np.asarray(errors, np.float64)
    values = np.sort(np.nan_to_num(values.max(axis=1) if values.ndim == 2 else values, nan=np.inf, posinf=np.inf))
    curve = np.r_[0.0, values], np.r_[0.0, np.arange(1, len(values) + 1) / max(len(values), 1)]
    areas = []
    for threshold in thresholds:
        below = int(np.searchsorted(curve[0], threshold))
        x, y = np.r_[curve[0][:below], threshold], np.r_[curve[1][:below], curve[1][below - 1]]
        areas.append(float(np.trapezoid(y, x)) / threshold)
    return tuple(areas)
