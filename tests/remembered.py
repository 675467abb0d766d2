"""SAM, XFeat and LightGlue for tests that run many commands on the same photographs: loaded once, and asked once about
each prompt, photograph and pair."""

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy

import numpy as np
import pytest
import torch

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.features import xfeat_network
from zpm2.features.lightglue import LightGlueMatcher
from zpm2.features.protocol import Features
from zpm2.model import Image
from zpm2.segment import sam, sam_backend
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.sam import SamSegmenter
from zpm2.segment.sam_view import SamView


class Memory:
    """What the networks said."""

    def __init__(self) -> None:
        self.opened: dict[tuple[object, ...], sam_backend.SamBackend] = {}
        self.views: dict[tuple[object, ...], SamView] = {}
        self.found: dict[tuple[object, ...], MaskPredictions] = {}
        self.xfeat: dict[object, torch.nn.Module] = {}
        self.points: dict[object, object] = {}
        self.lightglue: dict[object, LightGlueMatcher] = {}
        self.pairs: dict[object, object] = {}


@contextmanager
def remembered(memory: Memory | None = None) -> Iterator[None]:
    """Within it the networks run once for each photograph and each call with the same prompts; all else is as ever.
    `memory` is that of an earlier use."""
    memory = memory or Memory()
    opened, views, found = memory.opened, memory.views, memory.found
    predict, predict_small, open_backend = SamView.predict, SamView.predict_small, sam.open_backend

    def open_once(config: SegmentConfig, device: str, *more: object) -> sam_backend.SamBackend:
        key = config.model, config.backend, device
        if key not in opened:
            opened[key] = open_backend(config, device, *more)  # type: ignore[arg-type]
        return opened[key]

    def view_once(segmenter: SamSegmenter, image: Image) -> SamView:
        backend = segmenter.load()
        key = id(backend), segmenter.config.padding, segmenter.config.vicinity, image.rgb.shape, _digest(image.rgb)
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

    def small_once(
        view: SamView,
        prompts: Prompts,
        thresholds: MaskThresholds,
        known: Sequence[MaskPredictions],
        soon: Prompts | None = None,
    ) -> MaskPredictions:
        masks = *((part.extent.area.tobytes(), part.extent.box.tobytes()) for part in known), view.config.nms_iou
        key = id(view.parts), view.config.stability_offset, thresholds, prompts.points.tobytes(), masks
        if key not in found:
            found[key] = predict_small(view, prompts, thresholds, known, soon)
        return found[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sam, "open_backend", open_once)
        patch.setattr(SamSegmenter, "view", view_once)
        patch.setattr(SamView, "predict", predict_once)
        patch.setattr(SamView, "predict_small", small_once)
        _remember_points(memory, patch)
        yield


def _remember_points(memory: Memory, patch: pytest.MonkeyPatch) -> None:
    load, extract = xfeat_network.load, xfeat_network.extract
    build, pair = LightGlueMatcher.__init__, LightGlueMatcher.pair

    def load_once(device: str, progress: weights.Progress | None) -> torch.nn.Module:
        if device not in memory.xfeat:
            memory.xfeat[device] = load(device, progress)
        return memory.xfeat[device]

    def extract_once(network: torch.nn.Module, pixels: torch.Tensor, limit: int) -> object:
        key = id(network), limit, pixels.shape, _digest(pixels.numpy())
        if key not in memory.points:
            memory.points[key] = extract(network, pixels, limit)
        return memory.points[key]

    def build_once(self: LightGlueMatcher, name: str, device: str, progress: weights.Progress | None = None) -> None:
        if (name, device) not in memory.lightglue:
            build(self, name, device, progress)
            memory.lightglue[name, device] = self
        vars(self).update(vars(memory.lightglue[name, device]))

    def pair_once(self: LightGlueMatcher, left: Features, right: Features) -> object:
        arrays = [array for side in (left, right) for array in (side.points, side.descriptors)]
        key = id(self.network), left.size, right.size, *map(_digest, arrays)
        if key not in memory.pairs:
            memory.pairs[key] = pair(self, left, right)
        return memory.pairs[key]

    patch.setattr(xfeat_network, "load", load_once)
    patch.setattr(xfeat_network, "extract", extract_once)
    patch.setattr(LightGlueMatcher, "__init__", build_once)
    patch.setattr(LightGlueMatcher, "pair", pair_once)


def _digest(array: np.ndarray) -> bytes:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).digest()
