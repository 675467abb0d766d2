"""A surface from a rectified pair alone: disparity by semi-global matching, or a given one, as a mesh.

Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 2008, as OpenCV has it.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from zpm2.cloud.surface import Surface
from zpm2.errors import Failed, InputError
from zpm2.io.cameras import calibration, intrinsics, matrix, numbers
from zpm2.io.inputs import text
from zpm2.model import Camera, Image, PosedCamera

Array = NDArray[np.float64]
Disparity = NDArray[np.float32]
JUMP = 1.0  # px of disparity between neighbouring pixels, beyond which the surface is torn
CHECK = 1.0  # px by which the disparities of both images may differ
SPECKLE = 200  # px, smaller patches of disparity are noise
SMOOTH = 3.0  # px, standard deviation
TELLING, APART, AGREE = (
    30,
    5.0,
    0.25,
)  # points, px and share of points, from which a given map counts as that of the pair
MAX_FACES = 4_000_000


@dataclass(frozen=True, eq=False)
class Rig:
    """A rectified pair: equal rows, X_right = X_left - (baseline, 0, 0)."""

    left: Camera
    right: Camera
    baseline: float  # in the unit that the cloud shall have

    @property
    def offset(self) -> float:
        """px, cx of the right camera less that of the left one: disparity of a point at infinity, negative (doffs)."""
        return float(self.right.matrix[0, 2] - self.left.matrix[0, 2])

    @property
    def views(self) -> tuple[PosedCamera, PosedCamera]:
        """Both cameras in the frame of the left one."""
        shift = np.array([-self.baseline, 0.0, 0.0])
        return PosedCamera(self.left, np.eye(3), np.zeros(3)), PosedCamera(self.right, np.eye(3), shift)

    def depth(self, disparity: Any) -> Any:
        """Z = f B / (d + doffs); NaN where that is not before the cameras."""
        with np.errstate(divide="ignore", invalid="ignore"):
            z = self.left.matrix[0, 0] * self.baseline / (disparity + self.offset)
            return np.where(z > 0, z, np.nan)


def rig_of(left: Camera, right: Camera, baseline: float) -> Rig:
    """A rig of two cameras; `InputError` where they are none of a rectified pair."""
    if left.size != right.size:
        raise InputError(
            f"images of a rectified pair have one size, these have {left.size} and {right.size} px: rectify it"
        )
    if not 0 < baseline < float("inf"):
        raise InputError(f"the baseline of a rectified pair is a length above 0, got {baseline:g}: correct it")
    a, b = left.matrix, right.matrix
    if np.abs(a[[0, 1, 1], [0, 1, 2]] - b[[0, 1, 1], [0, 1, 2]]).max() > 0.01 * a[0, 0]:
        raise InputError("a rectified pair has one focal length and one cy: rectify it first (zpm2 pose --rectify)")
    if left.distortion.any() or right.distortion.any():
        raise InputError("a rectified pair has no distortion left: rectify it first (zpm2 pose --rectify)")
    return Rig(left, right, baseline)


def read_calibration(path: Path, size: tuple[int, int]) -> Rig:
    """The rig of a calibration file, for images of `size` (width, height) px.

    Middlebury (2014, 2021), calib.txt: cam0, cam1, baseline in mm. KITTI, calib.txt or calib_cam_to_cam.txt: the colour
    cameras P2 and P3 (or P_rect_02 and P_rect_03), in m. Both count pixel centres from 0.
    """
    lines = [re.match(r"\s*(\w+)\s*[=:]\s*(.*)", line) for line in text(path).splitlines()]
    values = {line[1]: line[2] for line in lines if line}
    for names in (("P2", "P3"), ("P_rect_02", "P_rect_03")):
        if all(name in values for name in names):
            return _kitti(values[names[0]], values[names[1]], path, _kitti_size(values, path) or size)
    try:
        own = int(values["width"]), int(values["height"])
        matrices = [
            calibration([row.split() for row in values[name].strip(" []").split(";")], f"{name} of {path}")
            for name in ("cam0", "cam1")
        ]
        left, right = (Camera(intrinsics(k), own) for k in matrices)
        return rig_of(left, right, float(values["baseline"]))
    except (LookupError, ArithmeticError, ValueError) as error:
        raise InputError(f"{path} is no calibration of Middlebury (cam0, cam1, baseline) or KITTI (P2, P3)") from error


def _kitti_size(values: dict[str, str], path: Path) -> tuple[int, int] | None:
    """px, of calib_cam_to_cam.txt; calib.txt does not say."""
    if "S_rect_02" not in values:
        return None
    try:
        width, height = (round(float(word)) for word in values["S_rect_02"].split())
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"{path} has an S_rect_02 that is no width and height: download it again") from error
    return width, height


def _kitti(left: str, right: str, path: Path, own: tuple[int, int]) -> Rig:
    """Both projections are K [I | t] in the frame of camera 0, for images of `own` px."""
    p, q = (matrix(numbers(words.split(), path), (3, 4), f"a projection of {path}") for words in (left, right))
    cameras = [Camera(intrinsics(calibration(k[:, :3], f"a projection of {path}")), own) for k in (p, q)]
    shift = np.linalg.solve(p[:, :3], p[:, 3]) - np.linalg.solve(q[:, :3], q[:, 3])
    return rig_of(cameras[0], cameras[1], float(shift[0]))


def semi_global(left: Image, right: Image, low: int, high: int) -> Disparity:
    """(h, w) px, left x - right x, NaN where it is not known: SGBM over [low, high] px, both images' maps compared.

    Both photographs must have the same size.
    """
    count = -(-(high - low + 1) // 16) * 16
    grey = [cv2.cvtColor(image.rgb, cv2.COLOR_RGB2GRAY) for image in (left, right)]
    window = 5
    matcher: Any = cv2.StereoSGBM.create(
        minDisparity=low,
        numDisparities=count,
        blockSize=window,
        P1=8 * window**2,
        P2=32 * window**2,
        disp12MaxDiff=-1,
        preFilterCap=31,
        uniquenessRatio=5,
        mode=cv2.STEREO_SGBM_MODE_HH if grey[0].size < 4_000_000 else cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    maps = []
    for side in (0, 1):  # the right map: both images mirrored and exchanged
        a, b = (grey[0], grey[1]) if side == 0 else (grey[1][:, ::-1], grey[0][:, ::-1])
        border = ((0, 0), (max(0, low + count), max(0, -low)))  # columns at the border have a partner beyond it
        a, b = (np.pad(np.ascontiguousarray(x), border, mode="edge") for x in (a, b))
        found = matcher.compute(a, b)[:, border[1][0] : border[1][0] + grey[0].shape[1]].astype(np.float32)
        found[found < 16 * low] = np.nan
        maps.append(found / 16 if side == 0 else (found / 16)[:, ::-1])
    for found, image in zip(maps, (left, right), strict=True):
        if image.valid is not None:
            found[~image.valid] = np.nan
    disparity = _checked(maps[0], maps[1])
    whole = np.where(np.isfinite(disparity), disparity * 16, (low - 1) * 16).astype(np.int16)
    cv2.filterSpeckles(whole, (low - 1) * 16, SPECKLE, 16)
    disparity[whole == (low - 1) * 16] = np.nan
    return _smoothed(disparity)


def _smoothed(disparity: Disparity) -> Disparity:
    """Without the steps of whole pixels and the noise between them: a mean over `SMOOTH` px of what differs by a pixel
    or so (bilateral filter), so that edges stay."""
    known = np.isfinite(disparity)
    if not known.any():
        return disparity
    nearest: Any = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = np.ascontiguousarray(disparity[tuple(nearest)])
    return np.where(known, cv2.bilateralFilter(whole, 0, 1.0, SMOOTH), np.nan).astype(np.float32)


def _checked(left: Disparity, right: Disparity) -> Disparity:
    """The left map where the right one says the same."""
    height, width = left.shape
    x = np.arange(width)[None] + 0.5 - np.where(np.isfinite(left), left, 0)
    column = np.floor(x).astype(np.intp)
    inside = np.isfinite(left) & (column >= 0) & (column < width)
    other = right[np.arange(height)[:, None], np.clip(column, 0, width - 1)]
    with np.errstate(invalid="ignore"):
        return np.where(inside & (np.abs(left - other) <= CHECK), left, np.nan).astype(np.float32)


def disparity_range(differences: Array, width: int) -> tuple[int, int] | Failed:
    """[low, high] px of the search, from left x - right x of homologous points, a tenth wider on both sides."""
    if len(differences) < 8:
        return Failed(f"only {len(differences)} homologous points tell where to look for disparities")
    low, high = np.percentile(differences, [1, 99])
    margin = max(0.1 * (high - low), 8.0)
    low, high = int(np.floor(low - margin)), int(np.ceil(high + margin))
    if high - low > width / 2:
        return Failed(f"disparities from {low} to {high} px: this is no rectified pair")
    return low, high


def refuse_other_disparity(disparity: Disparity, left: Array, right: Array) -> None:
    """`InputError` for a map of the left image that homologous points, (n, 2) px each, contradict: of another scale or
    sign, or of depths."""
    row, column = np.floor(left[:, 1]).astype(np.intp), np.floor(left[:, 0]).astype(np.intp)
    there, seen = disparity[row, column], left[:, 0] - right[:, 0]
    there, seen = there[np.isfinite(there)], seen[np.isfinite(there)]
    if len(there) < TELLING or (np.abs(there - seen) < APART).mean() > AGREE:
        return
    raise InputError(
        f"the disparity map does not fit the matches: it has {np.median(there):.1f} px where they have "
        f"{np.median(seen):.1f} (medians); give its scale and sign, and a map of disparities, not of depths"
    )


def disparity_mesh(disparity: Disparity, rig: Rig) -> Surface:
    """The surface that a disparity map of the left image shows, in the frame of the left camera.

    A vertex for each pixel (each second, third... where that would make more than four million triangles), torn where
    neighbours differ by more than `JUMP` px. `InputError` where nothing is left.
    """
    height, width = disparity.shape
    stride = int(np.ceil((2 * height * width / MAX_FACES) ** 0.5))
    rows, columns = np.arange(0, height, stride), np.arange(0, width, stride)
    d = disparity[np.ix_(rows, columns)].astype(np.float64)
    z = rig.depth(d)
    x, y = np.meshgrid(columns + 0.5, rows + 0.5)
    rays = rig.left.rays(np.c_[x.ravel(), y.ravel()])
    points = np.c_[rays * z.reshape(-1, 1), z.ravel()]
    known = np.isfinite(z)
    if np.isfinite(d).any() and not known.any():
        raise InputError(
            "all disparities lie behind the cameras: give the left photograph first, or with a map that stores -d "
            "--disparity-sign -1"
        )
    # edges of the grid that hold: to the right, down, and both diagonals
    limit = JUMP * stride
    at = np.arange(d.size).reshape(d.shape)
    a, b, c, e = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]

    def holds(p: NDArray[np.int64], q: NDArray[np.int64]) -> NDArray[np.bool_]:
        with np.errstate(invalid="ignore"):
            return known.flat[p] & known.flat[q] & (np.abs(d.flat[p] - d.flat[q]) <= limit)

    sides = holds(a, b), holds(b, c), holds(c, e), holds(e, a)
    main, other = holds(a, c), holds(b, e)
    first = [(a, e, c, sides[3] & sides[2] & main), (a, c, b, main & sides[1] & sides[0])]
    broken = ~(first[0][3] | first[1][3])  # a corner is missing on this diagonal: try the other one
    second = [(a, e, b, sides[3] & other & sides[0] & broken), (b, e, c, other & sides[2] & sides[1] & broken)]
    faces = np.concatenate([np.stack([p[ok], q[ok], r[ok]], axis=1) for p, q, r, ok in first + second])
    if len(faces) == 0:
        raise InputError("the disparity map shows no surface: its known pixels do not hang together")
    used, inverse = np.unique(faces, return_inverse=True)
    return Surface.of(points[used], inverse.reshape(-1, 3), "disparity mesh")
