import errno
import os
import re
import subprocess
import sys

import pytest

from zpm2.errors import OutputError
from zpm2.files.writing import results_folder
from zpm2.formats import atomic_write, output_folder


@pytest.mark.parametrize(("content", "stored"), [(b"\x00\xff", b"\x00\xff"), ("größer\n", "größer\n".encode())])
def test_writes_and_replaces(tmp_path, content, stored):
    path = tmp_path / "a.json"
    path.write_bytes(b"old and longer than the new")
    assert atomic_write(path, content) == path
    assert path.read_bytes() == stored
    assert os.listdir(tmp_path) == ["a.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX modes")
def test_the_file_has_ordinary_permissions(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    assert atomic_write(tmp_path / "a", b"").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize(
    ("code", "word"),
    [(errno.ENOSPC, "disk is full"), (errno.EACCES, "permission"), (errno.EROFS, "permission"), (errno.EIO, "error")],
)
def test_a_failure_keeps_the_old_file_and_leaves_nothing(tmp_path, monkeypatch, code, word):
    path = tmp_path / "a.json"
    path.write_text("old")

    def fail(*_args):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OutputError, match=word) as caught:
        atomic_write(path, "new")
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == ["a.json"]
    assert path.read_text() == "old"


def test_an_interruption_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        atomic_write(tmp_path / "a", "new")
    assert os.listdir(tmp_path) == []


def test_places_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder").mkdir()
    for path, word in [
        (tmp_path / "file" / "a.json", "is a file, not a folder"),
        (tmp_path / "folder", "folder of that name"),
        (tmp_path / "nowhere" / "a.json", "does not exist"),
    ]:
        with pytest.raises(OutputError, match=word):
            atomic_write(path, "x")
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def test_output_folder_is_created_and_left_empty(tmp_path):
    folder = output_folder(tmp_path / "a" / "b", [tmp_path / "left.png"])
    assert folder.is_dir()
    assert os.listdir(folder) == []
    assert output_folder(str(folder)) == folder


def test_output_folder_refuses_files(tmp_path):
    source = tmp_path / "left.png"
    source.write_text("x")
    with pytest.raises(OutputError, match="one of the input files"):
        output_folder(source, ["elsewhere.png", source])
    with pytest.raises(OutputError, match="is a file"):
        output_folder(source)
    with pytest.raises(OutputError, match="not a folder"):
        output_folder(source / "below")


def test_output_folder_tries_to_write(tmp_path, monkeypatch):
    def refuse(*_args, **_options):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(OutputError, match="permission denied"):
        output_folder(tmp_path)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folder(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="permission denied"):
        output_folder(tmp_path)
    with pytest.raises(OutputError, match="permission denied"):
        atomic_write(tmp_path / "a", "x")


LIMITED = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
from zpm2.errors import OutputError
from zpm2.files.writing import atomic_write, results_folder
out = Path(sys.argv[1])
try:
    with results_folder(out, ["a.json"]):
        if sys.argv[2] == "ours":
            atomic_write(out / "a.json", "x" * 1_000_000)
        else:
            (out / "a.json").write_text("x" * 1_000_000)
except OutputError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit")
@pytest.mark.parametrize("whose", ["ours", "a library's"])
def test_a_file_above_the_limit_is_said(tmp_path, whose):
    """Whoever writes it: Python's own write into the folder stands for a library's."""
    run = [sys.executable, "-c", LIMITED, tmp_path / "out", whose]
    said = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    assert "a file would be larger than allowed; raise the limit (ulimit -f), or give another disk" in said


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (errno.ENOSPC, "the disk is full; free some space"),
        (errno.EDQUOT, "your share of the disk is full; free some space"),
        (errno.EROFS, "permission denied, the disk can only be read; give a folder on another one"),
        (errno.EFBIG, "a file would be larger than allowed; raise the limit"),
    ],
)
def test_a_disk_that_takes_no_more_ends_a_run_in_one_line(tmp_path, code, words):
    with pytest.raises(OutputError, match=re.escape(words)), results_folder(tmp_path / "out", ["a.json"]):
        raise OSError(code, os.strerror(code), "a.json")
    assert not (tmp_path / "out").exists()
