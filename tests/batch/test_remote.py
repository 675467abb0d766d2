"""Lists and results at addresses that fsspec knows."""

from pathlib import Path

import pytest
from pair_stubs import content, listed
from test_engines import CONFIG, NAMES, Here

from zpm2 import batch
from zpm2.batch import remote
from zpm2.errors import InputError, MissingDependency

fsspec = pytest.importorskip("fsspec")
pytest.importorskip("pyarrow")


def job(out: str) -> batch.Job:
    return batch.Job(out, "pair_stubs:Recorded", CONFIG)


@pytest.mark.parametrize("kind", ["memory://", "file://"])
def test_the_same_results_as_on_a_disk(kind: str, tmp_path: Path) -> None:
    pairs, store = listed(tmp_path, NAMES), f"{kind}{tmp_path}/store"
    local = batch.run(pairs, job(str(tmp_path / "local")), engine=Here())
    place = batch.save_list(pairs, store)
    found = batch.run(place, job(f"{store}/out"), engine=Here())
    assert (found.done, found.failed) == (local.done, local.failed) == (16, 1)
    system, path = remote.opened(f"{store}/out")
    names = [str(name) for name in system.find(f"{path}/pairs")]
    files = {name[name.index("pairs/") :]: system.cat_file(name) for name in names}
    assert files == content(tmp_path / "local")
    assert remote.read(found.index) == Path(local.index).read_bytes()
    again = batch.run(place, job(f"{store}/out"), engine=Here())
    assert (again.reused, again.failed) == (16, 1)
    for i in (1, 2):
        parts = batch.run(place, job(f"{store}/parts"), engine=Here(), shard=f"{i}/2")
    assert parts.complete
    assert batch.read_index(f"{store}/parts") == batch.read_index(tmp_path / "local")


def test_places_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read memory://nothing"):
        batch.read_pairs("memory://nothing.csv")
    with pytest.raises(InputError, match="no address that fsspec can open"):
        batch.read_pairs("nosuch://bucket/a.csv")


def test_without_fsspec_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "fsspec", None)
    with pytest.raises(MissingDependency, match=r"zpm2\[remote\]"):
        batch.read_pairs("s3://bucket/pairs.csv")
