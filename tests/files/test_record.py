"""Only what a run of zpm2 made is replaced or removed."""

import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import zpm2
from zpm2.errors import OutputError
from zpm2.files import lock
from zpm2.files.record import (
    HIDDEN,
    LOCK,
    RECORD,
    make_folder,
    move_into_place,
    remove_own,
    save_key,
    saved_key,
    temporary_folder,
)
from zpm2.files.writing import results_folder
from zpm2.formats import atomic_write, claim


def contents(folder: Path) -> dict[str, bytes]:
    """All files that are not in a hidden folder of zpm2."""
    files = (p for p in folder.rglob("*") if p.is_file() and HIDDEN not in p.parts)
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def test_own_files_are_replaced_and_others_are_not(tmp_path):
    (tmp_path / "b.json").write_text("theirs")
    claim(tmp_path, ["a.json"])
    for content in ("one", "two"):
        atomic_write(tmp_path / "a.json", content)
    assert (tmp_path / "a.json").read_text() == "two"
    with pytest.raises(OutputError, match=r"b\.json is there already, and is not on record .*: move .* another output"):
        atomic_write(tmp_path / "b.json", "ours")
    with pytest.raises(OutputError, match=r"b\.json is there already"):
        remove_own(tmp_path / "b.json")
    with pytest.raises(OutputError, match=r"b\.json is there already"):
        claim(tmp_path, ["a.json", "b.json"])
    (tmp_path / "a.json").write_text("corrected by hand")
    with pytest.raises(OutputError, match=r"a\.json was changed since zpm2 wrote it"):
        atomic_write(tmp_path / "a.json", "three")
    assert contents(tmp_path) == {"a.json": b"corrected by hand", "b.json": b"theirs"}
    (tmp_path / "a.json").unlink()
    atomic_write(tmp_path / "a.json", "three")
    remove_own(tmp_path / "a.json")
    assert not (tmp_path / "a.json").exists()


def test_a_refusal_leaves_the_folder_as_it_was(tmp_path):
    (tmp_path / "b.json").write_text("theirs")
    with pytest.raises(OutputError):
        claim(tmp_path, ["b.json"])
    assert os.listdir(tmp_path) == ["b.json"]


@pytest.mark.parametrize("what", ["file", "folder", "link", "dangling"])
def test_links_and_folders_are_others_too(tmp_path, what):
    out, target = tmp_path / "out", tmp_path / "out" / "overlay.png"
    out.mkdir()
    (tmp_path / "precious").write_text("x")
    if what == "file":
        target.write_text("x")
    elif what == "folder":
        target.mkdir()
        (target / "inside").write_text("x")
    else:
        target.symlink_to(tmp_path / ("precious" if what == "link" else "nowhere"))
    with pytest.raises(OutputError, match=r"overlay\.png is there already"):
        claim(out, ["overlay.png"])
    assert os.path.lexists(target)
    assert (tmp_path / "precious").read_text() == "x"


@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_a_hidden_folder_of_somebody_else_is_refused(tmp_path, kind):
    hidden = tmp_path / HIDDEN
    if kind == "file":
        hidden.write_text("x")
    elif kind == "folder":
        hidden.mkdir()
        (hidden / "tiles").mkdir()
        (hidden / "tiles" / "x").write_text("x")
    else:
        (tmp_path / "other").mkdir()
        hidden.symlink_to(tmp_path / "other")
    before = sorted(str(p) for p in tmp_path.rglob("*"))
    with pytest.raises(OutputError, match=r"\.zpm2 is not the folder that zpm2 keeps its files in"):
        claim(tmp_path, [])
    assert sorted(str(p) for p in tmp_path.rglob("*")) == before


def test_a_record_that_is_none_is_refused(tmp_path):
    (tmp_path / HIDDEN).mkdir()
    (tmp_path / HIDDEN / RECORD).write_text("something else\n")
    (tmp_path / "a").write_text("x")
    with pytest.raises(OutputError, match=r"made.jsonl is not a record of zpm2"):
        claim(tmp_path, ["a"])
    assert (tmp_path / HIDDEN / RECORD).read_text() == "something else\n"


def test_an_unfinished_line_of_the_record_does_not_count(tmp_path):
    claim(tmp_path, [])
    atomic_write(tmp_path / "a", "x")
    with (tmp_path / HIDDEN / RECORD).open("a") as file:
        file.write('{"name": "b", "i')
    assert claim(tmp_path, ["a"]) == tmp_path


def test_folders(tmp_path):
    """What lies in a folder that we made has our record, and no hidden folder of its own."""
    out = claim(tmp_path / "out", ["pairs"])
    inner = make_folder(make_folder(out / "pairs") / "a")
    assert claim(inner, ["matches.json"]) == inner
    atomic_write(inner / "matches.json", "x")
    (inner / "notes.txt").write_text("theirs")
    assert not (inner / HIDDEN).exists()
    claim(out, ["pairs"])
    atomic_write(inner / "matches.json", "y")
    with pytest.raises(OutputError, match=r"notes\.txt is there already"):
        atomic_write(inner / "notes.txt", "ours")
    save_key(inner, "abc")
    assert saved_key(inner) == "abc"
    assert saved_key(out / "pairs" / "b") is None
    (tmp_path / "foreign" / "pairs").mkdir(parents=True)
    claim(tmp_path / "foreign", ["pairs"])  # it is empty
    (tmp_path / "foreign" / "pairs" / "x").write_text("theirs")
    with pytest.raises(OutputError, match="pairs is there already"):
        make_folder(tmp_path / "foreign" / "pairs")


def test_a_finished_folder_is_put_on_record_with_all_its_files(tmp_path):
    claim(tmp_path, [])
    with temporary_folder(tmp_path) as part:
        assert part.is_relative_to(tmp_path / HIDDEN)
        (part / "dense" / "stereo").mkdir(parents=True)
        (part / "dense" / "stereo" / "a.bin").write_bytes(b"x")
        move_into_place(part / "dense", tmp_path / "dense")
    assert not part.exists()
    atomic_write(tmp_path / "dense" / "stereo" / "a.bin", b"y")
    remove_own(tmp_path / "dense" / "stereo" / "a.bin")
    assert contents(tmp_path) == {}
    with pytest.raises(OutputError, match="dense is a folder that others may have put files into"):
        remove_own(tmp_path / "dense")


def test_a_folder_may_be_moved(tmp_path):
    atomic_write(claim(tmp_path / "here", []) / "a", "x")
    (tmp_path / "here").rename(tmp_path / "there")
    atomic_write(claim(tmp_path / "there", ["a"]) / "a", "y")


def test_an_input_is_not_written_over(tmp_path):
    out = claim(tmp_path, [])
    atomic_write(out / "overlay.png", "x")
    make_folder(out / "rectified")
    atomic_write(out / "rectified" / "left.png", "x")
    with pytest.raises(OutputError, match=r"overlay\.png is an input and would be written over"):
        claim(out, ["overlay.png"], [tmp_path / "overlay.png"])
    with pytest.raises(OutputError, match="rectified is an input and would be written over"):
        claim(out, ["rectified"], [out / "rectified" / "left.png"])
    claim(out, ["matches.json"], [tmp_path / "overlay.png"])


def end_early(folder, error, work):
    with pytest.raises(error), results_folder(folder, ["a"]):  # noqa: PT012
        work(folder)
        raise error


@pytest.mark.parametrize("error", [KeyboardInterrupt, OutputError, ValueError])
def test_a_run_that_ends_early_leaves_no_empty_folders(tmp_path, error):
    with pytest.raises(error), results_folder(tmp_path / "deep" / "out", ["a"]):
        raise error
    assert os.listdir(tmp_path) == []
    end_early(tmp_path / "out", error, lambda folder: atomic_write(folder / "a", "x"))
    assert contents(tmp_path) == {"out/a": b"x"}
    (tmp_path / "there").mkdir()
    with pytest.raises(error), results_folder(tmp_path / "there", ["a"]):
        raise error
    assert os.listdir(tmp_path / "there") == []


def test_tiles_for_the_next_run_stay(tmp_path):
    end_early(tmp_path / "out", KeyboardInterrupt, lambda folder: (folder / HIDDEN / "tiles").mkdir())
    assert (tmp_path / "out" / HIDDEN / "tiles").is_dir()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_what_a_killed_run_left_goes_with_the_next_one(tmp_path):
    code = (
        "import os, signal, sys\nfrom zpm2.formats import claim\nfrom zpm2.files.record import temporary_folder\n"
        "with temporary_folder(claim(sys.argv[1], [])) as part:\n"
        "    (part / 'x').write_text('x')\n    os.kill(os.getpid(), signal.SIGKILL)"
    )
    sources = str(Path(zpm2.__file__).parents[1])
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], env={**os.environ, "PYTHONPATH": sources}, check=False)
    parts = tmp_path / HIDDEN / "parts"
    assert len(list(parts.iterdir())) == 1
    (tmp_path / ".0123.part").write_text("theirs")
    with temporary_folder(tmp_path) as mine:
        claim(tmp_path, [])
        assert list(parts.iterdir()) == [mine]
    assert contents(tmp_path) == {".0123.part": b"theirs"}


def test_removal_is_in_one_place():
    package = Path(zpm2.__file__).parent
    words = ("rmtree(", ".unlink(", "os.remove(", "os.rename(", "shutil.move(", "write_text(", "write_bytes(")
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if any(word in path.read_text(encoding="utf-8") for word in words)
    }
    cache = "weights/converted.py"  # of our own folder, and it removes nothing itself
    lock = "files/lock.py"  # the file that it made and holds
    contract = "contract/formats.py"  # a file in a temporary folder, which a format must leave alone
    app = "app/session.py"  # what a browser sent, in a temporary folder, until it is decoded
    assert found == {"files/record.py", "files/writing.py", lock, cache, contract, app}


HOLD = """
import sys, time
from pathlib import Path
from zpm2.files.writing import results_folder
with results_folder(Path(sys.argv[1]), ["a.json"]):
    print("in", flush=True)
    time.sleep(60)
"""


def test_a_second_run_into_a_folder_ends_at_once(tmp_path):
    out = tmp_path / "out"
    with subprocess.Popen([sys.executable, "-c", HOLD, out], stdout=subprocess.PIPE, text=True) as first:
        try:
            assert first.stdout.readline() == "in\n"
            with (
                pytest.raises(
                    OutputError, match=r"another run is writing into .*: wait until it ends, or give another"
                ),
                results_folder(out, ["a.json"]),
            ):
                pass
            assert (out / HIDDEN / RECORD).exists()  # which is the first run's
        finally:
            first.kill()
    assert (out / HIDDEN / LOCK).exists()
    with results_folder(out, ["a.json"]):  # what was killed bars nobody
        atomic_write(out / "a.json", "{}")
    assert not (out / HIDDEN / LOCK).exists()


def test_runs_that_start_together_are_one_at_a_time(tmp_path):
    """Each of some processes adds 1 to a number when it gets the lock, and tries again when it does not."""
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom zpm2.files.lock import AlreadyLocked, locked\n"
        "out = Path(sys.argv[1])\n"
        "done = 0\nwhile done < 50:\n    try:\n        with locked(out / 'lock'):\n"
        "            n = int((out / 'n').read_text())\n            (out / 'n').write_text(str(n + 1))\n"
        "        done += 1\n    except AlreadyLocked:\n        time.sleep(0.001)\n"
    )
    (tmp_path / "n").write_text("0")
    runs = [subprocess.Popen([sys.executable, "-c", code, tmp_path]) for _ in range(3)]
    assert [run.wait(60) for run in runs] == [0, 0, 0]
    assert (tmp_path / "n").read_text() == "150"


def test_a_failed_run_leaves_no_lock(tmp_path):
    with pytest.raises(ValueError, match="stop"), results_folder(tmp_path / "out", ["a.json"]):
        raise ValueError("stop")
    assert not (tmp_path / "out").exists()


def test_a_disk_without_locks_is_said(tmp_path, monkeypatch, caplog):
    def none(_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lock, "_take", none)
    with results_folder(tmp_path / "out", ["a.json"]) as folder:
        atomic_write(folder / "a.json", "{}")
    assert "cannot be locked (No locks available): let no other run write there" in caplog.text


def test_a_folder_whose_record_a_kill_left_empty_or_cut_is_still_ours(tmp_path):
    record = tmp_path / HIDDEN / RECORD
    claim(tmp_path, ["a.json"])
    whole = record.read_text()
    record.write_text("")
    claim(tmp_path, ["a.json"])
    atomic_write(tmp_path / "a.json", "one")
    assert record.read_text().startswith(whole)
    with record.open("a") as file:
        file.write('{"name": "b.json", "i')
    atomic_write(tmp_path / "c.json", "one")
    for name in ("a.json", "c.json"):
        atomic_write(tmp_path / name, "two")
    assert contents(tmp_path) == {"a.json": b"two", "c.json": b"two"}


def test_an_interrupt_of_the_cleaning_up_leaves_nothing_either(tmp_path, monkeypatch):
    def interrupted(path):
        raise KeyboardInterrupt

    def write(out):
        with results_folder(out, ["a.json"]), monkeypatch.context() as patch:
            patch.setattr("zpm2.files.record._remove", interrupted)
            atomic_write(out / "a.json", "one")

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        write(out)
    assert contents(out) == {"a.json": b"one"}
    assert not list((out / HIDDEN / "parts").iterdir())


def test_an_interrupt_just_after_the_temporary_folder_is_made(tmp_path, monkeypatch):
    make = Path.mkdir

    def interrupted(path, mode=0o777, parents=False, exist_ok=False):
        make(path, mode, parents, exist_ok)
        if path.suffix == ".part":
            raise KeyboardInterrupt

    monkeypatch.setattr(Path, "mkdir", interrupted)
    with pytest.raises(KeyboardInterrupt), temporary_folder(tmp_path):
        pytest.fail("the folder is not there")
    assert not list(tmp_path.iterdir())


def test_an_interrupt_while_the_temporary_folder_is_removed(tmp_path, monkeypatch):
    remove, calls = shutil.rmtree, []

    def interrupted(path, **options):
        calls.append(path)
        if len(calls) == 1:
            raise KeyboardInterrupt
        remove(path, **options)

    monkeypatch.setattr(shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt), temporary_folder(tmp_path) as part:
        (part / "a").write_text("a")
    assert not list(tmp_path.iterdir())
