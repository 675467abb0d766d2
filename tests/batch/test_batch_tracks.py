"""Groups of photographs by `zpm2 batch --command tracks`: the same as `zpm2 tracks` of each, whichever way."""

import json
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
SETTINGS = [*wall.SETTINGS, "tracks.window=1", "tracks.extend=false"]
CONFIG = assign(preset("default"), SETTINGS)


def job(out: Path) -> batch.Job:
    return batch.Job(str(out), "tracks", CONFIG, way="sequential")


def files(folder: Path) -> dict[str, str]:
    """Names and content of a result, but for its row, which has seconds."""
    inside = (path for path in folder.rglob("*") if path.is_file() and ".zpm2" not in path.parts)
    return {path.relative_to(folder).as_posix(): fingerprint(path) for path in inside if path.name != "group.json"}


@pytest.fixture(scope="module")
def groups(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("groups")
    for name, count in (("far", 2), ("near", 3), ("one", 1)):
        (folder / name).mkdir()
        wall.save_photographs(folder / name, count)
    return folder


@pytest.fixture(scope="module")
def reference(groups: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All groups, done in this process, which fails once: pairs that were finished before are not matched again."""
    out, called, plain = tmp_path_factory.mktemp("reference") / "out", list[str](), zpm2.Matcher.__call__

    def fails_once(matcher: zpm2.Matcher, left: str, right: str) -> object:
        called.append(f"{Path(left).parent.name} {Path(left).stem} {Path(right).stem}")
        if called[-1] == "near p1 p2" and called.count("near p1 p2") == 1:
            raise MemoryError("no memory")
        return plain(matcher, left, right)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zpm2.Matcher, "__call__", fails_once)
        found = batch.run(batch.groups_of_folder(groups), job(out), engine=Here())
    assert (found.pairs, found.done, found.failed) == (3, 2, 1)
    assert called == ["far p0 p1", "near p0 p1", "near p1 p2", "near p1 p2"]
    return out


def test_each_group_as_by_zpm2_tracks(groups: Path, reference: Path) -> None:
    rows = batch.read_index(reference)
    assert [(row["group"], row["photographs"], row["status"]) for row in rows] == [
        ("far", 2, "done"),
        ("near", 3, "done"),
        ("one", 1, "failed"),
    ]
    assert "at least two" in str(rows[2]["reason"])
    folder = reference / "groups" / "far"
    result = zpm2.tracks(groups / "far", CONFIG, pairs="sequential")
    document = json.loads((folder / "tracks.json").read_text())
    assert len(document["tracks"]) > 5
    assert document["tracks"] == json.loads(json.dumps(result.to_dict()))["tracks"]
    assert (rows[0]["pairs"], rows[0]["tracks"], rows[0]["in_three"]) == (1, len(result.tracks), 0)
    assert json.loads((folder / "group.json").read_text())["group"] == "far"
    assert not any((folder / "sheets").glob("*"))


def test_processes_give_the_same(groups: Path, reference: Path, tmp_path: Path) -> None:
    place = batch.save_list(batch.groups_of_folder(groups), tmp_path)
    assert not batch.run(place, job(tmp_path / "out"), shard="1/3", engine=batch.Processes(1)).complete
    theirs = files(reference / "groups" / "far")
    assert files(tmp_path / "out" / "groups" / "far") == theirs
    assert {"tracks.json", "coco.json", "tracks.csv", "labels/p0.png", "labels/p1.png"} <= set(theirs)


def test_on_the_command_line_finished_groups_are_taken_over(groups: Path, reference: Path, run: Run) -> None:
    settings = [word for text in SETTINGS for word in ("--set", text)]
    words = ("batch", groups, "-o", reference, "--command", "tracks", "--pairs", "sequential", *settings, "--json")
    code, out, err = run(*words)
    found = json.loads(out)
    assert (code, found["groups"], found["done"], found["reused"], found["failed"]) == (1, 3, 2, 2, 1), err
