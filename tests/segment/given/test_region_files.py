"""Region files as other programs write them: nothing is taken for what it is not, and nothing is lost on the way."""

import builtins
import json

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.config import VectorizeConfig
from zpm2.errors import InputError, MissingDependency
from zpm2.formats import geojson
from zpm2.formats.coco import coco
from zpm2.model import Counterpart, Image, Polygon
from zpm2.photos.images import read_image
from zpm2.polygons.rasterize import rasterize
from zpm2.segment.given.precomputed import PrecomputedSegmenter

WIDTH, HEIGHT = 60, 40
IMAGE = Image(np.zeros((HEIGHT, WIDTH, 3), np.uint8), path="/photos/left.png")
RENUMBERED = "the regions' ids are not distinct whole numbers: numbered from 0 instead"


def source(path):
    return PrecomputedSegmenter(path, VectorizeConfig(tolerance=0.0), 4.0)


def labels(dtype=np.uint8):
    values = np.zeros((HEIGHT, WIDTH), dtype)
    values[2:12, 3:23] = 7
    values[20:30, 5:15] = 9
    return values


def raster(path, values, nodata=None, mask=None, **options):
    rasterio = pytest.importorskip("rasterio")
    bands = values.reshape(-1, *values.shape[-2:])
    size = {"width": bands.shape[2], "height": bands.shape[1], "count": len(bands)}
    kind = {"driver": "GTiff", "dtype": values.dtype.name, "nodata": nodata}
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True), rasterio.open(path, "w", **kind, **size, **options) as file:
        file.write(bands)
        if mask is not None:
            file.write_mask(mask)
    return path


def without_rasterio(monkeypatch):
    """As on a machine where the extra `geo` is not installed."""
    find = builtins.__import__

    def missing(name, *more):
        if name.partition(".")[0] == "rasterio":
            raise ImportError(name)
        return find(name, *more)

    monkeypatch.setattr(builtins, "__import__", missing)


def ids(segmenter, image=IMAGE):
    return [polygon.id for polygon in segmenter.polygons(image)]


def write(path, data):
    path.write_text(json.dumps(data))
    return path


def box(x0, y0, x1, y1):
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def feature(k, **members):
    geometry = {"type": "Polygon", "coordinates": [box(10 * k, 0, 10 * k + 9, 9)]}
    return {"type": "Feature", "properties": {}, "geometry": geometry, **members}


def collection(*features, **members):
    return {"type": "FeatureCollection", "features": list(features), **members}


# --- label images


@pytest.mark.filterwarnings("ignore::Warning")
@pytest.mark.parametrize("nodata", [255, -9999, -1])
def test_nodata_of_a_label_image_is_no_region(tmp_path, nodata):
    values = labels(np.int16 if nodata < 0 else np.uint8)
    values[values == 0] = nodata
    segmenter = source(raster(tmp_path / "a.tif", values, nodata))
    assert ids(segmenter) == [7, 9]
    assert segmenter.notes == ["pixels without data (nodata, mask or transparent) belong to no region"]


@pytest.mark.filterwarnings("ignore::Warning")
def test_masked_pixels_of_a_label_image_are_no_region(tmp_path):
    path = raster(tmp_path / "a.tif", labels(), mask=labels() != 9)
    assert ids(source(path)) == [7]


def transparent_picture(path, kind):
    values = np.where(labels() == 9, 3, labels())
    if kind == "alpha":
        bands = values, np.where(values == 3, 0, 255).astype(np.uint8)
        PIL.Image.merge("LA", [PIL.Image.fromarray(band) for band in bands]).save(path)
        return path
    picture = PIL.Image.fromarray(values).convert("P")
    picture.putdata(values.ravel().tolist())
    picture.putpalette(list(range(30)))
    picture.save(path, transparency=3 if kind == "one color" else bytes([255, 0, 255, 0, *[255] * 6]))
    return path


@pytest.mark.parametrize("by", ["rasterio", "pillow"])
@pytest.mark.parametrize("kind", ["alpha", "one color", "table"])
def test_transparent_pixels_of_a_label_image_are_no_region(tmp_path, monkeypatch, by, kind):
    path = transparent_picture(tmp_path / "a.png", kind)
    if by == "pillow":
        without_rasterio(monkeypatch)
    assert ids(source(path)) == [7]


def test_nodata_is_known_without_rasterio_too(tmp_path, monkeypatch):
    path = tmp_path / "a.tif"
    PIL.Image.fromarray(labels()).save(path, tiffinfo={42113: "9"})
    without_rasterio(monkeypatch)
    assert ids(source(path)) == [7]


@pytest.mark.parametrize("by", ["rasterio", "pillow"])
@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("ending", ["png", "tif"])
def test_labels_lie_in_the_stored_frame_as_photographs_do(tmp_path, monkeypatch, ending, orientation, by):
    """Whatever the EXIF orientation, the pixels of both files are the same ones."""
    exif = PIL.Image.Exif()
    exif[274] = orientation
    values = labels()
    photograph = np.repeat(values[..., None] * 20, 3, axis=2)
    paths = tmp_path / f"labels.{ending}", tmp_path / f"left.{ending}"
    for path, pixels in zip(paths, (values, photograph), strict=True):
        PIL.Image.fromarray(pixels).save(path, exif=exif)
    if by == "pillow":
        without_rasterio(monkeypatch)
    image = read_image(paths[1])
    segmenter = source(paths[0])
    found = np.zeros((HEIGHT, WIDTH), int)
    for mask in segmenter.segment(image):
        found[mask.y0 : mask.y0 + mask.bits.shape[0], mask.x0 : mask.x0 + mask.bits.shape[1]] += mask.bits * int(
            mask.label
        )
    assert np.array_equal(found, image.rgb[..., 0] // 20)
    assert np.array_equal(found, values)
    assert any("orientation" in note for note in segmenter.notes) == (orientation != 1)


def test_labels_of_the_turned_photograph_are_told_what_to_do(tmp_path):
    path = tmp_path / "a.png"
    PIL.Image.fromarray(labels().T.copy()).save(path)
    with pytest.raises(InputError, match=r"40 x 60 px, the image has 60 x 40 px.*without its EXIF orientation"):
        ids(source(path))


@pytest.mark.parametrize("by", ["rasterio", "pillow"])
def test_a_stack_of_labels_is_refused(tmp_path, monkeypatch, by):
    pages = [PIL.Image.fromarray(np.roll(labels(), k)) for k in range(3)]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:])
    if by == "pillow":
        without_rasterio(monkeypatch)
    with pytest.raises(InputError, match=r"a\.tif holds 3 pages: give the one"):
        source(tmp_path / "a.tif")


@pytest.mark.filterwarnings("ignore::Warning")
@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64"])
def test_label_images_of_any_whole_numbers(tmp_path, dtype):
    assert ids(source(raster(tmp_path / "a.tif", labels(dtype)))) == [7, 9]


@pytest.mark.filterwarnings("ignore::Warning")
def test_numbers_beyond_what_json_holds_stay_as_text(tmp_path):
    values = labels(np.uint64)
    values[values == 9] = 2**63 + 5
    segmenter = source(raster(tmp_path / "a.tif", values))
    found = segmenter.polygons(IMAGE)
    assert [(p.id, p.source_id, p.label) for p in found] == [(0, "7", "7"), (1, str(2**63 + 5), str(2**63 + 5))]
    assert segmenter.notes == [RENUMBERED]


@pytest.mark.filterwarnings("ignore::Warning")
@pytest.mark.parametrize("options", [{"compress": "lerc"}, {"compress": "zstd"}, {"tiled": True}, {"BIGTIFF": "YES"}])
def test_label_images_of_any_kind_of_tiff(tmp_path, options):
    path = tmp_path / "a.tif"
    try:
        raster(path, labels(np.int32), **options)
    except Exception:
        pytest.skip("this GDAL does not write it")
    assert ids(source(path)) == [7, 9]


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_large_label_images_are_no_bombs(tmp_path, monkeypatch, ending):
    pytest.importorskip("rasterio")
    path = tmp_path / f"a.{ending}"
    PIL.Image.fromarray(labels()).save(path)
    monkeypatch.setattr(PIL.Image, "MAX_IMAGE_PIXELS", WIDTH * HEIGHT // 4)
    assert ids(source(path)) == [7, 9]
    without_rasterio(monkeypatch)
    with pytest.raises(MissingDependency, match=r"so large that it needs rasterio: pip install"):
        source(path)


def test_a_label_image_beyond_all_measure_is_refused_before_it_is_unpacked(tmp_path, monkeypatch):
    PIL.Image.fromarray(labels()).save(tmp_path / "a.png")
    monkeypatch.setattr("zpm2.formats.regions.labels.MAX_PIXELS", 1000)
    with pytest.raises(InputError, match="gigapixel: give polygons"):
        source(tmp_path / "a.png")


def test_numbering_does_not_depend_on_the_rows_that_are_numbered_at_a_time(tmp_path, monkeypatch):
    values = np.random.default_rng(0).choice([0, 3, 500, 70_000], (HEIGHT, WIDTH)).astype(np.int64)
    np.save(tmp_path / "a.npy", values)
    whole = source(tmp_path / "a.npy").segment(IMAGE)
    monkeypatch.setattr("zpm2.formats.regions.labels.CHUNK_PX", 100)
    parts = source(tmp_path / "a.npy").segment(IMAGE)
    assert [(m.x0, m.y0, m.label, m.bits.tobytes()) for m in whole] == [
        (m.x0, m.y0, m.label, m.bits.tobytes()) for m in parts
    ]


# --- ids and properties


@pytest.mark.parametrize(
    ("members", "id", "source_id"),
    [
        ({"id": 12}, 12, "12"),
        ({"id": "12"}, 12, "12"),
        ({"id": 12.0}, 12, "12"),
        ({"id": None, "properties": {"id": 12}}, 12, "12"),
        ({"properties": {"fid": 12}}, 12, "12"),
        ({"properties": {"OBJECTID": 12}}, 12, "12"),
        ({"id": None, "properties": {"id": None, "fid": 12}}, 12, "12"),
        ({"id": "way/123"}, None, "way/123"),
        ({"id": 1.5}, None, "1.5"),
        ({"id": -3}, None, "-3"),
        ({"id": True}, None, "true"),
        ({"id": 2**60}, None, str(2**60)),
        ({"properties": {"id": "DEBW_001"}}, None, "DEBW_001"),
    ],
)
def test_every_id_is_kept_and_a_new_number_is_said(tmp_path, members, id, source_id):
    segmenter = source(write(tmp_path / "a.geojson", collection(feature(0, **members), feature(1, id=3))))
    first, second = segmenter.polygons(IMAGE)
    assert (first.source_id, second.source_id) == (source_id, "3")
    if id is None:
        assert (first.id, second.id) == (0, 1)
        assert segmenter.notes == [RENUMBERED]
    else:
        assert (first.id, second.id) == (id, 3)
        assert segmenter.notes == []


def test_without_any_id_nothing_is_said_of_ids(tmp_path):
    segmenter = source(write(tmp_path / "a.geojson", collection(feature(0), feature(1, id=None))))
    assert [(p.id, p.source_id) for p in segmenter.polygons(IMAGE)] == [(0, None), (1, None)]
    assert segmenter.notes == []


def test_parts_of_a_region_share_its_id_and_properties(tmp_path):
    multi = {"type": "MultiPolygon", "coordinates": [[box(0, 0, 5, 5)], [box(10, 10, 30, 30)]]}
    given = {"name": "Hof", "tags": [1, {"a": None}], "label": "roof", "score": 0.5}
    data = collection(feature(4, id=9), {"id": "way/4", "geometry": multi, "properties": given})
    found = source(write(tmp_path / "a.geojson", data)).polygons(IMAGE)
    assert [(p.id, p.source_id, p.score, p.label) for p in found[1:]] == [
        (1, "way/4", 0.5, "roof"),
        (2, "way/4", 0.5, "roof"),
    ]
    assert all(p.properties == {"name": "Hof", "tags": [1, {"a": None}]} for p in found[1:])


def test_what_no_file_can_hold_becomes_plain(tmp_path):
    text = json.dumps(
        collection(feature(0, id="a\ud800", properties={"x": [float("nan")], "y\udfff": 1, "label": "\ud800"}))
    )
    (tmp_path / "a.geojson").write_text(text)
    (polygon,) = source(tmp_path / "a.geojson").polygons(IMAGE)
    assert (polygon.source_id, polygon.label, polygon.properties) == ("a?", "?", {"x": [None], "y?": 1})
    geojson.write(tmp_path / "b.geojson", geojson.feature_collection([polygon], None, "left.png", WIDTH, HEIGHT))


def given_polygons():
    square = np.array(box(2, 2, 22, 12)[:-1], float)
    return [
        Polygon(5, square, (), 0.5, None, "roof", "way/123", {"name": "Hof", "area": 3, "match": "x", "iscrowd": 1}),
        Polygon(8, square + np.array([25, 20]), (), 1.0, None, None, "way/9", {"source_area": 1}),
        Polygon(11, square + np.array([0, 20])),
    ]


@pytest.mark.parametrize("form", ["geojson", "coco"])
def test_our_own_files_give_back_what_was_given(tmp_path, form):
    polygons = given_polygons()
    match_of = {5: Counterpart(5, 77, 0.25)}
    if form == "coco":
        masks = (rasterize(p.shape) for p in polygons)
        data = coco(polygons, masks, match_of, "left.png", WIDTH, HEIGHT, {8: "occluded"})
    else:
        data = geojson.feature_collection(polygons, match_of, "left.png", WIDTH, HEIGHT, {8: "occluded"})
    segmenter = source(write(tmp_path / "a.json", data))
    found = segmenter.polygons(IMAGE)
    assert segmenter.notes == []
    assert [(p.id, p.score, p.label, dict(p.properties)) for p in found] == [
        (p.id, p.score, p.label, p.properties) for p in polygons
    ]
    assert [p.source_id for p in found] == ["way/123", "way/9", "11"]


def test_coco_against_itself_is_perfect(tmp_path):
    """0 is no annotation for COCOeval: of annotations numbered from 0 the first one is never found."""
    pycocotools = pytest.importorskip("pycocotools.coco")
    evaluation = pytest.importorskip("pycocotools.cocoeval")
    polygons = given_polygons()
    data = coco(polygons, (rasterize(p.shape) for p in polygons), None, "left.png", WIDTH, HEIGHT)
    truth = pycocotools.COCO(str(write(tmp_path / "a.json", data)))
    for kind in ("segm", "bbox"):
        score = evaluation.COCOeval(truth, truth.loadRes(data["annotations"]), kind)
        own = evaluation.COCOeval(truth, truth, kind)
        for each in (score, own):
            each.evaluate()
            each.accumulate()
            each.summarize()
            assert each.stats[0] == pytest.approx(1.0)


# --- frames


@pytest.mark.parametrize(
    ("crs", "named"),
    [
        ({"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}, "urn:ogc:def:crs:EPSG::25832"),
        ({"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}, "CRS84"),
        ({"type": "EPSG", "properties": {"code": 25832}}, "25832"),
        ("EPSG:25832", "EPSG:25832"),
    ],
)
@pytest.mark.parametrize("where", ["collection", "feature", "geometry"])
def test_a_reference_system_is_refused_though_the_numbers_fit(tmp_path, crs, named, where):
    one = feature(0)
    if where != "collection":
        (one if where == "feature" else one["geometry"])["crs"] = crs
    data = collection(one, **({"crs": crs} if where == "collection" else {}))
    with pytest.raises(InputError, match=rf"a\.geojson is in the reference system .*{named}.*remove \"crs\"") as caught:
        source(write(tmp_path / "a.geojson", data)).polygons(IMAGE)
    assert "\n" not in str(caught.value)


def test_no_reference_system_is_one_of_pixels(tmp_path):
    assert ids(source(write(tmp_path / "a.geojson", collection(feature(0, id=3), crs=None)))) == [3]


@pytest.mark.parametrize("min_area", [0.0, 1e-12, 100.0])
def test_degrees_are_no_pixels_though_they_lie_in_the_image(tmp_path, min_area):
    """As in the GeoJSON that we write for georeferenced photographs, RFC 7946."""
    one = feature(0)
    one["geometry"]["coordinates"] = [box(9.0, 30.0, 9.001, 30.001)]
    segmenter = PrecomputedSegmenter(write(tmp_path / "a.geojson", collection(one)), min_area=min_area)
    with pytest.raises(InputError, match="check that its coordinates are pixels"):
        segmenter.polygons(IMAGE)


# --- whose regions they are


@pytest.mark.parametrize("form", ["geojson", "coco"])
@pytest.mark.parametrize(
    ("name", "said"),
    [("right.png", True), ("/data/right.png", True), ("left.png", False), ("C:\\other\\left.tif", False)],
)
def test_regions_of_another_photograph_are_said(tmp_path, form, name, said):
    polygons = given_polygons()
    if form == "coco":
        data = coco(polygons, (rasterize(p.shape) for p in polygons), None, name, WIDTH, HEIGHT)
    else:
        data = geojson.feature_collection(polygons, None, name, WIDTH, HEIGHT)
    segmenter = source(write(tmp_path / "a.json", data))
    assert len(segmenter.polygons(IMAGE)) == 3
    note = "made for right.png and used for left.png: check that left and right are not swapped"
    assert segmenter.notes == ([note] if said else [])
    assert len(segmenter.polygons(Image(IMAGE.rgb))) == 3  # pixels have no name
    assert segmenter.notes == []


def annotation(k, **members):
    x = 12 * k
    return {"id": k, "image_id": 1, "category_id": 1, "segmentation": [[x, 0, x + 9, 0, x + 9, 9, x, 9]], **members}


def annotations(*found, **members):
    images = [{"id": 1, "file_name": "left.png", "width": WIDTH, "height": HEIGHT}]
    return {"images": images, "categories": [{"id": 1, "name": "roof"}], "annotations": list(found), **members}


def test_annotations_of_images_that_are_not_listed_are_left_out(tmp_path):
    data = annotations(annotation(1), annotation(2, image_id=7), annotation(3, image_id="1"), annotation(4))
    del data["annotations"][3]["image_id"]
    segmenter = source(write(tmp_path / "a.json", data))
    assert ids(segmenter) == [1, 3, 4]
    assert segmenter.notes == ["1 annotation of no image that the file lists left out"]
    stray = write(tmp_path / "b.json", annotations(annotation(1, image_id=7)))
    with pytest.raises(InputError, match=r"b\.json holds no region of the image"):
        ids(source(stray))


def test_of_several_images_what_says_no_image_is_left_out(tmp_path):
    images = [{"id": 1, "file_name": "right.png"}, {"id": 2, "file_name": "left.png"}]
    found = (
        annotation(1, image_id=2),
        annotation(2, image_id=1),
        annotation(3, image_id=None),
        annotation(4, image_id=9),
    )
    segmenter = source(write(tmp_path / "a.json", annotations(*found, images=images)))
    assert ids(segmenter) == [1]
    assert segmenter.notes == ["2 annotations of no image that the file lists left out"]


@pytest.mark.parametrize("without", [{}, {"segmentation": None}])
def test_an_annotation_without_a_segmentation_does_not_empty_the_file(tmp_path, without):
    boxed = {"id": 2, "image_id": 1, "bbox": [0, 0, 9, 9], **without}
    segmenter = source(write(tmp_path / "a.json", annotations(annotation(1), boxed, annotation(3))))
    assert ids(segmenter) == [1, 3]
    assert segmenter.notes == ["1 annotation without a segmentation left out"]
    with pytest.raises(InputError, match=r"b\.json has annotations without a segmentation: boxes"):
        source(write(tmp_path / "b.json", annotations(boxed)))


def test_ids_and_properties_of_annotations(tmp_path):
    more = {"attributes": {"occluded": False}, "iscrowd": 0, "bbox": [1, 2, 3, 4], "area": 81}
    data = annotations(annotation(1, **more), annotation(2, id="a7", predicted_iou=0.5, stability_score=0.9))
    segmenter = source(write(tmp_path / "a.json", data))
    first, second = segmenter.polygons(IMAGE)
    assert (first.source_id, first.label, first.properties) == (
        "1",
        "roof",
        {"attributes": {"occluded": False}, "iscrowd": 0},
    )
    assert (second.source_id, second.score, second.properties) == ("a7", 0.5, {"stability_score": 0.9})
    assert segmenter.notes == [RENUMBERED]


@pytest.mark.parametrize("score", [95, 40, 1.2, -0.1, "0.9", True])
def test_scores_that_are_no_shares_are_refused(tmp_path, score):
    for data in (annotations(annotation(1, score=score)), collection(feature(0, properties={"score": score}))):
        with pytest.raises(InputError, match=r"score .*from 0 to 1 \(divide percentages by 100"):
            ids(source(write(tmp_path / "a.json", data)))


@given(
    st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), lambda v: st.lists(v, max_size=3))
)
@settings(max_examples=100, deadline=None)
def test_any_property_goes_to_a_file_and_back(tmp_path_factory, value):
    folder = tmp_path_factory.mktemp("any")
    data = collection(feature(0, id=3, properties={"p": value}))
    (polygon,) = source(write(folder / "a.geojson", data)).polygons(IMAGE)
    geojson.write(folder / "b.geojson", geojson.feature_collection([polygon], None, "left.png", WIDTH, HEIGHT))
    (again,) = source(folder / "b.geojson").polygons(IMAGE)
    assert again.properties == polygon.properties
