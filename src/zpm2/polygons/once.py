"""Work on polygons that recurs in a run is done once."""

from collections.abc import Callable, Hashable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zpm2.model import Polygon

T = TypeVar("T")
Known = dict[Hashable, tuple[object, T]]  # what was found, and the objects whose identity is in the key


def identity(polygon: Polygon) -> tuple[int, int]:
    """The same for polygons with the same arrays of vertices, whatever their ids and parents. Only as long as these
    arrays live: keep `vertices` beside it."""
    return id(polygon.exterior), id(polygon.holes)


def vertices(polygon: Polygon) -> tuple[object, object]:
    """What `identity` is of."""
    return polygon.exterior, polygon.holes


def each_once(
    known: Known[T],
    keys: Sequence[Hashable],
    kept: Callable[[int], object],
    find: Callable[[NDArray[np.intp]], Sequence[T]],
) -> list[T]:
    """What was found for each key: `known`, or what `find` finds now for the rows of those that are not.

    `kept(row)` are the objects that a key names by their identity; they are kept, so that no others get it. What is
    found for a row must not depend on the other rows.
    """
    new = np.array([row for row, key in enumerate(keys) if key not in known], np.intp)
    if len(new):
        for row, value in zip(new.tolist(), find(new), strict=True):
            known[keys[row]] = kept(row), value
    return [known[key][1] for key in keys]
