"""The homologous points of a pair and its geometry: a first look, and further ones while the geometry is not safe.

The first look is that of `points.methods`. Where its points agree far better than by chance, all over both photographs,
it is the only one. Else a coarse pass (`coarse`) finds the turn and the zoom between the photographs, and they are
searched again at this turn and at one ground resolution, by the same methods and then by stronger ones, until the
geometry is safe.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zpm2 import estimate, features, geometry, memory
from zpm2.config import Config, EscalateConfig
from zpm2.config.points import OWN, parts_of_search
from zpm2.errors import MissingDependency, WeightsError
from zpm2.features import METHODS, PointMatcher
from zpm2.features.answers import points_of
from zpm2.features.combined import CombinedMatcher, distinct
from zpm2.features.views import to_originals, view
from zpm2.global_match.coarse import Hint, Images, apart, hints
from zpm2.global_match.initial import InitialGeometry, initial_geometry, points_with_data
from zpm2.model import Image, PointMatches, thin
from zpm2.model.messages import Note
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.runtime import ForkAwareLock, StageTimer
from zpm2.weights import Progress

CELLS = 8  # along each side of a photograph, in which the spread of points is counted
AS_THEY_ARE = Hint(0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class PairPoints:
    """What was found in a pair."""

    initial: InitialGeometry  # its `points` are all that are kept
    notes: list[str]  # what was tried


class PointFinder:
    """Finds the points of pairs. Loads each matcher when it is first needed.

    `matcher` replaces the configured ones, and looks once. `progress` is told of downloads, `say(text)` before a long
    wait. `ConfigError` for a search by a method that does not exist.
    """

    def __init__(
        self,
        config: Config,
        device: str,
        matcher: PointMatcher | None = None,
        progress: Progress | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.config, self.device, self.progress, self.say = config, device, progress, say
        self._matcher, self._given = matcher, matcher is not None
        self._opened: dict[tuple[str, int], PointMatcher | str] = {}  # or why it takes no part
        self._lock = ForkAwareLock()  # networks use the whole device, so threads take turns
        for search in config.points.escalate.searches if config.points.escalate.on else ():
            if (method := parts_of_search(search)[0]) != OWN:
                METHODS.get(method)

    def load(self) -> PointMatcher:
        """The matcher of the first look."""
        if self._matcher is None:
            self._matcher = features.create(self.config.points, self.device, progress=self.progress)
        return self._matcher

    def __call__(self, images: Images, timer: StageTimer, kept: KeptPhotos = NOTHING_KEPT) -> PairPoints:
        """The points of two photographs. `timer` receives the stage "points" and, for further looks, "escalate".
        Features of photographs that are `kept` are not looked for again."""
        config = self.config.points.escalate
        with timer("points"):
            initial = self._geometry(self.first_look(images, kept))
        once = self._given or not config.on or any(thin(image.width, image.height) for image in images)
        if once or is_safe(initial, images, config):
            return PairPoints(initial, [])
        self.say(f"{initial.agreeing} of {len(initial.points)} points agree on one geometry: looking again")
        with timer("escalate"), self._lock:
            return self._again(images, initial)

    def first_look(self, images: Images, kept: KeptPhotos = NOTHING_KEPT) -> PointMatches:
        """The points of two photographs without further looks."""
        matcher = self.load()
        with self._lock:
            if isinstance(matcher, CombinedMatcher):
                points = matcher.match_kept(*images, kept)
            else:
                points = points_of(matcher, *images)
        return points_with_data(points, images)

    def _again(self, images: Images, first: InitialGeometry) -> PairPoints:
        """Further looks, until the geometry is safe or all are made."""
        config, notes = self.config.points.escalate, [f"looked again: first, {_told(first)}"]
        skipped: dict[str, str] = {}

        def opened(method: str, keypoints: int) -> PointMatcher | None:
            found = self._open(method, keypoints)
            if isinstance(found, str):
                skipped[method] = found
                return None
            return found

        found = hints(images, opened, config.coarse)
        notes += [f"looked again: {hint}" for hint in found]
        candidates = _candidates(found, config) or [AS_THEY_ARE]
        most = config.max_looks if found else min(config.max_looks, config.max_looks_without_hint)
        best, looks, made = first, [(AS_THEY_ARE, first)], set[tuple[str, Hint, tuple[int, int]]]()
        for search in config.searches:
            method, side = parts_of_search(search)
            if reason := _too_large(method, side):
                skipped[search] = reason
                continue
            if (matcher := opened(method, config.max_keypoints)) is None:
                continue
            for hint in candidates:
                sizes = view_sizes(images, hint, side)
                if (method, hint, sizes) not in made and len(made) < most:
                    made.add((method, hint, sizes))
                    if method != OWN:  # a larger network, which cannot use the pieces that others freed
                        memory.give_back()
                    looks.append((hint, self._geometry(_look(images, matcher, hint, sizes, config))))
                    notes.append(f"looked again: {search}, turned by {hint.turn:.0f}: {_told(looks[-1][1])}")
            hint, here = min(looks[1:], key=lambda look: look[1].chance, default=looks[0])
            if here.supported:
                candidates = [hint]
                seen = [each.points for other, each in looks if _sees_alike(hint, other, config)]
            else:
                seen = [each.points for _, each in looks]
            points = PointMatches.join(seen)
            best = self._geometry(points[distinct(points, config.merge_px)], trials=1 + len(made))
            if is_safe(best, images, config):
                break
        best = best if best.chance < first.chance else first
        notes += [f"looked again without {name}: {reason}" for name, reason in skipped.items()]
        notes.append(f"looked again: in the end, {_told(best)}")
        return PairPoints(best, [Note(text) for text in notes])

    def _geometry(self, points: PointMatches, trials: int = 1) -> InitialGeometry:
        return initial_geometry(points, self.config.global_match, self.config.seed, trials)

    def _open(self, method: str, keypoints: int) -> PointMatcher | str:
        """A matcher of further looks, or why it takes no part."""
        if (method, keypoints) not in self._opened:
            self._opened[method, keypoints] = self._load(method, keypoints)
        return self._opened[method, keypoints]

    def _load(self, method: str, keypoints: int) -> PointMatcher | str:
        config = self.config.points
        if method != OWN:
            learned = any(METHODS.get(name).info.weights for name in config.methods)
            if METHODS.get(method).info.weights and not learned:
                return f"it needs weights, {' and '.join(config.methods)} needs none"
            config = replace(config, methods=(method,))
        try:
            config = replace(config, max_keypoints=min(keypoints, config.max_keypoints))
            return features.combined(config, self.device, self.progress)
        except (WeightsError, MissingDependency) as error:
            return str(error)


def is_safe(initial: InitialGeometry, images: Images, config: EscalateConfig) -> bool:
    """Whether points agree on a geometry far better than by chance, all over both photographs."""
    agreeing = initial.points[initial.consistent]
    return (
        initial.agreeing >= max(config.safe_points, config.safe_share * len(initial.points))
        and min(_cells(agreeing.left, images[0]), _cells(agreeing.right, images[1])) >= config.safe_cells
        and initial.chance <= -config.safe_chance
    )


def view_sizes(images: Images, hint: Hint, side: int) -> tuple[int, int]:
    """Px, the longer sides of views of both photographs, before the right one is turned, that show the scene at one
    resolution, in at most side x side pixels each."""
    left, right = images
    longest = np.array([max(left.width, left.height), max(right.width, right.height)], np.float64)
    turned = geometry.turn_image(right.width, right.height, np.radians(hint.turn))[1]
    areas = np.array([left.width * left.height, turned[0] * turned[1] / hint.scale**2])  # in px of the left photograph
    alike = longest / [1.0, hint.scale]
    factor = side * min(np.sqrt(2 / (alike**2).sum()), np.sqrt(1 / areas.max()))
    first, second = np.minimum(np.maximum(np.rint(alike * factor), 1), longest)
    return int(first), int(second)


def _look(
    images: Images, matcher: PointMatcher, hint: Hint, sizes: tuple[int, int], config: EscalateConfig
) -> PointMatches:
    """The points of both photographs at `sizes` px, the right one turned as the hint says, in their own px."""
    turn = 0.0 if apart(hint.turn, 0.0) <= config.coarse.min_turn else hint.turn
    left, right = view(images[0], sizes[0]), view(images[1], sizes[1], turn)
    return points_with_data(to_originals(matcher.match(left.image, right.image), left, right), images)


def _candidates(found: list[Hint], config: EscalateConfig) -> list[Hint]:
    """The hints, each at the turn of its similarity, and at the turn at which it was seen if that is another one: with
    perspective, the similarity need not be how the cameras are turned."""
    both = [turned for hint in found for turned in (hint, replace(hint, turn=hint.seen_at))]
    return [h for n, h in enumerate(both) if n % 2 == 0 or apart(h.turn, both[n - 1].turn) > config.coarse.min_turn]


def _sees_alike(hint: Hint, other: Hint, config: EscalateConfig) -> bool:
    """Whether a look by the one hint may see what a look by the other does. Else the points of one are wrong."""
    coarse = config.coarse
    most = coarse.same_zoom**2
    return apart(hint.turn, other.turn) <= 3 * coarse.min_turn and 1 / most <= hint.scale / other.scale <= most


def _cells(points: NDArray[np.float64], image: Image) -> int:
    """How many of CELLS x CELLS cells of an image have points in them."""
    cells = np.clip(points * CELLS / [image.width, image.height], 0, CELLS - 1).astype(np.intp)
    return len(np.unique(cells, axis=0))


def _too_large(method: str, side: int) -> str:
    """Why a search at this size does not fit into the memory budget; empty where it does."""
    needed = estimate.search(method, side)
    return f"it needs about {memory.in_words(needed)}" if needed > memory.budget() else ""


def _told(found: InitialGeometry) -> str:
    return f"{found.agreeing} of {len(found.points)} points agree, chance 10^{found.chance:.0f}"
