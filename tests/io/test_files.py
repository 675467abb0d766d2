import errno
import os
import sys

import pytest

from zpm2.errors import OutputError
from zpm2.io import atomic_write, output_folder


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
