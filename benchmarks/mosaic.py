"""Real pairs brought to any size: their photographs side by side, at the same places in both photographs of a new pair.

Cells are as large as the smallest photograph allows (a whole number of the file's blocks, so that each block is
written, and compressed, once), cut from the middle of both photographs of a pair. The pairs take turns; the second
time around they are mirrored left to right, then upside down, then both, both photographs of a pair alike: other
content, the same real geometry. What the last column and row of cells have too much is cut off.
"""

import contextlib
import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.errors
import rasterio.windows
from numpy.typing import NDArray

from zpm2.photos.images import read_image
from zpm2.photos.source import open_source

BLOCK = 256  # px, side of the blocks of the file
CORNER = 500_000.0, 5_000_000.0  # m, upper left corner where a CRS is asked for
CELL = "CELL"  # tag of the file that holds the width and height of a cell, px


def write(
    pairs: Sequence[tuple[Path, Path]], out: Sequence[Path], size: tuple[int, int], crs: str = "", gsd: float = 0.1
) -> None:
    """Both mosaics of `size` (width, height) px, as tiled GeoTIFFs with JPEG inside; one photograph is in memory at a
    time. With `crs` both have the same georeference, `gsd` m per px, as if they were flown without parallax."""
    cell = cell_size([path for pair in pairs for path in pair])
    places = list(itertools.product(range(0, size[1], cell[1]), range(0, size[0], cell[0])))
    for side, file in enumerate(out):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            target = rasterio.open(file, "w", **_profile(size, crs, gsd))
        with target:
            target.update_tags(**{CELL: f"{cell[0]}x{cell[1]}"})
            for k, (y, x) in enumerate(places):
                pixels = cut(read_image(pairs[k % len(pairs)][side]).rgb, cell, k // len(pairs))
                _write_cell(target, pixels[: size[1] - y, : size[0] - x], x, y)


def cell_size(photographs: Sequence[Path]) -> tuple[int, int]:
    """(width, height) px that all photographs have, a multiple of BLOCK."""
    sizes = []
    for path in photographs:
        source = open_source(path)
        sizes.append((source.width, source.height))
        source.close()
    width, height = (int(side) // BLOCK * BLOCK for side in np.min(sizes, axis=0))
    if not width * height:
        raise SystemExit(f"the photographs must have at least {BLOCK} x {BLOCK} px")
    return width, height


def cut(rgb: NDArray[np.uint8], cell: tuple[int, int], turn: int) -> NDArray[np.uint8]:
    """The middle of a photograph, mirrored as the `turn`-th time around asks for."""
    y, x = (rgb.shape[0] - cell[1]) // 2, (rgb.shape[1] - cell[0]) // 2
    pixels = rgb[y : y + cell[1], x : x + cell[0]]
    return pixels[:: -1 if turn & 2 else 1, :: -1 if turn & 1 else 1]


def cell_of(path: str) -> tuple[int, int] | None:
    """(width, height) px of the cells of a mosaic; None for any other photograph."""
    with warnings.catch_warnings(), contextlib.suppress(rasterio.errors.RasterioIOError):
        warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
        with rasterio.open(path) as source:
            words = source.tags().get(CELL, "").split("x")
            return (int(words[0]), int(words[1])) if len(words) == 2 else None
    return None


def _profile(size: tuple[int, int], crs: str, gsd: float) -> dict[str, Any]:
    profile: dict[str, Any] = {"driver": "GTiff", "width": size[0], "height": size[1], "count": 3, "dtype": "uint8"}
    profile |= {"tiled": True, "blockxsize": BLOCK, "blockysize": BLOCK, "interleave": "pixel", "bigtiff": "if_safer"}
    profile |= {"compress": "jpeg", "jpeg_quality": 95, "photometric": "ycbcr"}
    if crs:
        profile |= {"crs": crs, "transform": rasterio.Affine(gsd, 0, CORNER[0], 0, -gsd, CORNER[1])}
    return profile


def _write_cell(target: Any, pixels: NDArray[np.uint8], x: int, y: int) -> None:
    for top in range(0, len(pixels), BLOCK):  # a row of blocks at a time
        part = pixels[top : top + BLOCK]
        window = rasterio.windows.Window(x, y + top, part.shape[1], len(part))
        target.write(np.ascontiguousarray(part.transpose(2, 0, 1)), window=window)
