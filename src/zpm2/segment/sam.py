"""SAM as a segmenter that takes prompts: a photograph is encoded once, each prompt predicts masks with scores.

Masks stay at the decoder's resolution, 256 px along the longer side, until the wanted ones are known. Only those are
brought to the image's resolution.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.model import Image, Mask
from zpm2.runtime import ForkAwareLock
from zpm2.segment import automatic, stacks
from zpm2.segment.mask_view import LITTLE_MEMORY, MaskView, Room, is_out_of_memory, predicted, settled
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedView
from zpm2.segment.sam_backend import TOKEN_PX, Opaque, SamBackend, TorchBackend, of_photograph, open_backend
from zpm2.segment.sam_input import ENCODER_SIDE, encoder_input, reduced
from zpm2.segment.sam_padding import thinned

AMBIGUOUS_TOKENS = 1  # points of a prompt up to which it is ambiguous and gets three masks (Kirillov et al. 2023, 3)
NETWORK_LOCK = ForkAwareLock()  # one for all segmenters: each of their networks uses all cores


class SamSegmenter:
    """SAM behind the `PromptedSegmenter` protocol. Loads its networks on first use and keeps them.

    `notes` tell the user how it runs. `say` receives a line when networks are converted, `progress` the share of an
    image's prompts that is done, 0..1, and `download` the bytes of missing weights.
    """

    def __init__(
        self,
        config: SegmentConfig,
        device: str = "cpu",
        say: Callable[[str], None] = lambda _: None,
        progress: Callable[[float], None] = lambda _: None,
        download: weights.Progress = lambda done, total: None,
    ) -> None:
        self.config, self.device = config, device
        self.say, self.progress, self.download = say, progress, download
        self.name: str = config.model
        self.notes: list[str] = []
        self._backend: SamBackend | None = None
        self._shared: Room | None = None  # of all views

    def load(self) -> SamBackend:
        """The networks, loaded (and converted, once per machine) at the first call."""
        config = self.config
        with NETWORK_LOCK:
            if self._backend is None:
                self._backend = open_backend(config, self.device, self.say, self.download)
                if config.backend == "auto" and self.device == "cpu" and self._backend.name == "torch":
                    self.notes.append("openvino is not installed, the segmenter runs in torch: pip install openvino")
            return self._backend

    def view(self, image: Image) -> "SamView":
        """The photograph, encoded."""
        backend = self.load()
        return SamView(backend, image, self.config, self._room(backend))

    def views_together(self, images: Sequence[Image]) -> "list[SamView]":
        """The photographs, encoded; on a GPU in one batch, or one by one where its memory ends, which a note says."""
        backend = self.load()
        if not isinstance(backend, TorchBackend) or not backend.resident:
            return [self.view(image) for image in images]
        room = self._room(backend)
        try:
            with NETWORK_LOCK:
                encoded = backend.images([reduced(image, encoder_scale(image)) for image in images])
        except RuntimeError as error:
            if not is_out_of_memory(error):
                raise
            note = f"{LITTLE_MEMORY}: photographs were encoded one at a time"
            if note not in self.notes:
                self.notes.append(note)
                self.say(note)
            return [self.view(image) for image in images]
        return [SamView(backend, image, self.config, room, each) for image, each in zip(images, encoded, strict=True)]

    def written(self, view: PromptedView) -> Mapping[str, NDArray[np.generic]] | None:
        """What a view keeps of the encoder's work; None in torch: on a GPU that takes no longer than a file."""
        assert isinstance(view, SamView)
        if not all(isinstance(part, np.ndarray) for part in view.parts):
            return None
        return {str(k): part for k, part in enumerate(view.parts)}

    def view_of_written(self, image: Image, arrays: Mapping[str, NDArray[np.generic]]) -> "SamView":
        """The view again, with the same bytes."""
        backend = self.load()
        return SamView(backend, image, self.config, self._room(backend), parts=list(arrays.values()))

    def _room(self, backend: SamBackend) -> Room:
        if self._shared is None:
            self._shared = Room(backend.batch, self.notes, backend.few)
        return self._shared

    def segment(self, image: Image) -> list[Mask]:
        """The regions, best score first."""
        return automatic.regions(self.view(image), self.config, self.progress)


class SamView(MaskView):
    """One photograph as SAM sees it: in a 1024-px square, encoded once. Implements `PromptedView` and `EmbeddedView`.

    `encoded` is what `backend.image` returns of it, where that is known, `parts` what an earlier view made of that, and
    `room` that of all views of a backend.
    """

    def __init__(
        self,
        backend: SamBackend,
        image: Image,
        config: SegmentConfig,
        room: Room | None = None,
        encoded: Opaque | None = None,
        parts: Opaque | None = None,
    ) -> None:
        super().__init__(image, ENCODER_SIDE)
        self.backend, self.config, self.batch = backend, config, backend.batch
        self.room = room or Room(backend.batch, [], backend.few)
        self.scale = encoder_scale(image)
        self.embedding_scale = self.mask_scale / TOKEN_PX
        self.cells = int(-(-self.size[0] // TOKEN_PX)), int(-(-self.size[1] // TOKEN_PX))  # (height, width) tokens
        self.parts: Opaque = parts
        if parts is not None:
            return
        few = thinned(self.cells, config.padding) if config.padding else None
        with NETWORK_LOCK:
            self.parts = backend.image(encoder_input(image, self.scale)) if encoded is None else encoded
            if few is not None:
                self.parts = backend.thinned(self.parts, few)

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The masks of each prompt that reach `thresholds`. Masks whose predicted IoU is too low are not decoded.

        A point alone is ambiguous: it predicts the masks of a whole, a part and a subpart. A point with a box also
        predicts SAM's mask for unambiguous prompts.
        """
        first = 1 if prompts.points.shape[1] <= AMBIGUOUS_TOKENS else 0
        return predicted(prompts, self.room, lambda p, s: self._predict_batch(p, s, first, thresholds), self.size)

    def _predict_batch(self, prompts: Prompts, start: int, first: int, thresholds: MaskThresholds) -> MaskPredictions:
        sparse = self.backend.embed(prompts.points * self.scale, prompts.labels)
        with NETWORK_LOCK:  # outputs lie in the network's own memory, until it runs again
            iou, hyper, tokens = self.backend.prompt(self.parts, sparse)
            iou, hyper = iou[:, first:], hyper[:, first:]
            rows = np.flatnonzero((iou >= thresholds.predicted_iou).any(1))
            if len(rows) == 0:
                return MaskPredictions.none(self.size)
            logits = self.backend.mask(tokens, rows, stacks.take(hyper, rows), self.size)
            iou = iou[rows]  # a copy
        good = iou >= thresholds.predicted_iou
        flat = stacks.take(logits.reshape(-1, *logits.shape[2:]), np.flatnonzero(good))
        prompt = start + rows[np.nonzero(good)[0]]
        return settled(prompt, iou[good], flat, self.config.stability_offset, thresholds)

    def embedding(self) -> NDArray[np.float32]:
        """(256, h, w) the encoder's image tokens, without those of the padding."""
        return of_photograph(self.backend.tokens(self.parts)[None], self.size)[0].transpose(2, 0, 1)


def encoder_scale(image: Image) -> float:
    """px of the encoder's square per image px."""
    return ENCODER_SIDE / max(image.width, image.height)
