"""How one photograph is turned and zoomed against the other, found at a small size.

Learned points stand turns of about 20 degrees and zooms of about 1.7. Searching at every turn and size takes most of
the time of a hard pair. A similarity between two small pictures is enough to tell at which turn and scale to search.
SIFT looks once, as its points stand both; XFeat looks at several turns; ALIKED, which sees more and takes longer, looks
where neither finds anything. Evidence is a contrario, as in `chance`, so that one number compares all.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log

import cv2
import numpy as np

from zpm2.config import CoarseConfig
from zpm2.features import PointMatcher
from zpm2.features.views import to_originals, view
from zpm2.global_match.chance import log_chance_of_map
from zpm2.model import Image, PointMatches

Images = tuple[Image, Image]
Open = Callable[[str, int], PointMatcher | None]  # method and points per view; None where it cannot take part


@dataclass(frozen=True)
class Hint:
    """How the right photograph stands to the left one in the plane of the pictures."""

    turn: float  # degrees from x to y by which the right photograph is turned back
    scale: float  # right px per left px
    chance: float  # log10 of how many similarities as good are expected by chance
    method: str = ""  # that found it
    seen_at: float = 0.0  # degrees by which the right photograph was turned when it was found; `turn` if any will do

    def __str__(self) -> str:
        turn, zoom = f"a turn by {-self.turn:.0f} degrees", f"a zoom of {self.scale:.2f}"
        return f"{self.method} sees {turn} and {zoom}, chance 10^{self.chance:.0f}"


def hints(images: Images, open_method: Open, config: CoarseConfig) -> list[Hint]:
    """What the pair may need, best first: each more than chance, none like a better one or far behind the best."""
    found: list[Hint] = []
    for look in _looks(config):
        if found and look.only_if_none:
            break
        matcher = open_method(look.method, look.keypoints)
        if matcher is not None:
            found += _compared(images, matcher, look, config)
    best: list[Hint] = []
    for hint in sorted(found, key=lambda each: each.chance):
        behind = best and hint.chance > config.rival_share * best[0].chance
        if not behind and not any(_alike(hint, other, config) for other in best):
            best.append(hint)
    return best


@dataclass(frozen=True)
class _Look:
    """A search for hints."""

    method: str
    keypoints: int
    sizes: tuple[int, int]  # px, longer sides of the left and the right view
    turns: tuple[int, ...]  # of the right view, degrees
    any_turn: bool = False  # the method sees the same at any turn
    only_if_none: bool = False  # made where those before it found nothing


def _looks(config: CoarseConfig) -> list[_Look]:
    """The searches, the cheapest first."""
    size, points = config.size, config.max_keypoints
    wide, near = round(size * config.zoom**0.5), round(size / config.zoom**0.5)
    return [
        _Look("sift", config.sift_keypoints, (config.sift_size, config.sift_size), (0,), any_turn=True),
        _Look("xfeat", points, (size, size), config.turns),
        _Look("aliked", points, (size, size), config.aliked_turns, only_if_none=True),
        _Look("xfeat", points, (wide, near), config.turns, only_if_none=True),
        _Look("xfeat", points, (near, wide), config.turns, only_if_none=True),
    ]


def similarity(points: PointMatches, reach: float) -> Hint | None:
    """The similarity from left to right that most points agree on within `reach` right px; None where there is none."""
    if len(points) < 3:
        return None
    matrix, _ = cv2.estimateAffinePartial2D(
        points.left, points.right, method=cv2.RANSAC, ransacReprojThreshold=reach, maxIters=2000, confidence=0.9999
    )
    if matrix is None or not np.isfinite(matrix).all() or not matrix[:, :2].any():
        return None
    mapped = points.left @ matrix[:, :2].T + matrix[:, 2]
    distances = np.linalg.norm(mapped[:, None] - points.right, axis=2)
    chance = log_chance_of_map(distances, reach, sample=2)
    turn = float(np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])))
    return Hint(-turn, float(np.hypot(matrix[0, 0], matrix[1, 0])), chance)


def _compared(images: Images, matcher: PointMatcher, look: _Look, config: CoarseConfig) -> list[Hint]:
    """The hints of one look, at most one a turn."""
    left = view(images[0], look.sizes[0])
    turned = [view(images[1], look.sizes[1], turn) for turn in look.turns]
    reach = config.reach * max(images[1].width, images[1].height)
    found = []
    searched = matcher.match_many([(left.image, each.image) for each in turned])
    for turn, right, points in zip(look.turns, turned, searched, strict=True):
        fitted = similarity(to_originals(points, left, right), reach)
        if fitted is not None and fitted.chance <= -config.significance:
            found.append(replace(fitted, method=look.method, seen_at=fitted.turn if look.any_turn else float(turn)))
    return found


def apart(turn: float, other: float) -> float:
    """Degrees between two turns, 0..180."""
    return abs((turn - other + 180) % 360 - 180)


def _alike(a: Hint, b: Hint, config: CoarseConfig) -> bool:
    """Whether a search by one hint sees what one by the other does."""
    return apart(a.turn, b.turn) <= 2 * config.min_turn and abs(log(a.scale / b.scale)) <= log(config.same_zoom)
