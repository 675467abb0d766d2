"""COLMAP's binary models: cameras.bin and images.bin. Every count in them is checked against the file's length.

https://colmap.github.io/format.html. pycolmap reads them too, but trusts the counts: a damaged file of
seventy bytes can take gigabytes of memory.
The other files (points3D.bin, rigs.bin, frames.bin) are not needed for cameras and poses.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.files.reading import read_bytes

CUT = "it is cut short, or not a COLMAP file"
# name and number of parameters of each camera model, by its id in the file
MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
    17: ("EQUIRECTANGULAR", 2),
}
POINT = 24  # bytes: x, y, and the id of its 3D point


class _Bytes:
    """A file, read from its start to its end; `ValueError` where it ends too early."""

    def __init__(self, path: Path) -> None:
        self.content, self.place = read_bytes(path), 0

    def integers(self, kinds: str) -> tuple[int, ...]:
        """The next numbers, of these kinds (`struct`)."""
        start = self.skip(struct.calcsize("<" + kinds))
        return struct.unpack_from("<" + kinds, self.content, start)

    def floats(self, count: int) -> tuple[float, ...]:
        """The next `count` doubles."""
        return struct.unpack_from(f"<{count}d", self.content, self.skip(8 * count))

    def skip(self, size: int) -> int:
        """Moves on by `size` bytes and returns where they begin."""
        start = self.place
        if start + size > len(self.content):
            raise ValueError(CUT)
        self.place += size
        return start

    def name(self) -> str:
        """The text up to the next zero byte."""
        end = self.content.find(b"\0", self.place)
        if end < 0:
            raise ValueError(CUT)
        start = self.skip(end + 1 - self.place)
        return self.content[start:end].decode("utf-8")

    def count(self, least: int) -> int:
        """The number of records that follow; `least` is the smallest size of one, in bytes."""
        (number,) = self.integers("Q")
        if self.place + number * least > len(self.content):
            raise ValueError(CUT)
        return number


def cameras(path: Path) -> Iterator[tuple[int, str, tuple[int, int], tuple[float, ...]]]:
    """For each camera: id, model, (width, height) px, parameters. `OSError` where the file cannot be read, `ValueError`
    where its content is wrong."""
    file = _Bytes(path)
    for _ in range(file.count(24)):
        key, number, width, height = file.integers("IiQQ")
        if number not in MODELS:
            raise ValueError(f"camera {key} has the unknown camera model number {number}")
        model, count = MODELS[number]
        yield key, model, (width, height), file.floats(count)


def image_points(path: Path) -> Iterator[tuple[str, NDArray[np.int64]]]:
    """For each registered image: name, and the ids of the 3D points that its points show, -1 for none. Errors as for
    `cameras`."""
    file = _Bytes(path)
    for _ in range(file.count(73)):
        file.skip(4 + 7 * 8 + 4)
        name = file.name()
        count = file.count(POINT)
        start = file.skip(count * POINT)
        points = np.frombuffer(file.content, np.dtype("<f8,<f8,<i8"), count, start)
        yield name, points["f2"].astype(np.int64)


def images(path: Path) -> Iterator[tuple[str, int, tuple[float, ...], tuple[float, ...]]]:
    """For each registered image: name, id of its camera, quaternion (w, x, y, z) and translation, world to camera.

    Errors as for `cameras`."""
    file = _Bytes(path)
    for _ in range(file.count(73)):
        file.integers("I")  # its id
        turn, shift = file.floats(4), file.floats(3)
        (camera,) = file.integers("I")
        name = file.name()
        file.skip(file.count(POINT) * POINT)
        yield name, camera, turn, shift
