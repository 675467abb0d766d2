import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as cocotools

from zpm2.formats.coco import coco
from zpm2.formats.run_lengths import compressed, run_lengths
from zpm2.model import Counterpart, Image, Mask, Polygon
from zpm2.polygons.rasterize import rasterize
from zpm2.polygons.shapes import from_shape
from zpm2.polygons.trace import trace
from zpm2.segment.given.precomputed import PrecomputedSegmenter

pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # inside pycocotools

SQUARE = np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]])


def annotation(mask, width, height):
    return coco([Polygon(0, SQUARE)], [mask], None, "a.png", width, height)["annotations"][0]


def full(mask, width, height):
    pixels = np.zeros((height, width), np.uint8)
    pixels[mask.y0 : mask.y0 + mask.bits.shape[0], mask.x0 : mask.x0 + mask.bits.shape[1]] = mask.bits
    return pixels


def agree(mask, width, height):
    """Text, pixels, area and box are those of pycocotools."""
    found, pixels = annotation(mask, width, height), full(mask, width, height)
    expected = cocotools.encode(np.asfortranarray(pixels))
    assert found["segmentation"] == {"size": [height, width], "counts": expected["counts"].decode()}
    assert np.array_equal(cocotools.decode(found["segmentation"]), pixels)
    assert found["area"] == cocotools.area(expected)
    assert found["bbox"] == cocotools.toBbox(expected).tolist()
    assert run_lengths(mask, width, height).sum() == width * height


@settings(max_examples=150, deadline=None)
@given(
    hnp.arrays(bool, hnp.array_shapes(min_dims=2, max_dims=2, max_side=7)),
    st.tuples(*[st.integers(0, 3)] * 4),
)
def test_masks_anywhere_are_as_pycocotools_has_them(bits, margins):
    left, top, right, bottom = margins
    agree(Mask(left, top, bits), left + bits.shape[1] + right, top + bits.shape[0] + bottom)


@pytest.mark.parametrize("margin", [0, 1])
@pytest.mark.parametrize("value", [False, True])
def test_whole_image_and_nothing(margin, value):
    agree(Mask(margin, margin, np.full((5, 6), value)), 6 + 2 * margin, 5 + 2 * margin)
    agree(Mask(0, 0, np.zeros((0, 0), bool)), 6, 5)


def test_blobs_touching_the_borders():
    rng = np.random.default_rng(0)
    for density in (0.03, 0.5, 0.97):
        agree(Mask(0, 0, rng.random((211, 307)) < density), 307, 211)
        agree(Mask(300, 200, rng.random((211, 307)) < density), 607, 600)


@given(st.lists(st.integers(0, 2**33), min_size=1, max_size=9))
def test_any_run_length_comes_back(counts):
    text, numbers, at = compressed(np.array(counts, np.int64)), [], 0
    while at < len(text):  # maskApi.c, rleFrString
        number, k, more = 0, 0, True
        while more:
            code = ord(text[at]) - 48
            number |= (code & 31) << 5 * k
            more, at, k = bool(code & 32), at + 1, k + 1
            if not more and code & 16:
                number |= -1 << 5 * k
        numbers.append(number + numbers[-2] if len(numbers) > 2 else number)
    assert numbers == counts


def test_a_large_image_needs_no_mask_of_its_size():
    width, height = 23_000, 15_000
    found = annotation(Mask(22_990, 14_990, np.ones((10, 10), bool)), width, height)
    assert cocotools.area(found["segmentation"]) == found["area"] == 100
    assert cocotools.toBbox(found["segmentation"]).tolist() == found["bbox"] == [22_990, 14_990, 10, 10]


def test_what_lies_beyond_the_image_is_cut_off():
    bits = np.ones((6, 6), bool)
    assert annotation(Mask(-2, -3, bits), 20, 20)["bbox"] == [0, 0, 4, 3]
    assert annotation(Mask(17, 18, bits), 20, 20)["bbox"] == [17, 18, 3, 2]
    assert annotation(Mask(-2, -3, bits), 3, 2)["area"] == 6
    for mask in (Mask(25, 3, bits), Mask(3, -9, bits)):
        found = annotation(mask, 20, 20)
        assert (found["area"], found["bbox"]) == (0, [0, 0, 0, 0])
        assert not cocotools.decode(found["segmentation"]).any()


def test_members():
    polygons = [Polygon(7, SQUARE, (), 0.5, None, "roof"), Polygon(9, SQUARE), Polygon(11, SQUARE, label="roof")]
    data = coco(polygons, map(rasterize, [p.shape for p in polygons]), {7: Counterpart(7, 3, 0.25)}, "left.png", 10, 8)
    assert data["images"] == [{"id": 1, "file_name": "left.png", "width": 10, "height": 8}]
    assert data["categories"] == [{"id": 1, "name": "region"}, {"id": 2, "name": "roof"}]
    assert [(a["id"], a["polygon_id"], a["category_id"], a["score"]) for a in data["annotations"]] == [
        (1, 7, 2, 0.5),
        (2, 9, 1, 1),
        (3, 11, 2, 1),
    ]
    assert [(a["match"], a["match_id"], a["confidence"]) for a in data["annotations"]] == [
        (3, 7, 0.25),
        (None, None, None),
        (None, None, None),
    ]
    assert all(a["image_id"] == 1 and a["iscrowd"] == 0 for a in data["annotations"])
    assert json.loads(json.dumps(data)) == data  # plain numbers throughout
    assert coco([], [], None, "a.png", 5, 5)["annotations"] == []


def test_masks_and_polygons_are_as_many():
    with pytest.raises(ValueError, match="zip"):
        coco([Polygon(0, SQUARE)], [], None, "a.png", 5, 5)


def test_the_segmenter_reads_it_back(tmp_path):
    bits = np.zeros((2, 30, 40), bool)
    bits[0, 3:20, 0:9] = bits[1, 10:30, 20:40] = True
    bits[1, 15:20, 25:30] = False
    polygons = [from_shape(trace(b)[0], 4 + k, 0.5, "roof") for k, b in enumerate(bits)]
    path = tmp_path / "left.json"
    path.write_text(json.dumps(coco(polygons, (rasterize(p.shape) for p in polygons), None, "left.png", 40, 30)))
    image = Image(np.zeros((30, 40, 3), np.uint8))
    masks = PrecomputedSegmenter(path, min_area=1).segment(image)
    assert all(np.array_equal(full(m, 40, 30), b) for m, b in zip(masks, bits, strict=True))
    back = PrecomputedSegmenter(path, min_area=1).polygons(image)
    assert [(p.id, p.score, p.label) for p in back] == [(4, 0.5, "roof"), (5, 0.5, "roof")]
