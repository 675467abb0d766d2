"""The segmenter without weights: its tree, and the prompts that it takes."""

import cv2
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from painted import blank

from zpm2.config import SegmentConfig
from zpm2.errors import WeightsError
from zpm2.model import Image
from zpm2.segment import registry
from zpm2.segment.classical import WARNING, ClassicalSegmenter
from zpm2.segment.partition_tree import PartitionTree, partition_tree
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskThresholds, Prompts
from zpm2.segment.protocol import PromptedSegmenter, notes_of

EVERYTHING = MaskThresholds(0.0, 0.0)
CLEAR = MaskThresholds(0.5, 0.0)


def nested(width: int = 400, height: int = 300) -> Image:
    """A red disc with a yellow square in it, and a blue bar, on grey."""
    rgb = np.full((height, width, 3), 120, np.uint8)
    cv2.circle(rgb, (120, 150), 80, (200, 30, 30), -1)
    cv2.rectangle(rgb, (100, 130), (140, 170), (230, 220, 40), -1)
    cv2.rectangle(rgb, (280, 40), (360, 260), (40, 60, 220), -1)
    return Image(rgb)


def of(tree: PartitionTree, node: int) -> NDArray[np.bool_]:
    return tree.bits(node, np.s_[:, :])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 40), st.integers(2, 40), st.integers(1, 5))
def test_every_node_is_its_children_and_knows_its_area_and_box(
    seed: int, width: int, height: int, colours: int
) -> None:
    """Against plain pixels: what the ranges of leaves stand for."""
    rng = np.random.default_rng(seed)
    small = rng.integers(0, 255, (colours, 3), dtype=np.uint8)[rng.integers(0, colours, (height, width))]
    tree = partition_tree(small, smoothing=0.7, noise=1.0)
    count = len(tree.parent)
    root = count - 1
    assert of(tree, root).all()
    assert tree.parent[root] == root
    for node in range(count):
        bits = of(tree, node)
        children = [k for k in np.flatnonzero(tree.parent == node) if k != node]
        assert len(children) in (0, 2)
        if children:
            assert np.array_equal(of(tree, children[0]) ^ of(tree, children[1]), bits)
        assert tree.area[node] == bits.sum() > 0
        rows, columns = np.nonzero(bits)
        assert list(tree.box[node]) == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert tree.ancestors(node)[-1] == root
    assert ((tree.contrast >= 0) & (tree.contrast <= 1)).all()


def test_regions_of_every_size_are_found() -> None:
    segmenter, image = ClassicalSegmenter(SegmentConfig(grid=16)), nested()
    assert isinstance(segmenter, PromptedSegmenter)
    areas = [mask.area for mask in segmenter.segment(image)]
    for true in (np.pi * 80**2 - 41 * 41, 41 * 41, 81 * 221):
        assert any(abs(area - true) < 0.15 * true for area in areas), (true, areas)


def test_a_point_asks_for_what_is_around_it_and_a_box_for_what_fits() -> None:
    view = ClassicalSegmenter(SegmentConfig()).view(nested())
    point = np.array([[120.0, 150.0]])
    found = view.predict(Prompts.at(point), CLEAR)
    row, column = (np.array([150, 120]) * view.mask_scale).astype(int)
    assert len(found) >= 2
    assert found.bits[:, row, column].all()
    for inside, low, high, true in ((60.0, 40, 200, np.pi * 80**2 - 41 * 41), (120.0, 99, 141, 41.0 * 41)):
        corners = np.array([[inside, 150.0], [low, low + 30.0], [high, high + 30.0]])
        boxed = view.predict(Prompts(corners[None], np.array([INSIDE, CORNER, OTHER_CORNER])), EVERYTHING)
        assert view.masks(boxed)[0].area == pytest.approx(true, rel=0.15)
    assert len(view.predict(Prompts.at(np.zeros((0, 2))), EVERYTHING)) == 0
    assert view.cover(np.array([shapely.box(0, 0, 400, 300)], object)).all()


def test_points_on_and_beyond_the_border_are_taken() -> None:
    view = ClassicalSegmenter(SegmentConfig()).view(nested())
    corners = np.array([[0.0, 0.0], [400.0, 300.0], [399.9, 0.0]])
    assert len(view.predict(Prompts.at(corners), EVERYTHING)) > 0


def test_one_colour_has_no_regions() -> None:
    assert ClassicalSegmenter(SegmentConfig(grid=4)).segment(Image(np.full((90, 120, 3), 99, np.uint8))) == []


def test_same_bytes_again() -> None:
    first, second = (ClassicalSegmenter(SegmentConfig(grid=6)).segment(blank(200, 150)) for _ in range(2))
    assert [m.bits.tobytes() for m in first] == [m.bits.tobytes() for m in second]


def test_it_warns_and_has_options() -> None:
    made = registry.create(SegmentConfig(model="classical", options={"noise": 2.5}))
    assert isinstance(made, ClassicalSegmenter)
    assert made.noise == 2.5
    assert notes_of(made) == [WARNING]
    assert "knows colours and no objects" in WARNING


def test_missing_weights_name_the_way_without_any(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZPM2_CACHE", str(tmp_path))
    monkeypatch.setenv("ZPM2_OFFLINE", "1")
    monkeypatch.delenv("ZPM2_WEIGHTS", raising=False)
    with pytest.raises(WeightsError, match="without any weights: --segmenter classical --points sift"):
        registry.create(SegmentConfig())
