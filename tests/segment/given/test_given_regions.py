"""Regions that a person brought along, through a whole run: every file leads back to the table that they came from."""

import json
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import shapely
from rendered import Pair, Run

from zpm2 import MatchResult
from zpm2.model import Georeference
from zpm2.photos.geolocation import between
from zpm2.photos.images import read_image
from zpm2.segment.given.precomputed import PrecomputedSegmenter

pyogrio = pytest.importorskip("pyogrio", reason="extra geo is not installed")


@pytest.fixture(scope="module")
def regions(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The known regions as OpenStreetMap's programs write them: ids that are no numbers, and properties."""
    folder, found = tmp_path_factory.mktemp("given"), {}
    for side in ("left", "right"):
        polygons = PrecomputedSegmenter(getattr(pair, f"{side}_regions")).polygons(read_image(getattr(pair, side)))
        features = [
            {
                "type": "Feature",
                "id": f"way/{polygon.source_id}",
                "properties": {"storeys": int(polygon.source_id or 0) % 5, "area": "as surveyed", "label": "house"},
                "geometry": {"type": "Polygon", "coordinates": [polygon.exterior.tolist()]},
            }
            for polygon in polygons
        ]
        found[side] = folder / f"{side}.geojson"
        image = {"name": f"{side}.png"}
        found[side].write_text(json.dumps({"type": "FeatureCollection", "image": image, "features": features}))
    return found


def options(left: Path | str, right: Path | str) -> list[str]:
    files = ["--left-regions", str(left), "--right-regions", str(right)]
    return ["--segmenter", "precomputed", *files, "--points", "sift", "--device", "cpu"]


@pytest.mark.parametrize("how", [[], ["--tiles", "on", "--set", "tiles.size=256"], ["--non-overlapping", "--outlines"]])
def test_ids_and_properties_reach_every_file(
    run: Run, pair: Pair, regions: dict[str, Path], tmp_path: Path, how: list[str]
) -> None:
    formats = [word for name in ("gpkg", "shapefile", "coco") for word in ("--format", name)]
    words = options(regions["left"], regions["right"])
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path, *words, *formats, *how)
    assert code == 0, err
    assert "left and right are not swapped" not in err
    result = MatchResult.load(tmp_path)
    assert len(result.matches) > 10
    for side in ("left", "right"):
        polygons = {polygon.id: polygon for polygon in getattr(result, side).polygons}
        given = {id: (polygon.source_id, polygon.properties["storeys"]) for id, polygon in polygons.items()}
        assert all(text == f"way/{text[4:]}" and int(text[4:]) % 5 == storeys for text, storeys in given.values())
        assert all(polygon.properties["area"] == "as surveyed" for polygon in polygons.values())
        features = json.loads((tmp_path / f"{side}.geojson").read_text())["features"]
        values = {f["id"]: f["properties"] for f in features}
        annotations = json.loads((tmp_path / f"{side}.coco.json").read_text())["annotations"]
        notes = {a["polygon_id"]: a for a in annotations}
        for rows in (values, notes):
            assert {id: (row["source_id"], row["storeys"]) for id, row in rows.items()} == given
            assert all(row["source_area"] == "as surveyed" for row in rows.values())
        for path, layer in ((tmp_path / "matches.gpkg", side), (tmp_path / f"{side}.shp", None)):
            meta, _, _, columns = pyogrio.raw.read(path, layer=layer)
            table = dict(zip(meta["fields"].tolist(), columns, strict=True))
            rows = zip(*(table[name].tolist() for name in ("polygon_id", "source_id", "storeys")), strict=True)
            assert {id: (text, storeys) for id, text, storeys in rows} == given
        for name in ("geojson", "coco.json"):  # and may be matched again
            again = tmp_path / f"again-{side}.json"
            again.write_bytes((tmp_path / f"{side}.{name}").read_bytes())
            image = read_image(getattr(pair, side))
            back = PrecomputedSegmenter(again, min_area=1).polygons(image)
            found = {p.id: (p.source_id, p.properties["storeys"]) for p in back}
            assert given.items() <= found.items()  # pixels may break a thin region into pieces
            assert set(found.values()) == set(given.values())


def test_swapped_files_are_said(run: Run, pair: Pair, regions: dict[str, Path], tmp_path: Path) -> None:
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path, *options(regions["right"], regions["left"]))
    assert code == 0
    assert "left regions: made for right.png and used for left.png: check that left and right are not swapped" in err
    assert "right regions: made for left.png and used for right.png" in err


def test_nodata_of_label_rasters_is_no_region(run: Run, pair: Pair, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    files = []
    for side in ("left", "right"):
        labels = np.asarray(PIL.Image.open(getattr(pair, f"{side}_regions"))).astype(np.uint16)
        files.append(tmp_path / f"{side}.tif")
        size = {"width": labels.shape[1], "height": labels.shape[0], "count": 1, "dtype": "uint16"}
        place = rasterio.Affine(0.5, 0, 500_000, 0, -0.5, 5_000_000)
        with rasterio.open(files[-1], "w", "GTiff", nodata=65535, crs="EPSG:32633", transform=place, **size) as file:
            file.write(np.where(labels, labels, 65535), 1)
    assert run("match", pair.left, pair.right, "-o", tmp_path / "out", *options(*files)).code == 0
    assert run("match", pair.left, pair.right, "-o", tmp_path / "plain", *pair.regions).code == 0
    found, plain = (MatchResult.load(tmp_path / name) for name in ("out", "plain"))
    for side in ("left", "right"):
        rings = [[p.exterior.tolist() for p in getattr(result, side).polygons] for result in (found, plain)]
        assert rings[0] == rings[1]


@pytest.mark.parametrize("how", [[], ["--tiles", "on", "--set", "tiles.size=256"]])
def test_layers_in_another_reference_system(run: Run, pair: Pair, tmp_path: Path, how: list[str]) -> None:
    """Two layers of one GeoPackage, in another zone than the photographs: the same matches as in pixels."""
    rasterio = pytest.importorskip("rasterio")
    photographs, layers, pixels = [], [], []
    for k, side in enumerate(("left", "right")):
        image = read_image(getattr(pair, side))
        place = rasterio.Affine(0.5, 0, 500_000 + 7 * k, 0, -0.5, 5_300_000)
        photographs.append(tmp_path / f"{side}.tif")
        size = {"width": image.width, "height": image.height, "count": 3, "dtype": "uint8"}
        with rasterio.open(photographs[-1], "w", "GTiff", crs="EPSG:32632", transform=place, **size) as file:
            file.write(np.moveaxis(image.rgb, 2, 0))
        geo = Georeference("EPSG:32632", np.array(place[:6]).reshape(2, 3))
        polygons = PrecomputedSegmenter(getattr(pair, f"{side}_regions")).polygons(image)
        shapes = np.array([polygon.shape for polygon in polygons], object)
        moved = shapely.transform(shapes, lambda xy, geo=geo: between("EPSG:32632", "EPSG:32633", geo.to_world(xy)))
        columns = [np.array([f"way/{polygon.source_id}" for polygon in polygons], object)]
        path = tmp_path / "houses.gpkg"
        where = {"layer": side, "driver": "GPKG", "geometry_type": "Polygon", "crs": "EPSG:32633"}
        pyogrio.raw.write(path, shapely.to_wkb(moved), columns, ["osm"], append=path.exists(), **where)
        layers.append(f"{path}|layername={side}")
        pixels.append(tmp_path / f"{side}.json")
        features = [{"type": "Feature", "id": n + 1, "geometry": json.loads(shapely.to_geojson(s)), "properties": {}}
                    for n, s in enumerate(shapes)]  # fmt: skip
        pixels[-1].write_text(json.dumps({"type": "FeatureCollection", "crs": None, "features": features}))
    found = []
    for name, files in (("ground", layers), ("px", pixels)):
        code, _, err = run("match", *photographs, "-o", tmp_path / name, *options(*files), *how)
        assert code == 0, err
        found.append(MatchResult.load(tmp_path / name))
    ground, px = ([(m.left, m.right) for m in result.matches] for result in found)
    assert len(px) > 10
    assert ground == px
    assert found[0].left.polygons[0].properties["osm"].startswith("way/")


def test_an_input_with_a_layer_is_not_written_over(run: Run, pair: Pair, tmp_path: Path) -> None:
    (tmp_path / "matches.gpkg").write_bytes(b"mine")
    words = options(f"{tmp_path / 'matches.gpkg'}|layername=left", f"{tmp_path / 'matches.gpkg'}|layername=right")
    code, _, err = run("match", pair.left, pair.right, "-o", tmp_path, *words, "--format", "gpkg")
    assert code == 2
    assert "matches.gpkg" in err
    assert (tmp_path / "matches.gpkg").read_bytes() == b"mine"
