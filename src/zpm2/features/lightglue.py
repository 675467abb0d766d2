"""LightGlue (Lindenberger et al., ICCV 2023) and LighterGlue, its small version for XFeat (Potje et al., CVPR 2024).

The network is kornia's, with the published settings; only the weights come from `zpm2.weights`.
"""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import torch
from kornia.feature import LightGlue
from numpy.typing import NDArray
from torch import Tensor, nn

from zpm2 import weights
from zpm2.features.protocol import Features

if TYPE_CHECKING:
    from kornia.feature.lightglue import CrossBlock, MatchAssignment

SETTINGS: Mapping[str, Mapping[str, float]] = {
    "xfeat_lighterglue": {
        "input_dim": 64,
        "descriptor_dim": 96,
        "n_layers": 6,
        "num_heads": 1,
        "depth_confidence": -1,
        "width_confidence": 0.95,
    },
    "disk_lightglue": {"input_dim": 128},
    "aliked_lightglue": {"input_dim": 128},
    "superpoint_lightglue": {"input_dim": 256},
}
BAND = 256  # points of an image that `LeanAssignment` sums over at a time


class LightGlueMatcher:
    """Pairs features by attention; `name` is one of `SETTINGS`. Scores are the network's assignment probabilities."""

    def __init__(self, name: str, device: str, progress: weights.Progress | None = None) -> None:
        self.device = device
        self.network = LightGlue(None, filter_threshold=0.0, **SETTINGS[name])
        state = published_names(weights.load_state_dict(name, progress=progress))
        state["confidence_thresholds"] = self.network.confidence_thresholds  # computed, not learned
        self.network.load_state_dict(state, strict=True)
        if device == "cpu":
            for layer in self.network.transformers:
                layer.cross_attn = FusedCrossAttention(layer.cross_attn)
            self.network.log_assignment = nn.ModuleList(map(LeanAssignment, self.network.log_assignment))
        self.network.eval().to(device)

    def pair(self, left: Features, right: Features) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """See `FeatureMatcher.pair`."""
        with torch.inference_mode():
            out = self.network({"image0": self._input(left), "image1": self._input(right)})
            rows, scores = out["matches"][0].cpu().numpy(), out["scores"][0].double().cpu().numpy()
        return rows.astype(np.intp), scores

    def _input(self, features: Features) -> dict[str, torch.Tensor]:
        """Original px: LightGlue divides by the image size itself, whatever size the detector saw."""
        return {
            "keypoints": torch.from_numpy(features.points).float()[None].to(self.device),
            "descriptors": torch.from_numpy(features.descriptors)[None].to(self.device),
            "image_size": torch.tensor([features.size], device=self.device),
        }


class FusedCrossAttention(nn.Module):
    """kornia's cross attention without the matrix of all points with all points that it builds on a CPU: two to three
    times as fast with 4096 points, with the same numbers up to rounding."""

    def __init__(self, block: "CrossBlock") -> None:
        super().__init__()
        self.block = block

    def forward(self, x0: Tensor, x1: Tensor, mask: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """(1, M, D) and (1, N, D) descriptors -> the same, each after attention to the other image's."""
        block = self.block
        (qk0, v0), (qk1, v1) = (
            [t.unflatten(-1, (block.heads, -1)).transpose(1, 2) for t in (block.to_qk(x), block.to_v(x))]
            for x in (x0, x1)
        )
        attend = nn.functional.scaled_dot_product_attention
        across = mask.transpose(-2, -1) if mask is not None else None
        messages = attend(qk0, qk1, v1, attn_mask=mask), attend(qk1, qk0, v0, attn_mask=across)
        y0, y1 = (
            x + block.ffn(torch.cat([x, block.to_out(m.transpose(1, 2).flatten(start_dim=-2))], -1))
            for x, m in zip((x0, x1), messages, strict=True)
        )
        return y0, y1


class LeanAssignment(nn.Module):
    """kornia's assignment of points to points, with two matrices of all points with all points instead of seven, and
    twice to four times as fast on a CPU, with the same numbers up to rounding."""

    def __init__(self, head: "MatchAssignment") -> None:
        super().__init__()
        self.head = head
        self.get_matchability = head.get_matchability

    def forward(self, desc0: Tensor, desc1: Tensor) -> tuple[Tensor, Tensor]:
        """(1, M, D) and (1, N, D) descriptors -> (1, M + 1, N + 1) log probabilities, the last row and column that of
        no partner, and again without these."""
        z0, z1 = self.head.matchability(desc0), self.head.matchability(desc1)
        desc0, desc1 = (x / x.shape[-1] ** 0.25 for x in (self.head.final_proj(desc0), self.head.final_proj(desc1)))
        alike = torch.einsum("bmd,bnd->bmn", desc0, desc1)
        given0 = torch.cat([rows.logsumexp(2, keepdim=True) for rows in torch.split(alike, BAND, dim=1)], 1)
        given1 = torch.cat([columns.logsumexp(1, keepdim=True) for columns in torch.split(alike, BAND, dim=2)], 2)
        scores = nn.functional.pad(alike, (0, 1, 0, 1))
        both = scores[:, :-1, :-1]
        certain = nn.functional.logsigmoid
        both.mul_(2).add_(certain(z0) - given0).add_(certain(z1).transpose(1, 2) - given1)
        scores[:, :-1, -1] = certain(-z0.squeeze(-1))
        scores[:, -1, :-1] = certain(-z1.squeeze(-1))
        return scores, both


def published_names(state: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """A published state dict with kornia's names, without the entries that are no part of the network.

    `self_attn.3.x` and `cross_attn.3.x` of the first release are `transformers.3.self_attn.x` now. LighterGlue's file
    holds the matcher under `matcher.` beside a copy of XFeat under `extractor.`; SuperPoint's and DISK's hold a
    `log_assignment.i.r` that no released code has ever read.
    """
    learned = {k.removeprefix("matcher."): v for k, v in state.items() if not k.startswith("extractor.")}
    return {
        re.sub(r"^(self_attn|cross_attn)\.(\d+)\.", r"transformers.\2.\1.", k): v
        for k, v in learned.items()
        if not re.fullmatch(r"log_assignment\.\d+\.r", k)
    }
