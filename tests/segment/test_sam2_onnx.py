"""SAM 2 tiny by ONNX Runtime, with the real weights."""

from pathlib import Path

import numpy as np
import pytest
from rendered import Pair

pytest.importorskip("onnxruntime", reason="needs the extra onnx")

from zpm2.config import SegmentConfig
from zpm2.errors import WeightsError
from zpm2.model import Image
from zpm2.segment.mask_network import NetworkSegmenter, NetworkView
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskThresholds, Prompts
from zpm2.segment.registry import create

EVERYTHING = MaskThresholds(0.0, 0.0)


@pytest.fixture(scope="module")
def view(pair: Pair) -> NetworkView:
    segmenter = create(SegmentConfig(model="sam2_tiny", cpu_batch=4))
    assert isinstance(segmenter, NetworkSegmenter)
    assert segmenter.notes == []
    return segmenter.view(Image(pair.scene.left))


@pytest.fixture(scope="module")
def points(view: NetworkView) -> np.ndarray:
    return np.random.default_rng(0).uniform(5, [view.image.width - 5, view.image.height - 5], (6, 2))


@pytest.mark.weights
def test_three_masks_a_prompt_whatever_the_batch(view: NetworkView, points: np.ndarray) -> None:
    found = view.predict(Prompts.at(points), EVERYTHING)
    assert np.bincount(found.prompt).max() == 3
    assert ((found.score >= 0) & (found.score <= 1)).all()
    alone = view.predict(Prompts.at(points[[4]]), EVERYTHING)
    together = found[found.prompt == 4]
    assert alone.score == pytest.approx(together.score, abs=1e-4)
    assert (alone.bits != together.bits).mean() < 1e-4


@pytest.mark.weights
def test_good_masks_hold_their_points_and_fit_their_boxes(view: NetworkView, points: np.ndarray) -> None:
    found = view.predict(Prompts.at(points), MaskThresholds(0.8, 0.9))
    assert len(found) > 0
    column, row = (points[found.prompt] * view.mask_scale).astype(int).T
    assert found.bits[np.arange(len(found)), row, column].mean() > 0.9
    mask = view.masks(found)[int(found.score.argmax())]
    height, width = mask.bits.shape
    box = np.array([[mask.x0, mask.y0], [mask.x0 + width, mask.y0 + height]], float)
    point = points[found.prompt[int(found.score.argmax())]]
    prompt = Prompts(np.concatenate([point[None], box])[None], np.array([INSIDE, CORNER, OTHER_CORNER]))
    again = view.masks(view.predict(prompt, EVERYTHING))
    assert max(min(m.area, mask.area) / max(m.area, mask.area) for m in again) > 0.8


def test_other_files_are_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "graph.ort"
    path.write_bytes(b"no graph at all")
    monkeypatch.setattr("zpm2.weights.get", lambda name, progress=None: path)
    with pytest.raises(WeightsError, match=r"ONNX Runtime .* cannot read .*graph\.ort") as caught:
        create(SegmentConfig(model="sam2_tiny"))
    assert "\n" not in str(caught.value)
