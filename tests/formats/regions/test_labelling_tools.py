"""Labelme, CVAT, YOLO and COCO: what they write is understood, and what they cannot mean is refused in one line."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from region_samples import BITS, CVAT, HEIGHT, SAMPLES, WIDTH, Photo, box

from zpm2.errors import InputError
from zpm2.formats.regions.outlines import _edge_of, one_ring, pixels_of, rings_of, shape_of
from zpm2.formats.regions.region import CarriedRegion, GivenRegions
from zpm2.formats.regions.registry import open_regions, write_regions
from zpm2.formats.regions.yolo import _names_in_yaml
from zpm2.model import Mask
from zpm2.polygons.trace import trace

PHOTO = Photo()
BY_NAME = {sample.name: sample for sample in SAMPLES}


def read(path: Path, photo: Photo = PHOTO) -> GivenRegions:
    return open_regions(path).read(photo)


def made(name: str, folder: Path) -> Path:
    BY_NAME[name].make(folder / BY_NAME[name].file)
    return folder / BY_NAME[name].file


def refused(path: Path, message: str, photo: Photo = PHOTO) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(path, photo)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)


# --- Labelme


def labelme(folder: Path, **shape: object) -> Path:
    whole = {"label": "a", "points": box(1, 1, 9, 9), "shape_type": "polygon"} | shape
    path = folder / "a.json"
    path.write_text(json.dumps({"shapes": [whole], "imagePath": "left.png", "imageData": None}))
    return path


def test_labelme(tmp_path: Path) -> None:
    found = read(made("Labelme", tmp_path))
    shapes = [shape_of(region) for region in found.regions]
    assert [region.label for region in found.regions] == ["roof", "door", "wheel", "mask"]
    assert found.notes == ["1 shape without an area (points, lines) left out"]
    assert shapes[0].area == pytest.approx(17.5 * 18)
    assert shapes[1].bounds == (30, 5, 45.5, 12)
    assert shapes[2].area == pytest.approx(np.pi * 36, rel=0.002)
    assert shapes[3].area == BITS.sum()
    given_ = found.regions[0].properties
    assert (given_["group_id"], given_["flags"], given_["description"]) == (4, {"occluded": True}, "of the city")
    assert "imageData" not in given_


def test_labelme_keeps_what_it_does_not_know(tmp_path: Path) -> None:
    file = open_regions(made("Labelme", tmp_path))
    entries = [CarriedRegion(r, shape_of(r)) for r in file.read(PHOTO).regions]
    write_regions(tmp_path, file, entries, Photo("/x/right.png", 70, 50))
    data = json.loads((tmp_path / "regions.json").read_text())
    assert (data["imagePath"], data["imageData"], data["imageWidth"], data["imageHeight"]) == (
        "right.png",
        None,
        70,
        50,
    )
    assert (data["version"], data["flags"], data["lineColor"]) == ("5.5.0", {"night": True}, [0, 255, 0])
    assert [s["shape_type"] for s in data["shapes"]] == ["polygon", "polygon", "polygon", "mask"]
    assert data["shapes"][0]["own"] == [1]


def test_labelme_finds_the_photograph(tmp_path: Path) -> None:
    """By its path from the written file, and in the file itself if the given one held its own."""
    (tmp_path / "out").mkdir()
    (tmp_path / "right.png").write_bytes(b"right")
    right = Photo(str(tmp_path / "right.png"))
    for name, content in (("Labelme", base64.b64encode(b"right").decode()), ("without", None)):
        path = made(name, tmp_path) if content else labelme(tmp_path)
        write_regions(tmp_path / "out", open_regions(path), [], right)
        data = json.loads((tmp_path / "out" / "regions.json").read_text())
        assert (data["imagePath"], data["imageData"]) == ("../right.png", content)


def test_text_and_numbers_that_no_file_can_hold(tmp_path: Path) -> None:
    file = open_regions(labelme(tmp_path, own="\ud800", number=float("nan")))
    (region,) = file.read(PHOTO).regions
    attributes = {"confidence": np.float32(0.5), "inside": np.int64(3), "dx": float("nan")}
    write_regions(tmp_path, file, [CarriedRegion(region, shape_of(region), attributes)], PHOTO)
    (shape,) = json.loads((tmp_path / "regions.json").read_text())["shapes"]
    assert (shape["own"], shape["number"]) == ("?", None)
    assert (shape["zpm2_confidence"], shape["zpm2_inside"], shape["zpm2_dx"]) == (0.5, 3, None)
    (row,) = json.loads((tmp_path / "regions.zpm2.json").read_text())["regions"]
    assert (row["confidence"], row["inside"], row["dx"]) == (0.5, 3, None)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"points": [[1, 1]], "shape_type": "circle"}, "a 'circle' of 1 point"),
        ({"points": [[1, 1]], "shape_type": "rectangle"}, "a 'rectangle' of 1 point"),
        ({"points": [[1, 1], [2, 2]], "shape_type": "spline"}, "a 'spline' of 2 points"),
        ({"points": "all"}, "has no list of points"),
        ({"points": [[1, None], [2, 2]]}, "not a finite number"),
        ({"points": [[1, "x"], [2, 2]]}, "not a list of"),
        ({"points": [[1, 1], [5, 5]], "shape_type": "mask"}, "not a PNG"),
        ({"points": [[1, 1], [5, 5]], "shape_type": "mask", "mask": "%%%"}, "not a PNG"),
        ({"points": [[1, 1], [5, 5]], "shape_type": "mask", "mask": "aGVsbG8="}, "not a PNG"),
    ],
)
def test_shapes_that_labelme_does_not_write(tmp_path: Path, shape: dict[str, object], message: str) -> None:
    refused(labelme(tmp_path, **shape), message)


def test_a_labelme_file_of_another_photograph(tmp_path: Path) -> None:
    path = made("Labelme", tmp_path)
    refused(path, "made for 60 x 40 px, the image has 40 x 60 px.*EXIF", Photo(width=40, height=60))
    assert "swapped" in read(path, Photo("right.png")).notes[0]


# --- CVAT


def cvat(folder: Path, shapes: str, **size: int) -> Path:
    sides = "".join(f' {name}="{value}"' for name, value in size.items())
    path = folder / "a.xml"
    path.write_text(f'<annotations><image id="0" name="left.png"{sides}>{shapes}</image></annotations>')
    return path


def test_cvat(tmp_path: Path) -> None:
    found = read(made("CVAT", tmp_path))
    shapes = [shape_of(region) for region in found.regions]
    assert [region.label for region in found.regions] == ["roof", "door", "wheel", "mask"]
    assert found.notes == ["1 shape without an area (points, lines, tags, ...) left out"]
    assert shapes[0].area == 17.5 * 18 / 2
    turned = shapely.affinity.rotate(shapely.box(30, 5, 45.5, 12), 90, "center")
    assert shapes[1].symmetric_difference(turned).area < 1e-9
    assert shapes[2].area == pytest.approx(np.pi * 40, rel=0.002)
    body = found.regions[3].body
    assert isinstance(body, Mask)
    assert np.array_equal(body.bits, BITS[25:35, 5:25])
    properties = found.regions[0].properties
    assert properties == {
        "source": "manual",
        "occluded": "1",
        "z_order": "3",
        "group_id": "2",
        "storeys": "3",
        "owner": "Straße & Söhne",
    }


def test_a_box_turns_clockwise(tmp_path: Path) -> None:
    shapes = '<box label="a" xtl="10" ytl="10" xbr="30" ybr="20" rotation="30"/>'
    (region,) = read(cvat(tmp_path, shapes)).regions
    corners = shapely.get_coordinates(shape_of(region))
    assert corners[:, 1][np.argmax(corners[:, 0])] > 15  # the right side went down


def test_the_photograph_is_found_by_its_name(tmp_path: Path) -> None:
    refused(made("CVAT", tmp_path), "describes several images, 0 of them", Photo("none.png"))


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ('<polygon label="a" points="1,1;2"/>', "not a list of"),
        ('<polygon label="a" points="1,1;2,x"/>', "'x' where a number must be"),
        ('<polygon label="a" points="1,1;2,nan"/>', "not a finite number"),
        ('<polygon label="a"/>', "where a number must be"),
        ('<box label="a" xtl="1" ytl="1" xbr="5"/>', "ybr, has '' where a number must be"),
        ('<mask label="a" rle="0, 5" left="0" top="0" width="4" height="2"/>', "run lengths"),
        ('<mask label="a" rle="0, x" left="0" top="0" width="4" height="2"/>', "run lengths"),
        ('<mask label="a" rle="0, 8" left="58" top="0" width="4" height="2"/>', "reaches out"),
        ('<mask label="a" rle="0" left="0" top="0" width="-4" height="2"/>', "reaches out"),
    ],
)
def test_shapes_that_cvat_does_not_write(tmp_path: Path, shapes: str, message: str) -> None:
    refused(cvat(tmp_path, shapes), message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not valid XML"),
        ("<annotations>", "not valid XML"),
        ("<svg/>", "not of CVAT for images"),
        ("<annotations><version>1.1</version></annotations>", "not of CVAT for images"),
        ('<annotations><track id="0" label="a"/></annotations>', "CVAT for video"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><annotations>&b;</annotations>", "document type or entities"),
        ("<a>" * 100 + "</a>" * 100, "not valid XML"),
        ("<a>" * 100_000 + "</a>" * 100_000, "not valid XML"),
    ],
)
def test_xml_that_is_not_read(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.xml").write_text(text)
    refused(tmp_path / "a.xml", message)


def test_xml_in_another_encoding_hides_no_entities(tmp_path: Path) -> None:
    text = '<?xml version="1.0" encoding="utf-16"?><!DOCTYPE a [<!ENTITY b "c">]><annotations>&b;</annotations>'
    (tmp_path / "a.xml").write_bytes(text.encode("utf-16"))
    refused(tmp_path / "a.xml", "not valid XML in UTF-8")


def test_cvat_writes_one_image_and_the_task(tmp_path: Path) -> None:
    file = open_regions(made("CVAT", tmp_path))
    entries = [CarriedRegion(r, shape_of(r), {"visible": 0.5, "moved": True}) for r in file.read(PHOTO).regions]
    write_regions(tmp_path, file, entries, Photo("/x/right.png", 70, 50))
    text = (tmp_path / "regions.xml").read_text(encoding="utf-8")
    assert text.count("<image ") == 1
    assert '<image id="1" name="right.png" subset="train" width="70" height="50">' in text
    assert "<task>" in text
    assert '<attribute name="zpm2_visible">0.5</attribute>' in text
    assert '<attribute name="zpm2_moved">true</attribute>' in text
    assert CVAT.count("<polyline") == 1
    assert "<polyline" not in text


# --- YOLO


def yolo(folder: Path, text: str) -> Path:
    (folder / "a.txt").write_text(text)
    return folder / "a.txt"


def test_yolo(tmp_path: Path) -> None:
    found = read(made("YOLO", tmp_path))
    assert [region.label for region in found.regions] == ["roof, red", "door", "wheel"]
    assert [region.score for region in found.regions] == [1.0, 1.0, 0.875]
    assert shape_of(found.regions[0]).area == pytest.approx(0.4 * 0.4 / 2 * WIDTH * HEIGHT)
    assert shape_of(found.regions[1]).bounds == pytest.approx((36, 10, 48, 30))
    assert found.notes == []


def test_yolo_without_names(tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b" / "c"
    deep.mkdir(parents=True)
    found = read(yolo(deep, "3 0.1 0.1 0.5 0.1 0.5 0.5\n"))
    assert [region.label for region in found.regions] == ["3"]
    assert found.notes == ["a.txt: no classes.txt or data.yaml with the names of its classes was found"]
    (tmp_path / "a" / "classes.txt").write_text("x\ny\nz\nhouse\n")
    assert [region.label for region in read(deep / "a.txt").regions] == ["house"]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("names: [a, 'b, c']\n", ["a", "b, c"]),
        ("names: [a, 'b', \"d\"]  # three\nnc: 3", ["a", "b", "d"]),
        ("path: x\nnames:\n- a\n- 'b: c'\n\n- d # e\nnc: 3\n- f", ["a", "b: c", "d"]),
        ("names:\n  0: a\n  2: b\n", ["a", "1", "b"]),
        ("names:\n  1000000: a\n", []),
        ("name: x", []),
        ("names: {0: a}", []),
    ],
)
def test_names_in_yaml(text: str, names: list[str]) -> None:
    assert _names_in_yaml(text) == names


@pytest.mark.parametrize(
    "text", ["hello\n", "0 1 2\n", "0.5 0.1 0.1 0.5 0.1 0.5 0.5\n", "0 0.1 0.1 0.1 1e\n", "-1 0 0 1 1"]
)
def test_other_texts(tmp_path: Path, text: str) -> None:
    refused(yolo(tmp_path, text), "holds no regions that can be read")


def test_pixels_are_no_shares(tmp_path: Path) -> None:
    refused(yolo(tmp_path, "0 10 10 50 10 50 50\n"), "no shares of the image")
    refused(yolo(tmp_path, "0 0.1 0.1 1e999 0.1 0.5 0.5\n"), "no shares of the image")


def test_an_empty_text_holds_no_region(tmp_path: Path) -> None:
    assert read(yolo(tmp_path, "\n")).regions == []


# --- one ring


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2), st.booleans()), min_size=1, max_size=6, unique=True))
def test_one_ring_is_the_shape(cells: list[tuple[int, int, bool]]) -> None:
    """Several parts with and without holes: the same pixels by the even-odd rule, and the same shape once repaired."""
    parts = {}
    for x, y, hole in cells:
        outer = shapely.box(15 * x, 13 * y, 15 * x + 10, 13 * y + 9.5)
        parts[x, y] = outer.difference(shapely.box(15 * x + 2, 13 * y + 2, 15 * x + 6, 13 * y + 5.5)) if hole else outer
    shape = shapely.MultiPolygon(list(parts.values()))
    ring = shapely.Polygon(one_ring(shape))
    one, other = pixels_of(shape, PHOTO), pixels_of(ring, PHOTO)
    assert (one.x0, one.y0) == (other.x0, other.y0)
    assert np.array_equal(one.bits, other.bits)
    assert shapely.make_valid(ring).symmetric_difference(shape).area < 1e-9


@pytest.mark.parametrize("turn", [0, 0.3])
def test_one_ring_goes_to_the_nearest_ring_of_all(turn: float) -> None:
    bits = np.ones((42, 42), bool)
    bits[2:-2:4, 2:-2:4] = False
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shape = shapely.transform(trace(bits)[0], lambda points: points @ matrix.T)
    merged, *others = rings_of(shapely.geometry.polygon.orient(shape))
    while others:
        line = shapely.linestrings(merged)
        ring = others.pop(int(np.argmin([shapely.distance(line, shapely.linestrings(ring)) for ring in others])))
        here, there = shapely.get_coordinates(shapely.shortest_line(line, shapely.linestrings(ring)))
        edge, last = _edge_of(merged, here), _edge_of(ring, there)
        added = [[here, there], ring[last + 1 :], ring[1 : last + 1], [there, here]]
        merged = np.concatenate([merged[: edge + 1], *added, merged[edge + 1 :]])
    assert np.array_equal(one_ring(shape), merged[:-1][(merged[:-1] != merged[1:]).any(1)])


# --- COCO


def test_pycocotools_reads_what_is_written(tmp_path: Path) -> None:
    coco = pytest.importorskip("pycocotools.coco")
    file = open_regions(made("COCO", tmp_path))
    regions = file.read(PHOTO).regions
    shapes = [shape_of(region) for region in regions]
    write_regions(tmp_path, file, [CarriedRegion(r, s) for r, s in zip(regions, shapes, strict=True)], PHOTO)
    path = tmp_path / "regions.json"
    data = json.loads(path.read_text())
    assert [image["id"] for image in data["images"]] == [3]
    assert data["images"][0]["license"] == 1
    assert (data["info"], data["licenses"]) == ({"description": "houses"}, [{"id": 1}])
    assert "keypoints" not in data["annotations"][0]
    back = coco.COCO(str(path))
    assert back.annToMask(data["annotations"][1]).sum() == BITS.sum() == data["annotations"][1]["area"]
    assert back.annToMask(data["annotations"][0]).sum() == pytest.approx(shapes[0].area, rel=0.1)
