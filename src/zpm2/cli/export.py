"""`zpm2 export`: many results for programs that reconstruct from photographs, and for catalogues."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from zpm2.cli.console import fresh_folder, warn
from zpm2.cli.options import Out, Quiet, Seed
from zpm2.errors import ConfigError, InputError

if TYPE_CHECKING:
    from zpm2.result import MatchResult

Program = Literal["colmap", "hloc", "stac"]


def export(
    results: Annotated[
        list[Path], typer.Argument(metavar="RESULTS...", help="Folders of results, or folders with such in them.")
    ],
    to: Annotated[
        Program,
        typer.Option(help="colmap: a database; hloc: keypoints and matches as HDF5; stac: an Item of each result."),
    ] = "colmap",
    out: Out = Path("zpm2-export"),
    images: Annotated[
        Path | None,
        typer.Option(help="Folder that the names of photographs start from.  [default: the deepest that holds all]"),
    ] = None,
    matched: Annotated[bool, typer.Option("--matched", help="Only points inside both polygons of a match.")] = False,
    datetime: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="stac: when the photographs were taken, a moment or START/END.  [default: as they say]",
        ),
    ] = None,
    seed: Seed = None,
    quiet: Quiet = False,
) -> None:
    """Write many results for COLMAP, hloc or STAC catalogues.

    A point that several pairs have is one keypoint. colmap: database.db with photographs, cameras by their EXIF,
    keypoints, matches, and what COLMAP's geometric verification accepts, ready for its mapper. hloc: features.h5 and
    matches.h5. Both: pairs.txt. stac: a file RESULT.json for each result, with its footprint, time and files.
    """
    if (datetime is not None) and to != "stac":
        raise ConfigError("--datetime is of --to stac: give it, too")
    if to == "stac":
        for name, value in {"--images": images, "--matched": matched or None}.items():
            if value is not None:
                raise ConfigError(f"{name} is of --to colmap and hloc: leave it out")
        _to_stac(results, out, datetime, quiet)
        return
    from zpm2.config import Config
    from zpm2.export import collect, colmap, hloc
    from zpm2.formats.colmap import require_pycolmap

    if to == "colmap":
        require_pycolmap()
    else:
        hloc.require_h5py()
    names = colmap.FILES if to == "colmap" else hloc.FILES
    with fresh_folder(out, *results, images, names=names):
        keypoints = collect((result for _, result in _results(results)), images, matched)
        if to == "colmap":
            colmap.write(keypoints, out, Config().seed if seed is None else seed)
        else:
            hloc.write(keypoints, out)
    if not quiet:
        points = sum(len(each) for each in keypoints.points.values())
        matches = sum(len(pair.rows) for pair in keypoints.pairs)
        print(f"{len(keypoints.points)} photographs with {points} keypoints")
        print(f"{len(keypoints.pairs)} pairs with {matches} matches")
        print(f"names start from {keypoints.root}\nin {out}")


def _to_stac(folders: list[Path], out: Path, datetime: str | None, quiet: bool) -> None:
    from zpm2.export import stac

    times = None if datetime is None else stac.read_times(datetime)
    results = list(_results(folders))
    names = stac.names([folder for folder, _ in results])
    with fresh_folder(out, *folders, names=names):
        warn(stac.write(results, out, times))
    if not quiet:
        print(f"{len(names)} Items in {out}: {', '.join(names[:3])}{', ...' if len(names) > 3 else ''}")


def _results(folders: list[Path]) -> "Iterator[tuple[Path, MatchResult]]":
    """Each result with its folder."""
    from zpm2.evaluate.overview import found_below
    from zpm2.formats.saving import DOCUMENT
    from zpm2.result import MatchResult

    for folder in folders:
        places = [folder] if folder.is_file() or (folder / DOCUMENT).is_file() else found_below(folder)
        places = [place for place in places if place.is_file() or (place / DOCUMENT).is_file()]
        if not places:
            raise InputError(f"{folder} holds no result: give folders that zpm2 match or zpm2 eval wrote")
        for place in places:
            try:
                yield (place.parent if place.is_file() else place), MatchResult.load(place)
            except InputError as error:
                if place == folder:
                    raise
                warn([f"left out: {error}"])
