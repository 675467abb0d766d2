"""SAM 2.1, EdgeTAM, SAM-HQ and SAM 3 by transformers: random weights of the real networks, saved and loaded."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from painted import blank

pytest.importorskip("transformers", reason="needs the extra hf")
pytest.importorskip("safetensors", reason="needs the extra hf")

import torch
from safetensors.torch import save_file

from zpm2.config import SegmentConfig
from zpm2.errors import MissingDependency, WeightsError
from zpm2.model.messages import Note
from zpm2.segment import transformers_sam
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedSegmenter, Segmenter, notes_of
from zpm2.segment.registry import create
from zpm2.segment.transformers_sam import EDGETAM, MODELS, SAM2, SAM3, SAM_HQ, Family

EVERYTHING = MaskThresholds(0.0, 0.0)
VIT = {"num_hidden_layers": 4, "num_attention_heads": 4, "global_attn_indexes": [1, 3]}
SMALL: dict[str, tuple[Family, int, dict[str, Any]]] = {  # the family, the side that is seen, its numbers
    "sam2.1_tiny": (
        SAM2,
        128,
        {
            "hidden_size": 8,
            "embed_dim_per_stage": [8, 16, 32, 64],
            "blocks_per_stage": [1, 1, 2, 1],
            "global_attention_blocks": [3],
        },
    ),
    "edgetam": (EDGETAM, 128, {}),
    "sam_hq_b": (SAM_HQ, 128, {"hidden_size": 32, **VIT}),
    "sam3": (SAM3, 126, {"hidden_size": 32, "intermediate_size": 64, "window_size": 3, **VIT}),
}
Tensors = dict[str, torch.Tensor]
needs_timm = pytest.mark.skipif(find_spec("timm") is None, reason="needs the extra edgetam")


@pytest.fixture(params=[pytest.param(each, marks=needs_timm if each == "edgetam" else ()) for each in SMALL])
def name(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> str:
    """A model whose network is made small."""
    family, side, numbers = SMALL[request.param]
    small = replace(family, sight=replace(family.sight, side=side))
    monkeypatch.setitem(MODELS, request.param, (small, numbers))
    monkeypatch.setenv("ZPM2_WEIGHTS", str(tmp_path))
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path / "cache"))
    return str(request.param)


def tensors(name: str) -> Tensors:
    """Random weights, by the names in a published file."""
    torch.manual_seed(0)
    family, numbers = MODELS[name]
    model = family.build(family.sight.side, **numbers)
    state = {key: value if kept(key) else torch.randn_like(value) * 0.1 for key, value in model.state_dict().items()}
    if name == "sam3":
        return {published(key): value for key, value in state.items()} | {"detector_model.text.weight": torch.ones(2)}
    if name == "sam_hq_b":
        del state[transformers_sam.SHARED[1]]  # stored once
        return state
    return state | {"memory_encoder.weight": torch.ones(2), "no_object_pointer": torch.ones(1)}


def kept(key: str) -> bool:
    """What a batch normalisation measured or scales by."""
    return key.endswith(("num_batches_tracked", "running_var", "bn.weight"))


def published(key: str) -> str:
    """The name of a tensor of SAM 3's tracker in the file of the whole SAM 3."""
    if key.startswith("vision_encoder.backbone."):
        return f"detector_model.{key}"
    return f"tracker_neck.{key[20:]}" if key.startswith("vision_encoder.neck.") else f"tracker_model.{key}"


def saved(name: str, state: Tensors, folder: Path) -> Path:
    path = folder / f"{name}.safetensors"
    save_file({key: value.clone() for key, value in state.items()}, path)
    return path


def opened(name: str) -> Segmenter:
    limits = {"min_predicted_iou": 0.0, "min_stability": 0.0, "min_area": 1.0}
    return create(SegmentConfig(model=name, grid=4, cpu_batch=3, **limits))


def test_contract(name: str, tmp_path: Path) -> None:
    saved(name, tensors(name), tmp_path)
    segmenter, image = opened(name), blank(120, 90)
    assert segmenter.name == name
    assert isinstance(segmenter, PromptedSegmenter)
    (note,) = notes_of(segmenter)
    assert isinstance(note, Note)
    assert "does not know the hash" in note
    view = segmenter.view(image)
    points = np.random.default_rng(0).uniform(5, 85, (7, 2))
    found = view.predict(Prompts.at(points), MaskThresholds(-9.0, 0.0))
    assert found.logits.shape[1:] == view.size == (192, 256)
    assert 0 < len(found) <= 21
    assert set(found.prompt) <= set(range(7))
    box = Prompts(np.stack([points, points - 5, points + 5], 1), np.array([INSIDE, CORNER, OTHER_CORNER]))
    assert not np.array_equal(view.predict(box, MaskThresholds(-9.0, 0.0)).logits, found.logits)
    alone = view.predict(Prompts.at(points[[4]]), MaskThresholds(-9.0, 0.0))
    assert alone.logits.astype(float) == pytest.approx(found.logits[found.prompt == 4].astype(float), abs=1e-2)
    for mask in view.masks(found):
        assert mask.x0 >= 0
        assert mask.x0 + mask.bits.shape[1] <= image.width
    whole = view.cover(np.array([shapely.box(0, 0, 120, 90)], object))
    assert whole.mean() > 0.98
    assert len(view.predict(Prompts.at(np.zeros((0, 2))), EVERYTHING)) == 0
    first, second = (segmenter.segment(image) for _ in range(2))
    assert [m.bits.tobytes() for m in first] == [m.bits.tobytes() for m in second]


def truncated(name: str, state: Tensors, folder: Path) -> None:
    path = saved(name, state, folder)
    path.write_bytes(path.read_bytes()[:-100])


def no_weights(name: str, state: Tensors, folder: Path) -> None:
    (folder / f"{name}.safetensors").write_bytes(b"<html>Please log in</html>")


def renamed(name: str, state: Tensors, folder: Path) -> None:
    key = next(key for key in state if "mask_decoder" in key)
    saved(name, {f"{k}_2" if k == key else k: v for k, v in state.items()}, folder)


def missing(name: str, state: Tensors, folder: Path) -> None:
    key = next(key for key in state if "prompt_encoder" in key and "shared" not in key)
    saved(name, {k: v for k, v in state.items() if k != key}, folder)


def of_another_shape(name: str, state: Tensors, folder: Path) -> None:
    key = next(key for key in state if "mask_decoder" in key and state[key].ndim == 2)
    saved(name, {**state, key: state[key][:-1]}, folder)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (truncated, "cannot be read as weights"),
        (no_weights, "cannot be read as weights"),
        (renamed, r"do not fit this network: the file lacks (\S*mask_decoder\S*); has besides \1_2;"),
        (missing, r"do not fit this network: the file lacks \S*prompt_encoder\S*;"),
        (of_another_shape, r"do not fit this network: the file has in another shape \S*mask_decoder\S*;"),
    ],
)
def test_other_files_are_refused_in_one_line(name: str, tmp_path: Path, damage: Any, said: str) -> None:
    damage(name, tensors(name), tmp_path)
    with pytest.raises(WeightsError, match=said) as caught:
        opened(name)
    assert "\n" not in str(caught.value)
    assert str(tmp_path / name) in str(caught.value)
    assert "--segmenter classical" in str(caught.value)


def test_the_networks_have_their_published_sizes() -> None:
    """Blocks of SAM 2.1's encoders and widths of SAM-HQ's, as their authors' configurations have them."""
    from transformers import Sam2HieraDetConfig

    published = {"sam2.1_tiny": 12, "sam2.1_small": 16, "sam2.1_base_plus": 24, "sam2.1_large": 48}  # blocks
    for name, blocks in published.items():
        config = Sam2HieraDetConfig(**MODELS[name][1])
        assert sum(config.blocks_per_stage) == blocks
        assert max(config.global_attention_blocks) < blocks
    for name, width in (("sam_hq_b", 768), ("sam_hq_l", 1024), ("sam_hq_h", 1280)):
        assert MODELS[name][1].get("hidden_size", 768) == width


def test_edgetam_says_what_it_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zpm2.plugins.find_spec", lambda package: None if package == "timm" else object())
    with pytest.raises(MissingDependency, match=r"segmenter 'edgetam' needs timm: pip install .zpm2\[edgetam\].$"):
        opened("edgetam")
