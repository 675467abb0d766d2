"""Whatever a file holds, a reader reads it or says in one line why not: in time, and without much memory.

A seeded share of what `long.py` runs; what it found once is here by name.
"""

import gzip
import json
import os
import struct
import threading
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
from harness import Hang, attempt, run, summary
from samples import Reader

from zpm2 import config, memory
from zpm2.cloud.surface import SurfaceMesh
from zpm2.errors import ConfigError, InputError, Zpm2Error
from zpm2.files.listing import json_file, text
from zpm2.files.reading import MAX_UNPACKED_BYTES, parse_json, read_array, read_arrays, unpack_gzip
from zpm2.formats import cameras, colmap
from zpm2.formats.maps import read_map
from zpm2.formats.regions.registry import open_regions
from zpm2.photos import listing
from zpm2.photos.images import read_image
from zpm2.photos.source import open_source
from zpm2.result import MatchResult
from zpm2.stereo.calibration import read_calibration
from zpm2.stereo.camera_check import orientation
from zpm2.stereo.intrinsics import from_exif, read_camera

MUTANTS = 1200


def test_mutants() -> None:
    found = summary(run(0, MUTANTS))
    assert found.get("wrong", 0) == 0, json.dumps(found["kinds"], indent=1)
    assert found["mutants"] == MUTANTS
    assert found["refused"] > MUTANTS / 3  # or they are no damage
    assert found["read"] > MUTANTS / 20  # or nothing gets past the first lines of a reader


def test_the_harness_sees_what_goes_wrong(tmp_path: Path) -> None:
    """An error of a library, a wait, and a text of two lines are none of "read" and "refused"."""

    def foreign(folder: Path) -> None:
        raise KeyError("key")

    def long(folder: Path) -> None:
        raise Hang

    def two_lines(folder: Path) -> None:
        raise type("Split", (Zpm2Error,), {"__str__": lambda self: "one\ntwo"})

    kinds = [attempt(Reader("", (), read), tmp_path)[0] for read in (foreign, long, two_lines)]
    assert [kind.split()[0] for kind in kinds] == ["KeyError", "hang", "no"]


READERS: dict[str, Callable[[Path], Any]] = {
    "photo.png": read_image,
    "labels.png": open_regions,
    "labels.npy": open_regions,
    "regions.json": open_regions,
    "map.pfm": read_map,
    "map.npy": read_map,
    "config.toml": config.load,
    "config.json": config.load,
    "matches.json": MatchResult.load,
    "pairs.json": json_file,
    "pairs.csv": text,
    "cameras.npz": cameras.archive,
    "K.txt": lambda path: read_camera(str(path), "a.png", (48, 40)),
    "cameras.txt": colmap.read_cameras,
    "cameras.bin": colmap.read_cameras,
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes")
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    ended: list[BaseException] = []

    def read() -> None:
        try:
            READERS[name](tmp_path / name)
        except BaseException as error:
            ended.append(error)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    thread.join(10)
    assert [type(error) for error in ended] == [ConfigError if "config" in name else InputError]


@pytest.mark.parametrize("name", [b"left-\xff.png", b"left-\xff.tif"])
def test_a_name_that_is_not_utf8_is_known_before_the_work(tmp_path: Path, name: bytes) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))
    with PIL.Image.new("RGB", (40, 40)) as picture:
        picture.save(tmp_path / "a.png")
    os.rename(tmp_path / "a.png", path)
    with pytest.raises(InputError, match="its name is not UTF-8, rename it") as caught:
        open_source(path)
    str(caught.value).encode()  # which can be printed


@pytest.mark.parametrize("name", ["a" * 5000 + "/", "a\0b", "a" * 300 + "/"])
@pytest.mark.parametrize("ending", READERS)
def test_names_that_no_file_can_have(tmp_path: Path, name: str, ending: str) -> None:
    with pytest.raises(Zpm2Error):
        READERS[ending](tmp_path / (name + ending))


def test_a_message_is_one_line_without_control_characters() -> None:
    error = InputError("cannot read a\nb\x1b[31m\udcff\u202e.png")
    assert str(error) == "cannot read a b\\x1b[31m\\udcff\\u202e.png"


def test_sizes_are_held_against_the_length_of_the_file(tmp_path: Path) -> None:
    """What these files declare takes gigabytes."""
    header = np.lib.format.magic(1, 0) + struct.pack("<H", 118)
    text = "{'descr': '<f8', 'fortran_order': False, 'shape': (100000, 100000), }"
    (tmp_path / "a.npy").write_bytes(header + text.ljust(117).encode() + b"\n" + bytes(80))
    with pytest.raises(ValueError, match="its length is not that of float64"):
        read_array(tmp_path / "a.npy")
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("world_mat_0.npy", bytes(MAX_UNPACKED_BYTES + 1))
    with pytest.raises(ValueError, match="more than 32 MB"):
        read_arrays(tmp_path / "a.npz")
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<Q", 10**8) + bytes(62))
    with pytest.raises(InputError, match="not a complete COLMAP model: it is cut short"):
        colmap.read_cameras(tmp_path / "cameras.bin")


def test_a_gzip_bomb_is_not_unpacked(tmp_path: Path) -> None:
    (tmp_path / "a.gz").write_bytes(gzip.compress(bytes(MAX_UNPACKED_BYTES + 1), 1))
    with pytest.raises(ValueError, match="more than 32 MB"):
        unpack_gzip(tmp_path / "a.gz")


@pytest.mark.parametrize("content", [b"[" * 100_000, b"9" * 5000, b"[" + b"1" * 400 + b"]", b"\xff"])
def test_json_raises_value_errors_only(content: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        parse_json(content)


@pytest.mark.parametrize("name", ["a.toml", "a.json"])
@pytest.mark.parametrize("value", ["[" * 50_000, "9" * 5000])
def test_a_configuration_nested_without_end(tmp_path: Path, name: str, value: str) -> None:
    (tmp_path / name).write_text(f"seed = {value}" if name == "a.toml" else f'{{"seed": {value}}}')
    with pytest.raises(ConfigError):
        config.load(tmp_path / name)


def test_a_picture_above_pillows_limit_has_a_size_and_exif(tmp_path: Path) -> None:
    """Pillow refuses 179 megapixels as a bomb, also where only the header is asked for."""
    path, exif = tmp_path / "large.png", PIL.Image.Exif()
    exif[0x0112] = 6
    PIL.Image.new("1", (20000, 20000)).save(path, exif=exif)
    assert listing.image_size(path) == (20000, 20000)
    assert orientation(str(path)) == 6
    assert "no focal length" in str(from_exif(path, (20000, 20000)))


def test_a_short_file_of_a_large_picture(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    PIL.Image.new("L", (64, 64)).save(path)
    content = bytearray(path.read_bytes())
    content[16:24] = struct.pack(">II", 31000, 31000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    path.write_bytes(content)
    for read in (read_image, open_regions):
        with memory.within("64GB"), pytest.raises(InputError, match="damaged"):  # whatever is free here
            read(path)


def test_a_box_without_an_end_in_another_one(tmp_path: Path) -> None:
    """GDAL reads it for ever."""
    content = cv2.imencode(".jp2", np.random.default_rng(0).integers(0, 255, (40, 48, 3), np.uint8))[1].tobytes()
    path = tmp_path / "a.jp2"
    path.write_bytes(content)
    read_image(path)
    path.write_bytes(content.replace(b"\0\0\0\x0fcolr", b"\0\0\0\0colr"))
    with pytest.raises(InputError, match="damaged"):
        read_image(path)


@pytest.mark.parametrize("filler", [b" ", b"\n", b"\n ", b"\t\n"])
@pytest.mark.parametrize("name", ["a.vrt", "a.ply", "a.pfm", "a.off", "a.obj", "calib.txt"])
def test_many_spaces_are_read_in_time(tmp_path: Path, name: str, filler: bytes) -> None:
    """A pattern that tries every one of them as its beginning takes minutes."""
    before = {"a.vrt": b"<VRTDataset>", "a.ply": b"ply\n", "a.pfm": b"Pf\n", "a.off": b"OFF\n", "a.obj": b"v"}
    path = tmp_path / name
    path.write_bytes(before.get(name, b"cam0=") + filler * 200_000)
    read = {"a.vrt": read_image, "a.pfm": read_map, "calib.txt": lambda path: read_calibration(path, (48, 40))}
    start = monotonic()
    with pytest.raises(InputError):
        read.get(name, SurfaceMesh.read)(path)
    assert monotonic() - start < 5


def test_counts_add_up() -> None:
    kinds = ("read", "refused", "KeyError", "KeyError")
    found = summary(
        {"case": k, "reader": "r", "kind": kind, "seconds": k / 4, "mb": 9 - k} for k, kind in enumerate(kinds)
    )
    assert found == {
        "mutants": 4,
        "read": 1,
        "refused": 1,
        "wrong": 2,
        "readers": {"r": 4},
        "worst": [{"seconds": 0.75, "reader": "r", "case": 3}, {"mb": 9, "reader": "r", "case": 0}],
        "kinds": {"r: KeyError": {"count": 2, "cases": [2, 3]}},
    }
