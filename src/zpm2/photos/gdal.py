"""GDAL (extra `geo`: rasterio), restricted to local files of known formats that refer to no other files.

By itself, GDAL opens whatever a name or a file refers to: network addresses, archives, scripts, other files. So we
check every file before GDAL opens it, together with the files that GDAL would open along with it, and allow only the
driver of its format. Our settings hold only while we open and read; GDAL's other configuration is not touched.
"""

import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from zpm2.errors import InputError, MissingDependency, Zpm2Error
from zpm2.files.reading import regular
from zpm2.photos import checks, jpeg2000, vrt

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

CACHE_BYTES = 256 * 2**20  # bytes of GDAL's cache of blocks
PICTURES = ("BMP", "GIF", "JPEG", "PNG", "WEBP")  # drivers of files that Pillow reads as well
SIGNATURES = {  # how the files of a driver begin
    "GTiff": rb"II\*\0|MM\0\*|II\+\0|MM\0\+",
    "JPEG": rb"\xff\xd8\xff",
    "PNG": rb"\x89PNG\r\n\x1a\n",
    "JP2OpenJPEG": rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51",
    "WEBP": rb"RIFF....WEBP",
    "BMP": rb"BM",
    "GIF": rb"GIF8[79]a",
    "VRT": rb"(\xef\xbb\xbf)?\s*(<\?xml[^<>]*\?>)?\s*<VRTDataset",
}
HEAD_BYTES = 1024  # bytes at the beginning, by which GDAL's drivers recognise their files
MAX_VRT_DEPTH = 8  # VRTs of VRTs
SETTINGS = {
    "GDAL_CACHEMAX": CACHE_BYTES,
    "GDAL_PNG_WHOLE_IMAGE_OPTIM": "NO",  # the shortcut for whole PNG files shows missing parts as black
    # the checks below refuse these anyway
    "GDAL_VRT_ENABLE_PYTHON": "NO",
    "GDAL_VRT_ENABLE_RAWRASTERBAND": "NO",
    "CPL_VSIL_CURL_ALLOWED_FILENAME": "none",
}

_PAGE = re.compile(r"(GTIFF_DIR:(?:off:)?\d+:)(.+)", re.DOTALL)  # of a TIFF, as GDAL lists its subdatasets
_ELSEWHERE = re.compile(r"/vsi|[\w+.-]{2,}:")  # names that GDAL or rasterio do not take for files
_HFA = b"EHFA_HEADER_TAG"


class UnsupportedByGdal(InputError):
    """GDAL does not read this file or colour model; another library may."""


def require_rasterio() -> ModuleType:
    """The package, or `MissingDependency`."""
    try:
        import rasterio
        import rasterio.warp
    except ImportError as error:
        raise MissingDependency('reading rasters by windows needs rasterio: pip install "zpm2[geo]"') from error
    return rasterio


def open_file(path: str | Path, what: str) -> "DatasetReader":
    """rasterio's dataset of a file, or of one page of a TIFF (`GTIFF_DIR:2:a.tif`). GDAL opens
    files for us nowhere else.

    `InputError` for a missing or empty file, for names of anything but a local file, and for files that refer to other
    places (a VRT, an overview or mask file; see `photos.vrt`). `UnsupportedByGdal` for other formats and damaged files.
    """
    page, name = page_and_file(str(path))
    rasterio = require_rasterio()
    file = Path(os.path.abspath(name))  # an absolute path cannot mean anything but a file
    if _ELSEWHERE.match(name) and not file.exists():
        raise InputError(f"{what} does not exist, and only local files are read: download or convert it first")
    with checks.opened_file(file, what):  # also refuses names that no file can have
        pass
    (_, driver), *others = _checked(file, what)
    for other, its_driver in others:
        _refuse_redirected(other, its_driver, what)
    try:
        with gdal(what):
            source = rasterio.open(f"{page}{file}" if page else file, driver=driver)
    except InputError as error:
        raise UnsupportedByGdal(str(error)) from error
    try:
        with gdal(what):
            _refuse_overviews_elsewhere(source, what)
    except BaseException:
        source.close()
        raise
    return source


def page_and_file(path: str) -> tuple[str, str]:
    """`GTIFF_DIR:2:` and `a.tif` of `GTIFF_DIR:2:a.tif`; "" and the path of anything else."""
    found = _PAGE.fullmatch(path)
    return (found[1], found[2]) if found else ("", path)


@contextmanager
def gdal(what: str) -> Iterator[None]:
    """GDAL with our settings; its errors become an `InputError`, its warnings are dropped."""
    with settings():
        try:
            yield
        except Zpm2Error:
            raise
        except MemoryError as error:
            raise checks.no_memory(what) from error
        except Exception as error:  # GDAL's errors have no public base class
            if "not recognized as" in str(error):
                raise checks.unknown_format(what) from error
            raise checks.damaged(what, error.__cause__ or error) from error


@contextmanager
def settings() -> Iterator[None]:
    """GDAL with our settings, inside this block."""
    rasterio = require_rasterio()
    with warnings.catch_warnings(), rasterio.Env(**SETTINGS):
        warnings.filterwarnings("ignore", category=rasterio.errors.NotGeoreferencedWarning)
        yield


def _checked(file: Path, what: str) -> list[tuple[Path, str]]:
    """The file and all that GDAL opens with it, each with its driver."""
    found: dict[Path, str] = {}
    listed: dict[Path, dict[str, list[Path]]] = {}
    beside = Path(os.path.realpath(file)).parent  # where GDAL resolves names, also for a link
    unchecked = [(file, what, 0)]
    while unchecked:
        path, name, depth = unchecked.pop()
        if path in found:
            continue
        if depth > MAX_VRT_DEPTH:
            raise InputError(f"{what} nests VRTs more than {MAX_VRT_DEPTH} deep: convert its parts to TIFF first")
        found[path] = _driver(path, name)
        if found[path] == "VRT":
            for source in vrt.sources(path, beside, name):
                unchecked.append((source, f"source {source} of {what}", depth + 1))
        sides = _side_files(path, name, listed)
        unchecked += [(side, f"side file {side} of {what}", 0) for side in sides]
    return list(found.items())


def _driver(path: Path, what: str) -> str:
    """The driver for a file by its first bytes. `UnsupportedByGdal` for other formats."""
    with checks.opened_file(path, what) as file:
        head = file.read(HEAD_BYTES)
        if re.match(SIGNATURES["JP2OpenJPEG"], head) and jpeg2000.endless(file):
            raise UnsupportedByGdal(f"{what} is damaged, its boxes do not end: copy or download it again")
    for driver, signature in SIGNATURES.items():
        if re.match(signature, head, re.DOTALL):
            # refused: drivers that GDAL may ask first look for a text before the first zero byte
            if driver != "VRT" and re.search(rb"[<{]", head.partition(b"\0")[0]):
                break
            return driver
    raise UnsupportedByGdal(str(checks.unknown_format(what)))


def _side_files(path: Path, what: str, listed: dict[Path, dict[str, list[Path]]]) -> list[Path]:
    """The overview and mask files that GDAL opens with a file. `InputError` where one is not a TIFF.

    listed: by folder, its side files by name in lower case; filled in here.
    """
    if path.parent not in listed:
        names = listed[path.parent] = {}
        for side in sorted(path.parent.iterdir()):
            if side.suffix.lower() in (".ovr", ".msk", ".aux"):
                names.setdefault(side.name.lower(), []).append(side)
    name, found = path.name.lower(), []
    for ending in (f"{name}.ovr", f"{name}.msk", f"{name}.aux", f"{path.stem.lower()}.aux"):
        for side in listed[path.parent].get(ending, []):
            try:
                with regular(side).open("rb") as file:
                    head = file.read(HEAD_BYTES)
            except OSError as error:
                raise InputError(f"{what} has a side file {side}, which cannot be read: remove it") from error
            if ending.endswith(".aux"):
                if head.startswith(_HFA):
                    raise InputError(f"{what} has overviews in {side}, which are not read: remove that file")
            elif head:
                if not re.match(SIGNATURES["GTiff"], head):
                    raise InputError(f"{what} has a side file {side}, which is not a TIFF: remove it")
                found.append(side)
    return found


def _refuse_redirected(path: Path, driver: str, what: str) -> None:
    """`_refuse_overviews_elsewhere` for a file that GDAL opens together with another one."""
    try:
        with gdal(what):
            dataset = require_rasterio().open(path, driver=driver)
    except InputError:  # damaged: GDAL will not open it later either, and reports it then
        return
    with gdal(what), dataset:
        _refuse_overviews_elsewhere(dataset, what)


def _refuse_overviews_elsewhere(dataset: "DatasetReader", what: str) -> None:
    """`InputError` for a file whose metadata name other files for its overviews: they could be anywhere."""
    if dataset.tags(ns="OVERVIEWS"):
        raise InputError(f"{what} names other files for its overviews: convert it first (gdal_translate)")
