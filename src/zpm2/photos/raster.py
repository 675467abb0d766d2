"""Rasters read by windows (extra `geo`: rasterio): GeoTIFF, COG, JPEG 2000, VRT, PNG, JPEG of any size and depth.

`photos.gdal` decides which files are opened.
"""

import math
import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from zpm2.config import StretchConfig
from zpm2.errors import ConfigError, InputError
from zpm2.model import Image
from zpm2.model.messages import Note
from zpm2.photos import checks, gdal, pictures, radiometry
from zpm2.photos.gdal import UnsupportedByGdal
from zpm2.photos.geolocation import place_of

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]  # x0, y0, x1, y1 px, end excluded

CHUNK_BYTES = 16 * 2**20  # bytes of source pixels at a time; their blocks fit into GDAL's cache
BYTES_PER_PX = 5  # bytes of memory a pixel: 8-bit RGB, the mask, and the source
# source pixels along each side, at most, that are averaged into a reduced pixel where there are gaps or palette colours
MAX_SAMPLES_PER_PX = 4


class Raster:
    """A photograph in a file, read by windows. A context manager; `open_raster` makes it.

    path; width, height: px.
    geo: CRS "EPSG:..." or WKT, transform (2, 3), ground sampling distance m/px, each None where unknown.
    alpha: whether an alpha band marks the pixels with data. plain: whether the file is an 8-bit picture in a common
        format without gaps other than transparent pixels, so that other libraries read the same values.
    """

    held = 0  # bytes that are in memory all the time
    pixels_given = False

    def __init__(
        self,
        source: "DatasetReader",
        path: str,
        what: str,
        bands: Sequence[int],
        gsd: float | None,
        stretch: StretchConfig,
    ) -> None:
        self._source, self._what, self._stretch = source, what, stretch
        self.path, self.width, self.height = path, int(source.width), int(source.height)
        overviews = [Path(file).name for file in source.files if file.endswith(".ovr")]
        self._reduced_what = " or its overview file ".join([what, *overviews])
        self._notes_on_opening = notes = list[str]()
        self._bands = _chosen_bands(source, bands, what, notes)
        kinds = [source.dtypes[band - 1] for band in self._bands]
        if any("complex" in kind for kind in kinds):
            raise InputError(f"{what} has complex values: give a raster of their magnitude")
        self._type = np.result_type(*kinds)
        self._mask_bands = _mask_bands(source, self._bands)
        self._palette = _palette(source, self._bands, notes)
        self._range = _few_bits(source, self._bands[0], notes) if self._palette is None else None
        self._negative = source.tags(ns="IMAGE_STRUCTURE").get("MINISWHITE") == "YES" and self._palette is None
        self._fills: list[radiometry.Values] = []
        gaps_or_colors = bool(self._mask_bands) or self._palette is not None or self._range is not None
        self._sampled = gaps_or_colors or self._type.kind == "f"
        self.alpha = _has_alpha(source, self._bands)
        known = not self._mask_bands or self.alpha
        self.plain = source.driver in gdal.PICTURES and self._type == np.uint8 and known and self._range is None
        if (self._sampled or self._type != np.uint8) and not self.plain:
            self._look(notes)
        self._place, self.geo = place_of(source, self.width, self.height, gsd, notes)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What is done to the pixels, as in `images.read_image`, and how the file is placed."""
        if self._sampled and self.plain:  # only on request: such files are usually read by Pillow
            self._look(self._notes_on_opening)
        with gdal.gdal(self._what):
            return (*_file_notes(self._source, self.path), *self._notes_on_opening)

    def read(self, window: Window | None = None, size: tuple[int, int] | None = None) -> Image:
        """The pixels of `window` (default: all), averaged to `size` (width, height) px, not larger than the window.

        Pixels without data are 0 and not `valid`. Averages leave them out; a reduced pixel is valid where at least half
        of it is. `InputError` where the file is damaged there.
        """
        x0, y0, x1, y1 = window or (0, 0, self.width, self.height)
        assert 0 <= x0 < x1 <= self.width, window
        assert 0 <= y0 < y1 <= self.height, window
        width, height = size or (x1 - x0, y1 - y0)
        assert 0 < width <= x1 - x0, size
        assert 0 < height <= y1 - y0, size
        checks.check_memory(width, height, BYTES_PER_PX, self._what)
        with gdal.gdal(self._what):
            return self._read((x0, y0, x1, y1), width, height)

    def _read(self, window: Window, width: int, height: int) -> Image:
        x0, y0, x1, y1 = window
        scale_x, scale_y = (x1 - x0) / width, (y1 - y0) / height
        across, down = (_samples(scale_x), _samples(scale_y)) if self._sampled else (1, 1)
        rows = max(1, CHUNK_BYTES // (width * across * down * len(self._bands) * self._type.itemsize))
        rgb = np.empty((height, width, 3), np.uint8)
        valid = np.ones((height, width), bool)
        for top in range(0, height, rows):
            bottom = min(top + rows, height)
            part = (x0, y0 + top * scale_y, x1, y0 + bottom * scale_y)
            seen, known = self._pixels(part, width * across, (bottom - top) * down, average=not self._sampled)
            if across * down > 1:
                seen, known = _means(seen, known, across, down)
            if known is not None:
                seen = np.where(known[..., None], seen, 0)
                valid[top:bottom] = known
            rgb[top:bottom] = self._to_8bit(seen)
        if valid.all():
            return Image(rgb, self.path, self.notes)
        rgb[~valid] = 0
        return Image(rgb, self.path, self.notes, valid)

    def to_lon_lat(self, points: Array) -> Array:
        """(n, 2) image px -> (n, 2) longitude, latitude of WGS 84, degrees; NaN where there is no way.

        By CRS and transform, or else by the rational polynomial coefficients at their mean terrain height.
        """
        points = np.asarray(points, np.float64).reshape(-1, 2)
        return np.full(points.shape, np.nan) if self._place is None else self._place.to_lon_lat(points)

    def from_lon_lat(self, degrees: Array) -> Array:
        """(n, 2) longitude, latitude of WGS 84, degrees -> (n, 2) image px; NaN where there is no way."""
        degrees = np.asarray(degrees, np.float64).reshape(-1, 2)
        return np.full(degrees.shape, np.nan) if self._place is None else self._place.from_lon_lat(degrees)

    @property
    def placed(self) -> bool:
        """Whether pixels can be given a longitude and latitude."""
        return self._place is not None

    @property
    def files(self) -> list[str]:
        """The file and all others that GDAL reads for it: side files, parts of a mosaic."""
        return list(self._source.files)

    def close(self) -> None:
        self._source.close()

    def __enter__(self) -> "Raster":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _look(self, notes: list[str]) -> None:
        """Determines the range of brightness from a reduced view of the whole file, and adds notes."""
        step = math.ceil(math.sqrt(self.width * self.height / self._stretch.sample_px))
        size = max(1, self.width // step), max(1, self.height // step)
        seen, valid = self._pixels((0, 0, self.width, self.height), *size)
        if valid is not None:
            notes += radiometry.gap_notes(valid, self._what)
        if self._type != np.uint8 and self._palette is None:
            self._range, self._fills, more = radiometry.look(seen, valid, True, self._stretch)
            self._sampled |= bool(self._fills)
            notes += more

    def _pixels(
        self, window: tuple[float, float, float, float], width: int, height: int, average: bool = False
    ) -> tuple[radiometry.Values, NDArray[np.bool_] | None]:
        """(height, width, bands) values and the (height, width) mask of valid pixels, None where all are; by nearest
        neighbour, or averaged."""
        from rasterio.enums import Resampling
        from rasterio.windows import Window as Box

        x0, y0, x1, y1 = window
        how = {
            "window": Box(x0, y0, x1 - x0, y1 - y0),
            "resampling": Resampling.average if average else Resampling.nearest,
        }
        bands, masks = self._bands, self._mask_bands
        reduced = width < x1 - x0 or height < y1 - y0
        with gdal.gdal(self._reduced_what if reduced else self._what):
            seen = self._source.read(bands, out_shape=(len(bands), height, width), out_dtype=self._type.name, **how)
            valid = None
            if masks:
                valid = self._source.read_masks(masks, out_shape=(len(masks), height, width), **how).any(axis=0)
        seen = np.moveaxis(seen, 0, -1)
        if self._palette is not None:
            seen = self._palette[np.minimum(seen[..., 0], len(self._palette) - 1)]
            seen, valid = seen[..., :3], radiometry.both(valid, seen[..., 3] > 0)
        if self._type.kind == "f":
            valid = radiometry.both(valid, np.isfinite(seen).all(axis=2))
        for fill in self._fills:
            valid = radiometry.both(valid, radiometry.differs(seen, fill))
        return seen, None if valid is None or valid.all() else valid

    def _to_8bit(self, seen: radiometry.Values) -> NDArray[np.uint8]:
        if self._range is not None:
            grey = radiometry.scaled(seen, *self._range)
        else:
            grey = (seen if seen.dtype == np.uint8 else np.rint(seen)).astype(np.uint8, copy=False)
        return 255 - grey if self._negative else grey


def open_raster(
    path: str | Path,
    name: str = "image",
    bands: Sequence[int] = (),
    gsd: float | None = None,
    stretch: StretchConfig = radiometry.DEFAULTS,
) -> Raster:
    """Opens a raster; at first only a reduced view of it is read.

    bands: from 1 on, one for grey or three for red, green, blue; by default those that the file marks as colours, else
        the first of at most two, else the first three. gsd: m/px, instead of what the file says. name: what error
        messages call it, for example "left image".

    8-bit values stay as they are; all others become 8 bit by the rule of `images.read_image`, with one range for the
    whole file. Pixels hold no data where they are nodata values, transparent, masked, NaN or infinite, or have a value
    that fills the border by the same rule.

    `InputError` for whatever cannot be read or matched: a missing, empty, damaged or unknown file
    (`UnsupportedByGdal` where another library may read it), complex values, no pixel with data, a side under 32 px.
    `ConfigError` for bands that do not exist.
    """
    what = f"{name} {path}"
    source = gdal.open_file(path, what)
    try:
        with gdal.gdal(what):
            if not source.count:
                raise InputError(f"{what} has no bands")
            checks.check_sides(source.width, source.height, what)
            if os.path.exists(path):
                checks.check_length(source.width, source.height, source.driver, path, what)
            checks.check_memory(*_unpacked_at_once(source), what)
            return Raster(source, str(path), what, bands, gsd, stretch)
    except BaseException:
        source.close()
        raise


def _unpacked_at_once(source: "DatasetReader") -> tuple[int, int, float]:
    """What GDAL must decode to read any pixel, the largest block or the whole file: its width and height in px, and
    bytes per pixel."""
    each = [np.dtype(kind).itemsize for kind in source.dtypes]
    if source.driver == "WEBP" or (source.driver == "JPEG" and pictures.is_progressive(Path(source.name))):
        return source.width, source.height, sum(each)
    height, width = max(source.block_shapes, key=math.prod)
    apart = source.driver == "GTiff" and source.tags(ns="IMAGE_STRUCTURE").get("INTERLEAVE") == "BAND"
    return width, height, max(each) if apart else sum(each)


def _file_notes(source: "DatasetReader", path: str) -> list[str]:
    pages = len(source.subdatasets)  # GDAL searches for them each time
    notes = [pictures.first_page_note(pages)] if pages > 1 else []
    if source.driver in ("GTiff", *gdal.PICTURES) and Path(path).exists():
        found = pictures.header(Path(path))
        notes += [] if found is None else found[1]
    overviews = Path(f"{path}.ovr")
    if overviews.is_file() and not overviews.stat().st_size:
        notes.append(f"The overview file {overviews.name} is empty and was ignored.")
    structure = source.tags(ns="IMAGE_STRUCTURE")
    model = structure.get("SOURCE_COLOR_SPACE", "RGB")
    if model not in ("RGB", "YCbCr") or (model == "YCbCr" and "JPEG" not in structure.get("COMPRESSION", "")):
        notes.append(Note(f"The colours were converted from {model} to RGB."))
    return notes


def _chosen_bands(source: "DatasetReader", bands: Sequence[int], what: str, notes: list[str]) -> list[int]:
    from rasterio.enums import ColorInterp

    count = int(source.count)
    if bands:
        if len(bands) not in (1, 3) or not all(1 <= band <= count for band in bands):
            given, there = ",".join(map(str, bands)), f"{count} band{'s' if count > 1 else ''}"
            raise ConfigError(f"bands {given}: {what} has {there}: give one (grey) or three (red,green,blue) from 1 on")
        return list(bands)
    marks = source.colorinterp
    colors = [marks.index(c) + 1 for c in (ColorInterp.red, ColorInterp.green, ColorInterp.blue) if c in marks]
    if len(colors) == 3:
        return colors
    if ColorInterp.cyan in marks or ColorInterp.Y in marks:
        model = "CMYK" if ColorInterp.cyan in marks else "YCbCr"
        raise UnsupportedByGdal(f"{what} has colour model {model}: convert it to RGB first")
    found = [band for band in range(1, count + 1) if marks[band - 1] != ColorInterp.alpha] or [1]
    if len(found) > 2:
        first, second, third = found[:3]
        names = f"Bands {first}, {second} and {third} of {count} are used as red, green and blue"
        notes.append(f"{names}; choose with --bands.")
        return found[:3]
    if len(found) == 2:
        notes.append(f"Band {found[0]} of {count} is used as grey; choose with --bands.")
    return found[:1]


def _mask_bands(source: "DatasetReader", bands: Sequence[int]) -> list[int]:
    """The bands whose masks say which pixels hold data (valid in any of them); none where all pixels do."""
    from rasterio.enums import MaskFlags

    flags = [source.mask_flag_enums[band - 1] for band in bands]
    if any(MaskFlags.all_valid in f for f in flags):
        return []
    return list(bands[:1]) if MaskFlags.per_dataset in flags[0] else list(bands)


def _has_alpha(source: "DatasetReader", bands: Sequence[int]) -> bool:
    from rasterio.enums import MaskFlags

    own = "SOURCE_COLOR_SPACE" not in source.tags(ns="IMAGE_STRUCTURE")  # GDAL adds alpha to what it converts
    return own and all(MaskFlags.alpha in source.mask_flag_enums[band - 1] for band in bands)


def _palette(source: "DatasetReader", bands: Sequence[int], notes: list[str]) -> NDArray[np.uint8] | None:
    """(n, 4) RGBA for each value of a band with a palette; None for other bands."""
    from rasterio.enums import ColorInterp

    if len(bands) > 1 or source.colorinterp[bands[0] - 1] != ColorInterp.palette:
        return None
    colors = source.colormap(bands[0])
    table = np.zeros((max(colors) + 1, 4), np.uint8)
    table[list(colors)] = list(colors.values())
    one_bit = _bits(source, bands[0]) == 1
    notes.append(Note("1-bit values became black and white." if one_bit else "The colour palette was expanded to RGB."))
    return table


def _few_bits(source: "DatasetReader", band: int, notes: list[str]) -> tuple[float, float] | None:
    """The range of values of fewer than 8 bits; None for others."""
    bits = _bits(source, band)
    if not 1 <= bits < 8:
        return None
    notes.append(Note(f"{bits}-bit values became {'black and white' if bits == 1 else '8-bit ones'}."))
    return 0.0, 2.0**bits - 1


def _bits(source: "DatasetReader", band: int) -> int:
    return int(source.tags(band, ns="IMAGE_STRUCTURE").get("NBITS", 8))


def _samples(scale: float) -> int:
    """How many source pixels along one side are averaged into a pixel."""
    return int(scale) if scale in range(1, MAX_SAMPLES_PER_PX) else MAX_SAMPLES_PER_PX


def _means(
    values: radiometry.Values, known: NDArray[np.bool_] | None, across: int, down: int
) -> tuple[radiometry.Values, NDArray[np.bool_] | None]:
    """Means over the known pixels of `down` x `across` px each, and where at least half of them are known."""
    height, width, bands = values.shape[0] // down, values.shape[1] // across, values.shape[2]
    values = values.reshape(height, down, width, across, bands)
    if known is None:
        return values.mean(axis=(1, 3)), None
    known = known.reshape(height, down, width, across)
    count = known.sum(axis=(1, 3))
    total = np.where(known[..., None], values, 0).sum(axis=(1, 3), dtype=np.float64)
    return total / np.maximum(count, 1)[..., None], 2 * count >= down * across
