"""left.parquet and right.parquet (GeoParquet), and matches.parquet, the table that joins them."""

from pathlib import Path

from zpm2.formats.geoparquet import write_layer, write_table
from zpm2.formats.layer import layers_of
from zpm2.formats.parquet import require_pyarrow
from zpm2.formats.registry import OutputFormat, PairResult, register
from zpm2.formats.table import match_table

FILES = ("left.parquet", "right.parquet", "matches.parquet")


def write(result: PairResult, folder: Path) -> None:
    """Writes the three files, see `formats.geoparquet`."""
    for name, layer in zip(FILES, layers_of(result), strict=False):
        write_layer(folder / name, layer)
    write_table(folder / FILES[-1], match_table(result.matches))


register(OutputFormat("geoparquet", FILES, write, lambda: require_pyarrow("GeoParquet")))
