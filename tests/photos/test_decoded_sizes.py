"""Small files that unpack to much: what they declare is held against the budget before anything is unpacked."""

import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import PIL.PngImagePlugin
import pytest

from zpm2 import memory
from zpm2.config import RasterConfig
from zpm2.errors import InputError
from zpm2.files.reading import read_bytes
from zpm2.formats import read_image
from zpm2.formats.maps import read_map
from zpm2.formats.regions.labels import open_labels
from zpm2.photos import pictures
from zpm2.photos.listing import image_size
from zpm2.photos.source import open_source

rasterio = pytest.importorskip("rasterio")
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
SIDE = 3000

LARGE = RasterConfig(large_px=1_000_000)


def blank(path: Path, mode: str = "RGB", **options: Any) -> Path:
    PIL.Image.new(mode, (SIDE, SIDE)).save(path, **options)
    return path


def raster(path: Path, count: int, kind: str, **options: Any) -> Path:
    shape = {"width": SIDE, "height": SIDE, "count": count, "dtype": kind}
    with rasterio.open(path, "w", driver="GTiff", sparse_ok=True, **shape, **options):
        pass
    return path


def directories(path: Path, pages: int, side: int = 40) -> Path:
    """A TIFF of so many directories, of one picture."""
    tags = {256: side, 257: side, 258: 8, 259: 1, 262: 1, 273: 0, 278: side, 279: side * side}
    length = 2 + 12 * len(tags) + 4
    content = bytearray(b"II*\0" + struct.pack("<I", 8))
    for page in range(1, pages + 1):
        content += struct.pack("<H", len(tags))
        for tag, value in (tags | {273: 8 + pages * length}).items():
            content += struct.pack("<HHII", tag, 4, 1, value)
        content += struct.pack("<I", 8 + page * length if page < pages else 0)
    path.write_bytes(bytes(content) + bytes(k % 251 for k in range(side * side)))
    return path


BOMBS: dict[str, Callable[[Path], Path]] = {
    "png": lambda folder: blank(folder / "a.png"),
    "webp": lambda folder: blank(folder / "a.webp", lossless=True),
    "jpg": lambda folder: blank(folder / "a.jpg"),
    "jp2": lambda folder: blank(folder / "a.jp2"),
    "gif": lambda folder: blank(folder / "a.gif", "L"),
    "tif": lambda folder: raster(folder / "a.tif", 3, "uint8", compress="deflate"),
    "many bands": lambda folder: raster(
        folder / "a.tif",
        60,
        "uint16",
        compress="deflate",
        tiled=True,
        blockxsize=2048,
        blockysize=2048,
        interleave="pixel",
    ),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_photographs_are_refused_unread(kind: str, tmp_path: Path) -> None:
    path = BOMBS[kind](tmp_path)
    assert path.stat().st_size < 1e6
    with memory.within("20MB"):
        start = time.perf_counter()
        with pytest.raises(InputError, match=r"needs about .* of memory, the budget is 20.0 MB"):
            read_image(path)
        assert time.perf_counter() - start < 2
    if kind not in ("many bands", "jp2"):
        with memory.within("150MB"):
            assert read_image(path).rgb.shape == (SIDE, SIDE, 3)


@pytest.mark.parametrize("kind", ["webp", "jpg"])
def test_large_ones_that_have_no_parts_are_not_read_by_windows(kind: str, tmp_path: Path) -> None:
    path = blank(tmp_path / f"a.{kind}", **({"progressive": True} if kind == "jpg" else {}))
    with memory.within("20MB"), pytest.raises(InputError, match=r"needs about 27\.0 MB of memory"):
        open_source(path, config=LARGE)


def test_large_ones_that_have_parts_are(tmp_path: Path) -> None:
    for path in (blank(tmp_path / "a.png"), blank(tmp_path / "a.jpg"), BOMBS["tif"](tmp_path)):
        with memory.within("20MB"):
            assert open_source(path, config=LARGE).read((0, 0, 64, 64)).width == 64


def test_labels_and_maps_are_refused_unread(tmp_path: Path) -> None:
    path = blank(tmp_path / "a.png", "L")
    with memory.within("20MB"):
        for read in (open_labels, read_map):
            with pytest.raises(InputError, match=r"needs about .* of memory, the budget is 20.0 MB"):
                read(path)  # type: ignore[operator]


def test_whole_files_are_bounded(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((1000, 300)))
    with memory.within("1MB"), pytest.raises(OSError, match=r"2.4 MB, more than the 1.0 MB of memory"):
        read_bytes(tmp_path / "a.npy")
    assert len(read_bytes(tmp_path / "a.npy")) > 2.4e6


@pytest.mark.parametrize("pages", [1, 2, 100, 101, 60_000])
def test_pages_of_a_tiff_are_counted_in_bounded_time(pages: int, tmp_path: Path) -> None:
    path = directories(tmp_path / "a.tif", pages)
    start = time.perf_counter()
    image = pictures.read_file(path, "image")
    assert time.perf_counter() - start < 2
    assert image.rgb[0, 1].tolist() == [1, 1, 1]
    counted = str(pages) if pages <= pictures.PAGES else f"more than {pictures.PAGES}"
    assert image.notes == (() if pages == 1 else (f"Only the first of {counted} pictures in the file is used.",))
    if pages > 1:
        with pytest.raises(InputError, match=f"holds {pages} pages"):
            open_labels(path)
    assert len(read_image(path).notes) == (pages > 1)


def test_the_header_of_a_png_is_enough_for_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = blank(tmp_path / "a.png")
    monkeypatch.setattr(PIL.PngImagePlugin.PngImageFile, "load", lambda self: pytest.fail("it was unpacked"))
    assert image_size(path) == (SIDE, SIDE)
