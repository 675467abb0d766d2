"""A photograph that SAM can be asked about, encoded once."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zpm2.config import SegmentConfig
from zpm2.model import Image
from zpm2.segment import stacks, suppression
from zpm2.segment.mask_view import NETWORK_LOCK, MaskView, Room, predicted, settled
from zpm2.segment.predictions import CORNER, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.sam_backend import EmbeddedPrompts, Opaque, SamBackend, of_photograph
from zpm2.segment.sam_input import ENCODER_SIDE, encoder_input
from zpm2.segment.sam_padding import thinned
from zpm2.segment.sam_vicinity import TOKEN_PX, Vicinity
from zpm2.segment.stacks import Stack

AMBIGUOUS_TOKENS = 1  # points of a prompt up to which it is ambiguous and gets three masks (Kirillov et al. 2023, 3)


class SamView(MaskView):
    """One photograph as SAM sees it: in a 1024-px square, encoded once. Implements `PromptedView`, `EmbeddedView` and
    `SmallThingsView`.

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
        self.room = room or Room(backend.batch, [])
        self.scale = encoder_scale(image)
        self.embedding_scale = self.mask_scale / TOKEN_PX
        self.cells = int(-(-self.size[0] // TOKEN_PX)), int(-(-self.size[1] // TOKEN_PX))  # (height, width) tokens
        few = thinned(self.cells, config.padding) if config.padding else None
        vicinity = Vicinity(self.cells, config.vicinity, few) if config.vicinity else None
        self.vicinity = vicinity if vicinity is not None and vicinity.saves else None
        self.parts: Opaque = parts
        if parts is not None:
            return
        with NETWORK_LOCK:
            self.parts = backend.image(encoder_input(image, self.scale)) if encoded is None else encoded
            if few is not None:
                self.parts = backend.thinned(self.parts, few)

    def predict(self, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        """The masks of each prompt that reach `thresholds`. Masks whose predicted IoU is too low are not decoded.

        A point alone is ambiguous: it predicts the masks of a whole, a part and a subpart. A point with a box also
        predicts SAM's mask for unambiguous prompts. Prompts with small boxes see what is near them (`sam_vicinity`).
        """
        if (prompts.labels >= CORNER).any():
            return self.predict_small(prompts, thresholds, [])
        return MaskPredictions.join(self._predict_whole(prompts, thresholds))

    def predict_small(
        self,
        prompts: Prompts,
        thresholds: MaskThresholds,
        known: Sequence[MaskPredictions],
        soon: Prompts | None = None,
    ) -> MaskPredictions:
        """As `predict`, of prompts that mostly show something small: they see what is near them.

        A mask that is larger than that is taken for the one of the `known` masks that looks like it there. Where none
        does, the prompt is asked again with the whole photograph in sight.
        """
        if self.vicinity is None or not len(prompts):
            return MaskPredictions.join(self._predict_whole(prompts, thresholds, soon))
        near, held = self._near(prompts)
        later = None if soon is None else self._near(soon)[0]
        row, again = np.flatnonzero(held), [np.flatnonzero(~held)]

        def predict_near(rows: slice, following: slice) -> MaskPredictions:
            next_ones = near[following] if rows.stop < len(near) else later
            found, cut = self._predict_near(near[rows], next_ones, thresholds, known)
            found = dataclasses.replace(found, prompt=row[rows][found.prompt])
            again.append(np.unique(found.prompt[cut]))
            return found[~np.isin(found.prompt, again[-1])]

        first = predicted(near.prompts, self.room, predict_near, self.size)
        rest = np.sort(np.concatenate(again))
        whole = self._predict_whole(prompts[rest], thresholds)
        return MaskPredictions.join([*first, *(dataclasses.replace(part, prompt=rest[part.prompt]) for part in whole)])

    def _predict_whole(
        self, prompts: Prompts, thresholds: MaskThresholds, soon: Prompts | None = None
    ) -> list[MaskPredictions]:
        """The masks of prompts that see the whole photograph."""
        later = None if soon is None else _Asked(soon)

        def predict(rows: slice, following: slice) -> MaskPredictions:
            next_ones = _Asked(prompts[following]) if rows.stop < len(prompts) else later
            found, iou, logits = self._ask(_Asked(prompts[rows]), next_ones, thresholds, self.size)
            return self._settled(rows.start + found, iou, logits, thresholds)

        return predicted(prompts, self.room, predict, self.size)

    def _near(self, prompts: Prompts) -> "tuple[_Asked, NDArray[np.bool_]]":
        """Those of the prompts (n,) that windows hold, and which these are."""
        assert self.vicinity is not None
        points = prompts.points * self.mask_scale
        origins, held = self.vicinity.origins(np.concatenate([points.min(1), points.max(1)], axis=1))
        return _Asked(prompts[np.flatnonzero(held)], origins[held]), held

    def _predict_near(
        self, asked: "_Asked", soon: "_Asked | None", thresholds: MaskThresholds, known: Sequence[MaskPredictions]
    ) -> tuple[MaskPredictions, NDArray[np.bool_]]:
        """The masks of prompts that see what is near them, and of each whether it is cut off."""
        vicinity, origins = self.vicinity, asked.origins
        assert vicinity is not None
        assert origins is not None
        size = TOKEN_PX * vicinity.size[0], TOKEN_PX * vicinity.size[1]
        rows, iou, logits = self._ask(asked, soon, thresholds, size)
        logits = stacks.cropped(logits, *(np.array(self.size) - TOKEN_PX * origins[rows]).T)
        found = self._settled(rows, iou, logits, thresholds)
        corner = TOKEN_PX * origins[found.prompt]
        cut = vicinity.cut(found.extent.box, origins[found.prompt])
        box = found.extent.box + np.tile(corner[:, ::-1], 2)
        placed = stacks.placed(found.logits, corner, self.size)
        extent = stacks.Extent(found.extent.area, box)
        whole = MaskPredictions(found.prompt, found.score, found.stability, placed, extent)
        return self._recognised(whole, cut, origins[found.prompt], known)

    def _recognised(
        self,
        masks: MaskPredictions,
        cut: NDArray[np.bool_],
        origins: NDArray[np.int64],
        known: Sequence[MaskPredictions],
    ) -> tuple[MaskPredictions, NDArray[np.bool_]]:
        """The masks (n,), of which those that are `cut` by their windows are replaced by `known` masks that look like
        them there, and which of them are not."""
        vicinity = self.vicinity
        assert vicinity is not None
        rows = np.flatnonzero(cut)
        if not len(known) or not len(rows):
            return masks, cut
        low = TOKEN_PX * origins[rows][:, ::-1]
        window = np.c_[low, np.minimum(low + TOKEN_PX * np.array(vicinity.size[::-1]), self.size[::-1])]
        row, same = suppression.alike_inside(masks[rows], known, window, self.config.nms_iou)
        if not len(row):
            return masks, cut
        rows = rows[row]
        replaced = dataclasses.replace(masks[rows], logits=same.logits, measured=same.extent)
        left = np.setdiff1d(np.arange(len(masks)), rows)
        return MaskPredictions.join([masks[left], replaced]), np.append(cut[left], np.zeros(len(rows), bool))

    def _ask(
        self, asked: "_Asked", soon: "_Asked | None", thresholds: MaskThresholds, size: tuple[int, int]
    ) -> tuple[NDArray[np.intp], NDArray[np.float32], Stack]:
        """The rows (m,) of prompts that have good masks, the predicted IoU (m, M) of all their masks, and the logits
        (m, M, height, width)."""
        first = 1 if asked.prompts.points.shape[1] <= AMBIGUOUS_TOKENS else 0
        embedded, later = self._embedded(asked), None if not soon else partial(self._embedded, soon)
        with NETWORK_LOCK:
            return self.backend.masks(self.parts, embedded, thresholds.predicted_iou, first, size, later)

    def _embedded(self, asked: "_Asked") -> EmbeddedPrompts:
        near = None
        if asked.origins is not None:
            assert self.vicinity is not None
            near = self.vicinity.near(asked.origins)
        return EmbeddedPrompts(self.backend.embed(asked.prompts.points * self.scale, asked.prompts.labels), near)

    def _settled(
        self, rows: NDArray[np.intp], iou: NDArray[np.float32], logits: Stack, thresholds: MaskThresholds
    ) -> MaskPredictions:
        """The masks that are good and stable; `rows` (m,) are of prompts, `iou` (m, M) and `logits` (m, M, h, w)."""
        good = iou >= thresholds.predicted_iou
        flat = stacks.take(logits.reshape(-1, *logits.shape[2:]), np.flatnonzero(good))
        return settled(rows[np.nonzero(good)[0]], iou[good], flat, self.config.stability_offset, thresholds)

    def embedding(self) -> NDArray[np.float32]:
        """(256, h, w) the encoder's image tokens, without those of the padding."""
        return of_photograph(self.backend.tokens(self.parts)[None], self.size)[0].transpose(2, 0, 1)


@dataclass(frozen=True, eq=False)
class _Asked:
    """n prompts of one view, and what they see of it."""

    prompts: Prompts
    origins: NDArray[np.int64] | None = None  # (n, 2) row and column of the first token of their windows; None: all

    def __len__(self) -> int:
        return len(self.prompts)

    def __getitem__(self, rows: slice) -> "_Asked":
        return _Asked(self.prompts[rows], None if self.origins is None else self.origins[rows])


def encoder_scale(image: Image) -> float:
    """px of the encoder's square per image px."""
    return ENCODER_SIDE / max(image.width, image.height)
