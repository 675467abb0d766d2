import json

import numpy as np
import PIL.Image
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from zpm2.config import VectorizeConfig
from zpm2.errors import InputError
from zpm2.formats import geojson
from zpm2.formats.regions.annotations import decode
from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.registry import open_regions
from zpm2.formats.run_lengths import decompressed
from zpm2.model import Image, Mask
from zpm2.polygons.nest import with_parents
from zpm2.polygons.vectorize import vectorize
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.segment.protocol import PolygonSource

WIDTH, HEIGHT = 60, 40
IMAGE = Image(np.zeros((HEIGHT, WIDTH, 3), np.uint8), path="/photos/left.png")
EXACT = VectorizeConfig(tolerance=0.0)


def labels(dtype=np.uint8):
    values = np.zeros((HEIGHT, WIDTH), dtype)
    values[2:12, 3:23] = 7
    values[20:30, 5:15] = 9
    values[20:36, 30:50] = 9
    values[38, 58] = 9
    return values


def save_labels(path, values):
    if path.suffix == ".npy":
        np.save(path, values)
    else:
        PIL.Image.fromarray(values).save(path)
    return path


def write(path, data):
    path.write_text(json.dumps(data))
    return path


def source(path, min_area=4.0):
    return PrecomputedSegmenter(path, EXACT, min_area)


def run_lengths(bits):
    flat = np.r_[False, bits.T.ravel()]
    edges = np.flatnonzero(np.diff(np.r_[flat, ~flat[-1]].astype(np.int8)))
    return {"size": list(bits.shape), "counts": np.diff(np.r_[0, edges]).tolist()}


def feature(*rings, **members):
    return {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": list(rings)}, **members}


def features(*items, **members):
    return {"type": "FeatureCollection", "features": list(items), **members}


def box(x0, y0, x1, y1):
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def full(mask):
    bits = np.zeros((HEIGHT, WIDTH), bool)
    bits[mask.y0 : mask.y0 + mask.bits.shape[0], mask.x0 : mask.x0 + mask.bits.shape[1]] = mask.bits
    return bits


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("ending", [".png", ".tif", ".npy"])
def test_label_image(tmp_path, ending, dtype):
    values = labels(dtype) * (1 if dtype == np.uint8 else 300)
    segmenter = source(save_labels(tmp_path / f"labels{ending}", values))
    masks = segmenter.segment(IMAGE)
    assert [(m.area, m.label) for m in masks] == [
        (200, str(values[2, 3])),
        (320, str(values[20, 5])),
        (100, masks[1].label),
    ]
    assert segmenter.notes == ["1 region under 4 px^2 left out"]
    assert np.array_equal(np.any([full(m) for m in masks], axis=0)[:38], values[:38] > 0)
    polygons = segmenter.polygons(IMAGE)
    assert [p.id for p in polygons] == [values[2, 3], values[20, 5], values[20, 5] + 1]
    assert [p.bounds for p in polygons] == [(3, 2, 23, 12), (30, 20, 50, 36), (5, 20, 15, 30)]


def test_it_is_a_polygon_source_with_a_name(tmp_path):
    segmenter = source(save_labels(tmp_path / "labels.png", labels()))
    assert isinstance(segmenter, PolygonSource)
    assert segmenter.name == "precomputed"


def test_palette_and_boolean_images_are_labels(tmp_path):
    picture = PIL.Image.fromarray(labels()).convert("P")
    picture.putdata(labels().ravel().tolist())
    picture.save(tmp_path / "palette.png")
    assert [p.id for p in source(tmp_path / "palette.png").polygons(IMAGE)] == [7, 9, 10]
    np.save(tmp_path / "bits.npy", labels() == 7)
    assert [p.id for p in source(tmp_path / "bits.npy").polygons(IMAGE)] == [1]


def test_notes_are_those_of_the_latest_call(tmp_path):
    segmenter = source(save_labels(tmp_path / "labels.png", labels()))
    for _ in range(2):
        segmenter.polygons(IMAGE)
        assert len(segmenter.notes) == 1


def coco(**members):
    second = np.zeros((HEIGHT, WIDTH), bool)
    second[10:20, 30:40] = True
    return {
        "images": [{"id": 1, "file_name": "left.png", "width": WIDTH, "height": HEIGHT}],
        "categories": [{"id": 3, "name": "roof"}],
        "annotations": [
            {
                "id": 11,
                "image_id": 1,
                "category_id": 3,
                "score": 0.5,
                "segmentation": [[1, 2, 21.5, 2, 21.5, 9.25, 1, 9]],
            },
            {"id": 12, "image_id": 1, "category_id": 4, "iscrowd": 1, "segmentation": run_lengths(second)},
        ],
        **members,
    }


def test_coco(tmp_path):
    segmenter = source(write(tmp_path / "coco.json", coco()))
    polygon, crowd = segmenter.polygons(IMAGE)
    assert (polygon.id, polygon.label, polygon.score) == (11, "roof", 0.5)
    assert polygon.exterior.tolist() == [[1, 2], [21.5, 2], [21.5, 9.25], [1, 9]]
    assert (crowd.id, crowd.label, crowd.score, crowd.bounds) == (12, None, 1.0, (30, 10, 40, 20))
    masks = segmenter.segment(IMAGE)
    assert [m.area for m in masks] == [7 * 20 + 0, 100]
    assert segmenter.notes == []


def test_odd_ids_of_coco_are_no_ids(tmp_path):
    data = coco()
    data["annotations"][0] |= {"id": [1], "category_id": {"a": 1}}
    data["annotations"][1] |= {"id": True, "category_id": 3}
    segmenter = source(write(tmp_path / "coco.json", data))
    assert [(p.id, p.label) for p in segmenter.polygons(IMAGE)] == [(0, None), (1, "roof")]


@given(arrays(bool, (HEIGHT, WIDTH), elements=st.booleans(), fill=st.booleans()), st.integers(0, 50))
@settings(max_examples=100, deadline=None)
def test_compressed_run_lengths_are_those_of_pycocotools(bits, thickness):
    rle = pytest.importorskip("pycocotools.mask")
    bits[:, 5 : 5 + thickness] = True
    packed = rle.encode(np.asfortranarray(bits.astype(np.uint8)))
    packed["counts"] = packed["counts"].decode()
    assert decompressed(packed["counts"]) == run_lengths(bits)["counts"]
    assert np.array_equal(decode(packed, "x", IMAGE), bits)


def test_a_known_compressed_rle(tmp_path):
    # pycocotools.mask.encode of labels() == 7
    data = [
        {
            "segmentation": {"size": [HEIGHT, WIDTH], "counts": "j3:n00000000000000000000000000000000000000V^1"},
            "predicted_iou": 1.01,
        }
    ]
    (mask,) = source(write(tmp_path / "a.json", data)).segment(IMAGE)
    assert np.array_equal(full(mask), labels() == 7)
    assert mask.score == 1.0


def test_sam_automatic_masks(tmp_path):
    data = [
        {"segmentation": run_lengths(labels() == 7), "predicted_iou": 0.97, "area": 200, "bbox": [3, 2, 20, 10]},
        {"segmentation": run_lengths(labels() == 9), "predicted_iou": 0.9},
    ]
    polygons = source(write(tmp_path / "masks.json", data)).polygons(IMAGE)
    assert [(p.id, p.score, p.area) for p in polygons] == [(0, 0.97, 200), (1, 0.9, 320), (2, 0.9, 100)]
    entry = {"image": {"file_name": "x.jpg", "width": WIDTH, "height": HEIGHT}, "annotations": data}
    assert len(source(write(tmp_path / "sa1b.json", entry)).segment(IMAGE)) == 3


def test_the_image_is_chosen_by_its_file_name(tmp_path):
    images = [{"id": 1, "file_name": "right.png"}, {"id": 2, "file_name": "some/folder/left.png"}]
    data = coco(images=images)
    data["annotations"][1]["image_id"] = 2
    segmenter = source(write(tmp_path / "coco.json", data))
    assert [p.id for p in segmenter.polygons(IMAGE)] == [12]
    for path in (None, "other.png"):
        with pytest.raises(InputError, match="describes several images, 0 of them"):
            segmenter.polygons(Image(IMAGE.rgb, path))
    del data["images"]
    with pytest.raises(InputError, match="annotations of several images"):
        source(write(tmp_path / "bare.json", data)).polygons(IMAGE)


def test_our_own_geojson_comes_back_bit_for_bit(tmp_path):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    discs = [Mask(0, 0, (x - cx) ** 2 + (y - 20) ** 2 < r**2, 0.9, "disc") for cx, r in ((20, 15), (22, 6), (45, 12))]
    written = with_parents(vectorize(discs, VectorizeConfig(), 20, (WIDTH, HEIGHT)), VectorizeConfig())
    path = tmp_path / "left.geojson"
    geojson.write(path, geojson.feature_collection(written, None, "left.png", WIDTH, HEIGHT))
    segmenter = source(path)
    read = segmenter.polygons(IMAGE)
    assert segmenter.notes == []
    assert written[1].parent == 0
    for a, b in zip(written, read, strict=True):
        assert np.array_equal(a.exterior, b.exterior)
        assert (a.id, a.score, a.label, a.parent) == (b.id, b.score, b.label, b.parent)


def test_holes_stay(tmp_path):
    path = write(tmp_path / "a.json", features(feature(box(1, 1, 31, 31), box(5, 5, 15, 15), id=2)))
    segmenter = source(path)
    (polygon,) = segmenter.polygons(IMAGE)
    assert polygon.area == 800
    assert polygon.holes[0].shape == (4, 2)
    assert segmenter.segment(IMAGE)[0].area == 800


def test_pieces_of_a_multipolygon_are_regions(tmp_path):
    multi = {"type": "MultiPolygon", "coordinates": [[box(0, 0, 5, 5)], [box(10, 10, 30, 30)]]}
    data = features({"id": 4, "geometry": multi, "properties": {"label": "a"}}, feature(box(40, 0, 50, 9), id=1))
    found = source(write(tmp_path / "a.geojson", data)).polygons(IMAGE)
    assert [(p.id, p.area, p.label) for p in found] == [(4, 400, "a"), (5, 25, "a"), (1, 90, None)]


@pytest.mark.parametrize("ids", [(1, 1), (1, None), (1, 2**60)])
def test_ids_that_cannot_serve_are_replaced_and_that_is_said(tmp_path, ids):
    data = features(*(feature(box(10 * k, 0, 10 * k + 9, 9), id=id) for k, id in enumerate(ids)))
    segmenter = source(write(tmp_path / "a.geojson", data))
    assert [p.id for p in segmenter.polygons(IMAGE)] == [0, 1]
    assert segmenter.notes == ["the regions' ids are not distinct whole numbers: numbered from 0 instead"]


def test_polygons_are_cut_at_the_border(tmp_path):
    data = features(feature(box(-10, 5, 20, 25)), feature(box(30, 5, 40, 25)), feature(box(100, 0, 120, 20)))
    segmenter = source(write(tmp_path / "a.geojson", data))
    assert [p.bounds for p in segmenter.polygons(IMAGE)] == [(0, 5, 20, 25), (30, 5, 40, 25)]
    assert segmenter.notes == [
        "1 region reaching out of the image cut at its border",
        "1 region outside of the image left out",
    ]
    assert all(m.x0 >= 0 and m.x0 + m.bits.shape[1] <= WIDTH for m in segmenter.segment(IMAGE))


def test_crossing_rings_are_repaired(tmp_path):
    bow_tie = [[0, 0], [20, 20], [20, 0], [0, 20], [0, 0]]
    segmenter = source(write(tmp_path / "a.geojson", features(feature(bow_tie, id=3))))
    found = segmenter.polygons(IMAGE)
    assert [(p.id, p.area) for p in found] == [(3, 100), (4, 100)]
    assert all(p.shape.is_valid for p in found)
    assert segmenter.notes == ["1 region with crossing rings repaired"]


def test_a_hole_on_the_outline_stays_a_hole(tmp_path):
    data = features(feature(box(0, 0, 30, 30), [[0, 5], [0, 15], [10, 15], [10, 5]], id=3))
    segmenter = source(write(tmp_path / "a.json", data))
    (polygon,) = segmenter.polygons(IMAGE)
    assert polygon.area == segmenter.segment(IMAGE)[0].area == 800
    assert shape_of(open_regions(tmp_path / "a.json").read(IMAGE).regions[0]).area == 800
    twice = features(feature(box(0, 0, 30, 30), box(10, 10, 20, 20), box(10, 10, 20, 20)))
    assert source(write(tmp_path / "b.json", twice)).polygons(IMAGE)[0].area == 800


def test_rings_of_one_point_are_no_rings(tmp_path):
    point = [[5, 5]] * 4
    data = features(feature(box(0, 0, 10, 10), point), feature(point), feature([[1, 1], [1, 1], [9, 9], [9, 9]]))
    segmenter = source(write(tmp_path / "a.json", data))
    assert [p.area for p in segmenter.polygons(IMAGE)] == [100]
    assert segmenter.notes == ["2 regions with fewer than 3 vertices left out"]


def test_a_region_of_several_parts_is_reported_once(tmp_path):
    bow_ties = [[[[x, 0], [x + 20, 20], [x + 20, 0], [x, 20], [x, 0]]] for x in (0, 30)]
    multi = {"type": "MultiPolygon", "coordinates": [*bow_ties, *([box(100, y, 120, y + 9)] for y in (0, 20))]}
    segmenter = source(write(tmp_path / "a.json", features({"geometry": multi})))
    assert len(segmenter.polygons(IMAGE)) == 4
    assert segmenter.notes == [
        "1 region with crossing rings repaired",
        "1 region reaching out of the image cut at its border",
    ]


def test_what_has_no_area_is_left_out_and_that_is_said(tmp_path):
    data = features(
        feature(box(0, 0, 10, 10)),
        feature([[0, 0], [9, 9]]),
        feature([[1, 1], [5, 5], [9, 9], [1, 1]]),
        {"geometry": {"type": "Point", "coordinates": [3, 4]}},
        {"geometry": None},
    )
    segmenter = source(write(tmp_path / "a.geojson", data))
    assert len(segmenter.polygons(IMAGE)) == 1
    assert "1 region with fewer than 3 vertices left out" in segmenter.notes
    assert "1 region without any area left out" in segmenter.notes
    assert "2 regions that are no polygons left out" in segmenter.notes


def test_a_sliver_between_pixel_centres_has_no_mask(tmp_path):
    data = features(feature(box(0, 0, 10, 10)), feature(box(20.6, 1, 20.9, 39)))
    segmenter = source(write(tmp_path / "a.geojson", data))
    assert len(segmenter.polygons(IMAGE)) == 2
    assert [m.area for m in segmenter.segment(IMAGE)] == [100]
    assert segmenter.notes == ["1 region without a pixel centre inside left out"]


def test_vertices_are_not_moved(tmp_path):
    ring = np.random.default_rng(3).random((5, 2)) * (WIDTH, HEIGHT)
    hull = shapely.get_coordinates(shapely.MultiPoint(ring).convex_hull.exterior)
    (polygon,) = source(write(tmp_path / "a.json", features(feature(hull.tolist())))).polygons(IMAGE)
    assert {tuple(v) for v in polygon.exterior} == {tuple(v) for v in hull}


def refused(path, message, image=IMAGE):
    with pytest.raises(InputError, match=message) as caught:
        source(path).polygons(image)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)


RLE = {"size": [HEIGHT, WIDTH], "counts": [HEIGHT * WIDTH]}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([], "holds no region"),
        (features(), "holds no region"),
        (coco(annotations=[]), "holds no region"),
        ({}, "holds no regions that can be read: give a label image"),
        ([1, 2], "holds no regions that can be read"),
        ("text", "holds no regions that can be read"),
        (features(feature(box(100, 0, 120, 20))), "no region of at least 4 px\\^2 in the 60 x 40 px image"),
        (features(feature(box(13.37, 5.25, 13.38, 5.26))), "check that its coordinates are pixels"),
        (features(feature([[0, 0], [9, float("nan")], [9, 9]])), "not a finite number"),
        (features(feature(box(0, 0, 9, 9)), image={"width": 61, "height": 40}), "made for 61 x 40 px"),
        (coco(images=[{"id": 1, "width": 40, "height": 60}]), "made for 40 x 60 px, the image has 60 x 40 px"),
        ([{"segmentation": {"size": [4, 4], "counts": [16]}}], "annotation 0 of .* is made for 4 x 4 px"),
        ([{"segmentation": {"size": [HEIGHT], "counts": [16]}}], "without its size"),
        ([{"segmentation": {**RLE, "counts": [16]}}], "do not add up"),
        ([{"segmentation": {**RLE, "counts": [-1, HEIGHT * WIDTH + 1]}}], "do not add up"),
        ([{"segmentation": {**RLE, "counts": "~~~~~~"}}], "damaged"),
        ([{"segmentation": {**RLE, "counts": "   "}}], "damaged"),
        ([{"segmentation": {**RLE, "counts": "o"}}], "damaged"),
        ([{"segmentation": {**RLE, "counts": ""}}], "damaged"),
        ([{"segmentation": {**RLE, "counts": "123"}}], "do not add up"),
        ([{"segmentation": RLE}], "no region of at least"),
        ([{"segmentation": RLE, "score": "high"}], "score 'high'"),
        ([{"segmentation": [[1, 2, 3]]}], "neither RLE nor lists"),
        ([{"segmentation": [[1, 2, 3, None]]}], "not a finite number"),
        ([{"segmentation": 5}], "neither RLE nor lists"),
        ([{"segmentation": []}], "no region of at least"),
    ],
)
def test_json_that_cannot_be_used(tmp_path, data, message):
    refused(write(tmp_path / "regions.json", data), message)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", b"{", "not valid JSON"),
        ("a.json", b"", "not valid JSON"),
        ("a.json", b"\xff\xfe\x00", "not valid JSON"),
        ("a.geojson", b"[" * 100_000, "not valid JSON"),
        ("a.png", b"not a picture", "cannot read label image"),
        ("a.tif", b"", "cannot read label image"),
        ("a.npy", b"not an array", "cannot read label image"),
        ("a.npy", b"", "cannot read label image"),
        ("a.shp", b"anything", "give a label image .* COCO .* GeoJSON"),
    ],
)
def test_files_that_cannot_be_read(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    refused(tmp_path / name, message)


def test_a_missing_file(tmp_path):
    refused(tmp_path / "none.png", "does not exist: give a label image")


def test_a_truncated_label_image(tmp_path):
    path = save_labels(tmp_path / "a.png", np.random.default_rng(0).integers(0, 9, (HEIGHT, WIDTH), np.uint8))
    path.write_bytes(path.read_bytes()[:400])
    refused(path, "damaged")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((HEIGHT, WIDTH), np.uint8), "holds no region"),
        (np.ones((HEIGHT, WIDTH + 1), np.uint8), "made for 61 x 40 px"),
        (np.ones((HEIGHT, WIDTH, 3), np.uint8), "must have one band"),
        (np.ones((HEIGHT, WIDTH)), "not whole numbers"),
        (np.full((HEIGHT, WIDTH), -1), "values below 0"),
        (np.eye(HEIGHT, WIDTH, dtype=int), "no region of at least 4"),
    ],
)
def test_label_arrays_that_cannot_be_used(tmp_path, values, message):
    refused(save_labels(tmp_path / "labels.npy", values), message)
