"""left.geojson and right.geojson, which are always written."""

import contextlib
from pathlib import Path

from zpm2.errors import InputError
from zpm2.formats import geojson
from zpm2.formats.layer import Layer, feature_collection, layers_of
from zpm2.formats.registry import OutputFormat, PairResult, register
from zpm2.model import SIDES, ImagePolygons


def feature_collections(result: PairResult) -> dict[str, dict[str, object]]:
    """The polygons as two GeoJSON FeatureCollections, "left" and "right".

    In longitude and latitude (RFC 7946) where the photograph's reference system allows it; else in image px, which the
    file states.
    """
    sides = result.left, result.right
    return {name: _collection(side, layer) for name, side, layer in zip(SIDES, sides, layers_of(result), strict=True)}


def write(result: PairResult, folder: Path) -> None:
    """Writes both files."""
    for name, collection in feature_collections(result).items():
        geojson.write(folder / f"{name}.geojson", collection)


def _collection(side: ImagePolygons, layer: Layer) -> dict[str, object]:
    if layer.crs is not None:
        with contextlib.suppress(InputError):  # no longitude and latitude: `gis.messages` has warned of it
            return feature_collection(layer)
    image = side.path or layer.name, side.width, side.height
    return geojson.feature_collection(side.polygons, layer.match_of, *image, side.unmatched)


register(OutputFormat("geojson", ("left.geojson", "right.geojson"), write, by_default=lambda result: True))
