"""The device, the timer of stages, a lock for networks, which cannot run in forked processes, and what torch is told
before its first call.

A process that is forked from one with networks lacks the threads that torch and OpenVINO compute with, and would wait
for them for ever.
"""

import ctypes
import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from zpm2.cores import usable
from zpm2.errors import ConfigError, ForkError

# torch has Intel's MKL compute these on a CPU
MKL_FUNCTIONS = (
    *("acos", "asin", "atan", "cos", "sin", "tan", "tanh", "erf", "erfc", "erfinv"),
    *("exp", "expm1", "log", "log10", "log1p", "log2", "sqrt", "trunc"),
)
_loaded_in: int | None = None  # process id: this process, or the one that it was forked from


def mark_networks_loaded() -> None:
    """Notes that this process has networks. `ForkError` if it was forked from one that has."""
    global _loaded_in
    check_not_forked()
    _loaded_in = os.getpid()


def check_not_forked() -> None:
    """`ForkError` in a process that was forked from one that had loaded networks."""
    if _loaded_in not in (None, os.getpid()):
        raise ForkError(
            "this process was forked from one that had loaded networks, which would hang here: start processes with "
            'multiprocessing.get_context("spawn"), or fork before the first match'
        )


@functools.cache
def settle_torch() -> None:
    """Once in a process, before networks run: limits torch to the cores that are usable, as it does not know quotas of
    processor time, and calls each of `MKL_FUNCTIONS` on one number.

    MKL chooses how to compute a function when it is first called. Where several threads make this first call together,
    one of them may compute its part with 11 correct bits (pytorch/pytorch issue 188792), so that one process in twenty
    to fifty found other points in its first pair. One number is computed by one thread.
    """
    import torch

    if torch.get_num_threads() > usable():
        torch.set_num_threads(usable())
    for number in torch.full((1,), 0.5), torch.full((1,), 0.5, dtype=torch.float64):
        for name in MKL_FUNCTIONS:
            getattr(torch, name)(number)


@functools.cache
def package_version() -> str:
    """The version of the installed package, which the version control system gives it; else "unknown"."""
    from importlib import metadata  # 10 ms

    try:
        return metadata.version("zpm2")
    except metadata.PackageNotFoundError:
        return "unknown"


class ForkAwareLock:
    """A re-entrant lock as a context. `ForkError` in a process that was forked from one that had loaded networks."""

    def __init__(self) -> None:
        self._lock, self._process = threading.RLock(), os.getpid()

    def __enter__(self) -> None:
        check_not_forked()
        if self._process != os.getpid():  # the lock may be held by a thread of the parent, and never be released here
            self._lock, self._process = threading.RLock(), os.getpid()
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


Progress = Callable[[str, float], None]  # receives a stage and the share of it that is done, 0..1


def resolve_device(name: str) -> str:
    """The device, "cpu" or "cuda", of "auto", "cpu" or "cuda". `ConfigError` for others, or without a GPU for cuda."""
    if name not in ("auto", "cpu", "cuda"):
        raise ConfigError(f"unknown device '{name}'; devices are: auto, cpu, cuda")
    if name == "cpu" or (name == "auto" and not _has_driver()):
        return "cpu"
    import torch

    if torch.cuda.is_available():
        return "cuda"
    if name == "cuda":
        raise ConfigError("device cuda is not available to torch on this machine; use --device cpu")
    return "cpu"


def _has_driver() -> bool:
    """False where torch cannot have a GPU. To ask torch itself takes seconds where nothing else has loaded it."""
    if "torch" in sys.modules:
        return True
    if sys.platform == "darwin":
        return False  # torch has no CUDA there
    try:
        ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
    except OSError:
        from importlib import metadata

        return "rocm" in metadata.version("torch")  # AMD's GPUs are "cuda" to torch, too
    return True


class StageTimer:
    """Seconds by stage, summed over its runs. `progress` receives 0 when a stage begins and 1 when it ends."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.progress = progress

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        self.progress(stage, 0.0)
        start = perf_counter()
        yield
        self.seconds[stage] = self.seconds.get(stage, 0.0) + perf_counter() - start
        self.progress(stage, 1.0)
