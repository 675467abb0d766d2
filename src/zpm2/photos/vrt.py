"""The content of a VRT, GDAL's virtual raster, checked before GDAL opens it.

A VRT is XML and can make GDAL open any file, network address or script. We parse it as GDAL does and refuse every
element, attribute and name that is not known to be harmless.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

from zpm2.errors import ConfigError, InputError
from zpm2.files.reading import read_text

ALLOWED = "ZPM2_ALLOW_VRT"  # environment variable: more folders for sources, separated as in PATH

_ELEMENTS = """
    VRTDataset SRS GeoTransform GCPList GCP Metadata BlockXSize BlockYSize VRTRasterBand MaskBand Description
    UnitType Offset Scale CategoryNames Category ColorInterp ColorTable Entry NoDataValue HideNoDataValue Histograms
    HistItem HistMin HistMax BucketCount IncludeOutOfRange Approximate HistCounts OverviewList Overview SimpleSource
    ComplexSource AveragedSource KernelFilteredSource NoDataFromMaskSource Kernel Size Coefs SourceFilename SourceBand
    SourceProperties SrcRect DstRect NODATA UseMaskBand ScaleOffset ScaleRatio Exponent SrcMin SrcMax DstMin DstMax
    Clamp LUT ColorTableComponent
"""
_ATTRIBUTES = """
    rasterXSize rasterYSize dataAxisToSRSAxisMapping coordinateEpoch Projection Id Info Pixel Line X Y Z dataType
    band blockXSize blockYSize c1 c2 c3 c4 resampling normalized relativeToVRT relativetoVRT shared RasterXSize
    RasterYSize DataType BlockXSize BlockYSize xOff yOff xSize ySize
"""
ELEMENTS, ATTRIBUTES = frozenset(_ELEMENTS.split()), frozenset(_ATTRIBUTES.split())
_DECLARATION = re.compile(r"\s*<\?xml[^<>]*\?>")
_ELSEWHERE = re.compile(r"/vsi|.*[<>{}|?*\"\0\n]|(?![A-Za-z]:[\\/]).*:|[A-Za-z]:.*:", re.DOTALL)  # not on a disk


def allow(folders: Sequence[Path]) -> None:
    """Allow sources of VRT files in and below these folders. `ConfigError` where one is not a folder."""
    for folder in folders:
        if not folder.is_dir():
            raise ConfigError(f"--allow-vrt {folder} is not a folder: give the one with the sources of the VRT")
    if folders:
        os.environ[ALLOWED] = os.pathsep.join(map(os.path.abspath, folders))


def sources(path: Path, beside: Path, what: str) -> list[Path]:
    """The files that a VRT is made of, in its order, each once.

    beside: the folder of the VRT that the user gave; this one may be a part of that. Links followed, every source must
    be a file directly in that folder, or below a folder that the user allows (`allow`, environment variable
    ZPM2_ALLOW_VRT). `InputError` for other sources, and for elements and attributes that are not in `ELEMENTS` and
    `ATTRIBUTES`: scripts, raw bands, warping.
    """
    found = list[Path]()
    unread = [_root(path, what)]
    while unread:
        element = unread.pop()
        if element.tag not in ELEMENTS:
            raise _refused(what, f"<{element.tag[:40]}>")
        for name, value in element.attrib.items():
            usual = name == "subClass" and value == "VRTSourcedRasterBand"
            if not usual and name not in ATTRIBUTES and element.tag != "Metadata":
                raise _refused(what, f'{name[:40]}="{value[:40]}"')
        if element.tag == "SourceFilename":
            found.append(_source(element, path, beside, what))
        if element.tag != "Metadata":  # which may hold any text
            unread += reversed(element)
    return list(dict.fromkeys(found))


def _root(path: Path, what: str) -> ElementTree.Element:
    try:
        text = read_text(path)  # as UTF-8, whatever it declares: GDAL does the same
    except (OSError, ValueError) as error:
        raise InputError(f"{what} is not a VRT in UTF-8: write it again with gdalbuildvrt") from error
    declared = _DECLARATION.match(text)  # at the beginning only: a search takes hours where there are many spaces
    text = text[declared.end() :] if declared else text
    if "<!" in text or "<?" in text:  # comments, entities, CDATA: parsers treat them differently
        raise InputError(f"{what} is a VRT with comments or declarations: write it again with gdalbuildvrt")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{what} is damaged, it is not valid XML: write it again with gdalbuildvrt") from error
    if root.tag != "VRTDataset":
        raise _refused(what, f"<{root.tag[:40]}>")
    return root


def _source(element: ElementTree.Element, path: Path, beside: Path, what: str) -> Path:
    name = element.text or ""
    shown = " ".join(name[:200].split())
    relative = element.get("relativeToVRT") or element.get("relativetoVRT") or "0"
    if _ELSEWHERE.match(name) or name != name.strip() or relative not in ("0", "1"):
        raise InputError(f"{what} has source '{shown}', which does not name a local file: download or unpack it first")
    start = Path(os.path.realpath(path)).parent if relative == "1" else Path.cwd()
    source = start / name
    try:
        real = Path(os.path.realpath(source, strict=True))
    except (OSError, ValueError) as error:
        raise InputError(f"{what} is damaged, its source {shown} does not exist: bring it beside the VRT") from error
    allowed = [Path(os.path.realpath(folder)) for folder in os.environ.get(ALLOWED, "").split(os.pathsep) if folder]
    if real.parent != beside and not any(real.is_relative_to(folder) for folder in allowed):
        raise InputError(
            f"{what} has source {shown}, which does not lie beside it: if you trust it, allow its folder with "
            f"--allow-vrt FOLDER ({ALLOWED})"
        )
    if not real.is_file():
        raise InputError(f"{what} has source {shown}, which is not a file: write it again with gdalbuildvrt")
    return source


def _refused(what: str, part: str) -> InputError:
    return InputError(
        f"{what} is a VRT with {part}; only plain mosaics of files are read, no scripts, raw bands or warping: "
        "if you trust it, convert it first (gdal_translate)"
    )
