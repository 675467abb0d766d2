"""Each way to run a list gives the same results, each once, whatever happens to its workers."""

import itertools
import os
from collections.abc import Callable, Generator
from importlib.util import find_spec
from pathlib import Path
from typing import cast

import pytest
from pair_stubs import LENGTHS, content, counted, listed

from zpm2 import batch
from zpm2.batch.engines import processes
from zpm2.batch.engines.engine import Engine
from zpm2.batch.job import Job
from zpm2.batch.results import Row
from zpm2.batch.supply import Supply
from zpm2.batch.worker import Worker
from zpm2.config import assign, preset
from zpm2.errors import ConfigError, InputError, MissingDependency, OutputError, WeightsError, WorkerError

pytest.importorskip("pyarrow")
CONFIG = assign(preset("default"), ["device=cpu"])
NAMES = [*"abcdefgh", "bad_1", *"ijklmnop"]


class Here:
    """A readable reference of an engine: one worker after the other, in this process. Nothing may die in it."""

    workers = 1

    def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
        worker = Worker(job)
        while block := supply.next():
            for message in worker.do(list(block)):
                yield from supply.told(block, message)


def on_ray() -> Engine:
    if find_spec("ray") is None:
        pytest.skip("needs the extra ray")
    return batch.RayEngine(2)


ENGINES = [Here, lambda: batch.Processes(2), on_ray]
MORTAL = pytest.mark.parametrize("engine", ENGINES[1:], ids=["processes", "ray"])


@pytest.mark.parametrize(("told", "inside"), [(None, "2"), ("5", "5")])
def test_workers_share_the_cores_unless_told_how_many(
    monkeypatch: pytest.MonkeyPatch, told: str | None, inside: str
) -> None:
    monkeypatch.setattr(processes, "usable", lambda: 8)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if told:
        monkeypatch.setenv("OMP_NUM_THREADS", told)
    with processes._environment({}, 3):
        assert os.environ["OMP_NUM_THREADS"] == inside
    assert os.environ.get("OMP_NUM_THREADS") == told


def job(out: Path, **more: object) -> Job:
    return Job(str(out), LENGTHS, CONFIG, **more)  # type: ignore[arg-type]


def statuses(out: Path) -> list[tuple[object, object]]:
    return [(row["pair"], row["status"]) for row in batch.read_index(out)]


@pytest.mark.parametrize("engine", ENGINES, ids=["here", "processes", "ray"])
def test_all_pairs_are_done_once_and_failures_are_rows(engine: Callable[[], Engine], tmp_path: Path) -> None:
    pairs = listed(tmp_path, NAMES)
    found = batch.run(pairs, job(tmp_path / "out"), engine=engine())
    assert (found.pairs, found.done, found.failed, found.reused, found.missing) == (17, 16, 1, 0, 0)
    rows = batch.read_index(tmp_path / "out")
    assert [row["pair"] for row in rows] == NAMES
    assert [row["left_bytes"] for row in rows] == [None if k == 8 else k for k in range(17)]
    assert rows[8]["status"] == "failed"
    assert "cannot be read" in cast(str, rows[8]["reason"])
    assert counted(tmp_path) == sorted(set(NAMES) - {"bad_1"})
    batch.run(pairs, job(tmp_path / "reference"), engine=Here())
    assert content(tmp_path / "out") == content(tmp_path / "reference")
    one, other = (tmp_path / name / "index.parquet" for name in ("out", "reference"))
    assert one.read_bytes() == other.read_bytes()


@MORTAL
def test_a_worker_that_dies_is_replaced_and_its_pair_done(engine: Callable[[], Engine], tmp_path: Path) -> None:
    pairs = listed(tmp_path, ["a", "b", "dies", "c", "killer", "d", "odd", "e"])
    found = batch.run(pairs, job(tmp_path / "out"), engine=engine(), retries=1)
    assert (found.done, found.failed) == (7, 1)
    assert [row["pair"] for row in batch.read_index(tmp_path / "out") if row["status"] == "failed"] == ["killer"]
    assert counted(tmp_path) == ["a", "b", "c", "d", "dies", "e", "odd"]
    (reason,) = (row["reason"] for row in batch.read_index(tmp_path / "out") if row["reason"])
    assert "(2 times)" in cast(str, reason)


@MORTAL
def test_an_engine_runs_more_than_once(engine: Callable[[], Engine], tmp_path: Path) -> None:
    pairs, same = listed(tmp_path, ["a", "b"]), engine()
    for name in ("out", "again"):
        assert batch.run(pairs, job(tmp_path / name), engine=same).done == 2


@MORTAL
def test_what_is_wrong_with_all_pairs_ends_the_run(engine: Callable[[], Engine], tmp_path: Path) -> None:
    pairs = listed(tmp_path, ["a"])
    with pytest.raises(WeightsError, match="no weights"):
        batch.run(pairs, Job(str(tmp_path / "out"), "pair_stubs:NoWeights", CONFIG), engine=engine())


def test_workers_that_never_begin_end_the_run(tmp_path: Path) -> None:
    supply = Supply(job(tmp_path), [], 1, 0)
    for _ in range(10):
        assert list(supply.lost([], "its process ended with 1")) == []
    with pytest.raises(WorkerError, match="10 workers in a row"):
        list(supply.lost([], "its process ended with 1"))


def test_a_run_goes_on_and_takes_only_what_is_the_same(tmp_path: Path) -> None:
    pairs = listed(tmp_path, ["a", "b", "c", "bad"])
    out = tmp_path / "out"
    batch.run(pairs[:2], job(out), engine=Here())
    said = list[str]()
    found = batch.run(pairs, job(out), engine=Here(), say=said.append)
    assert (found.done, found.reused, found.failed) == (3, 2, 1)
    assert counted(tmp_path) == ["a", "b", "c"]
    assert "2 of 4 pairs are finished already" in said
    (tmp_path / "a.png").write_bytes(b"another")
    (out / "pairs" / "b" / "pair.json").unlink()
    found = batch.run(pairs, job(out), engine=Here())
    assert (found.done, found.reused) == (3, 1)
    assert counted(tmp_path) == ["a", "a", "b", "b", "c"]
    assert batch.run(pairs, job(out, k="guess"), engine=Here()).reused == 0
    assert {row["by"] for row in batch.read_index(out)} == {"guess", None}


def test_a_pair_that_fails_now_leaves_no_old_result(tmp_path: Path) -> None:
    pairs = listed(tmp_path, ["a"])
    out = tmp_path / "out"
    batch.run(pairs, Job(str(out), "pair_stubs:Recorded", CONFIG), engine=Here())
    assert (out / "pairs" / "a" / "lengths.json").exists()
    (tmp_path / "a.png").unlink()
    found = batch.run(pairs, Job(str(out), "pair_stubs:Recorded", CONFIG), engine=Here(), retries=0)
    assert found.failed == 1
    assert sorted(path.name for path in (out / "pairs" / "a").iterdir()) == [".zpm2", "pair.json"]


def test_files_of_others_in_the_folder_of_a_pair_stay(tmp_path: Path) -> None:
    pairs = listed(tmp_path, ["a", "b"])
    own = tmp_path / "out" / "pairs" / "a" / "lengths.json"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    found = batch.run(pairs, Job(str(tmp_path / "out"), "pair_stubs:Recorded", CONFIG), engine=Here())
    assert (found.done, found.failed) == (1, 1)
    assert own.read_text() == "mine"
    edited = tmp_path / "out" / "pairs" / "b" / "pair.json"
    edited.write_text("{edited")
    found = batch.run(pairs, Job(str(tmp_path / "out"), "pair_stubs:Recorded", CONFIG), engine=Here())
    assert (found.done, found.failed) == (0, 2)
    assert edited.read_text() == "{edited"


def test_shards_write_side_by_side_and_the_last_one_merges(tmp_path: Path) -> None:
    pairs = listed(tmp_path, NAMES)
    batch.run(pairs, job(tmp_path / "whole"), engine=Here())
    out = tmp_path / "out"
    shards = [batch.run(pairs, job(out), engine=Here(), shard=f"{i}/3") for i in (3, 1)]
    assert [found.complete for found in shards] == [False, False]
    assert not (out / "index.parquet").exists()
    part = batch.merge(pairs, job(out))
    assert (part.done, part.failed, part.missing) == (11, 0, 6)
    assert statuses(out)[5:8] == [("f", "missing"), ("g", "missing"), ("h", "missing")]
    last = batch.run(pairs, job(out), engine=Here(), shard="2/3")
    assert last.complete
    assert last.index == str(out / "index.parquet")
    assert (out / "index.parquet").read_bytes() == (tmp_path / "whole" / "index.parquet").read_bytes()
    assert content(out) == content(tmp_path / "whole")
    assert counted(tmp_path) == sorted(2 * [name for name in NAMES if name != "bad_1"])


def test_shards_of_other_settings_are_not_merged(tmp_path: Path) -> None:
    pairs = listed(tmp_path, "abcd")
    batch.run(pairs, job(tmp_path / "out"), engine=Here(), shard="1/2")
    assert not batch.run(pairs, job(tmp_path / "out", rigid=True), engine=Here(), shard="2/2").complete
    assert not batch.run(pairs[:3], job(tmp_path / "out"), engine=Here(), shard="2/2").complete
    assert batch.run(pairs, job(tmp_path / "out"), engine=Here(), shard="2/2").complete


def test_the_index_grows_while_the_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    times = itertools.count(0.0, 6.0)
    monkeypatch.setattr("zpm2.batch.runner.time.monotonic", lambda: next(times))
    out, seen, said = tmp_path / "out", list[int](), list[str]()

    class Watched(Here):
        def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
            for row in super().run(job, supply):
                seen.append(len(batch.read_index(out)) if (out / "index.parquet").exists() else 0)
                yield row

    batch.run(listed(tmp_path, NAMES), job(out), engine=Watched(), say=said.append)
    assert seen[0] == 0
    assert sorted(seen) == seen
    assert len(set(seen)) > 3
    assert any(" of 17 pairs, 1 failed, " in text and text.endswith("left") for text in said)


def test_one_run_at_a_time_but_for_shards(tmp_path: Path) -> None:
    pairs, out = listed(tmp_path, "ab"), tmp_path / "out"

    class Greedy(Here):
        def run(self, job: Job, supply: Supply) -> Generator[Row, None, None]:
            with pytest.raises(OutputError, match="another run"):
                batch.run(pairs, job, engine=Here())
            yield from super().run(job, supply)

    assert batch.run(pairs, job(out), engine=Greedy()).done == 2


def test_misuse_is_said(tmp_path: Path) -> None:
    pairs = listed(tmp_path, "ab")
    with pytest.raises(ConfigError, match="--command tracks takes a list of groups, not of pairs"):
        batch.run(pairs, Job(str(tmp_path / "out"), "tracks"))
    with pytest.raises(ConfigError, match="for the groups of a list"):
        batch.run(pairs, Job(str(tmp_path / "out"), "tracks", way="list.txt"))
    with pytest.raises(ConfigError, match="did you mean 'match'"):
        batch.run(pairs, Job(str(tmp_path / "out"), "macth"))
    with pytest.raises(ConfigError, match="needs --regions"):
        batch.run(pairs, Job(str(tmp_path / "out"), "carry"))
    with pytest.raises(InputError, match="no pairs"):
        batch.run([], job(tmp_path / "out"))
    with pytest.raises(ConfigError, match="retries"):
        batch.run(pairs, job(tmp_path / "out"), retries=-1)
    with pytest.raises(InputError, match="run the batch first"):
        batch.read_index(tmp_path / "nothing")


@pytest.mark.skipif(find_spec("ray") is not None, reason="Ray is here")
def test_ray_is_asked_for_by_name(tmp_path: Path) -> None:
    with pytest.raises(MissingDependency, match=r"zpm2\[ray\]"):
        batch.RayEngine(1)
