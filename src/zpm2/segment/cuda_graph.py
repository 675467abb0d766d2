"""A network whose kernels are recorded once and then started together.

A decoder of prompts is two hundred small kernels. In half precision a GPU is through with them before one core of its
host has started them one by one.
"""

from collections.abc import Callable

import torch
from torch import Tensor

SMALLEST = 16  # prompts; smaller batches are filled up


class Recorded:
    """`network` for inputs of up to so many rows as it was recorded with.

    Recordings of one `pool` share their memory: the next call of any of them overwrites the outputs of this one.
    """

    def __init__(
        self, network: Callable[..., tuple[Tensor, ...]], inputs: tuple[Tensor, ...], pool: tuple[int, int]
    ) -> None:
        self.inputs = [each.clone() for each in inputs]
        other, stream = torch.cuda.Stream(), torch.cuda.current_stream()  # type: ignore[no-untyped-call]
        other.wait_stream(stream)
        with torch.cuda.stream(other):  # what is set up at the first call must not be recorded
            for _ in range(2):
                network(*self.inputs)
        stream.wait_stream(other)
        self.graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self.graph, pool=pool, capture_error_mode="thread_local"):  # type: ignore[arg-type]
            self.outputs = network(*self.inputs)

    def __call__(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        for own, given in zip(self.inputs, inputs, strict=True):
            own[: len(given)].copy_(given)
        self.graph.replay()
        return self.outputs


class Recordings:
    """The recordings of one backend's networks, made when they are first needed."""

    def __init__(self) -> None:
        self._pool = torch.cuda.graph_pool_handle()
        self._made: dict[tuple[int, ...], Recorded] = {}

    def __call__(
        self, key: tuple[int, ...], network: Callable[..., tuple[Tensor, ...]], inputs: tuple[Tensor, ...]
    ) -> Recorded:
        """That of `key`, by `inputs` of its full size."""
        if key not in self._made:
            self._made[key] = Recorded(network, inputs, self._pool)
        return self._made[key]


def capacity(rows: int) -> int:
    """The rows that a network is recorded with to take so many: a power of two, so that there are few recordings."""
    return max(SMALLEST, 1 << (rows - 1).bit_length())
