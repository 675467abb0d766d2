"""A small file of each kind of region file, as the programs of the field write them."""

import base64
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import PIL.Image
import shapely

from zpm2.model import Georeference

WIDTH, HEIGHT = 60, 40
AFFINE = np.array([[0.5, 0.0, 500_000.0], [0.0, -0.5, 5_300_000.0]])
UTM = Georeference("EPSG:32632", AFFINE, 0.5)
UTM_33 = "EPSG:32633"  # the zone beside


@dataclass(frozen=True)
class Photo:
    """What region files need of a photograph."""

    path: str | None = "/photos/left.png"
    width: int = WIDTH
    height: int = HEIGHT
    geo: Georeference = field(default_factory=Georeference)


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


HOLED = [box(2.5, 2, 20, 20.25), box(5, 5, 10, 10)]
PAIR = [[box(30, 2, 40, 12)], [box(42, 4, 55, 30)]]
BITS = np.zeros((HEIGHT, WIDTH), bool)
BITS[25:35, 5:25] = True
BITS[28:30, 8:12] = False


def labels(dtype: type = np.uint16) -> np.ndarray:
    values = np.zeros((HEIGHT, WIDTH), dtype)
    values[2:12, 3:23], values[20:30, 5:15], values[20:30, 30:50] = 7, 90, 200
    return values


def png(path: Path) -> None:
    PIL.Image.fromarray(labels()).save(path)


def palette(path: Path) -> None:
    picture = PIL.Image.fromarray(labels(np.uint8))
    picture.putpalette([k * 3 % 256 for k in range(768)])
    picture.save(path)


def tiff(path: Path) -> None:
    PIL.Image.fromarray(labels()).save(path)


def npy(path: Path) -> None:
    np.save(path, labels(np.int64))


def collection(**members: object) -> dict[str, object]:
    features = [
        {
            "type": "Feature",
            "id": "way/12",
            "properties": {"label": "roof", "score": 0.9, "storeys": 3, "owner": None, "tags": {"a": [1, 2]}},
            "geometry": {"type": "Polygon", "coordinates": HOLED},
        },
        {
            "type": "Feature",
            "properties": {"FID": 4, "grün": "straße"},
            "geometry": {"type": "MultiPolygon", "coordinates": PAIR},
        },
        {"type": "Feature", "id": "way/12", "properties": None, "geometry": None},
    ]
    return {"type": "FeatureCollection", "name": "houses", "features": features, **members}


def moved(data: dict[str, object], points: Callable[[np.ndarray], np.ndarray]) -> dict[str, object]:
    """A collection with other coordinates."""
    features = []
    for feature in data["features"]:  # type: ignore[attr-defined]
        shape = feature["geometry"] and shapely.transform(shapely.geometry.shape(feature["geometry"]), points)
        features.append(feature | {"geometry": shape and json.loads(shapely.to_geojson(shape))})
    return data | {"features": features}


def geojson_px(path: Path) -> None:
    path.write_text(json.dumps(collection(crs=None)))


def geojson_utm(path: Path) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    path.write_text(json.dumps(moved(collection(crs=crs), UTM.to_world)))


def to_other_zone(points: np.ndarray) -> np.ndarray:
    from zpm2.photos.geolocation import between

    return between("EPSG:32632", UTM_33, UTM.to_world(points))


def geojson_other_zone(path: Path) -> None:
    path.write_text(json.dumps(moved(collection(crs=UTM_33), to_other_zone)))


def to_degrees(points: np.ndarray) -> np.ndarray:
    from zpm2.photos.geolocation import between

    return between("EPSG:32632", "EPSG:4326", UTM.to_world(points))


def geojson_degrees(path: Path) -> None:
    path.write_text(json.dumps(moved(collection(), to_degrees)))


def coco(path: Path) -> None:
    counts = [int(n) for n in np.diff(np.flatnonzero(np.diff(np.r_[False, BITS.T.ravel(), False])))]
    first = int(np.argmax(BITS.T.ravel()))
    runs = [first, *counts, BITS.size - first - sum(counts)]
    data = {
        "info": {"description": "houses"},
        "licenses": [{"id": 1}],
        "images": [
            {"id": 3, "file_name": "left.png", "width": WIDTH, "height": HEIGHT, "license": 1},
            {"id": 4, "file_name": "other.png", "width": 5, "height": 5},
        ],
        "categories": [{"id": 5, "name": "roof", "supercategory": "house"}],
        "annotations": [
            {"id": 9, "image_id": 4, "category_id": 5, "segmentation": [[0, 0, 5, 0, 5, 5]], "iscrowd": 0},
            {
                "id": "way/12",
                "image_id": 3,
                "category_id": 5,
                "segmentation": [np.ravel(part[0][:-1]).tolist() for part in PAIR],
                "bbox": [30, 2, 25, 28],
                "area": 438,
                "iscrowd": 0,
                "score": 0.75,
                "owner": "city",
                "keypoints": [1, 2, 2],
            },
            {
                "id": 11,
                "image_id": 3,
                "category_id": 5,
                "segmentation": {"size": [HEIGHT, WIDTH], "counts": runs},
                "bbox": [5, 25, 20, 10],
                "area": 192,
                "iscrowd": 1,
            },
        ],
    }
    path.write_text(json.dumps(data))


def sam(path: Path) -> None:
    found = {"segmentation": [[2, 2, 20, 2, 20, 20]], "predicted_iou": 0.9, "stability_score": 0.95, "area": 162}
    path.write_text(json.dumps([found | {"point_coords": [[5, 5]], "crop_box": [0, 0, 60, 40]}]))


def labelme(path: Path) -> None:
    crop, out = BITS[25:35, 5:25], io.BytesIO()
    PIL.Image.fromarray(crop).save(out, "PNG")
    usual = {"group_id": None, "description": "", "flags": {}}
    data = {
        "version": "5.5.0",
        "flags": {"night": True},
        "shapes": [
            {"label": "roof", "points": box(2.5, 2, 20, 20)[:-1], "shape_type": "polygon", **usual}
            | {"group_id": 4, "flags": {"occluded": True}, "description": "of the city", "own": [1]},
            {"label": "door", "points": [[30, 5], [45.5, 12]], "shape_type": "rectangle", **usual},
            {"label": "wheel", "points": [[30, 25], [30, 31]], "shape_type": "circle", **usual},
            {"label": "line", "points": [[1, 1], [9, 9]], "shape_type": "line", **usual},
            {"label": "mask", "points": [[5, 25], [24, 34]], "shape_type": "mask", **usual}
            | {"mask": base64.b64encode(out.getvalue()).decode()},
        ],
        "imagePath": "..\\photos\\left.png",
        "imageData": base64.b64encode(b"pixels").decode(),
        "imageHeight": HEIGHT,
        "imageWidth": WIDTH,
        "lineColor": [0, 255, 0],
    }
    path.write_text(json.dumps(data))


CVAT = f"""<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta><task><id>8</id><labels><label><name>roof</name><attributes/></label></labels></task></meta>
  <image id="0" name="other.png" width="9" height="9"><tag label="x"></tag></image>
  <image id="1" name="photos/left.png" subset="train" width="{WIDTH}" height="{HEIGHT}">
    <polygon label="roof" source="manual" occluded="1"
     points="2.50,2.00;20.00,2.00;20.00,20.00" z_order="3" group_id="2">
      <attribute name="storeys">3</attribute><attribute name="owner">Stra&#223;e &amp; S&#246;hne</attribute>
    </polygon>
    <box label="door" source="manual" occluded="0"
     xtl="30.00" ytl="5.00" xbr="45.50" ybr="12.00" z_order="0" rotation="90">
    </box>
    <ellipse label="wheel" source="auto" occluded="0" cx="40" cy="28" rx="8" ry="5" z_order="0"></ellipse>
    <polyline label="line" source="manual" occluded="0" points="1,1;9,9" z_order="0"></polyline>
    <mask label="mask" source="manual" occluded="0" rle="RUNS" left="5" top="25" width="20" height="10" z_order="1">
    </mask>
  </image>
</annotations>
"""


def cvat(path: Path) -> None:
    crop = BITS[25:35, 5:25].ravel()
    edges = np.flatnonzero(np.diff(np.r_[False, crop, False]))
    path.write_text(CVAT.replace("RUNS", ", ".join(map(str, [edges[0], *np.diff(edges)]))), encoding="utf-8")


def yolo(path: Path) -> None:
    path.write_text("1 0.1 0.1 0.5 0.1 0.5 0.5\n0 0.7 0.5 0.2 0.5\n2 0.1 0.6 0.3 0.6 0.3 0.9 0.1 0.9 0.875\n")
    path.with_name("data.yaml").write_text("path: x\nnames:\n  0: door\n  1: 'roof, red'\n  2: wheel  # round\nnc: 3\n")


COLUMNS: dict[str, np.ndarray] = {
    "label": np.array(["roof", None, "door"], object),
    "storeys": np.array([3, 0, 5], np.int64),
    "height": np.array([3.5, np.nan, 7.25]),
    "listed": np.array([True, False, True]),
    "owner": np.array(["Straße", "", None], object),
    "built": np.array(["1970-01-02", "NaT", "2021-02-03"], "datetime64[D]"),
}


def layer(path: Path, points: Callable[[np.ndarray], np.ndarray], crs: str | None, fids: bool) -> None:
    import pyogrio

    shapes = np.array(
        [shapely.Polygon(HOLED[0], HOLED[1:]), None, shapely.MultiPolygon([(p[0], p[1:]) for p in PAIR])], object
    )
    columns = dict(COLUMNS) | ({"fid": np.array([7, 9, 12])} if fids else {})
    pyogrio.raw.write(
        path,
        shapely.to_wkb(shapely.transform(shapes, points)),
        list(columns.values()),
        list(columns),
        [np.array([False, True, False]) if name in ("storeys", "listed") else None for name in columns],
        layer="houses",
        driver="GPKG" if fids else "ESRI Shapefile",
        geometry_type="MultiPolygon",
        promote_to_multi=True,
        crs=crs,
        encoding="UTF-8",
    )


def gpkg_px(path: Path) -> None:
    layer(path, lambda points: points * (1, -1), None, True)


def gpkg_utm(path: Path) -> None:
    layer(path, UTM.to_world, "EPSG:32632", True)


def gpkg_other_zone(path: Path) -> None:
    layer(path, to_other_zone, UTM_33, True)


def shapefile(path: Path) -> None:
    layer(path, UTM.to_world, "EPSG:32632", False)


@dataclass(frozen=True)
class Sample:
    """A file of one kind."""

    name: str
    file: str
    make: Callable[[Path], None]
    photo: Photo = Photo()
    packages: tuple[str, ...] = ()
    tolerance: float = 1e-6  # px, by which outlines may move


PLACED = Photo(geo=UTM)
GEO = ("rasterio",)
SAMPLES = [
    Sample("PNG", "a.png", png),
    Sample("palette", "a.png", palette),
    Sample("TIFF", "a.tif", tiff),
    Sample("npy", "a.npy", npy),
    Sample("COCO", "a.json", coco),
    Sample("SAM", "a.json", sam),
    Sample("Labelme", "a.json", labelme),
    Sample("CVAT", "a.xml", cvat),
    Sample("YOLO", "a.txt", yolo),
    Sample("GeoJSON in px", "a.geojson", geojson_px),
    Sample("GeoJSON in UTM", "a.geojson", geojson_utm, PLACED, GEO),
    Sample("GeoJSON in another zone", "a.json", geojson_other_zone, PLACED, GEO),
    Sample("GeoJSON in degrees", "a.geojson", geojson_degrees, PLACED, GEO, 0.005),
    Sample("GeoPackage in px", "a.gpkg", gpkg_px, packages=("pyogrio",)),
    Sample("GeoPackage in UTM", "a.gpkg", gpkg_utm, PLACED, (*GEO, "pyogrio")),
    Sample("GeoPackage in another zone", "a.gpkg", gpkg_other_zone, PLACED, (*GEO, "pyogrio")),
    Sample("shapefile", "a.shp", shapefile, PLACED, (*GEO, "pyogrio")),
]
