"""Region files of the user, told apart by suffix and content."""

import os
from functools import partial
from pathlib import Path

from zpm2.errors import InputError
from zpm2.files.reading import read_json
from zpm2.formats import geojson
from zpm2.formats.regions.annotations import open_annotations
from zpm2.formats.regions.labels import open_labels
from zpm2.formats.regions.region import GivenRegion, GivenRegions, RegionReader, check_size, other_photograph
from zpm2.model import Image

FORMATS = (
    "a label image (.png, .tif or .npy of whole numbers, 0 = background), COCO annotations or SAM's automatic masks "
    "(.json), or a GeoJSON FeatureCollection in pixel coordinates (.geojson, .json)"
)


def open_regions(path: Path) -> RegionReader:
    """Reads a file as a function that gives the regions of an image.

    `InputError` where the file is missing or damaged, and with the list of kinds where it is none of them. The function
    raises it where the regions are those of another image.
    """
    suffix = path.suffix.lower()
    if not os.path.exists(path):
        raise InputError(f"region file {path} does not exist: give {FORMATS}")
    if suffix in (".png", ".tif", ".tiff", ".npy"):
        return open_labels(path)
    if suffix in (".json", ".geojson"):
        data = _json(path)
        if isinstance(data, dict) and data.get("type") == "FeatureCollection":
            return partial(_features, path, geojson.parse(data, str(path)))
        annotations = data.get("annotations") if isinstance(data, dict) else data
        if isinstance(annotations, list) and all(isinstance(a, dict) for a in annotations):
            return open_annotations(path, data if isinstance(data, dict) else {"annotations": data})
    raise InputError(f"{path} holds no regions that can be read: give {FORMATS}")


def _json(path: Path) -> object:
    try:
        return read_json(path)
    except OSError as error:
        raise InputError(f"cannot read region file {path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"region file {path} is not valid JSON: write it anew") from error


def _features(path: Path, collection: geojson.FeatureCollection, image: Image) -> GivenRegions:
    if collection.size:
        check_size(str(path), collection.size, image)
    regions = [GivenRegion(f.parts, f.id, f.source_id, f.score, f.label, f.properties) for f in collection.features]
    return GivenRegions(regions, other_photograph(collection.image_name, image))
