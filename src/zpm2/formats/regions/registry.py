"""Region files of the user, told apart by suffix and content; and those that are written in answer."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

from zpm2.errors import InputError
from zpm2.files.reading import read_json
from zpm2.files.writing import atomic_write
from zpm2.formats.regions.annotations import open_annotations
from zpm2.formats.regions.cvat import open_cvat
from zpm2.formats.regions.features import open_features
from zpm2.formats.regions.labelme import Labelme, is_labelme
from zpm2.formats.regions.labels import open_labels
from zpm2.formats.regions.region import CarriedRegion, Photograph, RegionFile, json_values, name_of, split_layer
from zpm2.formats.regions.vectors import DRIVERS, open_vectors
from zpm2.formats.regions.yolo import open_yolo

FORMATS = (
    "a label image (.png, .tif or .npy of whole numbers, 0 = background), COCO annotations or SAM's automatic masks "
    "(.json), a GeoJSON FeatureCollection (.geojson, .json), a GeoPackage (.gpkg), a shapefile (.shp), Labelme's JSON, "
    "CVAT for images (.xml), or YOLO's polygons (.txt)"
)
STEM = "regions"  # of written files
TABLE = f"{STEM}.zpm2.json"  # beside a format that does not hold all


def open_regions(path: str | Path) -> RegionFile:
    """Opens a file and reads it at once; its `read` gives the regions of a photograph.

    Of a GeoPackage with several layers, one is named as `FILE|layername=NAME`. `InputError` where the file is missing
    or damaged, and with the list of kinds where it is none of them.
    """
    path, layer = split_layer(path)
    suffix = path.suffix.lower()
    if not os.path.exists(path):
        raise InputError(f"region file {path} does not exist: give {FORMATS}")
    if layer is not None and suffix not in DRIVERS:
        raise InputError(f"region file {path} has no layers: leave out what follows '|'")
    if suffix in (".png", ".tif", ".tiff", ".npy"):
        return open_labels(path)
    if suffix == ".xml":
        return open_cvat(path)
    found: RegionFile | None = None
    if suffix in DRIVERS:
        found = open_vectors(path, layer)
    elif suffix == ".txt":
        found = open_yolo(path)
    elif suffix in (".json", ".geojson"):
        found = _in_json(path)
    if found is None:
        raise InputError(f"{path} holds no regions that can be read: give {FORMATS}")
    return found


def written_names(file: RegionFile) -> tuple[str, ...]:
    """The names of all files that `write_regions` may make."""
    return (*file.names(STEM), *(() if file.complete else (TABLE,)))


def write_regions(
    folder: Path, file: RegionFile, carried: Sequence[CarriedRegion], photograph: Photograph
) -> list[str]:
    """Writes regions of a file as outlines in another photograph into a folder: `regions.` and the ending of the file.

    Regions keep ids, labels and attributes, in the order of `carried`; ours are added as "zpm2_<name>". A format that
    holds neither our attributes nor regions without an outline gets `TABLE` beside it. Returns notes for the user.
    `OutputError`.
    """
    notes = file.write(folder / file.names(STEM)[0], carried, photograph)
    if not file.complete:
        atomic_write(folder / TABLE, json.dumps(_table(carried, photograph), ensure_ascii=False, indent=1))
    return notes


def _table(carried: Sequence[CarriedRegion], photograph: Photograph) -> dict[str, object]:
    """All regions with our attributes, those without an outline too. "row" counts the entries of the file from 0."""
    regions = [
        {
            "row": each.region.row,
            "id": each.region.source_id,
            "label": each.region.label,
            "written": each.shape is not None and not each.shape.is_empty,
            **json_values(each.attributes),
        }
        for each in carried
    ]
    return {
        "schema": "zpm2-regions/1",
        "image": {"name": name_of(photograph), "width": photograph.width, "height": photograph.height},
        "regions": regions,
    }


def _in_json(path: Path) -> RegionFile | None:
    data = _json(path)
    if isinstance(data, dict) and data.get("type") == "FeatureCollection":
        return open_features(path, data)
    if isinstance(data, dict) and is_labelme(data):
        return Labelme(path, data)
    annotations = data.get("annotations") if isinstance(data, dict) else data
    if isinstance(annotations, list) and all(isinstance(a, dict) for a in annotations):
        return open_annotations(path, annotations, data if isinstance(data, dict) else None)
    return None


def _json(path: Path) -> object:
    try:
        return read_json(path)
    except OSError as error:
        raise InputError(f"cannot read region file {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"region file {path} is not valid JSON: write it anew") from error
