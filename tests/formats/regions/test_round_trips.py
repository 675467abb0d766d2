"""Every kind of region file, read and written and read again, attribute by attribute."""

import json
import warnings
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import shapely
from region_samples import COLUMNS, HEIGHT, SAMPLES, UTM, UTM_33, WIDTH, Photo, Sample

from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.region import CarriedRegion, GivenRegion, RegionFile
from zpm2.formats.regions.registry import TABLE, open_regions, write_regions, written_names

OURS = {"confidence": 0.875, "status": "found", "visible": None}
BY_NAME = {sample.name: sample for sample in SAMPLES}


def opened(sample: Sample, folder: Path) -> RegionFile:
    for package in sample.packages:
        pytest.importorskip(package, reason="extra geo is not installed")
    folder.mkdir(exist_ok=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of pyogrio, on layers without a reference system
        sample.make(folder / sample.file)
    return open_regions(folder / sample.file)


def carried(regions: list[GivenRegion], attributes: dict[str, object] = OURS) -> list[CarriedRegion]:
    return [CarriedRegion(region, shape_of(region), attributes) for region in regions]


def written(sample: Sample, folder: Path, photo: Photo | None = None) -> tuple[RegionFile, RegionFile, Path]:
    file = opened(sample, folder / "given")
    out = folder / "out"
    out.mkdir()
    write_regions(out, file, carried(file.read(sample.photo).regions), photo or sample.photo)
    return file, open_regions(out / written_names(file)[0]), out


def close(one: shapely.Geometry | None, other: shapely.Geometry | None, tolerance: float) -> bool:
    if one is None or other is None:
        return one is other
    return float(one.symmetric_difference(other).area) <= tolerance * one.length


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.name)
def test_what_is_written_is_what_was_read(tmp_path: Path, sample: Sample) -> None:
    file, back, out = written(sample, tmp_path)
    given, found = (each.read(sample.photo).regions for each in (file, back))
    assert len(given) > 0
    kept = [region for region in given if shape_of(region) is not None or file.complete]
    assert len(found) == len(kept)
    for one, other in zip(kept, found, strict=True):
        assert (other.id, other.source_id, other.label, other.score) == (one.id, one.source_id, one.label, one.score)
        assert close(shape_of(one), shape_of(other), sample.tolerance)
        properties = {key: value for key, value in other.properties.items() if not key.startswith("zpm2_")}
        places = {"keypoints", "point_coords", "crop_box"}
        assert properties == {key: value for key, value in one.properties.items() if key not in places}
        ours = {key: value for key, value in other.properties.items() if key not in properties}
        if file.complete:
            assert ours["zpm2_status"[:10] if sample.file == "a.shp" else "zpm2_status"] == "found"
    assert {path.name for path in out.iterdir()} <= {*written_names(file)}
    if not file.complete:
        table = json.loads((out / TABLE).read_text())
        assert [row["id"] for row in table["regions"]] == [region.source_id for region in given]
        assert all(row["status"] == "found" for row in table["regions"])


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.name)
def test_the_same_bytes_and_no_trace_of_an_earlier_run(tmp_path: Path, sample: Sample) -> None:
    """Written twice, and written from what was written."""
    file, back, out = written(sample, tmp_path)
    again, third = tmp_path / "again", tmp_path / "third"
    again.mkdir(), third.mkdir()
    write_regions(again, file, carried(file.read(sample.photo).regions), sample.photo)
    for path in out.iterdir():
        assert (again / path.name).read_bytes() == path.read_bytes(), path.name
    write_regions(third, back, carried(back.read(sample.photo).regions, {"status": "hidden"}), sample.photo)
    last = open_regions(third / written_names(back)[0]).read(sample.photo).regions
    if file.complete or sample.name in ("COCO", "CVAT", "Labelme", "SAM"):
        assert all([k for k in r.properties if k.startswith("zpm2_")] == ["zpm2_status"] for r in last) or (
            sample.file == "a.shp"
        )


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.name)
def test_regions_without_an_outline_stay_listed(tmp_path: Path, sample: Sample) -> None:
    file = opened(sample, tmp_path / "given")
    regions = file.read(sample.photo).regions
    empty = shapely.MultiPolygon() if len(regions) > 1 else None
    gone = [CarriedRegion(r, empty if k else None, {"reason": "hidden"}) for k, r in enumerate(regions)]
    (tmp_path / "out").mkdir()
    write_regions(tmp_path / "out", file, gone, sample.photo)
    back = open_regions(tmp_path / "out" / written_names(file)[0]).read(sample.photo).regions
    if file.complete:
        assert [r.source_id for r in back] == [r.source_id for r in regions]
        assert all(shape_of(r) is None for r in back)
    else:
        assert back == []
        rows = json.loads((tmp_path / "out" / TABLE).read_text())["regions"]
        assert [(row["id"], row["reason"], row["written"]) for row in rows] == [
            (r.source_id, "hidden", False) for r in regions
        ]


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.name)
def test_another_photograph_has_its_size_name_and_place(tmp_path: Path, sample: Sample) -> None:
    """Moved by 20 px in a larger photograph, whose ground is in another reference system."""
    file = opened(sample, tmp_path / "given")
    regions = file.read(sample.photo).regions
    geo = UTM
    if sample.packages and sample.photo.geo.located:
        from zpm2.photos.geolocation import between

        spots = between("EPSG:32632", UTM_33, UTM.to_world(np.array([[0, 0], [100, 0], [0, 100.0]])))
        matrix = np.column_stack([(spots[1] - spots[0]) / 100, (spots[2] - spots[0]) / 100, spots[0]])
        geo = type(geo)(UTM_33, matrix, 0.5)
    right = Photo("/photos/right.png", WIDTH + 30, HEIGHT + 40, geo if sample.photo.geo.located else Photo().geo)
    shapes = [shape_of(region) for region in regions]
    moved = [s and shapely.transform(s, lambda points: points + np.array([20.0, 10.0])) for s in shapes]
    (tmp_path / "out").mkdir()
    entries = [CarriedRegion(r, s, OURS) for r, s in zip(regions, moved, strict=True)]
    assert write_regions(tmp_path / "out", file, entries, right) == []
    found = open_regions(tmp_path / "out" / written_names(file)[0]).read(right)
    assert not [note for note in found.notes if "swapped" in note]
    kept = [shape for shape in moved if shape is not None or file.complete]
    for one, region in zip(kept, found.regions, strict=True):
        assert close(one, shape_of(region), max(sample.tolerance, 1e-3))


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda sample: sample.name)
def test_no_regions_are_a_file_too(tmp_path: Path, sample: Sample) -> None:
    file = opened(sample, tmp_path / "given")
    (tmp_path / "out").mkdir()
    assert write_regions(tmp_path / "out", file, [], sample.photo) == []
    assert open_regions(tmp_path / "out" / written_names(file)[0]).read(sample.photo).regions == []


def test_a_label_image_keeps_its_type_and_colours(tmp_path: Path) -> None:
    for name in ("PNG", "palette", "TIFF", "npy"):
        folder = tmp_path / name
        folder.mkdir()
        file, _, out = written(BY_NAME[name], folder)
        path = out / written_names(file)[0]
        given = folder / "given" / BY_NAME[name].file
        if name == "npy":
            assert np.array_equal(np.load(path), np.load(given))
            assert np.load(path).dtype == np.load(given).dtype
            continue
        one, other = PIL.Image.open(given), PIL.Image.open(path)
        assert np.array_equal(np.asarray(one), np.asarray(other))
        assert one.mode == other.mode
        assert one.getpalette() == other.getpalette()


def test_where_regions_overlap_the_smallest_is_on_top(tmp_path: Path) -> None:
    file = opened(BY_NAME["npy"], tmp_path)
    regions = file.read(Photo()).regions
    shapes = [shapely.box(0, 0, 8, 8), shapely.box(-5, 0, 30, 30), shapely.box(2, 2, 6, 6)]
    entries = [CarriedRegion(r, s) for r, s in zip(regions, shapes, strict=True)]
    file.write(tmp_path / "b.npy", entries, Photo(width=32, height=50))
    values = np.load(tmp_path / "b.npy")
    assert values.shape == (50, 32)
    assert [values[y, x] for y, x in ((3, 3), (7, 7), (20, 20), (40, 20))] == [200, 7, 90, 0]


def test_columns_of_a_layer_keep_their_types_and_nulls(tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    file, _, out = written(BY_NAME["GeoPackage in UTM"], tmp_path)
    infos = [pyogrio.read_info(path) for path in (file.path, out / "regions.gpkg")]
    for name in COLUMNS:
        rows = [list(info["fields"]).index(name) for info in infos]
        assert infos[0]["dtypes"][rows[0]] == infos[1]["dtypes"][rows[1]]
    assert infos[0]["geometry_type"] == infos[1]["geometry_type"] == "MultiPolygon"
    assert infos[0]["layer_name"] == infos[1]["layer_name"]
    assert list(pyogrio.raw.read(out / "regions.gpkg", return_fids=True)[1]) == [7, 9, 12]
    found = open_regions(out / "regions.gpkg").read(BY_NAME["GeoPackage in UTM"].photo).regions
    assert found[0].properties["built"] == "1970-01-02"
    assert found[1].properties["storeys"] is None
    assert [r.properties["zpm2_confidence"] for r in found] == [0.875] * 3
