"""What point matchers return, checked, in the one form that zpm2 works with. They may be anybody's."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import PointMatcherError
from zpm2.features.protocol import PointMatcher, SparseMatcher
from zpm2.model import Image, PointMatches
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.plugins import WrongAnswer, answering, listed

KIND = "point matcher"


def points_of(matcher: PointMatcher, left: Image, right: Image, kept: KeptPhotos = NOTHING_KEPT) -> PointMatches:
    """The points of a pair, with the features of photographs that are `kept`, of a matcher that looks at each alone.
    `PointMatcherError` where the matcher fails, or its points cannot be used."""
    with answering(matcher, KIND, PointMatcherError):
        if isinstance(matcher, SparseMatcher):
            return _checked(matcher.match_kept(left, right, kept))
        return _checked(matcher.match(left, right))


def points_of_many(matcher: PointMatcher, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
    """The points of each pair. `PointMatcherError` as from `points_of`."""
    with answering(matcher, KIND, PointMatcherError):
        found = listed(matcher.match_many(pairs), "zpm2.model.PointMatches")
        if len(found) != len(pairs):
            raise WrongAnswer(f"{len(found)} results for {len(pairs)} pairs instead of one for each")
        return [_checked(points) for points in found]


def _checked(found: object) -> PointMatches:
    if not isinstance(found, PointMatches):
        raise WrongAnswer(f"a {type(found).__name__} instead of zpm2.model.PointMatches(left, right, score)")
    n = len(found) if np.ndim(found.left) else 0
    left, right = _array("left points", found.left, (n, 2)), _array("right points", found.right, (n, 2))
    return PointMatches(left, right, _array("scores", found.score, (n,)))


def _array(what: str, values: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.shape != shape:
        raise WrongAnswer(f"{what} of shape {array.shape} and type {array.dtype} instead of {shape} and float64")
    if not np.isfinite(array).all():
        raise WrongAnswer(f"{what} that are not finite: leave such matches out")
    return np.ascontiguousarray(array, np.float64)
