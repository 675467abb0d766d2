"""YOLO's text of one photograph: a line for each region, its class and x, y, x, y, ... as shares of the image's sides.

Four numbers after the class are a box (its centre, width and height). An odd number of them ends with a confidence, as
predictions are saved. The names of the classes are in `classes.txt` or
`data.yaml`, beside the file or up to two folders above.
"""

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.reading import read_text
from zpm2.files.writing import atomic_write
from zpm2.formats import geojson
from zpm2.formats.regions.outlines import one_ring
from zpm2.formats.regions.region import CarriedRegion, GivenRegion, GivenRegions, Photograph, placed

NAMES = "classes.txt"
DATA_FILES = ("data.yaml", "dataset.yaml", "data.yml")
MAX_SHARE = 2.0  # beyond this, a coordinate is no share of the image but pixels
FOLDERS = 3  # where names are looked for: the file's own and those above

_YAML_NAMES = re.compile(  # a list on one line, or the lines of a list or of a table
    r"^names:[ \t]*(\[[^\]]*\])?[ \t]*(?:#.*)?$((?:\n(?:[ \t]*-|[ \t]+\d+:|[ \t]*#|[ \t]*$).*)*)", re.MULTILINE
)
_LINE = re.compile(r"\d{1,9}(\s+[-+\d.eE]+){4,}\s*")


@dataclass(frozen=True, eq=False)
class Yolo:
    """The lines of a file."""

    path: Path
    lines: list[list[float]]  # class, then the numbers
    classes: list[str] | None  # names
    complete = False

    def read(self, photograph: Photograph) -> GivenRegions:
        """One region for each line."""
        size, found = np.array([photograph.width, photograph.height], np.float64), []
        for row, (number, *values) in enumerate(self.lines):
            name = f"region {row} of {self.path}"
            score = values.pop() if _has_score(values) else None
            shares = _corners(values) if len(values) == 4 else np.reshape(values, (-1, 2))
            if not (np.abs(shares) <= MAX_SHARE).all():
                raise InputError(f"{name} has coordinates that are no shares of the image, 0 to 1: divide by its size")
            ring = geojson.ring((shares * size).tolist(), name)
            label = self._label(int(number))
            found.append(GivenRegion(([ring],), None, None, geojson.score(score, name), label, {}, row))
        notes = []
        if found and self.classes is None:
            notes.append(f"{self.path.name}: no {NAMES} or {DATA_FILES[0]} with the names of its classes was found")
        return GivenRegions(found, notes)

    def names(self, stem: str) -> tuple[str, ...]:
        """The text, and the names of the classes where they are known."""
        return (f"{stem}.txt", *([] if self.classes is None else [NAMES]))

    def write(self, path: Path, carried: Sequence[CarriedRegion], photograph: Photograph) -> list[str]:
        """The same lines; several pieces and holes are joined into one ring (`one_ring`). The names of the classes go
        into `classes.txt` beside it."""
        lines = []
        for each, shape in placed(carried):
            number, *values = self.lines[each.region.row]
            shares = one_ring(shape) / (photograph.width, photograph.height)
            score = [values[-1]] if _has_score(values) else []
            lines.append(" ".join([str(int(number)), *(f"{v:.10g}" for v in [*shares.ravel().tolist(), *score])]))
        atomic_write(path, "".join(f"{line}\n" for line in lines))
        if self.classes is not None:
            atomic_write(path.with_name(NAMES), "".join(f"{name}\n" for name in self.classes))
        return []

    def _label(self, number: int) -> str:
        known = self.classes is not None and number < len(self.classes)
        return self.classes[number] if self.classes is not None and known else str(number)


def open_yolo(path: Path) -> Yolo | None:
    """A text of YOLO; None where it is another text. `InputError` where it cannot be read."""
    try:
        lines = [line.strip() for line in read_text(path).splitlines()]
    except OSError as error:
        raise InputError(f"cannot read region file {path}: {error.strerror}") from error
    except ValueError:
        return None
    lines = [line for line in lines if line]
    if not all(_LINE.fullmatch(line) for line in lines):
        return None
    try:
        values = [[float(word) for word in line.split()] for line in lines]
    except ValueError:
        return None
    return Yolo(path, values, _class_names(path.parent))


def begin(regions: Sequence[GivenRegion], labels: Sequence[str]) -> Yolo:
    """A document of its own (`region.Begin`). A name of a class is one line."""
    names = {label: " ".join(label.split()) for label in labels}
    classes = sorted(set(names.values()))
    numbers = {label: float(classes.index(name)) for label, name in names.items()}
    return Yolo(Path(), [[numbers[region.label or ""]] for region in regions], classes)


def _has_score(values: list[float]) -> bool:
    return len(values) % 2 == 1


def _corners(box: list[float]) -> NDArray[np.float64]:
    """(4, 2) corners of a box of centre, width and height."""
    center, half = np.array(box[:2]), np.array(box[2:]) / 2
    return center + half * [(-1, -1), (1, -1), (1, 1), (-1, 1)]


def _class_names(folder: Path) -> list[str] | None:
    """The names of the classes, from the nearest file that has them."""
    place = folder.absolute()
    for here in [place, *place.parents][:FOLDERS]:
        for file in (here / NAMES, *(here / name for name in DATA_FILES)):
            if file.is_file():
                with contextlib.suppress(OSError, ValueError):
                    text = read_text(file)
                    names = text.rstrip("\n").split("\n") if file.name == NAMES else _names_in_yaml(text)
                    if any(names):
                        return names
    return None


def _names_in_yaml(text: str) -> list[str]:
    """The member `names` of a data set's YAML: a list on one line, a list of "- name", or a table of "number: name"."""
    found = _YAML_NAMES.search(text)
    if found is None:
        return []
    if found[1]:
        return [_unquoted(name) for name in re.findall(r"'[^']*'|\"[^\"]*\"|[^,\s][^,]*", found[1][1:-1])]
    items = re.findall(r"^[ \t]*(?:-|(\d+):)[ \t]+(.*)$", found[2], re.M)
    if not any(number for number, _ in items):
        return [_unquoted(name) for _, name in items]
    table = {int(number): _unquoted(name) for number, name in items if number and len(number) < 6}
    return [table.get(k, str(k)) for k in range(max(table, default=-1) + 1)]


def _unquoted(text: str) -> str:
    text = text.strip()
    quoted = re.match(r"'([^']*)'|\"([^\"]*)\"", text)
    return (quoted[1] or quoted[2] or "") if quoted else text.partition(" #")[0].strip()
