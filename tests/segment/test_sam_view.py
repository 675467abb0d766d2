"""A photograph that SAM can be asked about, with the real weights."""

import numpy as np
import pytest
import shapely
from rendered import Pair

from zpm2.config import SegmentConfig, preset
from zpm2.model import Image
from zpm2.segment.mask_view import decoded_size
from zpm2.segment.predictions import CORNER, INSIDE, MASK_SIDE, OTHER_CORNER, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import EmbeddedView, WritableSegmenter
from zpm2.segment.sam import SamSegmenter
from zpm2.segment.sam_openvino import OpenVinoBackend
from zpm2.segment.sam_view import SamView

pytestmark = pytest.mark.weights

EVERYTHING = MaskThresholds(0.0, 0.0)


@pytest.fixture(scope="module")
def view(pair: Pair) -> SamView:
    return SamSegmenter(SegmentConfig()).view(Image(pair.scene.left))


@pytest.fixture(scope="module")
def points(view: SamView) -> np.ndarray:
    return np.random.default_rng(0).uniform(5, [view.image.width - 5, view.image.height - 5], (20, 2))


def boxed(points: np.ndarray, half: float = 30.0) -> Prompts:
    corners = np.stack([points, points - half, points + half], axis=1)
    return Prompts(corners, np.array([INSIDE, CORNER, OTHER_CORNER]))


def same(first: MaskPredictions, second: MaskPredictions) -> bool:
    return (
        np.array_equal(first.prompt, second.prompt)
        and np.allclose(first.score, second.score, atol=1e-4)
        and float((first.bits != second.bits).mean()) < 1e-4
    )


def test_a_point_has_three_masks_and_a_box_four(view: SamView, points: np.ndarray) -> None:
    assert np.bincount(view.predict(Prompts.at(points), EVERYTHING).prompt).max() == 3
    assert np.bincount(view.predict(boxed(points), EVERYTHING).prompt).max() == 4


def test_the_embedding_is_that_of_the_photograph_alone(view: SamView) -> None:
    cells = view.embedding()
    height, width = (-(-side // 4) for side in decoded_size(view.image))
    assert cells.shape == (256, height, width)
    assert isinstance(view, EmbeddedView)
    assert view.embedding_scale * max(view.image.width, view.image.height) == pytest.approx(64)
    tokens = view.backend.tokens(view.parts)
    assert np.array_equal(cells[:, 3, 5], tokens[3 * 64 + 5])


def test_the_floor_holds(view: SamView, points: np.ndarray) -> None:
    thresholds = MaskThresholds(0.85, 0.9)
    automatic_masks, good = view.predict(Prompts.at(points), EVERYTHING), view.predict(Prompts.at(points), thresholds)
    assert 0 < len(good) < len(automatic_masks)
    assert good.passing(thresholds).all()
    assert same(good, automatic_masks[automatic_masks.passing(thresholds)])


@pytest.mark.parametrize("prompts", [Prompts.at, boxed])
def test_questions_do_not_depend_on_each_other(view: SamView, points: np.ndarray, prompts) -> None:
    """One call or several: batches are filled up, and that changes nothing."""
    chosen = [0, view.batch - 1, view.batch, len(points) - 1]  # the ends of both batches
    together = view.predict(prompts(points), EVERYTHING)
    parts = [view.predict(prompts(points[[k]]), EVERYTHING) for k in chosen]
    apart = MaskPredictions.join(
        [MaskPredictions(p.prompt + k, p.score, p.stability, p.logits) for k, p in zip(chosen, parts, strict=True)]
    )
    assert same(together[np.isin(together.prompt, chosen)], apart)


def test_nothing_asked_nothing_answered(view: SamView) -> None:
    assert len(view.predict(Prompts.at(np.zeros((0, 2))), EVERYTHING)) == 0
    assert view.masks(MaskPredictions.none(view.size)) == []


def test_masks_cover_the_image_and_no_padding(view: SamView, points: np.ndarray) -> None:
    assert max(view.size) == MASK_SIDE
    assert view.size[0] / view.size[1] == pytest.approx(view.image.height / view.image.width, abs=1 / MASK_SIDE)
    assert view.predict(Prompts.at(points), EVERYTHING).bits.shape[1:] == view.size


@pytest.mark.parametrize(
    ("width", "height", "size"),
    [(1242, 375, (78, 256)), (64, 64, (256, 256)), (33, 4000, (256, 3)), (4001, 1, (1, 256))],
)
def test_size_of_decoded_masks(width: int, height: int, size: tuple[int, int]) -> None:
    assert decoded_size(Image(np.zeros((height, width, 3), np.uint8))) == size


def test_cover_has_the_areas_of_its_shapes(view: SamView) -> None:
    width, height = view.image.width, view.image.height
    hole = shapely.box(20, 20, 120, 120).difference(shapely.box(50, 50, 90, 90))
    two = shapely.union_all([shapely.box(10, 10, 40, 40), shapely.box(100, 60, 160, 100)])
    beyond = shapely.box(width - 40, height - 40, width + 400, height + 400)
    shapes = np.array([hole, two, beyond, shapely.Polygon()], object)
    area = view.cover(shapes).sum((1, 2)) / view.mask_scale**2
    inside = shapely.area(shapely.intersection(shapes, shapely.box(0, 0, width, height)))
    assert area == pytest.approx(inside, rel=0.12)


def test_masks_of_answers_are_where_the_answers_are(view: SamView, points: np.ndarray) -> None:
    predictions = view.predict(boxed(points), MaskThresholds(0.8, 0.9))
    masks = view.masks(predictions)
    assert len(masks) == len(predictions) > 0
    for mask, bits in zip(masks, predictions.bits, strict=True):
        assert mask.area == pytest.approx(bits.sum() / view.mask_scale**2, rel=0.15, abs=12)


def test_torch_and_openvino_answer_alike(view: SamView, points: np.ndarray) -> None:
    pytest.importorskip("openvino")
    torch = SamSegmenter(SegmentConfig(backend="torch")).view(view.image)
    for prompts in (Prompts.at(points[:4]), boxed(points[:4])):
        assert same(torch.predict(prompts, EVERYTHING), view.predict(prompts, EVERYTHING))


def test_a_view_comes_back_from_its_arrays(view: SamView, points: np.ndarray) -> None:
    pytest.importorskip("openvino")
    segmenter = SamSegmenter(view.config)
    segmenter._backend = view.backend
    assert isinstance(segmenter, WritableSegmenter)
    arrays = segmenter.written(view)
    again = segmenter.view_of_written(view.image, {name: array.copy() for name, array in arrays.items()})
    one, other = (each.predict(Prompts.at(points[:2]), EVERYTHING) for each in (view, again))
    assert np.array_equal(one.logits, other.logits)
    assert np.array_equal(view.embedding(), again.embedding())


def test_few_networks_stay_and_the_next_ones_answer_alike(
    view: SamView, points: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Photographs of each shape have a mask network of their own, and share the prompt network."""
    pytest.importorskip("openvino")
    backend = view.backend
    assert isinstance(backend, OpenVinoBackend)
    before = view.predict(Prompts.at(points[:1]), EVERYTHING)
    prompting = list(backend.networks["prompt"].values())
    monkeypatch.setattr("zpm2.segment.sam_openvino.KEPT", 1)
    for height in (40, 80):  # px
        other = SamView(backend, Image(np.zeros((height, 160, 3), np.uint8)), view.config, encoded=view.parts)
        other.predict(Prompts.at(np.full((1, 2), 20.0)), EVERYTHING)
    assert len(backend.networks["mask"]) == 1
    assert list(backend.networks["prompt"].values()) == prompting
    encoded = backend.image(np.zeros((1, 3, 1024, 1024), np.float32))  # which frees the prompt networks' memory
    assert not np.array_equal(encoded[0], view.parts[0])
    after = view.predict(Prompts.at(points[:1]), EVERYTHING)
    assert np.array_equal(before.logits, after.logits)
    assert np.array_equal(before.score, after.score)


def test_answers_do_not_depend_on_cores_nor_on_the_other_prompts(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("openvino")
    found = list[list[MaskPredictions]]()
    for cores in (1, 2, 3):
        for module in ("zpm2.segment.sam_openvino", "zpm2.cores"):
            monkeypatch.setattr(f"{module}.usable", lambda cores=cores: cores)
        view = SamSegmenter(preset("default").segment).view(Image(pair.scene.left))
        assert isinstance(view.backend, OpenVinoBackend)
        assert view.vicinity is not None
        at = np.random.default_rng(0).uniform(5, [view.image.width - 5, view.image.height - 5], (7, 2))
        for prompts in (Prompts.at(at), boxed(at)):
            every = view.predict(prompts, EVERYTHING)
            found.append([every, *(view.predict(prompts[k : k + 1], EVERYTHING) for k in range(len(at)))])
        view.predict_small(Prompts.at(at[:2]), EVERYTHING, [], Prompts.at(at[[5, 6, 1, 3]]))
        later = view.predict_small(Prompts.at(at[3:]), EVERYTHING, [], Prompts.at(at[:1]))
        assert np.array_equal(later.logits, view.predict_small(Prompts.at(at[3:]), EVERYTHING, []).logits)
    for one, other in zip(found[:2] + found[:2], found[2:], strict=True):
        for each, again in zip(one, other, strict=True):
            assert np.array_equal(each.logits, again.logits)
            assert np.array_equal(each.score, again.score)
        for k, alone in enumerate(one[1:]):
            of_all = one[0][np.flatnonzero(one[0].prompt == k)]
            assert np.array_equal(of_all.logits, alone.logits)
            assert np.array_equal(of_all.score, alone.score)


def test_sixteen_bits_give_the_masks_of_single_precision(view: SamView, points: np.ndarray) -> None:
    half = SamSegmenter(SegmentConfig(backend="torch", precision="bfloat16")).view(view.image)
    one, other = (v.predict(Prompts.at(points[:12]), MaskThresholds(-9.0, 0.0)) for v in (view, half))
    assert np.array_equal(one.prompt, other.prompt)
    good = one.passing(MaskThresholds(0.8, 0.9))
    iou = (one.bits & other.bits).sum((1, 2)) / (one.bits | other.bits).sum((1, 2))
    assert good.sum() >= 8
    assert np.median(iou[good]) > 0.99
    assert iou[good].min() > 0.9
    assert np.abs(one.score - other.score)[good].max() < 0.03


def test_no_region_over_pixels_without_data(view: SamView, points: np.ndarray) -> None:
    valid = np.ones((view.image.height, view.image.width), bool)
    valid[:, : view.image.width // 2] = False
    part = SamSegmenter(SegmentConfig()).view(Image(view.image.rgb, valid=valid))
    whole, cut = (v.masks(v.predict(Prompts.at(points), MaskThresholds(0.8, 0.9))) for v in (view, part))
    assert sum(mask.area for mask in whole) > sum(mask.area for mask in cut) > 0
    assert all(not mask.bits[:, : max(0, view.image.width // 2 - mask.x0)].any() for mask in cut)
