import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.model import Image, ImagePolygons, Polygon, PolygonMatch
from zpm2.view import overlay, unmatched
from zpm2.view.labels import MAX_LABEL, MIN_LABEL, REACH, SPACE, _centers, _sums, labels_of, write
from zpm2.view.legend import HEADER, Key, Legend
from zpm2.view.overlay import GAP
from zpm2.view.panel import PanelFrame, painted, region_of

WIDTH, HEIGHT = 400, 300


def _box(index, x0, y0, x1, y1):
    return Polygon(index, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float))


def _labels(polygons, crowded=False, size=(WIDTH, HEIGHT)):
    """Labels, masks, owners, boxes in the order in which regions are painted, and the frame's empty panel."""
    frame = PanelFrame("left", Image(np.full((size[1], size[0], 3), 90, np.uint8)), size, size)
    regions = [region_of(p, frame, p.area / (size[0] * size[1]), (200, 90, 40), str(p.id)) for p in polygons]
    order = sorted(regions, key=lambda region: -region.area)
    panel, masks, owner = painted(frame, order, [], 0, crowded)
    return labels_of(order, masks, owner, "left", crowded), masks, owner, order, panel


def _gap(a, b):
    """px between two boxes across and down; negative where they overlap."""
    return max(a[0], b[0]) - min(a[2], b[2]), max(a[1], b[1]) - min(a[3], b[3])


boxes = st.lists(
    st.tuples(st.floats(-20, 390), st.floats(-20, 290), st.floats(1, 150), st.floats(1, 120)), min_size=0, max_size=25
)


@settings(max_examples=30, deadline=None)
@given(boxes, st.booleans())
def test_labels_never_overlap_nor_leave_the_panel(places, crowded):
    polygons = [_box(1000 + k, x, y, x + w, y + h) for k, (x, y, w, h) in enumerate(places)]
    labels, masks, _, order, panel = _labels(polygons, crowded)
    assert len({label.text for label in labels}) == len(labels)
    for a, b in itertools.combinations(labels, 2):
        across, down = _gap(a.box, b.box)
        assert across >= SPACE[0] or down >= SPACE[1]
    for label in labels:
        assert MIN_LABEL <= label.size <= MAX_LABEL
        x0, y0, x1, y1 = label.box
        assert 0 <= x0 < x1 <= WIDTH
        assert 0 <= y0 < y1 <= HEIGHT
        if label.tick is not None:
            assert not crowded
            k = next(k for k, region in enumerate(order) if region.label == label.text)
            assert masks[k][label.tick[1] - order[k].box[1], label.tick[0] - order[k].box[0]]
    inside = [label for label in labels if label.tick is None]
    written = write(np.full_like(panel, 90), inside) != 90
    for label in inside:  # the text stays in its box
        written[label.box[1] : label.box[3], label.box[0] : label.box[2]] = False
    assert not written.any()
    again = _labels(polygons, crowded)[0]
    assert again == labels


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 9), st.integers(0, 1000))
def test_few_regions_all_have_a_number_in_or_beside_them(count, seed):
    rng = np.random.default_rng(seed)
    places = np.c_[rng.uniform(20, 350, count), rng.uniform(40, 250, count), rng.uniform(2, 60, (count, 2))]
    polygons = [_box(10 + k, x, y, x + w, y + h) for k, (x, y, w, h) in enumerate(places)]
    labels, _, _, order, _ = _labels(polygons)
    found = {label.text: label for label in labels}
    assert set(found) == {"left", *(region.label for region in order)}
    for region in order:
        assert max(_gap(found[region.label].box, region.box)) <= REACH


def test_the_type_follows_the_size_of_the_region():
    labels, *_ = _labels([_box(1, 30, 40, 330, 280), _box(2, 340, 40, 380, 80), _box(3, 345, 200, 352, 207)])
    sizes = {label.text: label.size for label in labels}
    assert sizes["1"] == MAX_LABEL > sizes["2"] > sizes["3"] == MIN_LABEL


def test_a_number_lies_in_the_visible_part_of_its_region():
    labels, _, owner, order, _ = _labels([_box(1, 20, 40, 380, 280), _box(2, 100, 60, 360, 260)])
    for label in labels[1:]:
        x0, y0, x1, y1 = label.box
        k = next(k for k, region in enumerate(order) if region.label == label.text)
        assert (owner[y0:y1, x0:x1] == k).all()


def test_a_number_beside_its_region_hides_no_small_one():
    row = [_box(k, 100 + 8 * k, 150, 106 + 8 * k, 156) for k in range(8)]
    labels, _, owner, _, _ = _labels(row)
    assert len(labels) > 4
    for label in labels[1:]:
        x0, y0, x1, y1 = label.box
        assert label.tick is not None
        assert (owner[y0:y1, x0:x1] == -1).all()


def test_a_region_outside_the_panel_has_no_number():
    labels, *_ = _labels([_box(1, 900, 900, 950, 950)])
    assert [label.text for label in labels] == ["left"]
    labels, *_ = _labels([_box(1, 2, 2, 9, 9)], size=(12, 12))  # a panel without room for any
    assert labels == []


@given(st.integers(1, 30), st.integers(1, 20), st.integers(0, 99))
def test_sums_over_boxes(width, height, seed):
    mask = np.random.default_rng(seed).integers(0, 2, (24, 33), np.uint8)
    sums, centers = _sums(mask, width, height), _centers(mask.astype(np.float32), width, height)
    assert sums.shape == centers.shape == (25 - height, 34 - width)
    for y, x in ((0, 0), (24 - height, 33 - width), ((24 - height) // 2, (33 - width) // 3)):
        assert sums[y, x] == mask[y : y + height, x : x + width].sum()
        assert centers[y, x] == mask[y + height // 2, x + width // 2]


def _pair(size, polygons):
    image = Image(np.full((size[1], size[0], 3), 120, np.uint8))
    side = ImagePolygons(*size, polygons, image=image)
    matches = [PolygonMatch(p.id, p.id, confidence=0.9, cost=1.0, dsf=5, stage="global") for p in polygons]
    return side, side, matches


@pytest.mark.parametrize("size", [(60, 40), (40, 1600), (1600, 30), (1, 1), (700, 500)])
def test_pictures_of_any_shape_are_no_larger_than_asked_and_have_a_legend(size):
    left, right, matches = _pair(size, [_box(1, 0, 0, size[0], size[1])])
    for picture in (overlay(left, right, matches, 1200), unmatched(left, right, [], 1200)):
        assert max(picture.shape[:2]) <= 1200
        assert picture.shape[1] >= 640
        assert (picture[:HEADER] > 200).all(axis=2).any()


def test_the_legend_says_how_many_numbers_are_left_out(monkeypatch):
    said = []
    draw = Legend.draw
    monkeypatch.setattr(Legend, "draw", lambda legend, *given: said.append(legend) or draw(legend, *given))
    crowd = [
        _box(1000 + k, 5 + 9 * (k % 40), 5 + 9 * (k // 40), 9 + 9 * (k % 40), 9 + 9 * (k // 40)) for k in range(320)
    ]
    left, right, matches = _pair((400, 300), [*crowd, _box(1, 100, 150, 300, 250)])
    overlay(left, right, matches, 800 + GAP)
    unmatched(left, right, [], 800 + GAP)
    overlay(left, right, matches[-1:], 800 + GAP)
    assert said[0].remarks[-1] == "without a number, for lack of room: 320"
    assert said[1].remarks[-1] == "without a number, for lack of room: 640"
    assert not any("lack of room" in remark for remark in said[2].remarks)


def test_small_pictures_are_not_all_legend():
    left, right, matches = _pair((300, 200), [_box(1, 20, 20, 250, 150)])
    picture = overlay(left, right, matches, 240)
    assert max(picture.shape[:2]) <= 240
    assert (np.ptp(picture[80:].astype(int), axis=2) > 40).sum() > 1000


@given(st.integers(640, 2400), st.integers(0, 6))
def test_all_entries_of_a_legend_are_in_the_picture(width, count):
    legend = Legend(
        "a title", "reason", [Key(f"reason number {k}: 123 left", (9, 9, 9)) for k in range(count)], ["abc"]
    )
    lines = legend._lines(width)
    assert sum(map(len, lines)) == count + 1 + (count > 0)
    assert all(sum(key.width + 20 for key in line) - 20 + 24 <= width for line in lines)
    assert legend.height(width) == HEADER + 26 * (len(lines) - 1)
