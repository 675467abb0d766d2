"""SuperGlue (Sarlin et al., CVPR 2020): pairs the points of SuperPoint by attention and optimal transport.

The trained layers are those of `transformers`. They are called here one by one, as `transformers` fills the smaller
image up with points that do not exist, and these take a share of the transport.
"""

from types import ModuleType

import numpy as np
import torch
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.features.protocol import Features

SPREAD = 0.7  # positions are divided by this share of the longer side, as published


class SuperGlueMatcher:
    """Pairs features by attention; `name` is that of the weights. Scores are the network's assignment probabilities."""

    def __init__(self, name: str, package: ModuleType, device: str, progress: weights.Progress | None = None) -> None:
        from transformers.models.superglue.modeling_superglue import log_optimal_transport

        self.device, self._transport = device, log_optimal_transport
        self.network = package.SuperGlueForKeypointMatching(package.SuperGlueConfig())
        weights.load_into(self.network, weights.load_state_dict(name, progress=progress), name)
        del self.network.keypoint_detector  # a copy of SuperPoint; ours is used
        self.network.eval().to(device)

    def pair(self, left: Features, right: Features) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """See `FeatureMatcher.pair`."""
        network, settings = self.network, self.network.config
        with torch.inference_mode():
            a, b = self._described(left), self._described(right)
            for layer, kind in zip(network.gnn.layers, settings.gnn_layers_types, strict=True):
                of_a, of_b = (b, a) if kind == "cross" else (None, None)
                a, b = a + layer(a, encoder_hidden_states=of_a)[0], b + layer(b, encoder_hidden_states=of_b)[0]
            similarity = network.final_projection(a) @ network.final_projection(b).mT / settings.hidden_size**0.5
            transport = self._transport(similarity, network.bin_score, settings.sinkhorn_iterations)
            probability = transport[0, :-1, :-1].exp()
            best, to_right = probability.max(1)
            rows = torch.nonzero(probability.argmax(0)[to_right] == torch.arange(len(left), device=self.device))[:, 0]
            pairs = torch.stack([rows, to_right[rows]], 1).cpu().numpy()
            scores = best[rows].double().cpu().numpy()
        return pairs.astype(np.intp), np.clip(scores, 0.0, 1.0)

    def _described(self, features: Features) -> torch.Tensor:
        """(1, n, 256) descriptors with the points' positions and scores in them."""
        size = np.array(features.size, np.float64)
        at = torch.from_numpy((features.points - size / 2) / (SPREAD * size.max())).float()
        scores = torch.from_numpy(features.scores).float()
        encoded: torch.Tensor = self.network.keypoint_encoder(at[None].to(self.device), scores[None].to(self.device))[0]
        return torch.from_numpy(features.descriptors)[None].to(self.device) + encoded
