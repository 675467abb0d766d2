"""What crosses from a device to the host while both images are segmented. The device is the CPU, by torch's tensors."""

import dataclasses

import numpy as np
import pytest
import torch
from test_redetection import CONFIG, match, scene
from torch.overrides import TorchFunctionMode

from zpm2.guided import redetection
from zpm2.segment import device_stacks
from zpm2.segment.predictions import MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.sam_view import SamView


class Watched(TorchFunctionMode):
    """Refuses every way from a tensor to the host but `device_stacks.to_host`."""

    WAYS = ("cpu", "numpy", "item", "tolist", "nonzero", "__array__", "__bool__", "__int__", "__float__", "__index__")

    def __init__(self) -> None:
        super().__init__()
        self.allowed = False

    def __torch_function__(self, func, types, args=(), kwargs=None):  # type: ignore[no-untyped-def]
        name = getattr(func, "__name__", "")
        assert self.allowed or name not in self.WAYS, f"a tensor crosses to the host by {name}"
        return func(*args, **(kwargs or {}))


def test_masks_stay_on_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole detection of both images: the same regions, by a few transfers of numbers and of the survivors' crops."""
    views, initial = scene(left_hidden=range(4), right_hidden=range(10))
    expected = redetection.detect(views, initial, CONFIG)
    expected = redetection.redetect(expected, [match(0, 0)], initial, CONFIG)
    sent = list[int]()  # bytes
    watched, to_host = Watched(), device_stacks.to_host

    def counted(*tensors: torch.Tensor) -> list[np.ndarray]:
        sent.append(sum(tensor.numel() * tensor.element_size() for tensor in tensors))
        watched.allowed = True
        try:
            return to_host(*tensors)
        finally:
            watched.allowed = False

    monkeypatch.setattr(device_stacks, "to_host", counted)
    views, initial = scene(left_hidden=range(4), right_hidden=range(10))
    for view in views:
        ask = view.predict

        def predict(prompts: Prompts, thresholds: MaskThresholds, ask=ask) -> MaskPredictions:  # type: ignore[no-untyped-def]
            found = ask(prompts, thresholds)
            return dataclasses.replace(found, logits=torch.from_numpy(found.logits), measured=None)

        monkeypatch.setattr(view, "predict", predict)
        monkeypatch.setattr(view, "masks", SamView.masks.__get__(view))
    with watched:
        found = redetection.detect(views, initial, CONFIG)
        found = redetection.redetect(found, [match(0, 0)], initial, CONFIG)
    for one, other in ((expected.left, found.left), (expected.right, found.right)):
        assert [p.shape.wkb for p in one.polygons] == [p.shape.wkb for p in other.polygons]
        assert np.array_equal(one.guided, other.guided)
        assert np.array_equal(one.confident, other.confident)
        assert isinstance(other.predictions.logits, torch.Tensor)  # type: ignore[attr-defined]
    assert len(sent) < 80
    assert max(sent) < 6 * 256 * 256  # no stack of masks: two maps of one view, 1 and 4 bytes a pixel, are the largest
