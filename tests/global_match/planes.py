"""A textured plane seen twice: the second image is the first one carried by a homography."""

import cv2
import numpy as np

from zpm2.errors import Failed
from zpm2.global_match import InitialGeometry
from zpm2.model import Image, PointMatches

CORNER = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])  # to OpenCV's pixel centres at 0


def texture(height, width, seed, grain=2.0):
    noise = cv2.GaussianBlur(
        np.random.default_rng(seed).normal(0, 1, (height, width)).astype(np.float32), (0, 0), grain
    )
    return 128 + 40 * noise / noise.std()


def image(gray):
    return Image(np.repeat(np.clip(np.round(gray), 0, 255).astype(np.uint8)[..., None], 3, axis=2))


def carried(gray, homography, gain=0.8, offset=20.0):
    """The plane as the right image shows it, with another brightness and contrast."""
    size = gray.shape[1], gray.shape[0]
    h = CORNER @ homography @ np.linalg.inv(CORNER)
    return gain * cv2.warpPerspective(gray, h, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT) + offset


def turn(degrees, scale, center, shift=(0.0, 0.0)):
    """Rotation and scale about a centre, then a shift."""
    c, s = scale * np.cos(np.radians(degrees)), scale * np.sin(np.radians(degrees))
    r = np.array([[c, -s], [s, c]])
    return np.block([[r, (center - r @ center + shift)[:, None]], [np.zeros((1, 2)), np.ones((1, 1))]])


def translation(x, y):
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def fundamental(homography, epipole=(-3000.0, 250.0)):
    """An F with which every pair of the plane agrees."""
    x, y = epipole
    matrix = np.array([[0, -1.0, y], [1, 0, -x], [-y, x, 0]]) @ homography
    return matrix / np.linalg.norm(matrix)


def known(f=None, h=None):
    """The geometry as if it had been estimated; what is not given has failed."""
    f, h = (Failed("not estimated") if matrix is None else matrix for matrix in (f, h))
    return InitialGeometry(PointMatches.empty(), f, h, np.zeros(0, bool), np.zeros(0, bool))
