"""A conversion is kept, checked at each use, and made again where anything in it is wrong."""

import json
import logging
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from zpm2 import weights
from zpm2.errors import WeightsError
from zpm2.weights import Entry, cache_dir
from zpm2.weights.converted import LIST

FILES = {"image.xml": b"<net/>" * 100, "image.bin": bytes(range(256)) * 40, "embedding.npz": b"PK" * 50}
made: list[Path] = []


def convert(folder: Path) -> None:
    made.append(folder)
    for name, content in FILES.items():
        (folder / name).write_bytes(content)


@pytest.fixture
def folder(manifest: Entry) -> Path:
    """A finished conversion; `made` counts those that follow."""
    path = weights.converted("tiny", "abc", convert)
    made.clear()
    return path


def is_whole(folder: Path) -> bool:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != LIST} == FILES


def truncate(name: str) -> Callable[[Path], None]:
    return lambda folder: os.truncate(folder / name, 100)


def flip_bits(folder: Path) -> None:
    content = bytearray(FILES["image.bin"])
    content[5000] ^= 0b101
    (folder / "image.bin").write_bytes(content)


def replace_by_file(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_bytes(b"")


def replace_by_folder(folder: Path) -> None:
    (folder / "image.bin").unlink()
    (folder / "image.bin").mkdir()


def empty(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def dangle(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.symlink_to("nowhere")


def listed(text: str) -> Callable[[Path], object]:
    return lambda folder: (folder / LIST).write_text(text)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "an empty file": lambda folder: (folder / "embedding.npz").write_bytes(b""),
    "a truncated file": truncate("image.xml"),
    "flipped bits": flip_bits,
    "a missing file": lambda folder: (folder / "image.bin").unlink(),
    "a folder in the place of a file": replace_by_folder,
    "no list": lambda folder: (folder / LIST).unlink(),
    "a truncated list": truncate(LIST),
    "a list of nothing": listed("{}"),
    "a list of another kind": listed("[1]"),
    "a list of other values": listed(json.dumps(dict.fromkeys(FILES, 3))),
    "a nested list": listed("[" * 100_000),
    "a list that is no text": lambda folder: (folder / LIST).write_bytes(b"\xff\xfe{"),
    "a half-made folder": lambda folder: [(folder / name).unlink() for name in (LIST, "embedding.npz")],
    "an empty folder": empty,
    "a file in the place of the folder": replace_by_file,
    "a link to nowhere": dangle,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_damaged_is_made_again_and_said(folder: Path, damage: str, caplog: pytest.LogCaptureFixture) -> None:
    DAMAGES[damage](folder)
    with caplog.at_level(logging.WARNING):
        assert weights.converted("tiny", "abc", convert) == folder
    assert len(made) == 1
    assert is_whole(folder)
    assert len(caplog.messages) == 1
    assert f"{folder} " in caplog.text
    assert "converting tiny again" in caplog.text
    assert weights.converted("tiny", "abc", convert) == folder
    assert len(made) == 1
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]  # nothing half-made stays


def test_what_is_whole_is_used_as_it_is(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    (folder / "Thumbs.db").write_bytes(b"put there by a file manager")
    assert weights.converted("tiny", "abc", convert) == folder
    assert made == []
    assert caplog.messages == []


def test_conversions_lie_beside_the_weights(folder: Path) -> None:
    assert folder.is_dir()
    assert folder.is_relative_to(cache_dir())
    assert folder != weights.converted("tiny", "abd", convert)


def test_a_faster_process_is_believed(manifest: Entry) -> None:
    def slower(folder: Path) -> None:
        other = weights.converted("tiny", "abc", convert)
        made.append(other)
        (folder / "image.xml").write_bytes(b"ours")

    assert is_whole(weights.converted("tiny", "abc", slower))


def test_a_broken_conversion_leaves_nothing(manifest: Entry) -> None:
    def full(folder: Path) -> None:
        convert(folder)
        raise OSError("no room")

    with pytest.raises(WeightsError, match="no room; free space there"):
        weights.converted("tiny", "abc", full)
    assert list((cache_dir() / "converted").iterdir()) == []


def test_a_place_that_cannot_be_had_is_one_line(manifest: Entry) -> None:
    cache_dir().mkdir(parents=True)
    (cache_dir() / "converted").write_bytes(b"a file")
    with pytest.raises(WeightsError, match="cannot write tiny"):
        weights.converted("tiny", "abc", convert)
