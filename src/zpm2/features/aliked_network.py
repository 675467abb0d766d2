"""ALIKED (Zhao et al., IEEE TIM 2023): kornia's network, with less memory."""

import torch
from kornia.feature import ALIKED
from torch import Tensor


class AlikedNetwork(ALIKED):  # type: ignore[misc]
    """kornia's ALIKED, with the same numbers. Its maps have 128 channels at full resolution: 0.5 GB of an image of
    1024 x 1024 px, which kornia copies."""

    def extract_dense_map(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(b, 3, h, w) RGB 0..1, sides multiples of 32 -> (b, 128, h, w) unit vectors and (b, 1, h, w) scores 0..1."""
        fine = self.block1(image)
        half = self.block2(self.pool2(fine))
        eighth = self.block3(self.pool4(half))
        coarse = self.block4(self.pool4(eighth))
        maps = torch.cat(
            [
                self.gate(self.conv1(fine)),
                self.upsample2(self.gate(self.conv2(half))),
                self.upsample8(self.gate(self.conv3(eighth))),
                self.upsample32(self.gate(self.conv4(coarse))),
            ],
            dim=1,
        )
        scores = torch.sigmoid(self.score_head(maps))
        return maps.div_(maps.norm(dim=1, keepdim=True).clamp_min_(1e-12)), scores
