"""Documents of Labelme, CVAT and YOLO that no given file stands behind: the polygons of a result."""

import base64
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import PIL.Image
import pytest
import shapely
from region_samples import HEIGHT, HOLED, WIDTH, box

from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.region import GivenRegions
from zpm2.formats.regions.registry import open_regions
from zpm2.model import ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.polygons.shapes import from_shape
from zpm2.result import MatchResult

MARKUP = "<b>\"Tür & Tor'"
KINDS = {"labelme": "left.labelme.json", "cvat": "left.cvat.xml", "yolo": "left.yolo.txt"}


def polygons(*labels: str | None) -> list[Polygon]:
    shapes = [shapely.Polygon(HOLED[0], HOLED[1:]), shapely.box(30, 2, 40, 12.5), shapely.Polygon(box(42, 4, 55, 30))]
    given = {"storeys": 3, "occluded": "1", "zpm2_status": "of an earlier run", "source_area": "x"}
    return [
        replace(from_shape(shape, 3 * k + 2, label=label), source_id=f"way/{k}", properties=given if k == 1 else {})
        for k, (shape, label) in enumerate(zip(shapes, labels, strict=True))
    ]


@pytest.fixture
def result(tmp_path: Path) -> MatchResult:
    sides = []
    for name, labels in (("left", ("roof", MARKUP, None)), ("right", ("door", MARKUP, None))):
        path = tmp_path / f"{name}.png"
        PIL.Image.fromarray(np.full((HEIGHT, WIDTH, 3), len(name), np.uint8)).save(path)
        sides.append(ImagePolygons(WIDTH, HEIGHT, polygons(*labels), str(path), unmatched={8: "hidden"}))
    matches = [PolygonMatch(2, 5, 0.875, 1.5, 3, "local"), PolygonMatch(5, 2, 0.5, 2.5, 1, "local")]
    return MatchResult(sides[0], sides[1], matches, PointMatches.empty(), np.eye(3), np.eye(3), {}, {})


def saved(result: MatchResult, folder: Path, kind: str) -> tuple[Path, GivenRegions]:
    path = result.save(folder / "out", [kind]) / KINDS[kind]
    return path, open_regions(path).read(result.left)


@pytest.mark.parametrize("kind", KINDS)
def test_our_readers_read_what_is_written(result: MatchResult, tmp_path: Path, kind: str) -> None:
    _, found = saved(result, tmp_path, kind)
    assert found.notes == []
    assert [region.label for region in found.regions] == ["roof", MARKUP, "region"]
    for region, polygon in zip(found.regions, result.left.polygons, strict=True):
        shape = shape_of(region)
        assert shape is not None
        assert shape.symmetric_difference(polygon.shape).area < 1e-6


@pytest.mark.parametrize("kind", ["labelme", "cvat"])
def test_properties_given_and_ours(result: MatchResult, tmp_path: Path, kind: str) -> None:
    _, found = saved(result, tmp_path, kind)
    rows = [{key: str(value) for key, value in region.properties.items()} for region in found.regions]
    ours = {"zpm2_id": "2", "zpm2_match": "5", "zpm2_match_id": "2", "zpm2_confidence": "0.875"}
    assert rows[0].items() >= ours.items()
    assert rows[1].items() >= {"storeys": "3", "occluded": "1", "source_area": "x", "zpm2_source_id": "way/1"}.items()
    assert "zpm2_status" not in rows[1]
    assert rows[2]["zpm2_unmatched"] == "hidden"
    assert "zpm2_match" not in rows[2]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_bytes_and_no_polygons(result: MatchResult, tmp_path: Path, kind: str) -> None:
    path, _ = saved(result, tmp_path, kind)
    before = path.read_bytes()
    assert saved(result, tmp_path, kind)[0].read_bytes() == before
    left = ImagePolygons(WIDTH, HEIGHT, [], result.left.path)
    empty = MatchResult(left, left, [], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})
    assert saved(empty, tmp_path / "empty", kind)[1].regions == []


def test_labelme_has_the_photograph(result: MatchResult, tmp_path: Path) -> None:
    path, _ = saved(result, tmp_path, "labelme")
    data = json.loads(path.read_text())
    assert base64.b64decode(data["imageData"]) == (tmp_path / "left.png").read_bytes()
    assert (data["imagePath"], data["imageWidth"], data["imageHeight"]) == ("../left.png", WIDTH, HEIGHT)
    assert [shape["shape_type"] for shape in data["shapes"]] == ["polygon"] * 3
    assert {"version", "flags"} <= data.keys()


def test_cvat_lists_the_labels_of_both(result: MatchResult, tmp_path: Path) -> None:
    path, _ = saved(result, tmp_path, "cvat")
    root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    assert [each.text for each in root.findall("meta/task/labels/label/name")] == sorted(
        ["door", "region", "roof", MARKUP]
    )
    (image,) = root.findall("image")
    assert image.attrib == {"id": "0", "name": "left.png", "width": str(WIDTH), "height": str(HEIGHT)}
    assert all({"label", "source", "occluded", "z_order", "points"} <= set(each.keys()) for each in image)


def test_cvat_holds_what_xml_cannot(result: MatchResult, tmp_path: Path) -> None:
    (first, *_) = result.left.polygons
    odd_properties = {"x\x0b": "\x01", "list": [1, True, "é"]}
    shown = replace(from_shape(first.shape, 0, label="a\x00b"), properties=odd_properties)
    left = ImagePolygons(WIDTH, HEIGHT, [shown], result.left.path)
    odd = MatchResult(left, left, [], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})
    (region,) = saved(odd, tmp_path, "cvat")[1].regions
    assert region.label == "a?b"
    assert region.properties.items() >= {"x?": "?", "list": '[1, true, "é"]'}.items()


def test_yolo_numbers_are_the_same_in_both(result: MatchResult, tmp_path: Path) -> None:
    (first, second, _) = result.left.polygons
    lines = [from_shape(first.shape, 0, label="b\n c"), from_shape(second.shape, 1, label="b c")]
    left = ImagePolygons(WIDTH, HEIGHT, lines, result.left.path)
    both = MatchResult(left, result.right, [], PointMatches.empty(), np.eye(3), np.eye(3), {}, {})
    path, found = saved(both, tmp_path, "yolo")
    assert [region.label for region in found.regions] == ["b c", "b c"]
    other = open_regions(path.with_name("right.yolo.txt")).read(both.right)
    assert [region.label for region in other.regions] == ["door", MARKUP, "region"]
    assert path.with_name("classes.txt").read_text().splitlines() == sorted(["b c", "door", MARKUP, "region"])
