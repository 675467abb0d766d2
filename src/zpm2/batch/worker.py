"""What a process does with what it gets: one after the other, each result saved before it is told."""

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import NamedTuple

from zpm2.batch.commands import Finished, command_of
from zpm2.batch.entries import Entry, TileEntry
from zpm2.batch.job import Job, Task
from zpm2.batch.results import DONE, FAILED, Results, Row, results_in
from zpm2.errors import OutputError, Zpm2Error
from zpm2.files.writing import stops_all


class Trouble(NamedTuple):
    """A pair that failed by what may not happen again: memory, a device, a disk."""

    name: str
    why: str


class Worker:
    """Does pairs for a job. Models are loaded with the first one, and kept."""

    def __init__(self, job: Job) -> None:
        self.results, self.command = results_in(job.out, job.kind), command_of(job)

    def do(self, tasks: Iterable[Task]) -> Iterator[Row | Trouble]:
        """What became of each pair, in their order. A `Zpm2Error` is raised where no pair can be done: no weights, a
        full disk."""
        source, waiting = iter(tasks), deque[Task]()
        again = list[Task]()

        def entries() -> Iterator[Entry | TileEntry]:
            for task in chain(tuple(again), source):
                waiting.append(task)
                yield task.entry

        while True:
            try:
                for result in self.command.results(entries()):
                    yield self._saved(waiting.popleft(), result)
                return
            except Exception as error:  # whatever a library may raise; it is the first waiting pair's
                if not waiting:
                    raise
                task = waiting.popleft()
                again = list(waiting)
                waiting.clear()
                yield (
                    self._saved(task, error) if isinstance(error, Zpm2Error) else Trouble(task.entry.name, _told(error))
                )

    def _saved(self, task: Task, result: Finished | Zpm2Error) -> Row | Trouble:
        name = task.entry.name
        try:
            if isinstance(result, Zpm2Error):
                raise result
            row = Row(name, DONE, None, result.seconds, result.found)
            self.results.save(row, task.key, result.write)
            return row
        except Zpm2Error as error:
            return failed(self.results, task, error)
        except Exception as error:  # whatever a library may raise
            return Trouble(name, _told(error))


def failed(results: Results, task: Task, error: Zpm2Error | str) -> Row:
    """The row of a pair that failed, which its folder gets, too. An `OutputError` that concerns all pairs is raised."""
    row = Row(task.entry.name, FAILED, str(error))
    try:
        if isinstance(error, OutputError):
            raise error
        results.save(row, task.key, None)
    except OutputError as trouble:  # of files that are not ours, the folder keeps them
        if stops_all(trouble):
            raise
    return row


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")
