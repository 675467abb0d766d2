"""The Linux control groups that this process is in, by which containers and schedulers limit it."""

import math
from collections.abc import Iterator
from pathlib import Path

_MOUNTED, _LISTED = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def folders(of: str) -> Iterator[tuple[Path, bool]]:
    """The folder of each group that may limit the "memory" or the "cpu", from our own to the topmost one, as far as it
    is mounted here, and whether it is of version 2."""
    try:
        lines = [line.split(":", 2) for line in _LISTED.read_text().splitlines()]
    except (OSError, ValueError):
        return
    for _, kinds, group in (line for line in lines if len(line) == 3):
        if kinds and of not in kinds.split(","):
            continue
        top = _MOUNTED / kinds
        for folder in (place := top / group.strip("/"), *place.parents):
            if folder.is_relative_to(top):
                yield folder, not kinds


def quota() -> float:
    """Seconds of processor time that this process may take in each second (`docker run --cpus 4`); infinite where there
    is no quota, or one of a form that is not Linux's: `import zpm2` asks for it."""
    least = math.inf
    for folder, second in folders("cpu"):
        names = ("cpu.max",) if second else ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        try:
            time, period = " ".join((folder / name).read_text() for name in names).split()
            if time not in ("max", "-1"):
                least = min(least, float(time) / float(period))
        except (OSError, ValueError, ZeroDivisionError):
            continue
    return least
