"""What the views of all promptable networks share: masks at the decoder's resolution, and back to pixels."""

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.model import Image, Mask, thin
from zpm2.polygons.rasterize import rasterize_stack
from zpm2.segment import suppression
from zpm2.segment.predictions import MASK_SIDE, MaskPredictions


class MaskView:
    """One photograph whose masks have MASK_SIDE px along its longer side. The geometric half of a `PromptedView`.

    `seen` is the side in px of the square in which the network sees the photograph. `InputError` for one so thin that
    nothing would be left of it there.
    """

    def __init__(self, image: Image, seen: int) -> None:
        if thin(image.width, image.height):
            shorter = round(seen * min(image.width, image.height) / max(image.width, image.height))
            raise InputError(
                f"{image.path or 'the image'} is {image.width} x {image.height} px, of which the segmenter would see "
                f"{seen} x {shorter}: match it in tiles (--tiles on)"
            )
        self.image = image
        self.mask_scale = MASK_SIDE / max(image.width, image.height)  # px of a decoded mask per image px
        self.size = decoded_size(image)

    def cover(self, shapes: NDArray[np.object_]) -> NDArray[np.bool_]:
        """(n,) polygons in image px -> (n, height, width) pixels of a decoded mask inside each."""
        scaled = shapely.transform(shapes, lambda xy: xy * self.mask_scale)
        return rasterize_stack(np.asarray(scaled, object), self.size[::-1])

    def masks(self, predictions: MaskPredictions) -> list[Mask]:
        """Each mask at the image's resolution, without pixels that hold no data."""
        if len(predictions) == 0:
            return []
        each = zip(predictions.logits, suppression.boxes(predictions.bits), predictions.score, strict=True)
        found = (
            upsample(logits, box, self.image, self.mask_scale, float(min(score, 1.0))) for logits, box, score in each
        )
        return [mask.within(self.image.valid) for mask in found]


def decoded_size(image: Image) -> tuple[int, int]:
    """(height, width) px of a decoded mask: the image with MASK_SIDE px along its longer side."""
    height, width = -(-np.array([image.height, image.width]) * MASK_SIDE // max(image.width, image.height))
    return int(height), int(width)


def upsample(
    logits: NDArray[np.float16], box: NDArray[np.int64], image: Image, mask_scale: float, score: float
) -> Mask:
    """A decoded mask at the image's resolution: bilinear logits cut at 0, in the box (x0, y0, x1, y1)."""
    size = 1 / mask_scale  # image px of one low-resolution pixel
    x0, y0 = np.maximum(np.floor((box[:2] - 1) * size).astype(int), 0)
    x1, y1 = np.minimum(np.ceil((box[2:] + 1) * size).astype(int), [image.width, image.height])
    if x1 <= x0 or y1 <= y0:
        return Mask(0, 0, np.zeros((1, 1), bool), score)
    to_low = np.array([[1 / size, 0, (x0 + 0.5) / size - 0.5], [0, 1 / size, (y0 + 0.5) / size - 0.5]])
    fine = cv2.warpAffine(
        logits.astype(np.float32),
        to_low,
        (int(x1 - x0), int(y1 - y0)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return Mask(int(x0), int(y0), fine > 0, score)
