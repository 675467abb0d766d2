"""`zpm2 batch`, and what it does with real pairs."""

import json
from pathlib import Path

import PIL.Image
import pytest
from pair_stubs import LENGTHS, listed
from rendered import Pair, Run

from zpm2 import batch
from zpm2.batch.job import tasks
from zpm2.batch.worker import Trouble, Worker
from zpm2.config import assign, preset
from zpm2.result import MatchResult

pytest.importorskip("pyarrow")
STUB = ("--command", LENGTHS, "--device", "cpu")
SIMPLE = ["device=cpu", "points.methods=sift", "segment.model=classical", "guided.direction=off"]
SIMPLE += ["segment.detail.level=off", "points.escalate.on=false", "pose.crops=off"]


def test_shards_of_a_list_on_the_command_line(tmp_path: Path, run: Run) -> None:
    list_file = batch.save_list(listed(tmp_path, ["a", "b", "bad"]), tmp_path)
    words = ("batch", list_file, "-o", tmp_path / "out", *STUB, "--json")
    code, out, err = run(*words, "--shard", "1/2")
    assert code == 0, err
    assert json.loads(out)["complete"] is False
    code, out, _ = run(*words, "--shard", "2/2")
    found = json.loads(out)
    assert code == 1
    assert (found["pairs"], found["done"], found["failed"], found["complete"]) == (2, 1, 1, True)
    code, out, _ = run(*words[:-1], "--merge")
    assert code == 1
    assert "2 of 3 pairs done (2 of an earlier run), 1 failed" in out
    assert [row["status"] for row in batch.read_index(tmp_path / "out")] == ["done", "done", "failed"]


@pytest.mark.parametrize("more", ["-q", "--json"])
def test_what_failed_is_always_told(tmp_path: Path, run: Run, more: str) -> None:
    left = str(tmp_path / "a[/x]" / "bad.png")
    list_file = batch.save_list([*listed(tmp_path, ["a"]), batch.Pair("b", left, str(tmp_path / "a.png"))], tmp_path)
    words = ("batch", list_file, "-o", tmp_path / "out", *STUB)
    reason = f"b: {left} cannot be read"
    code, out, err = run(*words, more)
    assert (code, err) == (1, f"warning: {reason}\n")
    assert not out or json.loads(out)["failures"] == {"b": f"{left} cannot be read"}
    assert reason in run(*words).err.splitlines()  # in one line, and as it is
    assert run(*words, "--merge", more).err == f"warning: {reason}\n"


def test_a_list_of_a_folder(tmp_path: Path, run: Run) -> None:
    for k in range(3):
        PIL.Image.new("RGB", (64, 48), (60 * k, 0, 0)).save(tmp_path / f"p{k}.png")
    code, out, err = run("batch", tmp_path, "-o", tmp_path / "out", "--pairs", "exhaustive", "--list-only", *STUB)
    assert code == 0, err
    assert "3 pairs in" in out
    assert [pair.name for pair in batch.read_pairs(tmp_path / "out" / "pairs.csv")] == ["p0_p1", "p0_p2", "p1_p2"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (("--gpus", "1"), "give it, too"),
        (("--engine", "slurm"), "give local or ray"),
        (("--shard", "3/2"), "--shard 3/2"),
        (("--command", "tracks"), "has no column group and photograph"),
        (("--command", "tracks", "--pairs", "a.txt"), "--pairs a.txt"),
        (("--command", "carry"), "needs --regions"),
        (("--command", "no_such:Class"), "cannot be loaded"),
        (("--command", "match", "--rigid"), "--rigid is for --command carry: leave it out"),
        (("--command", "match", "--K", "guess"), "--K is for --command pose: leave it out"),
        (("--command", "carry", "--format", "coco"), "--format is for --command match or pose: leave it out"),
        (("--pairs", "exhaustive"), "--pairs exhaustive is for a folder of photographs"),
        (("--merge", "--shard", "1/2"), "--merge is of all shards: leave out --shard"),
    ],
)
def test_misuse_on_the_command_line(tmp_path: Path, run: Run, more: tuple[str, ...], said: str) -> None:
    list_file = batch.save_list(listed(tmp_path, ["a", "b"]), tmp_path)
    code, _, err = run("batch", list_file, "-o", tmp_path / "out", *STUB, *more)
    assert (code, said in err, err.count("\n")) == (2, True, 1)
    assert not (tmp_path / "out").exists()


def test_poses_as_of_the_commands(pair: Pair, tmp_path: Path) -> None:
    scene = pair.scene
    k = f"{scene.f},{scene.f},{scene.cx},{scene.cy}"
    (tmp_path / "broken.png").write_text("no picture")
    pairs = [batch.Pair("good", str(pair.left), str(pair.right), k=k)]
    pairs.append(batch.Pair("broken", str(tmp_path / "broken.png"), str(pair.right)))
    job = batch.Job(str(tmp_path / "out"), "pose", assign(preset("default"), SIMPLE))
    good, broken = Worker(job).do(tasks(job, pairs))
    assert not isinstance(good, Trouble)
    assert not isinstance(broken, Trouble)
    assert (good.status, broken.status) == ("done", "failed")
    assert "broken.png" in (broken.reason or "")
    folder = tmp_path / "out" / "pairs" / "good"
    result = MatchResult.load(folder)
    posed = json.loads((folder / "pose.json").read_text())
    assert good.found["matches"] == len(result.matches)
    assert good.found["inliers"] == posed["counts"]["inliers"]
    assert len(good.found["rotation"]) == 9  # type: ignore[arg-type]
    assert not (folder / "overlay.png").exists()


def test_regions_are_carried(pair: Pair, tmp_path: Path) -> None:
    pairs = [batch.Pair("a", str(pair.left), str(pair.right), regions=str(pair.left_regions))]
    pairs.append(batch.Pair("b", str(pair.left), str(pair.right), regions=str(tmp_path / "none.png")))
    job = batch.Job(str(tmp_path / "out"), "carry", assign(preset("default"), SIMPLE), rigid=True)
    good, bad = Worker(job).do(tasks(job, pairs))
    assert not isinstance(good, Trouble)
    assert not isinstance(bad, Trouble)
    assert (good.status, bad.status) == ("done", "failed")
    carried = json.loads((tmp_path / "out" / "pairs" / "a" / "carry.json").read_text())
    assert good.found["found"] == carried["counts"]["found"]
