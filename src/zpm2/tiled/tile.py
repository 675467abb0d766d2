"""What one tile found, in px of the photographs, and its file."""

import gzip
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError, OutputError
from zpm2.files.keys import key as key_of
from zpm2.files.keys import stamp
from zpm2.files.reading import WRONG, parse_json, unpack_gzip
from zpm2.files.writing import atomic_write, output_folder
from zpm2.formats.convert import Members
from zpm2.formats.document import from_plain, to_plain
from zpm2.model import ImagePolygons, PointMatches, Polygon
from zpm2.photos.raster import Window
from zpm2.photos.source import Source
from zpm2.result import MatchResult
from zpm2.tiled.view import TileView

SIDES: tuple[Literal["left"], Literal["right"]] = ("left", "right")
Windows = tuple[Window | None, Window | None]  # of the left and the right photograph; None if it is not read


@dataclass(frozen=True)
class TilePart:
    """Windows that make a tile. What is found in one does not depend on the others of its level."""

    level: int
    number: int  # in its level
    windows: Windows
    size: tuple[int, int] | None = None  # px, of the view of the right window; None: that of any window
    turn: float = 0.0  # of that view (`view.read_view`)

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.level}-{self.number}"


@dataclass(frozen=True, eq=False)
class Tile:
    """The regions and points of a pair of windows, or the regions of a single one."""

    level: int  # 0 shows the whole photograph; higher levels are finer
    windows: Windows
    polygons: tuple[Sequence[Polygon], Sequence[Polygon]]  # ids are rows
    guided: NDArray[np.int64]  # (k, 2) left and right ids; one region was found by prompting with the other
    points: PointMatches
    seconds: Mapping[str, float]  # by stage


def tile_of_pair(level: int, windows: Windows, views: tuple[TileView, TileView], result: MatchResult) -> Tile:
    """The result of two views as a tile."""
    left, right = (
        [view.polygon(polygon, polygon.id) for polygon in side.polygons]
        for view, side in zip(views, (result.left, result.right), strict=True)
    )
    points = PointMatches(
        views[0].points(result.points.left), views[1].points(result.points.right), result.points.score
    )
    guided = np.array([(m.left, m.right) for m in result.matches if m.stage == "guided"], np.int64).reshape(-1, 2)
    return Tile(level, windows, (left, right), guided, points, result.timings)


def tile_without_partner(
    level: int, windows: Windows, found: Sequence[tuple[TileView, Sequence[Polygon]] | None], seconds: float
) -> Tile:
    """A tile with the regions of windows that have nothing in common, or of a window of one photograph."""
    left, right = (
        [] if side is None else [side[0].polygon(polygon, k) for k, polygon in enumerate(side[1])] for side in found
    )
    return Tile(level, windows, (left, right), np.zeros((0, 2), np.int64), PointMatches.empty(), {"detect": seconds})


def key(
    sources: Sequence[Source], config: Mapping[str, object], segmenters: str, regions: Sequence[str | Path] = ()
) -> str:
    """A name for the tiles of these photographs, files of given regions and configuration, by this code."""
    return key_of(regions, [_content(source) for source in sources], config, segmenters)


class TileCache:
    """The finished tiles of a run as files `<level>-<number>.json.gz`, in a folder named by the run's key.

    `reused` counts the tiles taken from an earlier run. Without a folder, nothing is stored.
    """

    def __init__(self, folder: Path | None, key: str) -> None:
        self.folder = None if folder is None else folder / key
        self.reused = 0

    def has(self, name: str) -> bool:
        """Whether there is a file of that name."""
        return self.folder is not None and (self.folder / f"{name}.json.gz").is_file()

    def load(self, name: str, windows: Windows) -> Tile | None:
        """The tile of that name; None if its file is missing, damaged, or belongs to other windows."""
        if self.folder is None:
            return None
        try:
            tile = _from_dict(parse_json(unpack_gzip(self.folder / f"{name}.json.gz")))
        except (OSError, InputError, *WRONG):
            return None
        if tile.windows != windows:
            return None
        self.reused += 1
        return tile

    def save(self, name: str, tile: Tile) -> None:
        """Write a tile. `OutputError` if that fails, as on a full disk; finished tiles stay for the next run."""
        if self.folder is None:
            return
        data = gzip.compress(json.dumps(_to_dict(tile)).encode(), compresslevel=1, mtime=0)
        try:
            output_folder(self.folder)
            atomic_write(self.folder / f"{name}.json.gz", data)
        except OutputError as error:
            raise OutputError(f"{error}; finished tiles are kept, run the same command again to go on") from error


def _content(source: Source) -> str | Sequence[tuple[str, int] | None]:
    """What identifies the content of a photograph: the stamps of its files if it is read by windows.

    If it is read whole, or if only GDAL can find its files, a hash of its pixels: a caller may give pixels that differ
    from the file at their path.
    """
    stamps = [stamp(file) for file in source.files]
    if stamps and None not in stamps:
        return stamps
    image = source.read()
    found = hashlib.sha256(repr(image.rgb.shape).encode())
    for values in (image.rgb, image.valid):
        if values is not None:
            found.update(np.ascontiguousarray(values).data)
    return found.hexdigest()


def _to_dict(tile: Tile) -> dict[str, object]:
    sides = [
        {**to_plain(ImagePolygons(0, 0, polygons)), "window": window}
        for polygons, window in zip(tile.polygons, tile.windows, strict=True)
    ]
    return {
        "level": tile.level,
        "sides": sides,
        "guided": tile.guided.tolist(),
        "points": to_plain(tile.points),
        "seconds": dict(tile.seconds),
    }


def _from_dict(content: Members) -> Tile:
    sides = content["sides"]
    return Tile(
        int(content["level"]),
        (_window(sides[0]["window"]), _window(sides[1]["window"])),
        (from_plain(ImagePolygons, sides[0]).polygons, from_plain(ImagePolygons, sides[1]).polygons),
        np.array(content["guided"], np.int64).reshape(-1, 2),
        from_plain(PointMatches, content["points"]),
        {stage: float(seconds) for stage, seconds in content["seconds"].items()},
    )


def _window(values: Sequence[int] | None) -> Window | None:
    if values is None:
        return None
    x0, y0, x1, y1 = map(int, values)
    return x0, y0, x1, y1
