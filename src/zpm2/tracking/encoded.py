"""A segmenter that keeps encoded photographs, so that each is encoded once for all its pairs."""

import hashlib
from collections.abc import Collection, Sequence

from zpm2.model import Image, Mask
from zpm2.segment.protocol import PromptedSegmenter, PromptedView, Segmenter, notes_of

VIEW_BYTES = 10.5e6  # of an encoded photograph beside its pixels: SAM's, 640 numbers for each of 64 x 64 cells


class EncodedPhotographs:
    """`PromptedSegmenter` in front of another one. It keeps the views of whole photographs, the latest used, up to
    `megabytes`; views of their parts are not kept. `sizes`: (width, height) px of the photographs."""

    def __init__(
        self, segmenter: Segmenter, prompted: PromptedSegmenter, sizes: Collection[tuple[int, int]], megabytes: int
    ) -> None:
        self._segmenter, self._prompted = segmenter, prompted
        self._sizes, self._bytes = set(sizes), megabytes * 1e6
        self._views: dict[str, PromptedView] = {}
        self.name = segmenter.name
        self.encoded = 0  # whole photographs, so far

    @property
    def notes(self) -> Sequence[str]:
        """What the segmenter has to tell."""
        return notes_of(self._segmenter)

    def segment(self, image: Image) -> list[Mask]:
        """See `Segmenter.segment`."""
        return self._segmenter.segment(image)

    def view(self, image: Image) -> PromptedView:
        """See `PromptedSegmenter.view`."""
        if (image.width, image.height) not in self._sizes:
            return self._prompted.view(image)
        key = hashlib.sha256(f"{image.rgb.shape}".encode() + image.rgb.tobytes()).hexdigest()
        view = self._views.pop(key, None)
        if view is None:
            view = self._prompted.view(image)
            self.encoded += 1
        self._views[key] = view  # the latest used is the last
        while len(self._views) > 2 and sum(v.image.rgb.nbytes + VIEW_BYTES for v in self._views.values()) > self._bytes:
            del self._views[next(iter(self._views))]
        return view
