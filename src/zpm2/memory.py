"""The memory budget of this process, and an error for work that would exceed it.

The user sets the budget; by default it is a share of the free memory. Code that is about to use much memory calls
`refuse_above` first, so that the user gets a one-line message instead of a process that the system kills. `within` sets
the budget for the code that runs inside it. Code that has used much calls `give_back`.
"""

import ctypes
import math
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from zpm2.control_groups import folders
from zpm2.errors import ConfigError, InputError

AUTO, UNLIMITED = "auto", "none"
FREE_SHARE = 0.8  # share of the free memory and this process's own; the rest is left for other processes
UNITS = {"KB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}

_SIZE = re.compile(r"(\d{1,12}(?:\.\d{1,12})?) ?([KMGT]I?B)", re.IGNORECASE)
_limit: ContextVar[str] = ContextVar("max_memory", default=AUTO)
_reserved: ContextVar[float] = ContextVar("reserved", default=0.0)
_processes = 1  # of one run, this one included, which share a budget


def size(text: str) -> float:
    """Bytes of a size such as 8GB (10^9 bytes each), 512MB or 7.5GiB (2^30). "none" is infinite, "auto" is `FREE_SHARE`
    of what is free. `ConfigError` for all else."""
    if text == AUTO:
        return FREE_SHARE * (free() / _processes + _own())
    if text == UNLIMITED:
        return math.inf
    found = _SIZE.fullmatch(text)
    bytes_ = float(found[1]) * UNITS[found[2].upper()] if found else 0.0
    if not bytes_:
        raise ConfigError(f"max_memory '{text}' is not a size: give a number with a unit (8GB, 512MB), auto or none")
    return bytes_


@contextmanager
def within(text: str) -> Iterator[None]:
    """Sets the budget (`size`) inside."""
    token = _limit.set(text)
    try:
        yield
    finally:
        _limit.reset(token)


@contextmanager
def reserved(bytes_: float) -> Iterator[None]:
    """Lowers the budget, for the code inside, by the bytes that the caller itself holds."""
    token = _reserved.set(_reserved.get() + bytes_)
    try:
        yield
    finally:
        _reserved.reset(token)


def limit(text: str) -> None:
    """Sets the budget (`size`) from here on, to the end of the enclosing `within`."""
    _limit.set(text)


def budget() -> float:
    """Bytes that this process may take in all; infinite where there is no limit, or none is known."""
    text = _limit.get()
    return max(0.0, size(text) / (1 if text == AUTO else _processes) - _reserved.get())


def share_among(processes: int) -> None:
    """From here on, this process is one of so many of a run: it has an equal part of what is free, or of the budget."""
    global _processes
    _processes = processes


def whose() -> str:
    """Where the budget comes from, in words."""
    text = f"{FREE_SHARE:.0%} of what is free" if _limit.get() == AUTO else f"--max-memory {_limit.get()}"
    return text if _processes == 1 else f"{text}, for one of {_processes} processes"


def refuse_above(needed: float, what: str, way_out: str) -> None:
    """`InputError` where something needs more bytes than the budget has."""
    if needed > (most := budget()):
        raise InputError(
            f"{what} needs about {in_words(needed)} of memory, the budget is {in_words(most)} ({whose()}): {way_out}"
        )


def give_back() -> None:
    """Return freed memory to the system. The GNU C library would keep it, in pieces that what comes next may not fit
    into; others need no call."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL("libc.so.6").malloc_trim(0)


def in_words(bytes_: float) -> str:
    """A size as `size` reads it, to two or three digits."""
    unit = "GB" if bytes_ >= 1e9 else "MB"
    number = bytes_ / UNITS[unit]
    return f"{number:.{0 if number >= 100 else 1}f} {unit}"


def free() -> float:
    """Bytes that this process can still have, by the system and by its control groups (Linux); elsewhere those of the
    machine, as the standard library knows no more, and where it does not know that (Windows), infinite."""
    try:
        found = re.search(r"MemAvailable:\s+(\d+) kB", Path("/proc/meminfo").read_text())
    except OSError:
        found = None
    if found is not None:
        return min([float(found[1]) * 2**10, *_free_of_groups()])
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return math.inf


def _free_of_groups() -> Iterator[float]:
    """What is left in each control group that we are in."""
    for folder, second in folders("memory"):
        names = ("memory.max", "memory.current") if second else ("memory.limit_in_bytes", "memory.usage_in_bytes")
        try:
            most, used = ((folder / name).read_text().strip() for name in names)
            cached = re.search(r"^(?:total_)?inactive_file (\d+)$", (folder / "memory.stat").read_text(), re.M)
        except OSError:
            continue
        if most != "max":
            yield max(0.0, float(most) - float(used) + float(cached[1] if cached else 0))


def _own() -> float:
    """Bytes that this process has now; 0 where that is not known."""
    try:
        return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, AttributeError, ValueError):
        return 0.0
