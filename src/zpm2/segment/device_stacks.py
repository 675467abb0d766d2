"""What `stacks` reads off masks on a device, in torch. A function of the same name is the same for arrays."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from zpm2.segment.stacks import MAX_LOGIT, NO_MASK, Bits, BitStack, Counts, Extent, Rows, Stack, boxes_by_lines

GATHER_PX = 1 << 23  # pixels that are interpolated at a time; each takes about 60 bytes
PRODUCT_PX = 1 << 13  # pixels of each mask that are multiplied at a time, 4 bytes each
PACKED_PX = 1 << 16  # pixels from which on bits cross packed


def to_host(*tensors: Tensor) -> list[NDArray[np.generic]]:
    """As arrays: all together, through pinned memory. The only way from a device to the host."""
    copies = [tensor.to("cpu", non_blocking=True) for tensor in tensors]
    if tensors[0].is_cuda:
        torch.cuda.current_stream(tensors[0].device).synchronize()
    return [copy.numpy() for copy in copies]


def on(array: NDArray[np.generic], device: torch.device) -> Tensor:
    """An array on a device. Bits cross packed. Nothing is waited for: CUDA copies what is not pinned aside first."""
    if array.dtype != np.bool_ or array.size < PACKED_PX:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device, non_blocking=True)
    packed = np.packbits(np.asarray(array, np.bool_), bitorder="little")
    words = torch.from_numpy(packed).to(device, non_blocking=True)
    bits = (words[:, None] >> torch.arange(8, dtype=torch.uint8, device=device)) & 1
    return bits.flatten()[: array.size].view(torch.bool).reshape(array.shape)


def take(stack: Tensor, rows: Rows | Counts) -> Tensor:
    """Rows of a stack."""
    return stack[on(np.asarray(rows, np.int64), stack.device)]


def join(stacks: Sequence[Stack]) -> Tensor:
    """One after the other."""
    device = next(stack.device for stack in stacks if not isinstance(stack, np.ndarray))
    return torch.cat([on(stack, device) if isinstance(stack, np.ndarray) else stack for stack in stacks])


def chosen(stacks: Sequence[Stack], of: Rows, rows: Rows) -> Tensor:
    """Row `rows[k]` (n,) of stack `of[k]`; one of the stacks that these are of is on a device."""
    parts = [(stacks[k], rows[of == k]) for k in np.unique(of)]
    found = join([stack[at] if isinstance(stack, np.ndarray) else take(stack, at) for stack, at in parts])
    return take(found, np.argsort(np.argsort(of, kind="stable"), kind="stable"))


def counts(bits: Tensor) -> Counts:
    """(n,) pixels of each."""
    return np.asarray(to_host(_counts(bits))[0], np.int64)


def extent(bits: Tensor) -> Extent:
    """Of masks as bits."""
    area, columns, rows = to_host(_counts(bits), bits.any(1), bits.any(2))
    return _extent(area, columns, rows)


def settled(logits: Tensor, offset: float, wanted: Callable[[Counts, Counts], Rows]) -> tuple[Rows, Tensor, Extent]:
    """Those that are wanted, by their rows."""
    half = logits.clamp(-MAX_LOGIT, MAX_LOGIT).half()
    bits = half > 0
    numbers = torch.stack([_counts(each) for each in (logits > offset, logits > -offset, bits)])
    pixels, columns, lines = to_host(numbers, bits.any(1), bits.any(2))
    inner, outer, area = np.asarray(pixels, np.int64)
    rows = wanted(inner, outer)
    return rows, take(half, rows), _extent(area, columns, lines)[rows]


def holds(logits: Tensor, row: Counts, column: Counts) -> Bits:
    """(n,) whether each holds one pixel."""
    at = (np.arange(len(row)) * logits.shape[1] + row) * logits.shape[2] + column
    return np.asarray(to_host(take(logits.flatten(), at) > 0)[0], np.bool_)


def painted(bits: Tensor, extent: Extent, chosen: Rows) -> tuple[Bits, NDArray[np.int32]]:
    """Of masks as bits."""
    area = on(extent.area.astype(np.int32), bits.device)
    smallest = torch.where(bits, area[:, None, None], NO_MASK).amin(0)
    union, least = to_host(take(bits, chosen).any(0), smallest)
    return np.asarray(union, np.bool_), np.asarray(least, np.int32)


def shared(bits: BitStack, other: BitStack, of: Rows | Counts) -> Counts:
    """(n,) pixels in common with row `of[k]`."""
    device = next(stack.device for stack in (bits, other) if not isinstance(stack, np.ndarray))
    one, two = (on(stack, device) if isinstance(stack, np.ndarray) else stack for stack in (bits, other))
    return counts(one & take(two, of))


def limited(bits: Tensor, rows: Rows, to: Bits) -> Tensor:
    """A copy with fewer pixels in some rows."""
    kept, at = bits.clone(), on(rows, bits.device)
    kept[at] = bits[at] & on(to, bits.device)
    return kept


def cropped(logits: Tensor, beyond: Bits) -> Tensor:
    """Without what lies `beyond` (n, h, w)."""
    return logits.masked_fill(on(beyond, logits.device)[:, None], -MAX_LOGIT)


def placed(logits: Tensor, corner: Counts, size: tuple[int, int]) -> Tensor:
    """In a frame of `size`."""
    n, h, w = logits.shape
    result = torch.full((n, size[0] + h, size[1] + w), -MAX_LOGIT, dtype=logits.dtype, device=logits.device)
    row, column = on(corner, logits.device).T
    lines = row[:, None] + torch.arange(h, device=logits.device)
    columns = column[:, None] + torch.arange(w, device=logits.device)
    result[torch.arange(n, device=logits.device)[:, None, None], lines[:, :, None], columns[:, None]] = logits
    return result[:, : size[0], : size[1]].contiguous()


def alike(logits: Tensor, area: Counts, threshold: float) -> Bits:
    """(n, n) which of n masks overlap by an IoU above `threshold`; `area` (n,) are theirs.

    Pixels in common are products of zeros and ones, whose sums are exact in single precision up to 2^24, also where it
    is allowed to multiply in fewer bits.
    """
    flat = (logits > 0).flatten(1)
    common = torch.zeros(len(flat), len(flat), device=flat.device)
    for start in range(0, flat.shape[1], PRODUCT_PX):
        part = flat[:, start : start + PRODUCT_PX].float()
        common.addmm_(part, part.T)
    both, areas = common.double(), on(area.astype(np.float64), flat.device)
    return np.asarray(to_host(both > threshold * (areas[:, None] + areas - both))[0], np.bool_)


def enlarged(logits: Tensor, at: Counts, scale: float) -> list[Bits]:
    """The pixels (y1 - y0, x1 - x0) of an image inside each mask: bilinear logits cut at 0, packed on their way to the
    host. `at` (n, 4) are x0, y0, x1, y1 of each in the image, `scale` the px of a decoded mask per image px."""
    device, (n, height, width) = logits.device, logits.shape
    size = np.maximum(at[:, 2:] - at[:, :2], 0)
    pixels = size.prod(1)
    ends, flat, found = np.cumsum(pixels), logits.flatten(), []
    first = 0
    while first < n:
        last = max(first + 1, int(np.searchsorted(ends, ends[first] - pixels[first] + GATHER_PX, side="right")))
        count = on(pixels[first:last], device)
        table = np.c_[np.arange(first, last), (ends - pixels)[first:last] - (ends - pixels)[first], size[first:last, 0]]
        table = on(np.c_[table, at[first:last, :2]], device)
        mask, start, columns, x0, y0 = table.repeat_interleave(count, 0, output_size=int(pixels[first:last].sum())).T
        place = torch.arange(len(mask), device=device) - start
        row = place // columns
        x, across = _steps((place - row * columns + x0 + 0.5) * scale - 0.5, width)
        y, down = _steps((row + y0 + 0.5) * scale - 0.5, height)
        corner = (mask * height + y) * width + x
        right, below = (x + 1 < width).long(), (y + 1 < height).long() * width
        upper = torch.lerp(flat[corner].float(), flat[corner + right].float(), across)
        lower = torch.lerp(flat[corner + below].float(), flat[corner + below + right].float(), across)
        found.append(torch.lerp(upper, lower, down) > 0)
        first = last
    bits = torch.cat(found)
    values = 2 ** torch.arange(8, dtype=torch.uint8, device=device)
    words = (torch.nn.functional.pad(bits, (0, -len(bits) % 8)).reshape(-1, 8) * values).sum(1, dtype=torch.uint8)
    every = np.unpackbits(np.asarray(to_host(words)[0], np.uint8), bitorder="little").view(np.bool_)
    return [every[end - k : end].reshape(h, w) for end, k, (w, h) in zip(ends, pixels, size, strict=True)]


def resampled(squares: Tensor, x: float, y: float, size: tuple[int, int]) -> Tensor:
    """(n, height, width) of `size`, bilinear, of (n, m, m) with `x` and `y` of their px per px of the result."""
    side, device = squares.shape[1], squares.device
    row, down = _steps((torch.arange(size[0], device=device) + 0.5) * y - 0.5, side)
    column, across = _steps((torch.arange(size[1], device=device) + 0.5) * x - 0.5, side)
    lines = torch.lerp(squares[:, row], squares[:, (row + 1).clamp(max=side - 1)], down[:, None])
    return torch.lerp(lines[:, :, column], lines[:, :, (column + 1).clamp(max=side - 1)], across)


def _extent(area: NDArray[np.generic], columns: NDArray[np.generic], rows: NDArray[np.generic]) -> Extent:
    lines = np.asarray(columns, np.bool_), np.asarray(rows, np.bool_)
    return Extent(np.asarray(area, np.int64), boxes_by_lines(*lines))


def _counts(bits: Tensor) -> Tensor:
    return bits.flatten(1).sum(1)


def _steps(at: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The pixel before each place along an axis, and how far the place lies beyond its centre; repeated at borders."""
    at = at.clamp(0, size - 1)
    whole = at.floor()
    return whole.long(), at - whole
