"""A region as a file has it, and what every reader of region files checks."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PureWindowsPath

from zpm2.errors import InputError
from zpm2.formats import geojson
from zpm2.model import Image, Mask


@dataclass(frozen=True, eq=False)
class GivenRegion:
    """One region: pixels, or the rings of its polygons, which nobody has checked yet."""

    body: Mask | tuple[geojson.Rings, ...]
    id: int | None  # where the file's id is a whole number
    source_id: str | None = None  # the file's id as text
    score: float = 1.0
    label: str | None = None
    properties: Mapping[str, object] = field(default_factory=dict)  # whatever else the file says of it


@dataclass(frozen=True, eq=False)
class GivenRegions:
    """The regions that a file has for a photograph, and notes for the user."""

    regions: list[GivenRegion]
    notes: list[str] = field(default_factory=list)


RegionReader = Callable[[Image], GivenRegions]  # `InputError` where a file's regions are those of another photograph


def check_size(name: str, size: tuple[int, int], image: Image) -> None:
    """`InputError` where `size` (width, height) px, that of `name`, is not the image's."""
    own = image.width, image.height
    if size != own:
        frame = " (in the stored frame of the photograph, without its EXIF orientation)" if size == own[::-1] else ""
        raise InputError(
            f"{name} is made for {size[0]} x {size[1]} px, the image has {own[0]} x {own[1]} px: "
            f"the two must be of one size{frame}"
        )


def other_photograph(name: object, image: Image) -> list[str]:
    """The note that a file names another photograph; folder and suffix may differ. It is no error, as the photograph
    may have been renamed."""
    if not isinstance(name, str) or not name or image.path is None:
        return []
    theirs, ours = PureWindowsPath(name), PureWindowsPath(image.path)
    if theirs.stem == ours.stem:
        return []
    return [f"made for {theirs.name} and used for {ours.name}: check that left and right are not swapped"]


def counted(n: int, what: str) -> str:
    """As "1 region", "2 regions"."""
    return f"1 {what}" if n == 1 else f"{n} {what}s"
