"""What runs pairs somewhere."""

from collections.abc import Generator
from typing import Protocol

from zpm2.batch.job import Job
from zpm2.batch.results import Row
from zpm2.batch.supply import Supply


class Engine(Protocol):
    """Workers (`worker.Worker`) in processes of their own."""

    @property
    def workers(self) -> int:
        """How many there are."""
        ...

    def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
        """The row of each pair of the supply, as they come, once. A worker that dies is replaced. Errors are those that
        concern all pairs, as from `Worker.do`. Whoever stops asking for rows closes the iterator, which ends the
        workers at once."""
        ...
