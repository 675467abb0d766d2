"""Processes of this machine: each loads the models once and asks for pairs whenever it can take more."""

import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import cast

from zpm2 import memory
from zpm2.batch.job import Job, Task
from zpm2.batch.results import Row
from zpm2.batch.supply import Supply
from zpm2.batch.worker import Trouble, Worker
from zpm2.cores import usable
from zpm2.errors import Zpm2Error
from zpm2.runtime import resolve_device

MORE, IDLE = "more", "idle"  # a worker asks: it may have none and go on, or has nothing to do
GPUS = "CUDA_VISIBLE_DEVICES"
THREADS = "OMP_NUM_THREADS"


@dataclass(eq=False)
class _Hand:
    """A worker, seen from here."""

    number: int
    process: BaseProcess
    pipe: "Connection[object, object]"
    given: list[Task] = field(default_factory=list)  # of which nothing was told yet
    idle: bool = False


class Processes:
    """So many workers, each in a process that is started afresh (`spawn`). They share a GPU; of several, each has one.
    They share the cores, where the system lets them."""

    def __init__(self, workers: int) -> None:
        self.workers = workers

    def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
        """See `Engine`."""
        gpus = _gpus(job.config.device)
        crew = [_start(k, self.workers, job, gpus) for k in range(min(self.workers, len(supply)))]
        try:
            while True:
                for hand in crew:
                    if hand.idle and (block := supply.next()):
                        _give(hand, block)
                if not len(supply) and not any(hand.given for hand in crew):
                    return
                for pipe in wait([hand.pipe for hand in crew]):
                    k = next(k for k, hand in enumerate(crew) if hand.pipe is pipe)
                    hand = crew[k]
                    try:
                        message = hand.pipe.recv()
                    except (EOFError, OSError):
                        hand.process.join()
                        yield from supply.lost(hand.given, _why(hand.process.exitcode))
                        crew[k] = _start(hand.number, self.workers, job, gpus)
                        continue
                    if isinstance(message, Zpm2Error):
                        raise message
                    if isinstance(message, Row | Trouble):
                        yield from supply.told(hand.given, message)
                    elif message == MORE:
                        _give(hand, supply.next())
                    else:
                        hand.idle = True
        finally:
            for hand in crew:
                hand.process.kill()
            for hand in crew:
                hand.process.join()
                supply.stopped(hand.given)


def _give(hand: _Hand, block: list[Task]) -> None:
    hand.idle = False
    hand.given += block
    with suppress(OSError):  # it died; its pipe tells
        hand.pipe.send(block)


def _start(number: int, workers: int, job: Job, gpus: list[str]) -> _Hand:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, job, number, workers), name=f"zpm2-{number}", daemon=True)
    with _environment({GPUS: gpus[number % len(gpus)]} if len(gpus) > 1 else {}, workers):
        process.start()
    theirs.close()  # so that the pipe ends with the process
    return _Hand(number, process, ours)


@contextmanager
def _environment(more: dict[str, str], workers: int) -> Iterator[None]:
    """What a process that is started inside finds: `more`, and its part of the threads unless the user set them."""
    more = {THREADS: str(max(1, usable() // workers)), **more}
    before = dict(os.environ)
    os.environ.update({name: value for name, value in more.items() if name != THREADS or THREADS not in before})
    try:
        yield
    finally:
        for name in more:
            os.environ.pop(name, None)
        os.environ.update({name: before[name] for name in more if name in before})


def _gpus(device: str) -> list[str]:
    """The GPUs that workers may have; none where they compute on processors."""
    if resolve_device(device) == "cpu":
        return []
    visible = os.environ.get(GPUS)
    if visible is not None:
        return [name for name in visible.split(",") if name]
    import torch

    return [str(k) for k in range(torch.cuda.device_count())]


def _work(pipe: "Connection[object, object]", job: Job, number: int, workers: int) -> None:
    """What a process does. It ends with the one that started it, and leaves signals to that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    warnings.filterwarnings("ignore", "Dataset has no geotransform")  # rasterio's, of usual photographs
    _take_cores(number, workers)
    memory.share_among(workers)
    try:
        worker = Worker(job)
        while True:
            pipe.send(IDLE)
            for message in worker.do(_asked(pipe)):
                pipe.send(message)
    except Zpm2Error as error:
        pipe.send(error)


def _asked(pipe: "Connection[object, object]") -> Iterator[Task]:
    """Pairs as long as there are some."""
    while block := pipe.recv():
        yield from cast(list[Task], block)
        pipe.send(MORE)


def _take_cores(number: int, workers: int) -> None:
    """An equal part of the cores, where the system has such a thing: networks take all that they see."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        own = cores[number::workers] or [cores[number % len(cores)]]
        os.sched_setaffinity(0, own)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _why(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        return f"its process was ended by {name}" + (", for lack of memory perhaps" if name == "SIGKILL" else "")
    return f"its process ended with {code}"
