"""Photographs of any size through one interface: in memory, or read from their file by windows."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from zpm2.config import RasterConfig
from zpm2.errors import InputError, MissingDependency
from zpm2.model import Georeference, Image
from zpm2.photos import checks, pictures, radiometry
from zpm2.photos.gdal import UnsupportedByGdal
from zpm2.photos.raster import Window, open_raster

Array = NDArray[np.float64]
ImageLike = str | Path | NDArray[np.generic] | PIL.Image.Image | Image
DEFAULTS = RasterConfig()
_GEO_TAGS = {33550, 33922, 34264, 34735}  # of a TIFF: scale, tie points, transform, keys


class Source(Protocol):
    """A photograph that is read by windows."""

    @property
    def path(self) -> str | None: ...

    @property
    def files(self) -> Sequence[str]:
        """The files that a run reads: the photograph's and those that belong to it; none where it is in memory."""
        ...

    @property
    def pixels_given(self) -> bool:
        """Whether the caller gave its pixels, which may differ from the file at its path."""
        ...

    @property
    def width(self) -> int:
        """In px."""
        ...

    @property
    def height(self) -> int:
        """In px."""
        ...

    @property
    def held(self) -> int:
        """Bytes that it takes in memory permanently."""
        ...

    @property
    def notes(self) -> tuple[str, ...]: ...

    @property
    def geo(self) -> Georeference: ...

    @property
    def placed(self) -> bool:
        """Whether pixels can be given a longitude and latitude."""
        ...

    def read(self, window: Window | None = None, size: tuple[int, int] | None = None) -> Image:
        """The window (default: all), reduced to `size` (width, height) px."""
        ...

    def to_lon_lat(self, points: Array) -> Array:
        """(n, 2) image px -> (n, 2) degrees, WGS 84; NaN where this is not possible."""
        ...

    def from_lon_lat(self, degrees: Array) -> Array:
        """(n, 2) degrees -> (n, 2) image px; NaN where this is not possible."""
        ...

    def close(self) -> None: ...


class InMemoryPhoto:
    """A photograph that is in memory."""

    placed = False
    files = ()

    def __init__(
        self, image: Image, notes: Sequence[str] = (), gsd: float | None = None, pixels_given: bool = False
    ) -> None:
        self.image, self.path, self.pixels_given = image, image.path, pixels_given
        self.width, self.height = image.width, image.height
        self.notes = (*image.notes, *notes)
        self.geo = Georeference(gsd=gsd)
        self.held = image.rgb.nbytes + (0 if image.valid is None else image.valid.nbytes)

    def read(self, window: Window | None = None, size: tuple[int, int] | None = None) -> Image:
        """See `Source.read`."""
        x0, y0, x1, y1 = window or (0, 0, self.width, self.height)
        rgb, valid = self.image.rgb[y0:y1, x0:x1], self.image.valid
        valid = None if valid is None else valid[y0:y1, x0:x1]
        if size is not None and size != (x1 - x0, y1 - y0):
            rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
            if valid is not None:
                valid = cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
        return Image(rgb, self.path, self.notes, valid)

    def to_lon_lat(self, points: Array) -> Array:
        """Unknown."""
        return np.full((len(points), 2), np.nan)

    from_lon_lat = to_lon_lat

    def close(self) -> None:
        """Nothing to do."""


def open_source(
    source: ImageLike, name: str = "image", config: RasterConfig = DEFAULTS, gsd: float | None = None
) -> Source:
    """A photograph as a `Source`. Chooses the library that reads the file.

    rasterio reads a file by windows where it is georeferenced, where `config.bands` are chosen, and where it has more
    than `config.large_px` pixels. Other files are read at once. Pillow reads 8-bit pictures (PNG, JPEG, ...), formats
    that GDAL does not know, and everything where rasterio is not installed (a note says what is lost); rasterio reads
    the rest. The rules for values and gaps are the same for both (`read_image`). `gsd` (m per px) replaces the file's
    own. Errors are those of `read_image` and `open_raster`.
    """
    if isinstance(source, str | Path):
        return _open_file(Path(source), name, config, gsd)
    if config.bands:
        raise InputError(f"{name}: bands are chosen from files; choose them in the array yourself")
    return InMemoryPhoto(_from_memory(source, name, config), (), gsd, pixels_given=True)


def _open_file(path: Path, name: str, config: RasterConfig, gsd: float | None) -> Source:
    what, bands = f"{name} {path}", config.bands
    try:
        raster = open_raster(path, name, bands, gsd, config.stretch)
    except MissingDependency:
        if bands:
            raise
        try:
            return InMemoryPhoto(pictures.read_file(path, what, config.stretch), _missed(path, config), gsd)
        except pictures.UnknownFormat as error:
            raise InputError(f'{error}; with pip install "zpm2[geo]" more kinds of rasters are read') from error
    except UnsupportedByGdal as error:
        try:
            image = pictures.read_file(path, what, config.stretch)
        except pictures.UnknownFormat:
            raise error from None  # GDAL's message says more about rasters
        if bands:
            raise InputError(f"{what}: bands are chosen from rasters that GDAL reads, it does not know this") from error
        return InMemoryPhoto(image, (), gsd)
    large = raster.width * raster.height > config.large_px
    if raster.placed or raster.geo.transform is not None or bands or large:
        return raster
    with raster:
        image = pictures.read_file(path, what, config.stretch) if raster.plain else raster.read()
        dropped = raster.alpha and not raster.plain and image.valid is None
    return InMemoryPhoto(image, [radiometry.NOT_TRANSPARENT] if dropped else (), gsd)


def _from_memory(source: object, name: str, config: RasterConfig) -> Image:
    if isinstance(source, Image):
        checks.check_image(source, name)
        return source
    if isinstance(source, PIL.Image.Image):
        return pictures.from_picture(source, name, config.stretch)
    if isinstance(source, np.ndarray):
        checks.check(source, name)
        checks.check_memory(source.shape[1], source.shape[0], radiometry.bytes_each(source), name)
        return radiometry.to_image(source, name, stretch=config.stretch)
    raise InputError(f"{name}: expected a path, a numpy array or a PIL picture, got {type(source).__name__}")


@contextlib.contextmanager
def opened(left: ImageLike, right: ImageLike, config: RasterConfig = DEFAULTS) -> Iterator[tuple[Source, Source]]:
    """Both photographs of a pair, open inside this block."""
    sides = [config.gsd[0], config.gsd[-1]] if config.gsd else [None, None]
    with contextlib.ExitStack() as stack:
        found = []
        for source, name, each in ((left, "left image", sides[0]), (right, "right image", sides[1])):
            found.append(open_source(source, name, config, each))
            stack.callback(found[-1].close)
        yield found[0], found[1]


def reduced(source: Source, longest: int) -> Image:
    """The whole photograph, reduced so that its longer side has at most `longest` px."""
    factor = min(1.0, longest / max(source.width, source.height))
    return source.read(None, (max(1, round(source.width * factor)), max(1, round(source.height * factor))))


def _missed(path: Path, config: RasterConfig) -> list[str]:
    """Notes on what is lost without rasterio."""
    notes = []
    with contextlib.suppress(*pictures.DAMAGE), pictures.looked_at(path) as picture:
        if _GEO_TAGS & set(getattr(picture, "tag_v2", {})):
            notes.append('Its georeference was not read: pip install "zpm2[geo]".')
        if picture.width * picture.height > config.large_px:
            notes.append('It is held in memory as a whole; by windows with: pip install "zpm2[geo]".')
    return notes
