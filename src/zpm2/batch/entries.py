"""What workers are given: pairs of photographs or groups of them, from a list, or tiles of a pair."""

import csv
import io
import os
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import ClassVar, Literal

from zpm2.batch.tables import Columns, Value
from zpm2.tiled.elsewhere import TileOrder
from zpm2.tiled.tile import TilePart

Kind = Literal["pair", "group", "tile"]


@dataclass(frozen=True)
class Pair:
    """Two photographs of a list."""

    kind: ClassVar[Kind] = "pair"
    header: ClassVar = ("name", "left", "right", "regions", "K", "K2")  # of the list, by field
    columns: ClassVar[Columns] = {"pair": "text", "left": "text", "right": "text"}  # of the index

    name: str  # of its folder, unique in the list
    left: str  # absolute paths
    right: str
    regions: str | None = None  # of the left photograph, for `carry`
    k: str | None = None  # cameras as `--K` takes them, for `pose`
    k2: str | None = None

    def lines(self) -> list[tuple[str | None, ...]]:
        """Its lines in the list."""
        return [astuple(self)]

    def told(self) -> dict[str, Value]:
        """What the index says of it."""
        return {"pair": self.name, "left": self.left, "right": self.right}


@dataclass(frozen=True)
class Group:
    """Photographs of one scene, for `tracks`."""

    kind: ClassVar[Kind] = "group"
    header: ClassVar = ("group", "photograph")
    columns: ClassVar[Columns] = {"group": "text", "photographs": "int"}

    name: str  # of its folder, unique in the list
    photographs: tuple[str, ...]  # absolute paths

    def lines(self) -> list[tuple[str | None, ...]]:
        """Its lines in the list."""
        return [(self.name, photograph) for photograph in self.photographs]

    def told(self) -> dict[str, Value]:
        """What the index says of it."""
        return {"group": self.name, "photographs": len(self.photographs)}


Entry = Pair | Group


@dataclass(frozen=True)
class TileEntry:
    """A tile of a large pair (`tiles.Tiles`), which is in no list."""

    order: TileOrder
    part: TilePart

    @property
    def name(self) -> str:
        """Of its file."""
        return self.part.name


def to_csv(entries: Sequence[Entry]) -> str:
    """The entries as `read_pairs` or `read_groups` reads them."""
    out = io.StringIO()
    lines = csv.writer(out, lineterminator="\n")
    lines.writerow((entries[0] if entries else Pair).header)
    lines.writerows(line for entry in entries for line in entry.lines())
    return out.getvalue()


def absolute(path: str, folder: str) -> str:
    """A path of a list in that folder; "" where the list is at an address, from which no photograph is read."""
    return os.path.abspath(os.path.join(folder, path))
