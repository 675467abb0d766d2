"""Groups of photographs by `zpm2 batch --command tracks`: the same as `zpm2 tracks` of each, whichever way."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import wall
from rendered import Run
from test_engines import Here

import zpm2
from zpm2 import batch
from zpm2.config import assign, preset
from zpm2.files.keys import fingerprint

pytest.importorskip("pyarrow")
CONFIG = assign(preset("default"), wall.SETTINGS)


def job(out: Path) -> batch.Job:
    return batch.Job(str(out), "tracks", CONFIG, way="sequential")


def files(folder: Path) -> dict[str, str]:
    """Names and content of a result."""
    inside = (path for path in folder.rglob("*") if path.is_file() and ".zpm2" not in path.parts)
    return {path.relative_to(folder).as_posix(): fingerprint(path) for path in inside}


@pytest.fixture(scope="module")
def groups(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("groups")
    for name, count in (("far", 2), ("near", 3)):
        (folder / name).mkdir()
        wall.save_photographs(folder / name, count)
    (folder / "one").mkdir()
    wall.save_photographs(folder / "one", 1)
    return folder


@pytest.fixture(scope="module")
def reference(groups: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """All groups, done in this process; what `zpm2 tracks` gives for two of them."""
    out = tmp_path_factory.mktemp("reference") / "out"
    found = batch.run(batch.groups_of_folder(groups), job(out), engine=Here())
    assert (found.pairs, found.done, found.failed) == (3, 2, 1)
    yield out


def test_each_group_as_by_zpm2_tracks(groups: Path, reference: Path) -> None:
    rows = batch.read_index(reference)
    assert [(row["group"], row["photographs"], row["status"]) for row in rows] == [
        ("far", 2, "done"),
        ("near", 3, "done"),
        ("one", 1, "failed"),
    ]
    assert "at least two" in str(rows[2]["reason"])
    folder = reference / "groups" / "near"
    result = zpm2.tracks(groups / "near", CONFIG, pairs="sequential")
    document = json.loads((folder / "tracks.json").read_text())
    assert [each["id"] for each in document["tracks"]] == [track.id for track in result.tracks]
    assert document["tracks"] == json.loads(json.dumps(result.to_dict()))["tracks"]
    assert rows[1]["tracks"] == len(result.tracks)
    assert rows[1]["in_three"] == result.lengths()[3]
    assert rows[1]["pairs"] == 3
    assert json.loads((folder / "group.json").read_text())["group"] == "near"
    assert not (folder / "sheets").exists() or not any((folder / "sheets").iterdir())


def test_processes_give_the_same_and_shards_merge(groups: Path, reference: Path, tmp_path: Path) -> None:
    place = batch.save_list(batch.groups_of_folder(groups), tmp_path)
    last = batch.run(place, job(tmp_path / "out"), shard="1/2", engine=batch.Processes(2))
    assert not last.complete
    last = batch.run(place, job(tmp_path / "out"), shard="2/2", engine=Here())
    assert last.complete
    for name in ("far", "near"):
        ours, theirs = files(tmp_path / "out" / "groups" / name), files(reference / "groups" / name)
        assert {**ours, "group.json": ""} == {**theirs, "group.json": ""}
    assert batch.run(place, job(tmp_path / "out"), engine=Here()).reused == 2


def test_finished_pairs_of_a_group_are_not_matched_again(
    groups: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed, called, plain = batch.groups_of_folder(groups)[1:2], list[str](), zpm2.Matcher.__call__

    def fails_once(matcher: zpm2.Matcher, left: str, right: str) -> object:
        called.append(f"{Path(left).stem} {Path(right).stem}")
        if len(called) == 2:
            raise MemoryError("no memory")
        return plain(matcher, left, right)

    monkeypatch.setattr(zpm2.Matcher, "__call__", fails_once)
    assert batch.run(listed, job(tmp_path), engine=Here()).done == 1
    assert called == ["p0 p1", "p0 p2", "p0 p2", "p1 p2"]


def test_on_the_command_line(groups: Path, reference: Path, run: Run) -> None:
    settings = [word for text in wall.SETTINGS for word in ("--set", text)]
    words = ("batch", groups, "-o", reference, "--command", "tracks", "--pairs", "sequential", *settings, "--json")
    code, out, err = run(*words, "--retries", "0")
    found = json.loads(out)
    assert (code, found["groups"], found["done"], found["reused"], found["failed"]) == (1, 3, 2, 2, 1), err
    assert "2 of 3 groups are finished already" in err or not err
