"""The tiles of one large pair, made by the workers of an engine."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import ClassVar

from zpm2.batch.commands import Finished, one_by_one
from zpm2.batch.engines.engine import Engine
from zpm2.batch.entries import TileEntry
from zpm2.batch.job import TILES, Job, Task
from zpm2.batch.results import DONE
from zpm2.batch.supply import Supply
from zpm2.batch.tables import Columns
from zpm2.errors import Zpm2Error
from zpm2.tiled.elsewhere import TileMaker, TileOrder
from zpm2.tiled.tile import TilePart


class TileEngine:
    """Makes tiles by an engine (`zpm2.Matcher(..., workers=...)`).

        workers = zpm2.batch.TileEngine(zpm2.batch.Processes(4))
        zpm2.match("a.tif", "b.tif", tiles="on", kept="tiles", workers=workers)

    A tile whose worker died or failed is tried again, `retries` times; what is left then is made by the run itself.
    Workers begin anew on each of the three to five levels of a pair, as one needs the points of the one before.
    """

    def __init__(self, engine: Engine, retries: int = 2) -> None:
        self.engine, self.retries = engine, retries

    def make(self, order: TileOrder, parts: Sequence[TilePart], say: Callable[[str], None]) -> None:
        """See `tiled.TileWorkers`."""
        job = Job(order.folder, TILES, order.config)
        tasks = [Task(TileEntry(order, part), "") for part in parts]
        with closing(self.engine.run(job, Supply(job, tasks, self.engine.workers, self.retries))) as rows:
            for row in rows:
                if row.status != DONE:
                    say(f"tile {row.name} is left to the run itself: {row.reason}")


class Tiles:
    """The command that makes tiles. They go into the folder of their order, and have no files of their own here."""

    columns: ClassVar[Columns] = {}

    def __init__(self, job: Job) -> None:
        self.maker = TileMaker()

    def results(self, entries: Iterable[TileEntry]) -> Iterator[Finished | Zpm2Error]:
        """See `commands.Command`."""
        return one_by_one(entries, self.made)

    def made(self, entry: TileEntry) -> Finished:
        """A tile."""
        return Finished(_nothing, {}, self.maker.make(entry.order, entry.part))


def _nothing(folder: Path) -> None:
    pass
