"""What the views of all promptable networks share: masks at the decoder's resolution, and back to pixels."""

from collections.abc import Callable

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import ConfigError, InputError
from zpm2.model import Image, Mask, thin
from zpm2.polygons.rasterize import rasterize_stack
from zpm2.runtime import ForkAwareLock
from zpm2.segment import stacks
from zpm2.segment.predictions import MASK_SIDE, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.stacks import Counts, Rows, Stack

NETWORK_LOCK = ForkAwareLock()  # one for all segmenters: each of their networks uses all cores
LITTLE_MEMORY = "the GPU has little free memory"


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
        boxes, score = predictions.extent.box, np.minimum(predictions.score, 1.0).tolist()
        logits, image, scale = predictions.logits, self.image, self.mask_scale
        if isinstance(logits, np.ndarray):
            found = [upsample(each, box, image, scale, s) for each, box, s in zip(logits, boxes, score, strict=True)]
        else:
            from zpm2.segment import device_stacks

            at = np.array([_in_image(box, image, scale) for box in boxes])
            crops = device_stacks.enlarged(logits, at, scale)
            found = [
                Mask(int(x0), int(y0), bits, s) if bits.size else Mask(0, 0, np.zeros((1, 1), bool), s)
                for (x0, y0, *_), bits, s in zip(at, crops, score, strict=True)
            ]
        return [mask.within(image.valid) for mask in found]


class Room:
    """How many prompts go to a network at a time: half as many, from then on, once its device ran out of memory.

    `notes` receive that. Which prompts are made does not depend on it, so results do not.
    """

    def __init__(self, most: int, notes: list[str]) -> None:
        self.most, self.notes = most, notes

    def halve(self, error: RuntimeError) -> None:
        """After an `error`, which is raised again if it is another one. `ConfigError` where one prompt is too much."""
        if not is_out_of_memory(error):
            raise error
        if self.most == 1:
            raise ConfigError("the GPU has too little free memory for one prompt: use --device cpu") from error
        self.most //= 2
        told = f"{LITTLE_MEMORY}: prompts went to the segmenter"
        self.notes[:] = [note for note in self.notes if not note.startswith(told)]
        self.notes.append(f"{told} {self.most} at a time")


def is_out_of_memory(error: RuntimeError) -> bool:
    """Whether a device had too little memory; told without loading torch."""
    return type(error).__name__ == "OutOfMemoryError"


def predicted(
    prompts: Prompts, room: Room, predict: Callable[[slice, slice], MaskPredictions], size: tuple[int, int]
) -> list[MaskPredictions]:
    """What `predict` says to prompts, as many at a time as there is `room` for. It gets the rows of these, and of those
    that are next; `size` is that of a decoded mask."""
    found, start = [MaskPredictions.none(size)], 0
    while start < len(prompts):
        end = min(start + room.most, len(prompts))
        try:
            found.append(predict(slice(start, end), slice(end, end + room.most)))
            start = end
        except RuntimeError as error:
            room.halve(error)
    return found


def settled(
    prompt: NDArray[np.int64],
    score: NDArray[np.float32],
    logits: Stack,
    offset: float,
    thresholds: MaskThresholds,
) -> MaskPredictions:
    """Of masks in single precision those that are stable enough and not empty. `prompt` and `score` are (n,);
    `offset` is `SegmentConfig.stability_offset`."""
    stability = np.zeros(0, np.float32)

    def wanted(inner: Counts, outer: Counts) -> Rows:
        nonlocal stability
        stability = np.asarray(inner / np.maximum(outer, 1), np.float32)
        return np.flatnonzero((stability >= thresholds.stability) & (inner > 0))

    rows, half, extent = stacks.settled(logits, offset, wanted)
    return MaskPredictions(prompt[rows], np.asarray(score[rows], np.float32), stability[rows], half, extent)


def decoded_size(image: Image) -> tuple[int, int]:
    """(height, width) px of a decoded mask: the image with MASK_SIDE px along its longer side."""
    height, width = -(-np.array([image.height, image.width]) * MASK_SIDE // max(image.width, image.height))
    return int(height), int(width)


def upsample(
    logits: NDArray[np.float16], box: NDArray[np.int64], image: Image, mask_scale: float, score: float
) -> Mask:
    """A decoded mask at the image's resolution: bilinear logits cut at 0, in the box (x0, y0, x1, y1)."""
    size = 1 / mask_scale  # image px of one low-resolution pixel
    x0, y0, x1, y1 = _in_image(box, image, mask_scale)
    if x1 <= x0 or y1 <= y0:
        return Mask(0, 0, np.zeros((1, 1), bool), score)
    to_low = np.array([[1 / size, 0, (x0 + 0.5) / size - 0.5], [0, 1 / size, (y0 + 0.5) / size - 0.5]])
    fine = cv2.warpAffine(
        logits.astype(np.float32),
        to_low,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return Mask(x0, y0, fine > 0, score)


def _in_image(box: NDArray[np.int64], image: Image, mask_scale: float) -> tuple[int, int, int, int]:
    """What a box of decoded pixels, and one more on each side, may reach of the image: x0, y0, x1, y1."""
    size = 1 / mask_scale
    x0, y0 = np.maximum(np.floor((box[:2] - 1) * size).astype(int), 0)
    x1, y1 = np.minimum(np.ceil((box[2:] + 1) * size).astype(int), [image.width, image.height])
    return int(x0), int(y0), int(x1), int(y1)
