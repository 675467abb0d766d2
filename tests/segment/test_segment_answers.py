"""What segmenters of others return: what is harmless is put right, the rest is an error that names them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from zpm2.errors import InputError, SegmenterError
from zpm2.model import Image, Mask, Polygon
from zpm2.segment.answers import masks_of, polygons_of
from zpm2.segment.protocol import notes_of

IMAGE = Image(np.zeros((20, 30, 3), np.uint8))
MASK = Mask(1, 2, np.ones((3, 4), bool), 0.5)
SQUARE = Polygon(4, np.array([[1.0, 1], [9, 1], [9, 9], [1, 9]]))


@dataclass
class Says:
    """A segmenter that returns, or raises, what it is told."""

    answer: Any
    name: str = "says"
    notes: Any = ()

    def segment(self, image: Image) -> list[Mask]:
        if isinstance(self.answer, BaseException):
            raise self.answer
        return self.answer  # type: ignore[no-any-return]

    def polygons(self, image: Image) -> list[Any]:
        return self.segment(image)


def test_what_is_right_stays_the_same_object() -> None:
    assert masks_of(Says([MASK]), IMAGE)[0] is MASK
    assert polygons_of(Says([SQUARE]), IMAGE)[0] is SQUARE


def test_numbers_of_numpy_become_those_of_python() -> None:
    bits: Any = np.ones((3, 4), np.int64)
    odd = Mask(np.uint16(1), 2.0, bits, np.float32(0.5), np.str_("a"))  # type: ignore[arg-type]
    (mask,) = masks_of(Says((odd,)), IMAGE)
    kinds = [type(value) for value in (mask.x0, mask.y0, mask.score, mask.label)]
    assert (mask.bits.dtype, kinds) == (bool, [int, int, float, str])
    numbered = replace(SQUARE, id=np.int64(4), parent=np.int8(2), exterior=SQUARE.exterior.tolist())
    (polygon,) = polygons_of(Says(iter([numbered])), IMAGE)
    assert (type(polygon.id), type(polygon.parent), polygon.area) == (int, int, 64)


def test_a_mask_that_reaches_out_of_an_image_with_gaps_is_cut() -> None:
    half = replace(IMAGE, valid=np.arange(30) < np.full((20, 1), 2))
    (mask,) = masks_of(Says([replace(MASK, x0=-1)]), half)
    assert (mask.x0, mask.bits.sum(1).tolist()) == (0, [2, 2, 2])


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (None, "returned a NoneType instead of a list of zpm2.model.Mask"),
        (np.ones((1, 20, 30), bool), "returned region 0 as a ndarray instead of zpm2.model.Mask"),
        ([replace(MASK, bits=np.ones((3, 4)))], r"mask 0 with bits of shape \(3, 4\) and type float64"),
        ([MASK, replace(MASK, x0=0.5)], "mask 1 with x0 = 0.5 instead of an int"),
        ([replace(MASK, score=float("nan"))], "mask 0 with the score nan"),
        ([replace(MASK, score=None)], "mask 0 with the score None"),
        ([replace(MASK, label=7)], "mask 0 with the label 7"),
        (RuntimeError("no\nmemory"), "raised RuntimeError: no memory$"),
    ],
)
def test_masks_that_cannot_be_used(answer: Any, told: str) -> None:
    with pytest.raises(SegmenterError, match=f"^segmenter 'says' .*{told}"):
        masks_of(Says(answer), IMAGE)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"exterior": SQUARE.exterior * np.nan}, "polygon 0 with vertices that are not finite"),
        ({"exterior": SQUARE.exterior[[0, 2, 1, 3]]}, "polygon 0, which is not valid"),
        ({"exterior": SQUARE.exterior[:2]}, "polygon 0 with a ring of shape"),
        ({"id": "4"}, "polygon 0 with id = '4' instead of an int"),
        ({"id": 5}, "two polygons with one id"),
    ],
)
def test_polygons_that_cannot_be_used(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(SegmenterError, match=f"^segmenter 'says' returned {told}"):
        polygons_of(Says([replace(SQUARE, **changes), replace(SQUARE, id=5)]), IMAGE)


@pytest.mark.parametrize("error", [InputError("too dark"), MemoryError(), KeyboardInterrupt()])
def test_what_is_no_fault_of_a_segmenter_passes(error: BaseException) -> None:
    with pytest.raises(type(error)):
        masks_of(Says(error), IMAGE)


@pytest.mark.parametrize(("notes", "listed"), [("slow", ["slow"]), (None, []), (("a", "b"), ["a", "b"])])
def test_notes(notes: object, listed: list[str]) -> None:
    assert notes_of(Says([], notes=notes)) == listed
