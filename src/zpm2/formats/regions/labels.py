"""Label images: each pixel holds the number of its region, 0 for none."""

import io
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageOps
from numpy.typing import NDArray
from scipy import ndimage

from zpm2.errors import InputError, MissingDependency, Zpm2Error
from zpm2.files.reading import read_array, regular
from zpm2.files.writing import atomic_write
from zpm2.formats.regions.outlines import pixels_of
from zpm2.formats.regions.region import CarriedRegion, GivenRegion, GivenRegions, Photograph, check_size, placed
from zpm2.model import Mask
from zpm2.photos import gdal, pictures
from zpm2.photos.checks import MAX_PIXELS, check_length, check_memory, no_memory

Values = NDArray[np.generic]
Hidden = NDArray[np.bool_] | None  # (h, w) where there is no data, None for nowhere
CHUNK_PX = 4_000_000  # px that are numbered at a time
BYTES_PER_PX = 16  # bytes a pixel: what is read, where there is no data, and the numbers
ORIENTATION, NODATA = 274, 42113  # tags of a TIFF


@dataclass(frozen=True, eq=False)
class LabelImage:
    """A label image."""

    path: Path
    values: Values  # (h, w) whole numbers
    notes: list[str]
    complete = False

    def read(self, photograph: Photograph) -> GivenRegions:
        """The regions in the order of their numbers."""
        check_size(str(self.path), (self.values.shape[1], self.values.shape[0]), photograph)
        return GivenRegions(_regions(self.values), list(self.notes))

    def names(self, stem: str) -> tuple[str, ...]:
        """One file of the same ending."""
        return (stem + self.path.suffix.lower(),)

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """A label image of the photograph's size, of the same type and with the same numbers (and colours, in a PNG).

        Where regions overlap, the smallest is on top. A TIFF has the photograph's georeference (extra `geo`).
        """
        width, height = photograph.width, photograph.height
        check_memory(width, height, 2 * self.values.itemsize + 1, f"label image {path}")  # it and its file
        painted = np.zeros((height, width), self.values.dtype)
        for each, shape in sorted(placed(carried), key=lambda found: -found[1].area):
            mask = pixels_of(shape, photograph)
            rows, columns = mask.bits.shape
            painted[mask.y0 : mask.y0 + rows, mask.x0 : mask.x0 + columns][mask.bits] = each.region.id or 0
        atomic_write(path, self._encoded(painted, photograph))
        return []

    def _encoded(self, painted: Values, photograph: Photograph) -> bytes:
        out = io.BytesIO()
        if self.path.suffix.lower() == ".npy":
            np.save(out, painted)
        elif self.path.suffix.lower() == ".png":
            picture = PIL.Image.fromarray(painted.astype(np.uint8 if painted.itemsize == 1 else np.uint16))
            palette = _palette(self.path) if picture.mode == "L" else None
            if palette is not None:
                picture.putpalette(palette)
            picture.save(out, "PNG")
        else:
            try:
                return _tiff(painted, photograph)
            except MissingDependency:
                PIL.Image.fromarray(painted).save(out, "TIFF", compression="tiff_deflate")
        return out.getvalue()


def _palette(path: Path) -> list[int] | None:
    """The colours of a label image, red, green, blue, red, ..., where it has any."""
    try:
        with pictures.looked_at(path) as picture:
            return picture.getpalette() if picture.mode == "P" else None
    except pictures.DAMAGE:
        return None


def _tiff(values: Values, photograph: Photograph) -> bytes:
    rasterio = gdal.require_rasterio()
    place = {}
    if photograph.geo.transform is not None:
        place["transform"] = rasterio.Affine(*photograph.geo.transform.ravel())
        place["crs"] = photograph.geo.crs
    size = {"width": values.shape[1], "height": values.shape[0], "count": 1, "dtype": values.dtype.name}
    with gdal.settings(), rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", compress="deflate", bigtiff="if_safer", **size, **place) as file:
            file.write(values, 1)
        return bytes(memory.read())


def open_labels(path: Path) -> LabelImage:
    """A label image, read at once.

    Pixels without data (nodata value, mask, transparent) belong to no region. Pixels are in the stored frame, as those
    of photographs are. `InputError` for what is damaged, has several bands or pages, or holds no whole numbers from 0.
    """
    what, notes = f"label image {path}", []
    try:
        regular(path)
    except OSError as error:
        raise InputError(f"cannot read {what}: {error.strerror}") from error
    if path.suffix.lower() == ".npy":
        values, hidden = _array(path, what), None
    else:
        try:
            values, hidden = _picture(path, what)
        except MemoryError as error:
            raise no_memory(what) from error
        header = pictures.header(path)
        notes = [] if header is None else header[1]
    if values.ndim != 2:
        raise _several_bands(what, values.shape)
    if values.dtype.kind == "b":
        values = values.astype(np.uint8)
    if values.dtype.kind not in "iu":
        raise InputError(f"{what} holds {values.dtype}, not whole numbers: convert it to whole numbers")
    if hidden is not None and hidden.any():
        values = np.where(hidden, 0, values)
        notes.append("pixels without data (nodata, mask or transparent) belong to no region")
    if np.less(values, 0).any():
        raise InputError(f"{what} has values below 0: set them to 0, the background, or declare them as nodata")

    return LabelImage(path, values, notes)


def _regions(labels: Values) -> list[GivenRegion]:
    rows = max(1, CHUNK_PX // labels.shape[1]) if labels.size else 1
    starts = range(0, len(labels), rows)
    found = [np.unique(labels[start : start + rows]) for start in starts]
    values = np.unique(np.concatenate([np.zeros(0, labels.dtype), *found]))
    values = values[values > 0]
    numbers = np.zeros(labels.shape, np.int32)  # 0 for the background, k for values[k - 1]
    for start in starts:
        part = slice(start, start + rows)
        numbers[part] = np.searchsorted(values, labels[part], side="right")
    regions = []
    for k, (value, (down, across)) in enumerate(zip(values, ndimage.find_objects(numbers), strict=True), start=1):
        mask = Mask(across.start, down.start, numbers[down, across] == k)
        regions.append(GivenRegion(mask, int(value), str(value), label=str(value), row=k - 1))
    return regions


def _array(path: Path, what: str) -> Values:
    try:
        return read_array(path)
    except (OSError, ValueError) as error:
        raise _unreadable(path, what) from error


def _picture(path: Path, what: str) -> tuple[Values, Hidden]:
    """By rasterio, which knows more kinds of TIFF, or else by Pillow."""
    if not path.stat().st_size:
        raise _unreadable(path, what)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a label image without georeference, or a large one, is as it should be
        try:
            return _by_rasterio(path, what)
        except MissingDependency:
            return _by_pillow(path, what)


def _by_rasterio(path: Path, what: str) -> tuple[Values, Hidden]:
    gdal.require_rasterio()
    from rasterio.enums import ColorInterp

    try:
        with gdal.settings(), gdal.open_file(path, what) as file:
            _check(what, file.width, file.height, str(len(file.subdatasets) or 1))
            check_length(file.width, file.height, file.driver, path, what)
            alone = file.count == 2 and file.colorinterp[1] == ColorInterp.alpha
            if file.count != 1 and not alone:
                raise _several_bands(what, (file.height, file.width, file.count))
            values, hidden = file.read(1), file.read_masks(1) == 0
            if file.colorinterp[0] == ColorInterp.palette:
                hidden |= np.isin(values, [value for value, color in file.colormap(1).items() if not color[3]])
    except gdal.UnsupportedByGdal as error:
        raise _unreadable(path, what) from error
    except (Zpm2Error, MemoryError):
        raise
    except Exception as error:  # GDAL's errors have no public base class
        raise _unreadable(path, what) from error
    return values, hidden


def _by_pillow(path: Path, what: str) -> tuple[Values, Hidden]:
    try:
        # not by its path: what is mapped into memory Pillow reads with the sides of the turned picture
        with path.open("rb") as stream, pictures.opened(stream) as file:
            _check(what, file.width, file.height, pictures.count_pages(file))
            check_length(file.width, file.height, file.format or "", path, what)
            turned, nodata = file.getexif().get(ORIENTATION, 1), getattr(file, "tag_v2", {}).get(NODATA)
            transparent = file.info.get("transparency")
            file.load()
            picture: PIL.Image.Image = file
            if file.format == "TIFF" and turned != 1:  # Pillow turns TIFFs, and only those, while it loads them
                file.getexif()[ORIENTATION] = {6: 8, 8: 6}.get(turned, turned)
                picture = PIL.ImageOps.exif_transpose(file)
            if picture.mode == "LA":
                return np.asarray(picture.getchannel(0)), np.asarray(picture.getchannel(1)) == 0
            values = np.asarray(picture)
    except PIL.Image.DecompressionBombError as error:
        raise MissingDependency(f'{what} is so large that it needs rasterio: pip install "zpm2[geo]"') from error
    except pictures.DAMAGE as error:
        raise InputError(
            f'cannot read {what}: it is damaged, no {path.suffix} file, or needs rasterio: pip install "zpm2[geo]"'
        ) from error
    hidden = np.zeros(values.shape, bool)
    if isinstance(transparent, int):
        hidden |= values == transparent
    elif isinstance(transparent, bytes):
        hidden |= np.isin(values, np.flatnonzero(np.frombuffer(transparent, np.uint8) == 0))
    if nodata is not None:
        hidden |= values == float(nodata)
    return values, hidden


def _check(what: str, width: int, height: int, pages: str) -> None:
    if pages != "1":
        raise InputError(f"{what} holds {pages} pages: give the one of this photograph as a file of its own")
    if width * height > MAX_PIXELS:
        raise InputError(f"{what} has more than {MAX_PIXELS // 10**9} gigapixel: give polygons (GeoJSON) instead")
    check_memory(width, height, BYTES_PER_PX, what)


def _several_bands(what: str, shape: tuple[int, ...]) -> InputError:
    return InputError(f"{what} must have one band, its shape is {shape}: give labels, not colours")


def _unreadable(path: Path, what: str) -> InputError:
    return InputError(f"cannot read {what}: it is damaged or no {path.suffix} file")
