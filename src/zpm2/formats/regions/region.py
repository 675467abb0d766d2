"""A region as a file has it and as it is written again, and what every format of region files checks."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from typing import Protocol, TypeAlias

import numpy as np
import shapely

from zpm2.errors import InputError
from zpm2.formats import geojson
from zpm2.formats.properties import plain
from zpm2.model import Georeference, Mask

PREFIX = "zpm2_"  # of the attributes that we add, so that those of the file keep their names

SEPARATOR = "|layername="  # between a file and the name of its layer, as in QGIS

Shape: TypeAlias = shapely.Polygon | shapely.MultiPolygon


class Photograph(Protocol):
    """What region files need to know of a photograph; an `Image` and a `Source` have it."""

    @property
    def path(self) -> str | None: ...

    @property
    def width(self) -> int:
        """In px."""
        ...

    @property
    def height(self) -> int:
        """In px."""
        ...

    @property
    def geo(self) -> Georeference: ...


@dataclass(frozen=True, eq=False)
class GivenRegion:
    """One region: pixels, or the rings of its polygons, which nobody has checked yet."""

    body: Mask | tuple[geojson.Rings, ...]
    id: int | None  # where the file's id is a whole number
    source_id: str | None = None  # the file's id as text
    score: float = 1.0
    label: str | None = None
    properties: Mapping[str, object] = field(default_factory=dict)  # whatever else the file says of it
    row: int = 0  # of its entry in the file
    crs: str | None = None  # the reference system of the file, from which `body` was brought to px; None: px


@dataclass(frozen=True, eq=False)
class GivenRegions:
    """The regions that a file has for a photograph, and notes for the user."""

    regions: list[GivenRegion]
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class CarriedRegion:
    """A region of a file with its outline in another photograph."""

    region: GivenRegion
    shape: Shape | None  # px of the other photograph; None where it is not seen there
    attributes: Mapping[str, object] = field(default_factory=dict)  # ours, JSON values or numpy's numbers


class RegionFile(Protocol):
    """An opened file of regions: reads them, and writes them again with other outlines."""

    @property
    def path(self) -> Path: ...

    @property
    def complete(self) -> bool:
        """Whether the format holds our attributes, and regions without an outline."""
        ...

    def read(self, photograph: Photograph) -> GivenRegions:
        """The regions. `InputError` where they are those of another photograph."""
        ...

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """Writes regions of this file, as outlines in `photograph`, to `path`, with all else that the file says of
        them; returns notes for the user. Regions without an outline are left out where the format is not `complete`.
        `OutputError`."""
        ...

    def names(self, stem: str) -> tuple[str, ...]:
        """The names of all files that `write` may make for a path with that stem; the first is the path's."""
        ...


# Makes a file of regions with these labels and properties, in their order, that no file on disk holds: its `write`
# gives a document of its own. The second argument has the labels of all documents that are made together.
Begin: TypeAlias = Callable[[Sequence[GivenRegion], Sequence[str]], RegionFile]


def check_size(name: str, size: tuple[int, int], photograph: Photograph) -> None:
    """`InputError` where `size` (width, height) px, that of `name`, is not the photograph's."""
    own = photograph.width, photograph.height
    if size != own:
        frame = " (in the stored frame of the photograph, without its EXIF orientation)" if size == own[::-1] else ""
        raise InputError(
            f"{name} is made for {size[0]} x {size[1]} px, the image has {own[0]} x {own[1]} px: "
            f"the two must be of one size{frame}"
        )


def other_photograph(name: object, photograph: Photograph) -> list[str]:
    """The note that a file names another photograph; folder and suffix may differ. It is no error, as the photograph
    may have been renamed."""
    if not isinstance(name, str) or not name or photograph.path is None:
        return []
    theirs, ours = PureWindowsPath(name), PureWindowsPath(photograph.path)
    if theirs.stem == ours.stem:
        return []
    return [f"made for {theirs.name} and used for {ours.name}: check that left and right are not swapped"]


def of_photograph(names: Sequence[object], photograph: Photograph, path: Path) -> int:
    """The row of the photograph among the images that a file describes, by their names: the only one, or else the one
    with the photograph's file name. `InputError` where that is not exactly one."""
    if len(names) == 1:
        return 0
    name = PureWindowsPath(photograph.path or "").name
    rows = [row for row, each in enumerate(names) if PureWindowsPath(str(each)).name == name]
    if len(rows) != 1:
        raise InputError(f"{path} describes several images, {len(rows)} of them by the file name '{name}': one must")
    return rows[0]


def name_of(photograph: Photograph, otherwise: str = "image") -> str:
    """The photograph's file name without its folder."""
    return PureWindowsPath(photograph.path).name if photograph.path else otherwise


def split_layer(path: str | Path) -> tuple[Path, str | None]:
    """A path and the layer that it names after `SEPARATOR`, as QGIS writes both."""
    file, separator, layer = str(path).partition(SEPARATOR)
    return Path(file), layer if separator else None


def ours(attributes: Mapping[str, object]) -> dict[str, object]:
    """Our attributes by the names that files have for them."""
    return {PREFIX + name: value for name, value in json_values(attributes).items()}


def json_values(attributes: Mapping[str, object]) -> dict[str, object]:
    """Attributes as JSON values; numpy's numbers as Python's."""
    return {name: plain(value.item() if isinstance(value, np.generic) else value) for name, value in attributes.items()}


def without_ours(members: Mapping[str, object]) -> dict[str, object]:
    """The members of an entry but for those that an earlier run added (`ours`)."""
    return {name: value for name, value in members.items() if not name.startswith(PREFIX)}


def counted(n: int, what: str) -> str:
    """As "1 region", "2 regions"."""
    return f"1 {what}" if n == 1 else f"{n} {what}s"


def placed(carried: Sequence[CarriedRegion]) -> Iterator[tuple[CarriedRegion, Shape]]:
    """Those with an outline, with it."""
    return ((each, each.shape) for each in carried if each.shape is not None and not each.shape.is_empty)
