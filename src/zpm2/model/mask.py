"""A region as pixels, kept as the crop that holds it (never as a full-image stack)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zpm2.model.brief import brief


@dataclass(frozen=True, eq=False)
class Mask:
    """A set of pixels of one image: `bits[r, c]` says whether pixel (x0 + c, y0 + r) belongs to it."""

    x0: int  # column of the crop's first pixel
    y0: int  # row of the crop's first pixel
    bits: NDArray[np.bool_]  # (h, w)
    score: float = 1.0  # the segmenter's own quality, 0..1
    label: str | None = None

    __repr__ = brief

    @property
    def area(self) -> int:
        """Number of pixels."""
        return int(np.count_nonzero(self.bits))

    def within(self, valid: NDArray[np.bool_] | None) -> "Mask":
        """The mask without pixels that hold no data; `valid` (h, w) is that of the image, None: all do."""
        if valid is None:
            return self
        rows, columns = self.bits.shape
        return replace(self, bits=self.bits & valid[self.y0 : self.y0 + rows, self.x0 : self.x0 + columns])
