"""Work on several cores, in threads: for what is nearly all in libraries that let go of Python's lock meanwhile, as
OpenCV, GEOS, OpenVINO, and NumPy on large arrays do."""

import functools
import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from zpm2.control_groups import quota

T = TypeVar("T")
_this_thread = threading.local()


def in_chunks(do: Callable[[slice], T], count: int, size: int) -> list[T]:
    """What `do` returns for each slice of `size` rows of `count`, in their order.

    Slices do not depend on the number of cores, so results do not. Within `do`, further calls use one core.
    """
    slices = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    pool = _several() if len(slices) > 1 else None
    return [do(rows) for rows in slices] if pool is None else list(pool.map(do, slices))


def begin(do: Callable[[], T]) -> Future[T] | None:
    """Has a core `do` something once it is free, after what was begun before, and does not wait for it. None, and
    nothing is begun, where one core does all."""
    pool = _several()
    return None if pool is None else pool.submit(do)


def usable() -> int:
    """Cores that this process may use: those that the system gives it, and at most as many as it is `told`."""
    given = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(given, told() or given)


def told() -> int | None:
    """Threads that `OMP_NUM_THREADS` allows. Where it is not set, as many as use up the quota of processor time of our
    control groups, which leave all cores visible. None where there is neither."""
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return (int(wanted) if wanted.isdecimal() else 0) or _quota()


def limit() -> int | None:
    """`usable` cores where the machine has more, else None: for libraries that see all of them."""
    cores = usable()
    return cores if cores < (os.cpu_count() or 1) else None


def _several() -> ThreadPoolExecutor | None:
    """A thread for each core, where there are several and this thread is none of those."""
    threads = 1 if hasattr(_this_thread, "is_ours") else usable()
    return None if threads == 1 else _pool(os.getpid(), threads)


@functools.cache
def _quota() -> int | None:
    most = quota()
    return None if math.isinf(most) else max(1, math.ceil(most))


@functools.lru_cache(1)
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Of one `process`, as a forked one has no threads."""
    return ThreadPoolExecutor(threads, "zpm2-cores", lambda: setattr(_this_thread, "is_ours", True))
