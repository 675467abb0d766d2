"""SAM for tests that run many commands on the same photographs: loaded once, and asked once about each prompt."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy

import pytest

from zpm2.config import SegmentConfig
from zpm2.model import Image
from zpm2.segment import sam, sam_backend
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.sam import SamSegmenter, SamView


class Memory:
    """What the networks said."""

    def __init__(self) -> None:
        self.opened: dict[tuple[object, ...], sam_backend.SamBackend] = {}
        self.views: dict[tuple[object, ...], SamView] = {}
        self.found: dict[tuple[object, ...], MaskPredictions] = {}


@contextmanager
def remembered(memory: Memory | None = None) -> Iterator[None]:
    """Within it the networks run once for each photograph and each call with the same prompts; all else is as ever.
    `memory` is that of an earlier use."""
    memory = memory or Memory()
    opened, views, found = memory.opened, memory.views, memory.found
    predict = SamView.predict

    def open_once(config: SegmentConfig, device: str, *more: object) -> sam_backend.SamBackend:
        key = config.model, config.backend, device
        if key not in opened:
            opened[key] = sam_backend.open_backend(config, device, *more)  # type: ignore[arg-type]
        return opened[key]

    def view_once(segmenter: SamSegmenter, image: Image) -> SamView:
        backend = segmenter.load()
        key = id(backend), segmenter.config.padding, image.rgb.shape, hashlib.sha256(image.rgb.tobytes()).digest()
        if key not in views:
            views[key] = SamView(backend, image, segmenter.config)
        view = copy(views[key])
        view.image, view.config = image, segmenter.config
        return view

    def predict_once(view: SamView, prompts: Prompts, thresholds: MaskThresholds) -> MaskPredictions:
        offset = view.config.stability_offset
        key = id(view.parts), offset, thresholds, prompts.points.tobytes(), prompts.labels.tobytes()
        if key not in found:
            found[key] = predict(view, prompts, thresholds)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sam, "open_backend", open_once)
        patch.setattr(SamSegmenter, "view", view_once)
        patch.setattr(SamView, "predict", predict_once)
        yield
