"""What is to be done, in blocks for workers, and what becomes of pairs that a worker did not finish."""

from collections import Counter, deque
from collections.abc import Iterator, Sequence

from zpm2.batch.job import Job, Task
from zpm2.batch.results import DONE, Row, results_in
from zpm2.batch.worker import Trouble, failed
from zpm2.errors import WorkerError

BLOCK = 16  # pairs; neighbours in a list often have a photograph in common
DEATHS = 10  # of workers in a row, without a result in between, that end a run


class Supply:
    """Blocks of pairs, each of which is given out once, and again where it was not finished.

    A pair that failed by what may not happen again (`worker.Trouble`), or whose worker died, is tried again, alone, up
    to `retries` times; then it has failed.
    """

    def __init__(self, job: Job, tasks: Sequence[Task], workers: int, retries: int) -> None:
        self.job, self.retries = job, retries
        most = BLOCK if job.kind == "pair" else 1  # groups and tiles take long, and need no neighbours
        size = max(1, min(most, len(tasks) // (4 * workers)))  # the last blocks end at about the same time
        self._blocks = deque(list(tasks[k : k + size]) for k in range(0, len(tasks), size))
        self._tries = Counter[str]()
        self._results = results_in(job.out, job.kind)
        self._deaths = 0  # since the last result

    def __len__(self) -> int:
        """How many blocks there are now."""
        return len(self._blocks)

    def stopped(self, given: Sequence[Task]) -> None:
        """Removes what a worker that was ended left of the pairs that it was `given`."""
        for task in given:
            self._results.tidy(task.entry.name)

    def next(self) -> list[Task]:
        """A block; empty where there is none now."""
        return self._blocks.popleft() if self._blocks else []

    def told(self, given: list[Task], message: Row | Trouble) -> Iterator[Row]:
        """Takes what a worker tells of one of the pairs that it was `given`, which is removed from them. Gives its row,
        where it has one now."""
        self._deaths = 0
        task = next(task for task in given if task.entry.name == message.name)
        given.remove(task)
        if isinstance(message, Row):
            yield message
        else:
            yield from self._again(task, message.why)

    def lost(self, given: list[Task], why: str) -> Iterator[Row]:
        """Takes back what a worker that died had been `given`, which is emptied. Gives the rows of pairs that have one
        now. Only the first ones can have been in work; the others are no suspects. `WorkerError` where too many workers
        died in a row."""
        self._deaths += 1
        if self._deaths > DEATHS:
            raise WorkerError(
                f"{DEATHS} workers in a row ended without a result, the last as {why}: try one pair first"
            )
        for k, task in enumerate(given):
            self._results.tidy(task.entry.name)
            row = self._results.row(task.entry.name, task.key)
            if row is not None and row.status == DONE:  # saved, and not told any more
                yield row
            elif k < self.job.at_once:
                yield from self._again(task, why)
            else:
                self._blocks.append([task])
        given.clear()

    def _again(self, task: Task, why: str) -> Iterator[Row]:
        self._tries[task.entry.name] += 1
        if self._tries[task.entry.name] <= self.retries:
            self._blocks.append([task])
        else:
            times = self._tries[task.entry.name]
            yield failed(self._results, task, why if times == 1 else f"{why} ({times} times)")
