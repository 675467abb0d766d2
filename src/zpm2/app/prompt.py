"""What a person says of a region, as the browser sends it: points, a box, or an outline. Checked, as nothing that a
browser sends is trusted."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.files.reading import WRONG
from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.region import GivenRegion, Shape
from zpm2.model import SIDES
from zpm2.segment.predictions import CORNER, INSIDE, OTHER_CORNER, OUTSIDE, Prompts

MOST_POINTS = 100  # of a prompt; more are a mistake, or an attack
FAR = 1e7  # px; no photograph reaches there


@dataclass(frozen=True, eq=False)
class Prompt:
    """Points and a box, for the segmenter. One of both is there."""

    inside: NDArray[np.float64]  # (n, 2) px
    outside: NDArray[np.float64]  # (m, 2) px
    box: NDArray[np.float64] | None  # (2, 2) px, two corners
    size: int | None  # which of several answers, the smallest first; None: the best

    def prompts(self, scale: NDArray[np.float64]) -> Prompts:
        """The same for a segmenter, in px times `scale` (2,)."""
        corners = np.zeros((0, 2)) if self.box is None else self.box
        labels = [INSIDE] * len(self.inside) + [OUTSIDE] * len(self.outside) + [CORNER, OTHER_CORNER][: len(corners)]
        points = np.concatenate([self.inside, self.outside, corners]) * scale
        return Prompts(points[None], np.array(labels, np.int64))


def side_of(message: Mapping[str, object]) -> int:
    """0 for the left photograph, 1 for the right one. `InputError` for anything else."""
    if message.get("side") not in SIDES:
        raise InputError("side is neither left nor right")
    return int(message["side"] == "right")


def prompt_of(value: object) -> Prompt:
    """{"points": [[x, y, 1 inside or 0 outside], ...], "box": [x0, y0, x1, y1] or null, "size": a number or null}.
    `InputError` for anything else."""
    try:
        if not isinstance(value, Mapping):
            raise TypeError("it is no object")
        rows = _numbers(value["points"], 3)
        box = None if value.get("box") is None else _numbers([value["box"]], 4).reshape(2, 2)
        size = value.get("size")
        if not isinstance(size, int | None):
            raise TypeError("size is no whole number")
    except WRONG as error:
        raise InputError(f"the prompt cannot be used: {error}") from error
    if box is not None:
        box = np.sort(box, axis=0)
        if (box[0] == box[1]).any():
            raise InputError("the box is empty: draw a larger one")
    inside = rows[:, 2] > 0
    if not inside.any() and box is None:
        raise InputError("there is no point inside of the region: click on it")
    return Prompt(rows[inside, :2], rows[~inside, :2], box, size)


def _numbers(value: object, columns: int) -> NDArray[np.float64]:
    """(n, columns) of a list of lists."""
    if not isinstance(value, Sequence) or len(value) > MOST_POINTS:
        raise TypeError(f"points are a list of at most {MOST_POINTS}")
    found = np.array(value, np.float64) if value else np.zeros((0, columns))
    if found.shape != (len(value), columns):
        raise TypeError(f"each has {columns} numbers")
    if not (np.abs(found) < FAR).all():
        raise ValueError("a coordinate is no number")
    return found


def shape_from(value: object) -> Shape:
    """Parts, each an exterior and its holes, each ring a list of [x, y], px: as a valid shape. `InputError` for
    anything else, and where it has no area."""
    try:
        rings = [[np.array(ring, np.float64).reshape(-1, 2) for ring in part] for part in value]  # type: ignore[attr-defined]
        if not all((np.abs(ring) < FAR).all() for part in rings for ring in part):
            raise ValueError("a coordinate is no number")
        shape = shape_of(GivenRegion(tuple(rings), None))
    except (*WRONG, shapely.errors.GEOSException) as error:
        raise InputError(f"the outline cannot be used: {error}") from error
    if shape is None or not shape.area > 0:
        raise InputError("the outline has no area: draw one around the region")
    return shape


def share(value: object) -> float:
    """A number from 0 to 1. `InputError` for anything else."""
    if isinstance(value, int | float) and math.isfinite(value) and 0 <= value <= 1:
        return float(value)
    raise InputError(f"{value!r} is no number from 0 to 1")
