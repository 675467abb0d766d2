"""The later SAMs by the library transformers: SAM 2.1, EdgeTAM, SAM-HQ, and SAM 3 on one image.

The library has the networks; their sizes are written here, so that one file of weights is all that is needed. They are
those of the configurations that the authors published (named at each family).
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.errors import MissingDependency
from zpm2.model.messages import Note
from zpm2.runtime import mark_networks_loaded, settle_torch
from zpm2.segment.mask_network import Array, Sight
from zpm2.segment.predictions import CORNER
from zpm2.segment.stacks import Stack

if TYPE_CHECKING:
    from torch import Tensor
    from transformers import PreTrainedModel

    Encoded = dict[str, Tensor | list[Tensor]]  # by the names of the model's arguments

# of a file for video, what a single image does not need
VIDEO = (
    r"memory_",
    r"mask_downsample",
    r"object_pointer_proj",
    r"temporal_positional_encoding_projection_layer",
    r"no_memory_positional_encoding$",
    r"no_object_pointer$",
    r"occlusion_spatial_embedding_parameter$",
)
SHARED = ("shared_image_embedding.positional_embedding", "prompt_encoder.shared_embedding.positional_embedding")
MIDDLE = (127.5, 127.5, 127.5)
Number = int | list[int]  # of a network: one, or one for each of its stages


@dataclass(frozen=True)
class Family:
    """Networks that differ in their numbers only."""

    build: "Callable[..., PreTrainedModel]"  # (side, **numbers) -> the library's model, with any weights
    sight: Sight
    renamed: Mapping[str, str] = field(default_factory=dict)  # patterns of names in the file, and what they become here
    left_out: tuple[str, ...] = VIDEO  # patterns of names in the file that are not needed


def _sam2(side: int, **hiera: Number) -> "PreTrainedModel":
    """`configs/sam2.1` of the repository facebookresearch/sam2."""
    from transformers import Sam2Config, Sam2HieraDetConfig, Sam2Model, Sam2PromptEncoderConfig, Sam2VisionConfig

    backbone = Sam2HieraDetConfig(image_size=[side, side], **hiera)
    vision = Sam2VisionConfig(
        backbone_config=backbone,
        backbone_channel_list=backbone.embed_dim_per_stage[::-1],
        backbone_feature_sizes=_pyramid(side // 16),
    )
    return Sam2Model(Sam2Config(vision_config=vision, prompt_encoder_config=Sam2PromptEncoderConfig(image_size=side)))


def _edgetam(side: int) -> "PreTrainedModel":
    """`sam2/configs/edgetam.yaml` of the repository facebookresearch/EdgeTAM. Its encoder is RepViT M1 of timm."""
    from transformers import EdgeTamConfig, EdgeTamModel, EdgeTamPromptEncoderConfig, EdgeTamVisionConfig
    from transformers import TimmWrapperConfig as Timm

    arguments = {"in_chans": 3, "features_only": True, "out_indices": [0, 1, 2, 3]}
    backbone = Timm(architecture="repvit_m1", model_args=arguments)
    vision = EdgeTamVisionConfig(backbone_config=backbone, backbone_feature_sizes=_pyramid(side // 16))
    prompts = EdgeTamPromptEncoderConfig(image_size=side)
    return EdgeTamModel(EdgeTamConfig(vision_config=vision, prompt_encoder_config=prompts))


def _sam_hq(side: int, **vit: Number) -> "PreTrainedModel":
    """`segment_anything/build_sam.py` of the repository SysCV/sam-hq."""
    from transformers import (
        SamHQConfig,
        SamHQMaskDecoderConfig,
        SamHQModel,
        SamHQPromptEncoderConfig,
        SamHQVisionConfig,
    )

    vision = SamHQVisionConfig(image_size=side, **vit)
    prompts = SamHQPromptEncoderConfig(image_size=side)
    decoder = SamHQMaskDecoderConfig(vit_dim=vision.hidden_size)
    return SamHQModel(SamHQConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=decoder))


def _sam3(side: int, **vit: Number) -> "PreTrainedModel":
    """The library's own numbers, which are those of the only SAM 3 (`sam3/model_builder.py`, facebookresearch/sam3)."""
    from transformers import Sam3TrackerConfig, Sam3TrackerModel, Sam3VisionConfig, Sam3ViTConfig
    from transformers.models.sam3_tracker.configuration_sam3_tracker import Sam3TrackerPromptEncoderConfig

    backbone = Sam3ViTConfig(image_size=side, **vit)
    vision = Sam3VisionConfig(backbone_config=backbone, backbone_feature_sizes=_pyramid(side // 14))
    prompts = Sam3TrackerPromptEncoderConfig(image_size=side)
    return Sam3TrackerModel(Sam3TrackerConfig(vision_config=vision, prompt_encoder_config=prompts))


def _pyramid(grid: int) -> list[list[int]]:
    return [[4 * grid] * 2, [2 * grid] * 2, [grid] * 2]


SAM2 = Family(_sam2, Sight(1024, stretched=True))
EDGETAM = Family(_edgetam, Sight(1024, stretched=True), left_out=(*VIDEO, r"spatial_perceiver"))
SAM_HQ = Family(_sam_hq, Sight(1024, stretched=False), left_out=())
SAM3 = Family(
    _sam3,
    Sight(1008, stretched=True, mean=MIDDLE, std=MIDDLE),
    renamed={
        r"^detector_model\.vision_encoder\.backbone\.": "vision_encoder.backbone.",
        r"^tracker_neck\.": "vision_encoder.neck.",
        r"^tracker_model\.": "",
    },
    left_out=(*VIDEO, r"detector_model\."),
)

MODELS: dict[str, tuple[Family, dict[str, Number]]] = {
    "sam2.1_tiny": (SAM2, {}),
    "sam2.1_small": (SAM2, {"blocks_per_stage": [1, 2, 11, 2], "global_attention_blocks": [7, 10, 13]}),
    "sam2.1_base_plus": (
        SAM2,
        {
            "hidden_size": 112,
            "num_attention_heads": 2,
            "embed_dim_per_stage": [112, 224, 448, 896],
            "num_attention_heads_per_stage": [2, 4, 8, 16],
            "blocks_per_stage": [2, 3, 16, 3],
            "global_attention_blocks": [12, 16, 20],
            "window_positional_embedding_background_size": [14, 14],
        },
    ),
    "sam2.1_large": (
        SAM2,
        {
            "hidden_size": 144,
            "num_attention_heads": 2,
            "embed_dim_per_stage": [144, 288, 576, 1152],
            "num_attention_heads_per_stage": [2, 4, 8, 16],
            "blocks_per_stage": [2, 6, 36, 4],
            "global_attention_blocks": [23, 33, 43],
            "window_size_per_stage": [8, 4, 16, 8],
        },
    ),
    "edgetam": (EDGETAM, {}),
    "sam_hq_b": (SAM_HQ, {}),
    "sam_hq_l": (
        SAM_HQ,
        {
            "hidden_size": 1024,
            "num_hidden_layers": 24,
            "num_attention_heads": 16,
            "global_attn_indexes": [5, 11, 17, 23],
        },
    ),
    "sam_hq_h": (
        SAM_HQ,
        {
            "hidden_size": 1280,
            "num_hidden_layers": 32,
            "num_attention_heads": 16,
            "global_attn_indexes": [7, 15, 23, 31],
        },
    ),
    "sam3": (SAM3, {}),
}


class TransformersSam:
    """A `MaskNetwork` of `MODELS` with its released weights, in torch.

    `WeightsError` where the file cannot be had or is not of this network, `MissingDependency` where transformers does
    not have it.
    """

    def __init__(
        self, name: str, config: SegmentConfig, device: str = "cpu", download: weights.Progress | None = None
    ) -> None:
        family, numbers = MODELS[name]
        import torch

        path = weights.get(name, progress=download)
        note = weights.hash_note(name, path)
        self.notes = [] if note is None else [Note(note)]
        mark_networks_loaded()
        settle_torch()
        self.sight, self.batch = family.sight, config.cpu_batch if device == "cpu" else config.gpu_batch
        self._torch, self._device = torch, torch.device(device)
        half = config.precision != "float32"
        self._arithmetic = partial(torch.autocast, device, getattr(torch, config.precision), enabled=half)
        try:
            model = family.build(family.sight.side, **numbers)
        except ImportError as error:  # the library is there and cannot be loaded, or is too old
            reason = " ".join(str(error.__cause__ or error).split())[:200]
            raise MissingDependency(
                f"transformers cannot load the network of {name} ({reason}): pip install -U 'zpm2[hf]', and where "
                "torchvision is installed, the one that fits your torch"
            ) from error
        weights.load_into(model, _tensors(path, family, model), f"{name} ({path})")
        self._model = model.eval().requires_grad_(False).to(self._device)

    def encode(self, pixels: Array) -> "Encoded":
        with self._torch.inference_mode():
            found = self._model.get_image_embeddings(self._to(pixels))
        if isinstance(found, tuple):  # SAM-HQ: and what its blocks with global attention gave
            return {"image_embeddings": found[0], "intermediate_embeddings": found[1]}
        return {"image_embeddings": found}

    def decode(self, encoded: "Encoded", points: Array, labels: NDArray[np.int64]) -> tuple[Array, Stack]:
        centred = points - np.float32(0.5)  # the library counts from the centre of the first pixel
        single = labels < CORNER
        prompts = {"input_points": self._to(centred[None, :, single])}
        prompts["input_labels"] = self._to(np.tile(labels[single], (1, len(points), 1)))
        if (corners := centred[:, ~single]).size:
            prompts["input_boxes"] = self._to(corners.reshape(1, len(corners), 4))
        with self._torch.inference_mode(), self._arithmetic():
            found = self._model(**encoded, **prompts, multimask_output=True)
        masks = found.pred_masks[0].float()
        return found.iou_scores[0].float().cpu().numpy(), masks if self._device.type != "cpu" else masks.numpy()

    def _to(self, array: Array) -> "Tensor":
        return self._torch.from_numpy(np.ascontiguousarray(array)).to(self._device)


def _tensors(path: Path, family: Family, model: "PreTrainedModel") -> "dict[str, Tensor]":
    """What a file has for a network, by the names that the network gives it."""
    state = {}
    for name, tensor in weights.load_tensors(path).items():
        for pattern, new in family.renamed.items():
            name = re.sub(pattern, new, name)
        if not any(re.match(pattern, name) for pattern in family.left_out):
            state[name] = tensor
    own = model.state_dict()
    for one, other in (SHARED, SHARED[::-1]):  # two names of one tensor, which some files hold once
        if one in own and one not in state and other in state:
            state[one] = state[other]
    return state
