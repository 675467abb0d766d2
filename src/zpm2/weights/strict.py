"""Tensors into a network, all of them or none."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from zpm2.errors import WeightsError

if TYPE_CHECKING:
    from torch import Tensor, nn


def load_into(network: "nn.Module", state: "Mapping[str, Tensor]", name: str) -> None:
    """Give `network` the tensors of the weights `name`. `WeightsError`, in one line, unless their names and shapes are
    its own."""
    own = network.state_dict()
    missing = [key for key in own if key not in state]
    foreign = [key for key in state if key not in own]
    other = [key for key in own if key in state and own[key].shape != state[key].shape]
    said = [_some("lacks", missing), _some("has besides", foreign), _some("has in another shape", other)]
    if any(said):
        raise WeightsError(f"the weights {name} do not fit this network: the file {'; '.join(filter(None, said))}")
    network.load_state_dict(dict(state), strict=True)


def _some(what: str, keys: Sequence[str]) -> str:
    """The first of some keys, and how many there are."""
    if not keys:
        return ""
    return f"{what} {keys[0]}" + (f" and {len(keys) - 1} more" if len(keys) > 1 else "")
