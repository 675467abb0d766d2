"""ALIKED (Zhao et al., IEEE TIM 2023): kornia's network, in less memory and time."""

import torch
from kornia.feature import ALIKED
from kornia.feature.aliked.aliked import DeformableConv2d
from torch import Tensor
from torch.nn.functional import embedding_bag

ROWS = 32  # that the first layer of the score head takes at a time: the library copies what it reads


class AlikedNetwork(ALIKED):  # type: ignore[misc]
    """kornia's ALIKED, with the same numbers up to rounding. Its maps have 128 channels at full resolution: 0.5 GB of
    an image of 1024 x 1024 px, of which kornia holds several."""

    def __init__(self, model: str, **settings: float) -> None:
        super().__init__(model, **settings)
        for block in (self.block3, self.block4):
            block.conv1, block.conv2 = map(DeformableConvolution.like, (block.conv1, block.conv2))

    def extract_dense_map(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """(b, 3, h, w) RGB 0..1, sides multiples of 32 -> (b, 128, h, w) unit vectors and (b, 1, h, w) scores 0..1."""
        fine = self.block1(image)
        maps = fine.new_empty(len(fine), 4 * self.conv1.out_channels, *fine.shape[2:])
        parts = maps.chunk(4, dim=1)
        parts[0].copy_(self.gate(self.conv1(fine)))
        half = self.block2(self.pool2(fine))
        del fine
        parts[1].copy_(self.upsample2(self.gate(self.conv2(half))))
        eighth = self.block3(self.pool4(half))
        parts[2].copy_(self.upsample8(self.gate(self.conv3(eighth))))
        coarse = self.block4(self.pool4(eighth))
        parts[3].copy_(self.upsample32(self.gate(self.conv4(coarse))))
        first, *rest = self.score_head
        scores = torch.cat([first(rows) for rows in torch.split(maps, ROWS, dim=2)], dim=2)
        for layer in rest:
            scores = layer(scores)
        return maps.div_(_lengths(maps)), scores.sigmoid_()


class DeformableConvolution(DeformableConv2d):  # type: ignore[misc]
    """kornia's deformable convolution (Dai et al., ICCV 2017) of 3 x 3 px without a bias. It reads one of the nine
    pixels of all windows at a time, whose four neighbours one call sums: fifteen times as fast on a CPU."""

    @classmethod
    def like(cls, other: DeformableConv2d) -> "DeformableConvolution":
        """One of the same shape and weights."""
        made = cls(other.regular_conv.in_channels, other.regular_conv.out_channels)
        made.load_state_dict(other.state_dict(), strict=True)
        return made

    def forward(self, x: Tensor) -> Tensor:
        """(b, c, h, w) -> (b, d, h, w)."""
        b, c, h, w = x.shape
        most = max(h, w) / 4
        pixels, weights = _neighbours(self.offset_conv(x).clamp(-most, most))
        table = x.permute(0, 2, 3, 1).reshape(-1, c)
        kernel = self.regular_conv.weight.flatten(2).permute(2, 1, 0)  # (9, c, d)
        out = table.new_zeros(len(table), kernel.shape[2])
        for at, shares, of_it in zip(pixels, weights, kernel, strict=True):
            out.addmm_(embedding_bag(at, table, per_sample_weights=shares, mode="sum"), of_it)
        return out.view(b, h, w, -1).permute(0, 3, 1, 2).contiguous()


def _neighbours(offsets: Tensor) -> tuple[Tensor, Tensor]:
    """(b, 18, h, w) px, dy and dx of each pixel of a window -> (9, b h w, 4) the pixels around it, counted through all
    images, and their weights in bilinear interpolation, 0 outside."""
    b, _, h, w = offsets.shape
    of_image = torch.arange(b, device=offsets.device).view(-1, 1, 1, 1, 1)
    rows, columns = (torch.arange(n, device=offsets.device, dtype=offsets.dtype) for n in (h, w))
    step = torch.arange(-1, 2, device=offsets.device, dtype=offsets.dtype)
    y = rows[:, None] + step.repeat_interleave(3)[:, None, None] + offsets[:, 0::2]
    x = columns + step.repeat(3)[:, None, None] + offsets[:, 1::2]
    top, left = y.floor(), x.floor()
    ys, xs = torch.stack([top, top, top + 1, top + 1], -1), torch.stack([left, left + 1, left, left + 1], -1)
    inside = (ys >= 0) & (ys < h) & (xs >= 0) & (xs < w)
    weights = (1 - (y[..., None] - ys).abs()) * (1 - (x[..., None] - xs).abs()) * inside
    pixels = (ys.clamp(0, h - 1) * w + xs.clamp(0, w - 1)).long() + of_image * (h * w)
    return pixels.transpose(0, 1).reshape(9, -1, 4), weights.transpose(0, 1).reshape(9, -1, 4)


def _lengths(maps: Tensor) -> Tensor:
    """(b, 1, h, w) norms of (b, c, h, w) vectors. One channel at a time, a CPU is ten times as fast as with `norm`."""
    squares = torch.zeros_like(maps[:, :1])
    for channel in torch.split(maps, 1, dim=1):
        squares.addcmul_(channel, channel)
    return squares.sqrt_().clamp_min_(1e-12)
