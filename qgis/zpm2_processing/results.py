"""The layers in the folder of a result, and the style of each. Nothing here needs QGIS."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

STYLES = Path(__file__).parent / "styles"
LAYER_FILES = (".gpkg", ".shp", ".geojson", ".json")  # in which regions.* come that QGIS reads


@dataclass(frozen=True)
class ResultLayer:
    """A layer to load."""

    output: str  # name of the algorithm's output
    source: str  # as QGIS opens it
    name: str  # in the list of layers
    style: Path

    @staticmethod
    def of(output: str, path: Path, name: str, style: str, table: str = "") -> ResultLayer:
        """A layer of a file, which may have several tables."""
        return ResultLayer(output, f"{path}|layername={table}" if table else str(path), name, STYLES / f"{style}.qml")


def layers_of(folder: Path) -> list[ResultLayer]:
    """The layers of what `zpm2 match`, `carry` or `link` wrote into a folder, those to be drawn on top first.

    Of several right photographs of `carry`, each has a folder. Empty if there is no result, or none with a place.
    """
    found: list[ResultLayer] = []
    if (folder / "matches.gpkg").is_file():
        path = folder / "matches.gpkg"
        found += [
            ResultLayer.of(side.upper(), path, f"{folder.name}: {side}", "matched", side) for side in ("left", "right")
        ]
    if (folder / "links.json").is_file():
        found += _with_shifts(folder, "linked", folder.name)
    for document in sorted(folder.glob("carry.json")) + sorted(folder.glob("*/carry.json")):
        found += _with_shifts(document.parent, "carried", document.parent.name)
    return found


def _with_shifts(folder: Path, style: str, name: str) -> list[ResultLayer]:
    found = []
    if (folder / "shifts.geojson").is_file():
        found.append(ResultLayer.of("SHIFTS", folder / "shifts.geojson", f"{name}: shifts", "shifts"))
    regions = [folder / f"regions{ending}" for ending in LAYER_FILES]
    found += [ResultLayer.of("REGIONS", path, f"{name}: {style}", style) for path in regions if path.is_file()]
    return found
