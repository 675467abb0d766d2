"""Ray: workers are actors, on this machine or in a cluster. Extra `ray`."""

import os
import sys
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from zpm2 import memory
from zpm2.batch.job import Job, Task
from zpm2.batch.results import Row
from zpm2.batch.supply import Supply
from zpm2.batch.worker import Trouble, Worker
from zpm2.errors import ConfigError, MissingDependency, Zpm2Error

if TYPE_CHECKING:
    from types import ModuleType


class RayWorker:
    """What an actor is."""

    def __init__(self, job: Job, sharing: int, places: list[str]) -> None:
        sys.path += [place for place in places if place not in sys.path]
        memory.share_among(sharing)
        self.job = job
        self.worker: Worker | None = None

    def do(self, block: list[Task]) -> Iterator[Row | Trouble | Zpm2Error]:
        """As `Worker.do`; an error that concerns all pairs comes last."""
        try:
            self.worker = self.worker or Worker(self.job)
            yield from self.worker.do(block)
        except Zpm2Error as error:
            yield error


@dataclass(eq=False)
class _Hand:
    """An actor, and what it was asked for last."""

    actor: Any
    stream: Any = None  # of references to its messages; None: it has nothing to do
    given: list[Task] = field(default_factory=list)


class RayEngine:
    """So many actors, each with one block in work, whose rows come as they are finished. One that dies is replaced,
    wherever Ray finds room.

    address: of a cluster, "auto" for the one that this machine belongs to; None: Ray is started here, for this run.
    cpus, gpus: of each actor; four share a GPU with 0.25. `MissingDependency` without Ray, `ConfigError` where the
    cluster is not there, or has not even room for one actor.
    """

    def __init__(self, workers: int, address: str | None = None, cpus: float = 1.0, gpus: float = 0.0) -> None:
        self.workers, self.cpus, self.gpus, self.address = workers, cpus, gpus, address
        self._ray, self._ours = self._connected()
        room = self._ray.cluster_resources()
        if room.get("CPU", 0) < cpus or room.get("GPU", 0) < gpus:
            shown = ", ".join(f"{room.get(name, 0):g} {name}" for name in ("CPU", "GPU"))
            raise ConfigError(f"the Ray cluster has {shown}, and one worker takes {cpus:g} and {gpus:g}: ask for less")

    def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
        """See `Engine`."""
        ray = self._ray
        if not ray.is_initialized():  # it ended with the run before
            _, self._ours = self._connected()
        nodes = sum(bool(node["Alive"]) for node in ray.nodes())
        made = ray.remote(num_cpus=self.cpus, num_gpus=self.gpus)(RayWorker)
        places = sys.path if self.address is None else []  # of plug-ins; a cluster has packages on each machine
        more = job, -(-self.workers // nodes), places
        crew = [_Hand(made.remote(*more)) for _ in range(min(self.workers, len(supply)))]
        try:
            while True:
                for hand in crew:
                    if hand.stream is None and (block := supply.next()):
                        hand.given = block
                        hand.stream = hand.actor.do.options(num_returns="streaming").remote(list(block))
                busy = [hand for hand in crew if hand.stream is not None]
                if not busy:
                    return
                (ready, *_), _ = ray.wait([hand.stream for hand in busy], fetch_local=False)
                hand = next(hand for hand in busy if hand.stream is ready or hand.stream == ready)
                try:
                    message = ray.get(next(hand.stream))
                except StopIteration:
                    hand.stream = None
                except ray.exceptions.RayError as error:
                    ray.kill(hand.actor)  # the call failed; whether it still lives or not
                    hand.actor, hand.stream = made.remote(*more), None
                    yield from supply.lost(hand.given, f"its actor died ({type(error).__name__})")
                else:
                    if isinstance(message, Zpm2Error):
                        raise message
                    yield from supply.told(hand.given, message)
        finally:
            for hand in crew:
                ray.kill(hand.actor)
            for hand in crew:
                supply.stopped(hand.given)
            if self._ours:
                ray.shutdown()

    def _connected(self) -> "tuple[ModuleType, bool]":
        return _connected(self.address, max(self.workers * self.cpus, os.cpu_count() or 1))


def _connected(address: str | None, cpus: float) -> "tuple[ModuleType, bool]":
    """Ray, and whether it was started for us."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # actors without a GPU see none
    try:
        import ray
    except ModuleNotFoundError as error:
        raise MissingDependency('--engine ray needs Ray: pip install "zpm2[ray]"') from error
    if ray.is_initialized():
        return ray, False
    try:
        if address is None:
            ray.init(num_cpus=int(cpus), include_dashboard=False, log_to_driver=False, logging_level="error")
        else:
            ray.init(address=address, log_to_driver=False, logging_level="error")
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        text = " ".join(str(error).split())[:200]
        raise ConfigError(f"no Ray cluster at {address or 'this machine'}: {text}") from error
    return ray, True
