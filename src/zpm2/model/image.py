"""A photograph as all stages take it."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zpm2.model.brief import brief
from zpm2.model.georeference import Georeference

THIN = 32  # length / width; of a thinner image, a network that sees 1024 px of the length sees less than 32 px across


@dataclass(frozen=True, eq=False)
class Image:
    """One photograph: 8-bit RGB pixels, and what had to be done to get them.

    `rgb[r, c]` covers the unit square with outer corner (c, r) and centre (c + 0.5, r + 0.5) in image coordinates.
    """

    rgb: NDArray[np.uint8]  # (h, w, 3)
    path: str | None = None
    notes: tuple[str, ...] = ()  # what was done to the pixels: an alpha band dropped, 16 bits stretched, ...
    valid: NDArray[np.bool_] | None = None  # (h, w) False where there is no data; None: everywhere
    geo: Georeference = field(default_factory=Georeference)  # of a photograph that is read as a whole

    __repr__ = brief

    @property
    def width(self) -> int:
        return int(self.rgb.shape[1])

    @property
    def height(self) -> int:
        return int(self.rgb.shape[0])

    @cached_property
    def gray(self) -> NDArray[np.float32]:
        """(h, w) float32 luma (ITU-R BT.601), 0..255."""
        weights = np.array([0.299, 0.587, 0.114], np.float32)
        return self.rgb.astype(np.float32) @ weights

    @cached_property
    def levels(self) -> dict[int, list[NDArray[np.float32]]]:
        """By factor, the levels of its Gaussian pyramids that are known (`photos.sampling.levels`)."""
        return {}


def thin(width: int, height: int) -> bool:
    """Whether an image is so thin that it shows nothing when it is reduced to fit into a network's input."""
    return max(width, height) > THIN * min(width, height)
