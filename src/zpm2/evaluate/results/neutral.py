"""`areas`: our own neutral JSON for area matches of any tool (docs/peers.md)."""

from pathlib import Path

import numpy as np

from zpm2.errors import InputError
from zpm2.evaluate.results.areas import (
    AreaMatches,
    Pieces,
    Size,
    SizedPair,
    numbers,
    of_box,
    of_pixels,
    of_rings,
    scaled,
    sized_pair,
)
from zpm2.evaluate.results.files import json_of, pixels_of_labels
from zpm2.evaluate.results.registry import result_format
from zpm2.formats.convert import Members
from zpm2.formats.regions.annotations import decode
from zpm2.formats.regions.region import GivenRegion
from zpm2.model import SIDES, Image, Mask
from zpm2.photos.checks import MAX_PIXELS

SCHEMA = "zpm2-area-matches/1"
KINDS = ("box", "polygon", "rle", "mask")


@result_format("areas", where="NAME.json")
def read(folder: Path, pair: SizedPair) -> AreaMatches | None:
    """FOLDER/NAME.json; masks lie beside it."""
    file = folder / f"{pair.name}.json"
    if not file.exists():
        return None
    document = json_of(file)
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        raise InputError(f'{file} is no file of area matches: its "schema" must be "{SCHEMA}"')
    sides = [_Side(file, document, k, pair) for k in (0, 1)]
    matches = []
    for k, match in enumerate(_list(document.get("matches", []), f'{file}: "matches"')):
        what = f"{file}: match {k}"
        if not isinstance(match, dict):
            raise InputError(f'{what} is no object with "left", "right" and "score"')
        score = float(numbers(match.get("score", 1.0), (), f"{what}: its score is no number"))
        left, right = (side.area(match.get(name), what) for side, name in zip(sides, SIDES, strict=True))
        matches.append((left, right, min(max(score, 0.0), 1.0)))
    others = [side.others() for side in sides]
    seconds = document.get("seconds")
    taken = None if seconds is None else float(numbers(seconds, (), f'{file}: "seconds" is no number'))
    return AreaMatches(matches, (others[0], others[1]), taken)


class _Side:
    """The areas of one image, in the frame of its photograph."""

    def __init__(self, file: Path, document: Members, k: int, pair: SizedPair) -> None:
        self.file, self.document, self.name, self.size = file, document, SIDES[k], pair.sizes[k]
        given = document.get(f"{self.name}_size")
        self.given: Size = self.size
        if given is not None:
            width, height = numbers(given, (2,), f'{file}: "{self.name}_size" must be [width, height]')
            if not (width >= 1 and height >= 1 and width * height <= MAX_PIXELS):
                raise InputError(f'{file}: "{self.name}_size" is {width:g} x {height:g} px, which no image has')
            self.given = int(width), int(height)
        self.image: Image = sized_pair("", (self.given, self.given)).images[0]
        self._labels: dict[str, list[GivenRegion]] = {}  # of the masks that were read

    def others(self) -> list[Pieces]:
        """The areas of this image without a match."""
        what = f'{self.file}: "{self.name}_areas"'
        areas = _list(self.document.get(f"{self.name}_areas", []), what)
        return [self.area(area, f"{what} {k}") for k, area in enumerate(areas)]

    def area(self, value: object, what: str) -> Pieces:
        """One area of the document."""
        what = f"{what}, {self.name}"
        members = value if isinstance(value, dict) else {}
        kinds = [kind for kind in KINDS if kind in members]
        if len(kinds) != 1:
            raise InputError(f"{what}: an area has one of {', '.join(KINDS)}")
        body = members[kinds[0]]
        if kinds[0] == "box":
            found = of_box(body, what)
        elif kinds[0] == "polygon":
            found = of_rings(body, what)
        elif kinds[0] == "rle":
            found = of_pixels(decode(body if isinstance(body, dict) else {}, what, self.image), what)
        else:
            found = self._mask(body, members.get("value"), what)
        return scaled(found, self.given, self.size)

    def _mask(self, name: object, value: object, what: str) -> Pieces:
        if not isinstance(name, str) or not name:
            raise InputError(f"{what}: a mask is the name of a file")
        if name not in self._labels:
            self._labels[name] = pixels_of_labels(self.file.parent / name, self.image)
        bits = np.zeros((self.image.height, self.image.width), bool)
        for region in self._labels[name]:
            mask = region.body
            if isinstance(mask, Mask) and value in (None, region.id):
                rows, columns = mask.bits.shape
                bits[mask.y0 : mask.y0 + rows, mask.x0 : mask.x0 + columns] |= mask.bits
        if not bits.any():
            raise InputError(f"{what}: {name} has no pixel" + ("" if value is None else f" of value {value}"))
        return of_pixels(bits, what)


def _list(value: object, what: str) -> list[object]:
    if not isinstance(value, list):
        raise InputError(f"{what} is no list")
    return value
