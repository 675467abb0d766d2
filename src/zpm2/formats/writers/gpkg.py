"""matches.gpkg: a GeoPackage with both photographs' polygons and the matches."""

from pathlib import Path

from zpm2.formats import gis
from zpm2.formats.layer import layers_of
from zpm2.formats.registry import OutputFormat, PairResult, register

NAME = "matches.gpkg"


def write(result: PairResult, folder: Path) -> None:
    """Writes the file, see `gis.write_geopackage`."""
    gis.write_geopackage(folder / NAME, *layers_of(result), result.matches)


def _by_default(result: PairResult) -> bool:
    """Where a photograph is placed on the ground and pyogrio is installed."""
    return any(layer.crs is not None for layer in layers_of(result)) and gis.has_pyogrio()  # which takes 0.2 s to load


FILES = tuple(NAME + suffix for suffix in ("", *gis.LOG_FILES))
register(OutputFormat("gpkg", FILES, write, gis.require_pyogrio, _by_default))
