"""A surface from a rectified pair alone: a disparity map as a mesh."""

import numpy as np
from numpy.typing import NDArray

from zpm2.cloud.surface import SurfaceMesh
from zpm2.config import CloudConfig
from zpm2.errors import InputError
from zpm2.stereo.rig import Rig

Array = NDArray[np.float64]
Disparity = NDArray[np.float32]


def disparity_mesh(disparity: Disparity, rig: Rig, config: CloudConfig) -> SurfaceMesh:
    """The surface that a disparity map of the left image shows, in the frame of the left camera.

    Each pixel gives a vertex (every second, third... pixel if there would be more than `max_faces` triangles). The mesh
    is torn where neighbours differ by more than `tear` px. `InputError` if no triangle is left.
    """
    height, width = disparity.shape
    stride = int(np.ceil((2 * height * width / config.max_faces) ** 0.5))
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
    # edges of the grid along which the surface is not torn: to the right, down, and both diagonals
    limit = config.tear * stride
    at = np.arange(d.size).reshape(d.shape)
    a, b, c, e = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]

    def joined(p: NDArray[np.int64], q: NDArray[np.int64]) -> NDArray[np.bool_]:
        with np.errstate(invalid="ignore"):
            return known.flat[p] & known.flat[q] & (np.abs(d.flat[p] - d.flat[q]) <= limit)

    sides = joined(a, b), joined(b, c), joined(c, e), joined(e, a)
    main, other = joined(a, c), joined(b, e)
    first = [(a, e, c, sides[3] & sides[2] & main), (a, c, b, main & sides[1] & sides[0])]
    neither = ~(first[0][3] | first[1][3])  # the surface is torn along this diagonal: try the other one
    second = [(a, e, b, sides[3] & other & sides[0] & neither), (b, e, c, other & sides[2] & sides[1] & neither)]
    faces = np.concatenate([np.stack([p[ok], q[ok], r[ok]], axis=1) for p, q, r, ok in first + second])
    if len(faces) == 0:
        raise InputError("the disparity map shows no surface: no three neighbouring pixels form a triangle")
    used, inverse = np.unique(faces, return_inverse=True)
    return SurfaceMesh.of(points[used], inverse.reshape(-1, 3), "disparity mesh")
