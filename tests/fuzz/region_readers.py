"""Region files of labelling tools and of a GIS, as readers."""

import base64
import json
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from mutate import SIZE
from samples import Files, Reader, encoded, pixels

from zpm2.formats.regions.registry import open_regions
from zpm2.model import Georeference, Image

PLACE = Georeference("EPSG:32632", np.array([[1.0, 0, 5e5], [0, -1.0, 5e6]]), 1.0)


def region_readers() -> list[Reader]:
    """One for each format, on a photograph that is placed on the ground."""
    image = Image(pixels(), "photo.png", geo=PLACE)

    def read(folder: Path) -> None:
        (path,) = (path for path in folder.iterdir() if path.name.startswith("a.") and path.suffix in ENDINGS)
        open_regions(path).read(image)

    return [Reader(f"regions of {name}", samples, read) for name, samples in _samples().items()]


ENDINGS = (".json", ".geojson", ".xml", ".txt", ".gpkg", ".shp")


def _samples() -> dict[str, tuple[Files, ...]]:
    ring = [[5, 5], [30, 5], [30, 20], [5, 20], [5, 5]]
    mask = base64.b64encode(encoded("PNG", np.eye(8, dtype=np.uint8))).decode()
    shapes = [
        {"label": "roof", "points": ring[:-1], "group_id": 3, "shape_type": "polygon", "flags": {"a": True}},
        {"label": "wheel", "points": [[20, 20], [20, 26]], "group_id": None, "shape_type": "circle"},
        {"label": "door", "points": [[20, 20], [30, 26]], "shape_type": "rectangle"},
        {"label": "mask", "points": [[3, 4], [10, 11]], "shape_type": "mask", "mask": mask},
    ]
    size = {"imageWidth": SIZE[0], "imageHeight": SIZE[1]}
    labelme = {"version": "5.5.0", "flags": {}, "shapes": shapes, "imagePath": "photo.png", "imageData": None, **size}
    cvat = (
        f'<annotations><image id="0" name="photo.png" width="{SIZE[0]}" height="{SIZE[1]}">'
        '<polygon label="roof" points="5.0,5.0;30.0,5.0;30.0,20.0"><attribute name="a">b</attribute></polygon>'
        '<box label="door" xtl="1" ytl="2" xbr="20" ybr="30" rotation="30"/>'
        '<ellipse label="e" cx="9" cy="9" rx="5" ry="4"/>'
        '<mask label="m" rle="3, 5, 4" left="2" top="3" width="4" height="3"/></image></annotations>'
    )
    feature = {"type": "Feature", "id": 1, "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    world = PLACE.to_world(np.array(ring, np.float64)).tolist()
    placed = feature | {"geometry": {"type": "Polygon", "coordinates": [world]}}
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    degrees = feature | {"geometry": {"type": "Polygon", "coordinates": [[[9.0001, 45.1], [9.0002, 45.1], [9, 45.2]]]}}
    collections = [
        {"type": "FeatureCollection", "crs": crs, "features": [placed]},
        {"type": "FeatureCollection", "features": [degrees]},
    ]
    triangle, yaml = b"0 0.1 0.1 0.5 0.1 0.5 0.5\n", b"names:\n  0: roof\n  1: door\n"
    return {
        "Labelme": ({"a.json": json.dumps(labelme).encode()},),
        "CVAT": ({"a.xml": cvat.encode()},),
        "YOLO": (
            {"a.txt": triangle + b"1 0.5 0.5 0.2 0.2\n" + triangle[:-1] + b" 0.9\n", "data.yaml": yaml},
            {"a.txt": triangle, "classes.txt": b"roof\n"},
        ),
        "GeoJSON on the ground": tuple({"a.geojson": json.dumps(data).encode()} for data in collections),
        "GeoPackage": (_layer("a.gpkg", "GPKG"),),
        "shapefile": (_layer("a.shp", "ESRI Shapefile"),),
    }


def _layer(name: str, driver: str) -> Files:
    ring = PLACE.to_world(np.array([[5, 5], [30, 5], [30, 20.0]]))
    shapes = np.array([shapely.Polygon(ring), None], object)
    columns = [np.array([1, 2]), np.array(["a", None], object)]
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder, name)
        pyogrio.raw.write(
            path, shapely.to_wkb(shapes), columns, ["n", "s"], driver=driver, geometry_type="Polygon", crs="EPSG:32632"
        )
        order = sorted(Path(folder).iterdir(), key=lambda each: each.name != name)  # the first is damaged most
        return {each.name: each.read_bytes() for each in order}
