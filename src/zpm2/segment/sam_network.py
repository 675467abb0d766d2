"""SAM cut into three networks for segment everything: per image, per prompt, per mask that is kept.

The mask decoder of SAM (Kirillov et al., Segment Anything, ICCV 2023, Fig. 4) lets T prompt tokens (here 7) and N =
4096 image tokens attend to each other in two layers, and then upscales the image tokens to a 256 x 256 mask. Run as
published it costs 1.75 G multiply-adds a prompt, nearly all of it in projections of the image tokens. Three
identities, none of which changes the result beyond rounding, leave about a quarter of the attention part:

- In the first layer the image tokens are the same for every prompt, so their projections belong to the image.
- A projection of the image tokens that only meets T tokens can be moved to their side:
  q (X W)^T = (q W^T) X^T and (A X) W instead of A (X W). T tokens x 8 heads = 56 columns replace 128.
- A prompt whose predicted IoU is too low needs no mask, so the upscaling is a network of its own.

Image tokens may be fewer than 4096, where each stands for several (`sam_padding`).

The weights are those of kornia's `Sam`; `tests/segment/test_sam_network.py` compares this file with kornia's decoder.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from zpm2 import weights
from zpm2.segment.sam_backend import WEIGHTS
from zpm2.segment.sam_input import ENCODER_SIDE
from zpm2.segment.sam_padding import GRID

if TYPE_CHECKING:
    from kornia.models.sam import Sam
    from kornia.models.sam.architecture.transformer import Attention


def load_sam(model: str) -> "Sam":
    """kornia's `Sam` of that name with its released weights, in evaluation mode."""
    from kornia.models.sam import Sam

    sam = Sam.from_name(model)
    sam.load_state_dict(weights.load_state_dict(WEIGHTS[model]), strict=True)
    return sam.eval().requires_grad_(False)


class ImageNetwork(nn.Module):
    """Image -> everything that does not depend on the prompt.

    (1, 3, 1024, 1024) normalised image -> keys (N, 256), of the first layer's two cross attentions the image side:
    k (8, 16, N) and v (8, N, 16) of token-to-image, q (N, 128) of image-to-token, and of each image token its
    positional encoding (N, 256) and the logarithm (N,) of how many it stands for, which is 0.
    """

    def __init__(self, sam: "Sam") -> None:
        super().__init__()
        self.encoder = sam.image_encoder
        layer = sam.mask_decoder.transformer.layers[0]
        self.to_image, self.to_token = layer.cross_attn_token_to_image, layer.cross_attn_image_to_token
        self.heads = self.to_image.num_heads
        self.no_mask = nn.Buffer(sam.prompt_encoder.no_mask_embed.weight.detach().clone())
        self.position = nn.Buffer(_position(sam))

    def forward(self, image: Tensor) -> tuple[Tensor, ...]:
        return self.parts(self.encoder(image)[0])

    def parts(self, embedding: Tensor) -> tuple[Tensor, ...]:
        """What `forward` returns, of what the encoder made of one image: (256, 64, 64)."""
        keys = embedding.flatten(1).T + self.no_mask
        positioned = keys + self.position
        k = self.to_image.k_proj(positioned).reshape(GRID * GRID, self.heads, -1).permute(1, 2, 0)
        v = self.to_image.v_proj(keys).reshape(GRID * GRID, self.heads, -1).permute(1, 0, 2)
        return keys, k, v, self.to_token.q_proj(positioned), self.position, torch.zeros_like(self.position[:, 0])


class PromptNetwork(nn.Module):
    """Image parts + prompt tokens -> predicted IoU (B, 4), mask weights (B, 4, 32), image tokens (B, N, 256).

    `sparse` (B, P, 256) are embedded prompts (`PromptEmbedding`). Each prompt may have image tokens of its own
    (`sam_vicinity`): then all image parts have B as their first side.
    """

    def __init__(self, sam: "Sam") -> None:
        super().__init__()
        decoder = sam.mask_decoder
        self.layers = decoder.transformer.layers
        self.final = decoder.transformer.final_attn_token_to_image
        self.final_norm = decoder.transformer.norm_final_attn
        self.iou_head = decoder.iou_prediction_head
        self.mask_heads = decoder.output_hypernetworks_mlps
        self.own = nn.Buffer(torch.cat([decoder.iou_token.weight, decoder.mask_tokens.weight]).detach().clone())

    def forward(
        self, keys: Tensor, k: Tensor, v: Tensor, q: Tensor, position: Tensor, log_count: Tensor, sparse: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        tokens = torch.cat([self.own.expand(sparse.shape[0], -1, -1), sparse], dim=1)
        first, second = self.layers

        queries = first.norm1(first.self_attn(tokens, tokens, tokens))
        queries = first.norm2(
            queries + _token_to_shared_image(first.cross_attn_token_to_image, queries + tokens, k, v, log_count)
        )
        queries = first.norm3(queries + first.mlp(queries))
        weights, bias, values = _token_side(first.cross_attn_image_to_token, queries + tokens, queries, fold=False)
        image = first.norm4(_attend_tokens(first.cross_attn_image_to_token, keys, q @ weights + bias, values))

        positioned = image + position
        positioned_queries = queries + tokens
        queries = second.norm1(queries + second.self_attn(positioned_queries, positioned_queries, queries))
        queries = second.norm2(
            queries + _token_to_image(second.cross_attn_token_to_image, queries + tokens, positioned, image, log_count)
        )
        queries = second.norm3(queries + second.mlp(queries))
        weights, bias, values = _token_side(second.cross_attn_image_to_token, queries + tokens, queries, fold=True)
        image = second.norm4(
            _attend_tokens(second.cross_attn_image_to_token, image, positioned @ weights + bias, values)
        )

        queries = self.final_norm(
            queries + _token_to_image(self.final, queries + tokens, image + position, image, log_count)
        )
        masks = [head(queries[:, 1 + i]) for i, head in enumerate(self.mask_heads)]
        return self.iou_head(queries[:, 0]), torch.stack(masks, dim=1), image


class MaskNetwork(nn.Module):
    """Image tokens (B, h, w, 256) + mask weights (B, M, 32) -> mask logits (B, M, 4 h, 4 w).

    Tokens are decoded each by itself, so those of the padding can be left out. The two transposed convolutions have
    stride = kernel = 2, so each is a linear layer on tokens; the 2 x 2 children of a token stay together until the end,
    where one permutation puts the pixels in order.
    """

    def __init__(self, sam: "Sam") -> None:
        super().__init__()
        up = sam.mask_decoder.output_upscaling
        self.norm = nn.LayerNorm(up[1].weight.shape[0], eps=up[1].eps)
        self.norm.weight, self.norm.bias = up[1].weight, up[1].bias
        self.first, self.first_bias = (nn.Buffer(part) for part in _as_linear(up[0]))
        self.second, self.second_bias = (nn.Buffer(part) for part in _as_linear(up[3]))

    def forward(self, image: Tensor, hyper: Tensor) -> Tensor:
        b, h, w, _ = image.shape
        x = (image @ self.first + self.first_bias).reshape(b, h * w, 4, -1)
        x = nn.functional.gelu(self.norm(x))
        x = nn.functional.gelu(x @ self.second + self.second_bias)
        x = x.reshape(b, h * w * 16, -1) @ hyper.transpose(1, 2)
        x = x.reshape(b, h, w, 2, 2, 2, 2, hyper.shape[1])  # row, column, then child and grandchild (row, column)
        return x.permute(0, 7, 1, 3, 5, 2, 4, 6).reshape(b, hyper.shape[1], 4 * h, 4 * w)


@dataclass(frozen=True, eq=False)
class PromptEmbedding:
    """SAM's prompt encoder for points and boxes, as plain arrays."""

    frequencies: NDArray[np.float32]  # (2, 128) random spatial frequencies of the positional encoding
    labels: NDArray[np.float32]  # (4, 256) outside point, inside point, first and second corner of a box
    padding: NDArray[np.float32]  # (256,) what stands in for the missing box

    @staticmethod
    def of(sam: "Sam") -> "PromptEmbedding":
        encoder = sam.prompt_encoder
        return PromptEmbedding(
            encoder.pe_layer.positional_encoding_gaussian_matrix.detach().cpu().numpy(),
            np.concatenate([e.weight.detach().cpu().numpy() for e in encoder.point_embeddings]),
            encoder.not_a_point_embed.weight.detach().cpu().numpy()[0],
        )

    def __call__(self, points: NDArray[np.float64], labels: NDArray[np.int64]) -> NDArray[np.float32]:
        """(B, P, 2) px of the 1024-px square, outer-corner origin, and (P,) labels (0 outside, 1 inside, 2 and 3 the
        corners of a box) -> (B, P, 256) tokens, and one padding token more if there is no box."""
        phase = (2 * np.pi) * (points.astype(np.float32) * np.float32(2 / ENCODER_SIDE) - 1) @ self.frequencies
        tokens = np.concatenate([np.sin(phase), np.cos(phase)], axis=-1) + self.labels[labels]
        if (labels >= 2).any():
            return tokens
        padding = np.broadcast_to(self.padding, (len(points), 1, len(self.padding)))
        return np.concatenate([tokens, padding], axis=1)


def _as_linear(conv: nn.ConvTranspose2d) -> tuple[Tensor, Tensor]:
    """A transposed convolution with stride = kernel = 2 as weights (in, 4 out) and bias (4 out), children in rows."""
    weight = conv.weight.detach().permute(0, 2, 3, 1)  # in, 2, 2, out
    bias = conv.bias if conv.bias is not None else torch.zeros(weight.shape[-1])
    return weight.reshape(weight.shape[0], -1).clone(), bias.detach().repeat(4).clone()


def _position(sam: "Sam") -> Tensor:
    dense: Tensor = sam.prompt_encoder.get_dense_pe()
    return dense[0].flatten(1).T.detach().clone()


def _heads(x: Tensor, heads: int) -> Tensor:
    """(B, T, C) -> (B, heads, T, C / heads)."""
    b, t, c = x.shape
    return x.reshape(b, t, heads, c // heads).transpose(1, 2)


def _token_to_shared_image(attention: "Attention", tokens: Tensor, k: Tensor, v: Tensor, log_count: Tensor) -> Tensor:
    """Tokens (B, T, C) attend to image tokens that all prompts share, whose k and v were projected once."""
    query = _heads(attention.q_proj(tokens), attention.num_heads)
    weights = (query @ k * query.shape[-1] ** -0.5 + log_count[..., None, None, :]).softmax(-1)
    out = (weights @ v).transpose(1, 2)
    return attention.out_proj(out.reshape(out.shape[0], out.shape[1], -1))


def _on_gpu(tensor: Tensor) -> bool:
    """Where other orders of the same arithmetic are fast."""
    return tensor.is_cuda


def _token_to_image(
    attention: "Attention", tokens: Tensor, positioned: Tensor, image: Tensor, log_count: Tensor
) -> Tensor:
    """Tokens (B, T, C) attend to image tokens (B, N, C); the image's k and v projections are moved to the tokens.

    The bias of k adds the same to a row of scores, which softmax ignores; that of v comes out unchanged, as weights sum
    to one.
    """
    heads = attention.num_heads
    query = _heads(attention.q_proj(tokens), heads)  # B, H, T, d
    b, _, t, d = query.shape
    key = attention.k_proj.weight.reshape(heads, d, -1)  # H, d, C
    folded = (query @ key * d**-0.5).reshape(b, heads * t, -1)
    if _on_gpu(positioned):  # each device in the order in which it is fast
        weights = (folded @ positioned.transpose(1, 2) + log_count[..., None, :]).softmax(2)
    else:
        weights = (positioned @ folded.transpose(1, 2) + log_count[..., None]).softmax(1).transpose(1, 2)
    gathered = (weights @ image).reshape(b, heads, t, -1)
    value = attention.v_proj.weight.reshape(heads, d, -1).transpose(1, 2)  # H, C, d
    out = (gathered @ value).transpose(1, 2).reshape(b, t, heads * d) + attention.v_proj.bias
    return attention.out_proj(out)


def _token_side(
    attention: "Attention", key_tokens: Tensor, value_tokens: Tensor, fold: bool
) -> tuple[Tensor, Tensor, Tensor]:
    """What image tokens need to attend to tokens: score weights (B, C or 128, H T), score bias (B, 1, H T), values
    (B, H T, C) that carry the output projection. With `fold`, the image's q projection is in the weights too."""
    heads = attention.num_heads
    key = _heads(attention.k_proj(key_tokens), heads)  # B, H, T, d
    b, _, t, d = key.shape
    key = key * d**-0.5
    if fold:
        query = attention.q_proj.weight.reshape(heads, d, -1).transpose(1, 2)  # H, C, d
        weights = (query @ key.transpose(2, 3)).permute(0, 2, 1, 3).reshape(b, -1, heads * t)
        bias = (key * attention.q_proj.bias.reshape(heads, 1, d)).sum(-1).reshape(b, 1, heads * t)
    else:
        blocks = torch.eye(heads, dtype=key.dtype, device=key.device).reshape(heads, 1, heads, 1)
        weights = (key.transpose(2, 3)[:, :, :, None] * blocks).reshape(b, heads * d, heads * t)
        bias = torch.zeros(1, 1, 1, dtype=key.dtype, device=key.device)
    out = attention.out_proj.weight.T.reshape(heads, d, -1)  # H, d, C
    values = (_heads(attention.v_proj(value_tokens), heads) @ out).reshape(b, heads * t, -1)
    return weights, bias, values


def _attend_tokens(attention: "Attention", image: Tensor, scores: Tensor, values: Tensor) -> Tensor:
    """Image tokens, (N, C) or (B, N, C), and what they gather from tokens: scores (B, N, H T) and values (B, H T, C)
    -> (B, N, C).

    The weights of a head sum to one, so each head may carry its share of the bias: on a GPU, whose memory is what takes
    time here, image tokens are then read and written once.
    """
    b, n, columns = scores.shape
    heads = attention.num_heads
    if _on_gpu(image):
        weights = scores.reshape(b, n, heads, columns // heads).softmax(-1).reshape(b, n, columns)
        return torch.baddbmm(image.expand(b, -1, -1), weights, values + attention.out_proj.bias / heads)
    # a softmax over a last side of 7 would take up to a third of the whole network's time
    weights = scores.transpose(1, 2).reshape(b, heads, columns // heads, n).softmax(2).reshape(b, columns, n)
    return image + (weights.transpose(1, 2) @ values + attention.out_proj.bias)
