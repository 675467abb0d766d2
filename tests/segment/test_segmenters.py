"""The contract of every segmenter: the regions of any picture, as crops inside of it, the same each time."""

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from itertools import combinations
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from numpy.typing import NDArray
from remembered import Memory, remembered
from rendered import Pair

from zpm2.config import SegmentConfig, VectorizeConfig
from zpm2.contract import segmenters
from zpm2.contract.segmenters import check_form
from zpm2.errors import InputError
from zpm2.model import Image, Mask
from zpm2.polygons.vectorize import vectorize
from zpm2.segment.classical import ClassicalSegmenter
from zpm2.segment.given.precomputed import PrecomputedSegmenter
from zpm2.segment.protocol import FromFile, HasNotes, Segmenter, notes_of
from zpm2.segment.sam import SamSegmenter

SAM = SegmentConfig(grid=4, min_area=150.0)
ANEW = ("leaves the image alone", "gives the same bytes twice", "works in threads that take turns")
MEMORY = Memory()
Maker = Callable[[Image], Segmenter]  # the segmenter to use on that image


@pytest.fixture(scope="session")
def sam() -> SamSegmenter:
    return SamSegmenter(SAM)


@pytest.fixture(autouse=True)
def networks(request: pytest.FixtureRequest) -> Iterator[None]:
    """They run once for each image, but for the checks `ANEW`, which are about each run."""
    with nullcontext() if any(check in request.node.name for check in ANEW) else remembered(MEMORY):
        yield


@pytest.fixture(params=["precomputed", "classical", pytest.param("sam", marks=pytest.mark.weights)])
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Maker:
    if request.param == "sam":
        sam = request.getfixturevalue("sam")
        return lambda image: sam
    if request.param == "classical":
        return lambda image: ClassicalSegmenter(SAM)
    return lambda image: PrecomputedSegmenter(brightness_levels(image, tmp_path / f"{id(image)}.png"))


def brightness_levels(image: Image, path: Path) -> Path:
    """A label image of the picture's bright and dark parts."""
    PIL.Image.fromarray((image.gray // 64 + 1).astype(np.uint8)).save(path)
    return path


def flat(width: int, height: int, value: int = 120) -> NDArray[np.uint8]:
    return np.full((height, width, 3), value, np.uint8)


def as_bytes(masks: list[Mask]) -> list[tuple[int, int, bytes, float]]:
    return [(m.x0, m.y0, m.bits.tobytes(), m.score) for m in masks]


def full(mask: Mask, image: Image) -> NDArray[np.bool_]:
    bits = np.zeros((image.height, image.width), bool)
    bits[mask.y0 : mask.y0 + mask.bits.shape[0], mask.x0 : mask.x0 + mask.bits.shape[1]] = mask.bits
    return bits


@pytest.mark.parametrize("check", segmenters.CHECKS)
def test_contract(make: Maker, check: str) -> None:
    """What the author of a plug-in runs, `python -m zpm2.contract`."""
    segmenters.CHECKS[check](make)


def test_regions_of_a_scene(make: Maker, pair: Pair) -> None:
    image = Image(pair.scene.left)
    segmenter = make(image)
    assert segmenter.name
    masks = segmenter.segment(image)
    check_form(masks, image)
    assert len(masks) >= 4
    polygons = vectorize(masks, VectorizeConfig(), 100.0, (image.width, image.height))
    assert len(polygons) >= 4
    assert all(p.shape.is_valid for p in polygons)


def test_precomputed_regions_of_another_size_are_refused(tmp_path: Path) -> None:
    segmenter = PrecomputedSegmenter(brightness_levels(Image(flat(60, 50)), tmp_path / "labels.png"))
    with pytest.raises(InputError, match="60 x 50 px"):
        segmenter.segment(Image(flat(50, 60)))


@pytest.fixture(scope="session")
def found(sam: SamSegmenter, pair: Pair) -> list[Mask]:
    """SAM's regions of the scene's left image."""
    return sam.segment(Image(pair.scene.left))


@pytest.mark.weights
def test_sam_respects_areas_and_suppression(found: list[Mask], pair: Pair) -> None:
    """Suppression works on low-resolution masks: at full resolution an IoU may lie a little above the limit."""
    image, masks = Image(pair.scene.left), found
    areas = [mask.area for mask in masks]
    assert min(areas) >= SAM.min_area
    assert max(areas) <= (SAM.max_area + 0.01) * image.width * image.height
    assert [m.score for m in masks] == sorted((m.score for m in masks), reverse=True)
    assert min(m.score for m in masks) >= SAM.min_predicted_iou
    for a, b in combinations([full(mask, image) for mask in masks], 2):
        assert (a & b).sum() <= (SAM.nms_iou + 0.02) * (a | b).sum()


@pytest.mark.weights
def test_sam_filters_bite(sam: SamSegmenter, found: list[Mask], pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    strict = dataclasses.replace(SAM, min_predicted_iou=0.95, max_area=0.1)
    monkeypatch.setattr(sam, "config", strict)
    left = sam.segment(Image(pair.scene.left))
    limit = strict.max_area * pair.scene.left[..., 0].size
    assert 0 < len(left) < len(found)
    assert set(as_bytes(left)) < set(as_bytes(found))
    assert min(m.score for m in left) >= 0.95 > min(m.score for m in found)
    assert max(m.area for m in left) <= 1.05 * limit < max(m.area for m in found)


@pytest.mark.weights
def test_sam_without_any_stable_mask_and_how_it_gets_on(
    sam: SamSegmenter, pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares: list[float] = []
    monkeypatch.setattr(sam, "progress", shares.append)
    monkeypatch.setattr(sam, "config", dataclasses.replace(SAM, grid=5, min_stability=1.0, stability_offset=50.0))
    assert sam.segment(Image(pair.scene.left)) == []
    assert shares == [16 / 25, 1.0]


@pytest.mark.weights
def test_sam_masks_lie_on_what_they_show(sam: SamSegmenter) -> None:
    """A bright disc on a dark ground, off the centre of an oblong picture: the mask is the disc, to a pixel."""
    rows, columns = np.indices((300, 500)) + 0.5
    disc = (columns - 320) ** 2 + (rows - 120) ** 2 <= 60**2
    image = Image(np.where(disc[..., None], np.uint8(220), np.uint8(40)).repeat(3, axis=2))
    best = max((full(mask, image) for mask in sam.segment(image)), key=lambda m: (m & disc).sum() / (m | disc).sum())
    assert (best & disc).sum() > 0.95 * (best | disc).sum()
    at = np.argwhere(best).mean(0) + 0.5
    assert at == pytest.approx([120, 320], abs=0.5)


def test_what_a_segmenter_may_have_besides_its_regions(tmp_path: Path) -> None:
    class Plain:
        name = "plain"

        def segment(self, image: Image) -> list[Mask]:
            return []

    class Talkative(Plain):
        notes = ("one thing",)
        path = tmp_path / "regions.geojson"

    assert (notes_of(Plain()), notes_of(Talkative())) == ([], ["one thing"])
    assert not isinstance(Plain(), HasNotes | FromFile)
    assert isinstance(Talkative(), FromFile)
    assert isinstance(SamSegmenter(SegmentConfig()), HasNotes)
