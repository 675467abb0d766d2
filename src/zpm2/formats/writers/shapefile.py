"""left.shp and right.shp with their side files."""

from pathlib import Path

from zpm2.formats import gis
from zpm2.formats.layer import layers_of
from zpm2.formats.registry import OutputFormat, PairResult, register
from zpm2.model import SIDES


def write(result: PairResult, folder: Path) -> None:
    """Writes both shapefiles, see `gis.write_shapefile`."""
    for layer in layers_of(result):
        gis.write_shapefile(folder, layer)


FILES = tuple(f"{side}{suffix}" for side in SIDES for suffix in gis.SIDE_FILES)
register(OutputFormat("shapefile", FILES, write, gis.require_pyogrio))
