"""The contract of a segmenter (`zpm2.segment.protocol`): the regions of any picture, as crops inside of it, the same
each time. A check takes a function that gives the segmenter to use on an image."""

from collections.abc import Callable, Mapping

import numpy as np

from zpm2.config import VectorizeConfig
from zpm2.contract.check import Broken, expect
from zpm2.contract.scenes import grey, half_valid, in_threads, no_data, scene, texture, unchanged
from zpm2.errors import InputError
from zpm2.model import Image, Mask
from zpm2.polygons.vectorize import vectorize
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, MaskPredictions, MaskThresholds, Prompts
from zpm2.segment.protocol import (
    HasNotes,
    PolygonSource,
    PromptedSegmenter,
    PromptedView,
    Segmenter,
    SmallThingsView,
)

For = Callable[[Image], Segmenter]
Content = list[tuple[int, int, tuple[int, ...], bytes, float]]


def check_form(masks: object, image: Image) -> list[Mask]:
    """The masks of an image. `Broken` where one is not as `Segmenter.segment` says."""
    expect(isinstance(masks, list), f"segment returns a {type(masks).__name__}: return a list of zpm2.model.Mask")
    assert isinstance(masks, list)
    for k, mask in enumerate(masks):
        expect(
            isinstance(mask, Mask), f"item {k} is a {type(mask).__name__}: return zpm2.model.Mask(x0, y0, bits, score)"
        )
        bits, what = mask.bits, f"mask {k} of an image of {image.width} x {image.height} px"
        good = isinstance(bits, np.ndarray) and bits.dtype == np.bool_ and bits.ndim == 2
        expect(good, f"the bits of {what} are no 2-D array of bool: use bits.astype(bool)")
        at = type(mask.x0) is int and type(mask.y0) is int
        expect(at, f"x0, y0 of {what} are no int: use int(x0), int(y0)")
        rows, columns = bits.shape
        inside = 0 <= mask.x0 <= mask.x0 + columns <= image.width and 0 <= mask.y0 <= mask.y0 + rows <= image.height
        expect(inside, f"{what} lies outside: {columns} x {rows} px at {mask.x0}, {mask.y0}; cut it to the image")
        expect(bool(bits.any()), f"{what} has no pixel: leave empty masks out")
        score = type(mask.score) is float and 0 <= mask.score <= 1
        expect(score, f"the score of {what} is {mask.score!r}: give a float from 0 to 1")
        label = mask.label is None or isinstance(mask.label, str)
        expect(label, f"the label of {what} is {mask.label!r}: give a str or None")
    return masks


def content(masks: list[Mask]) -> Content:
    """What masks hold, to compare."""
    return [(m.x0, m.y0, m.bits.shape, m.bits.tobytes(), m.score) for m in masks]


def has_a_name(of: For) -> None:
    """`name` is a text, which results and messages show."""
    name = of(scene()[0]).name
    expect(isinstance(name, str) and bool(name.strip()), "it has no name: give the class name = 'word'")


def regions_of_a_scene(of: For) -> None:
    """A small scene has regions, each a mask in the image, and they become valid polygons."""
    image = scene()[0]
    masks = check_form(of(image).segment(image), image)
    expect(bool(masks), "no regions are found in a small scene with a dozen objects: find some")
    polygons = vectorize(masks, VectorizeConfig(), 0.0, (image.width, image.height))
    expect(all(polygon.shape.is_valid for polygon in polygons), "its masks give polygons that are not valid")


def same_bytes_twice(of: For) -> None:
    """The same image gives the same regions in the same order, also when another image came between."""
    image, other = scene()
    first = content(of(image).segment(image))
    of(other).segment(other)
    again = content(of(image).segment(image))
    expect(sorted(first) == sorted(again), "the same image gives other regions the second time: seed what is random")
    expect(first == again, "the same regions come in another order the second time: sort them, or use no sets")


def image_is_left_alone(of: For) -> None:
    """The pixels that it is given stay as they are."""
    first, second = scene()[0], half_valid(scene()[0])
    for image in (first, second):
        segmenter = of(image)
        unchanged([image], lambda used=segmenter, seen=image: used.segment(seen))  # type: ignore[misc]


def any_size(of: For) -> None:
    """Images of one pixel, small, long and thin, and of one colour give regions or none, or an `InputError`."""
    sizes = [(1, 1), (2, 3), (32, 32), (1200, 40), (40, 1200)]
    images = [Image(texture(*size)) for size in sizes] + [grey(90, 60, value) for value in (0, 120, 255)]
    for image in images:
        _any(of, image, f"of {image.width} x {image.height} px")


def no_data_is_no_error(of: For) -> None:
    """Images with pixels that hold no data (`image.valid`), and without any that do."""
    for image in (half_valid(scene()[0]), no_data(scene()[0])):
        _any(of, image, "with pixels that hold no data (image.valid)")


def threads_take_turns(of: For) -> None:
    """Two threads that use it in turn get what one gets."""
    image = scene()[0]
    segmenter = of(image)
    alone = content(segmenter.segment(image))
    for found in in_threads(segmenter.segment, [image, image]):
        expect(content(found) == alone, "another thread gets other regions: keep no state of a thread between images")


def extras(of: For) -> None:
    """What it may have besides: `polygons`, `notes`, `view`."""
    image = scene()[0]
    segmenter = of(image)
    segmenter.segment(image)
    if isinstance(segmenter, HasNotes):
        notes = segmenter.notes
        good = not isinstance(notes, str) and all(isinstance(note, str) for note in notes)
        expect(good, "its notes are no texts: give a list of str")
    if isinstance(segmenter, PolygonSource):
        _polygons(segmenter, image)
    if isinstance(segmenter, PromptedSegmenter):
        _prompts(segmenter, image)


def _any(of: For, image: Image, what: str) -> None:
    try:
        masks = of(image).segment(image)
    except InputError:
        return
    except Exception as error:
        told = " ".join(str(error).split())
        raise Broken(
            f"an image {what} raises {type(error).__name__}: {told}; return no regions, or raise zpm2.errors.InputError"
        ) from error
    vectorize(check_form(masks, image), VectorizeConfig(), 100.0, (image.width, image.height))


def _polygons(source: PolygonSource, image: Image) -> None:
    polygons = source.polygons(image)
    ids = {polygon.id for polygon in polygons}
    expect(len(ids) == len(polygons), "two polygons have one id: number them")
    expect(
        all(polygon.shape.is_valid for polygon in polygons), "a polygon is not valid: repair it (shapely.make_valid)"
    )
    parents = {polygon.parent for polygon in polygons} - {None}
    expect(parents <= ids, "a parent is the id of no polygon: leave such out")
    low = min((float(polygon.exterior.min()) for polygon in polygons), default=0.0)
    high = [max((float(p.exterior[:, k].max()) for p in polygons), default=0.0) for k in (0, 1)]
    inside = low >= 0 and high[0] <= image.width and high[1] <= image.height
    expect(inside, "a polygon lies outside of the image: cut it")


def _prompts(segmenter: PromptedSegmenter, image: Image) -> None:
    view = segmenter.view(image)
    every = MaskThresholds(0.0, 0.0)
    prompts = Prompts.at(np.array([[image.width / 2, image.height / 2], [10.5, 10.5]]))
    found = view.predict(prompts, every)
    _answer(found, len(prompts), view)
    if isinstance(view, SmallThingsView):
        _answer(view.predict_small(prompts, every, []), len(prompts), view)
        _answer(view.predict_small(prompts, every, [found, MaskPredictions.none(view.size)]), len(prompts), view)
    some = found[np.arange(min(len(found), 3))]
    expect(len(view.masks(some)) == len(some), "view.masks gives another number of masks than predictions")
    x, y = np.array([image.width, image.height]) / 2
    boxed = Prompts(
        np.array([[[x, y], [x - 2, y], [x, y - 2], [x / 2, y / 2], [1.5 * x, 1.5 * y]]]),
        np.array([INSIDE] * 3 + [CORNER, OTHER_CORNER]),
    )
    several = view.predict(boxed, every)
    expect(bool((several.prompt == 0).all()), "a prompt of three points and a box gives masks of another row")
    none = view.predict(prompts[:0], every)
    expect(len(none) == 0, "no prompts give masks")
    expect(view.masks(none) == [], "no predictions give masks")


def _answer(found: MaskPredictions, prompts: int, view: PromptedView) -> None:
    """The masks of so many prompts have the form that they should have."""
    shape = (len(found), *view.size)
    expect(found.logits.shape == shape, f"logits are {found.logits.shape}: give {shape}, as view.size says")
    rows = bool(((found.prompt >= 0) & (found.prompt < prompts)).all())
    expect(rows, "MaskPredictions.prompt holds rows that are no prompt")


CHECKS: Mapping[str, Callable[[For], None]] = {
    "has a name": has_a_name,
    "finds the regions of a scene": regions_of_a_scene,
    "gives the same bytes twice": same_bytes_twice,
    "leaves the image alone": image_is_left_alone,
    "takes images of any size and colour": any_size,
    "takes images without data": no_data_is_no_error,
    "works in threads that take turns": threads_take_turns,
    "keeps what else it promises": extras,
}
