"""How much two polygons cover each other where a dense optical flow puts them.

The left photograph is warped by the homologous points in and around the polygon. Optical flow, forth and back, finds
what motion is left: it corrects points that are a few px off. Where the two flows do not agree, the insides do not show
the same. The outlines take no part in the flow.
"""

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.config import VerifyConfig
from zpm2.cores import in_chunks
from zpm2.local_match.texture import covered, together
from zpm2.model import Image
from zpm2.verify.content import Array, Bits, Patches, rectified

Flow = NDArray[np.float32]  # (size, size, 2): what is at (x, y) of one patch is at (x, y) + flow of the other, cells
GREY, STEP = 128.0, 48.0  # of 8-bit patches: the mean, and one standard deviation


def agreement(
    images: tuple[Image, Image],
    warped: NDArray[np.object_],
    right: NDArray[np.object_],
    maps: Array,
    config: VerifyConfig,
    max_halvings: int,
) -> Array:
    """(k,) 0..1: the IoU of each left polygon, warped and moved by the flow, with its partner, times the share of both
    where the flows forth and back agree.

    `warped` (k,) are the left polygons mapped by `maps` (k, 3, 3) of the points, `right` (k,) their partners, px of the
    right image. Flows are computed in a square around the partner, twice as wide, at no more than the right image's
    resolution. 0 where no photograph shows both.
    """
    size = 2 * config.patch
    bounds = shapely.bounds(right).reshape(-1, 4)
    middle = (bounds[:, :2] + bounds[:, 2:]) / 2
    half = np.maximum((bounds[:, 2:] - bounds[:, :2]).max(1, initial=0.0), size / 2)[:, None]
    box = np.c_[middle - half, middle + half]
    covers = covered(warped, box, size), covered(right, box, size)

    def agree(rows: slice) -> list[float]:
        (left, seen), (other, seen_there) = rectified(images, box[rows], maps[rows], config, max_halvings)
        shown = zip(seen, seen_there, strict=True)
        inside = zip(*(cover[rows] for cover in covers), strict=True)
        return [
            _agreement(_flow(there, here, config), _flow(here, there, config), seen_both, inside_both, config)
            for here, there, seen_both, inside_both in zip(_grey(left), _grey(other), shown, inside, strict=True)
        ]

    return np.array([share for found in in_chunks(agree, len(right), together(size)) for share in found], np.float64)


def _flow(here: NDArray[np.uint8], there: NDArray[np.uint8], config: VerifyConfig) -> Flow:
    """From one patch to another: Farnebäck 2003, whose polynomials OpenCV suggests to fit over 5 cells."""
    return np.asarray(cv2.calcOpticalFlowFarneback(here, there, None, 0.5, 3, config.flow_window, 3, 5, 1.1, 0))


def _agreement(
    there: Flow, back: Flow, seen: tuple[Bits, Bits], covers: tuple[Bits, Bits], config: VerifyConfig
) -> float:
    """Of one pair; `there` leads from the right patch to the left one."""
    along = np.arange(len(there), dtype=np.float32)
    at = there.copy()
    at[..., 0] += along
    at[..., 1] += along[:, None]

    def of_left(values: NDArray[np.uint8]) -> Bits:
        return np.asarray(cv2.remap(values, at, None, cv2.INTER_NEAREST) > 0)

    shown = seen[1] & of_left(seen[0].astype(np.uint8))
    moved = of_left(covers[0].astype(np.uint8))
    either = (moved | covers[1]) & shown
    cells = int(either.sum())
    if not cells:
        return 0.0
    round_trip = np.linalg.norm(there + cv2.remap(back, at, None, cv2.INTER_LINEAR), axis=2)
    consistent = either & (round_trip < config.round_trip)
    return float((moved & covers[1] & either).sum() / cells * consistent.sum() / cells)


def _grey(patches: Patches) -> NDArray[np.uint8]:
    """As 8-bit grey values, which the flow takes."""
    return np.asarray(np.clip(GREY + STEP * patches, 0, 255).astype(np.uint8))
