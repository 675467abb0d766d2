"""The method on one screen (paper Fig. 3): points -> regions -> locations -> matches.

Points come before regions, because guided re-detection warps the regions of one image into the other by them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from zpm2 import config as configuration
from zpm2 import estimate, memory
from zpm2.config import Config
from zpm2.features import METHODS, PointMatcher, check_methods, weights_notes
from zpm2.global_match import InitialGeometry, PyramidLocations, locate, search_candidates
from zpm2.global_match.messages import geometry_warnings, location_notes
from zpm2.global_match.pair_points import PointFinder
from zpm2.guided.regions import PairRegions, RegionFinder, no_matches
from zpm2.local_match import MatchProblem, match_polygons
from zpm2.local_match.unmatched import with_reasons
from zpm2.model import Image, ImagePolygons, Polygon, PolygonArrays, PolygonMatch
from zpm2.model.messages import split
from zpm2.photos.images import read_image
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.photos.source import ImageLike
from zpm2.polygons.warp import warp_by_points
from zpm2.result import MatchResult
from zpm2.runtime import Progress, StageTimer, resolve_device
from zpm2.segment.protocol import PolygonSource, Segmenter
from zpm2.segment.registry import SEGMENTERS
from zpm2.verify import judged, same_scene_matches, verified

Sides = tuple[ImagePolygons, ImagePolygons]
# stages of a configuration that do not change matches
AFTER_MATCHING = ("cloud", "carry", "tracks", "pose", "stereo", "reconstruct", "device", "max_memory")


def matching_part(config: Config) -> Mapping[str, object]:
    """The part of a configuration that the matches depend on."""
    return {name: value for name, value in config.to_dict().items() if name not in AFTER_MATCHING}


def plugin_code(config: Config) -> list[str]:
    """Hashes of the code of the configured segmenter and point matchers that come from other packages.

    They are part of resume keys.
    """
    used = [(SEGMENTERS, config.segment.model), *((METHODS, name) for name in config.points.methods)]
    codes = [models.code(name) for models, name in used if name in models]  # a matcher that was given has any name
    return [code for code in codes if code]


class PairMatcher:
    """Finds and matches the polygons of image pairs. Loads its models once, on first use.

        matcher = PairMatcher("paper")
        result = matcher("left.png", "right.png")

    `config` is a preset's name or a `Config`. `segmenter` replaces the configured one: one for both images, or a (left,
    right) pair; `points` replaces the configured point matcher. `progress(stage, share)` receives the share of a stage
    that is done, 0..1, and `say(text)` a message before a long wait.
    """

    def __init__(
        self,
        config: Config | str = "default",
        *,
        segmenter: Segmenter | tuple[Segmenter, Segmenter] | None = None,
        points: PointMatcher | None = None,
        progress: Progress = lambda stage, share: None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.config = configuration.as_config(config)
        self.device = resolve_device(self.config.device)
        self.config.check_together()
        if points is None:
            check_methods(self.config.points)
        self.progress = progress
        self._regions = RegionFinder(self.config, segmenter, progress, say)
        self._points_given = points is not None
        self._points = PointFinder(self.config, self.device, points, self._regions.download, say)
        self.lock = self._regions.lock

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair as a whole. Inputs are paths, arrays (grey, RGB, 8 or 16 bit), PIL images, or an `Image`;
        `Matcher` also takes large pairs, and keeps georeferences.

        Raises `InputError` for an input that is no photograph or does not fit into `max_memory`, and `ForkError` in a
        process that was forked from one that had loaded networks (`zpm2.runtime`). All other failures (no overlap, no
        texture, no regions) are in the result: fewer matches, `Failed` geometry, `warnings`.

        Threads may share a matcher: it matches their pairs one after the other.
        """
        with self.lock, memory.within(self.config.max_memory):
            return self.one_of_many(left, right)

    @property
    def takes_threads(self) -> bool:
        """Whether threads may use `one_of_many` at the same time: all models are zpm2's own, which take turns."""
        return not (self._regions.given or self._points_given or plugin_code(self.config))

    def one_of_many(self, left: ImageLike, right: ImageLike, kept: KeptPhotos = NOTHING_KEPT) -> MatchResult:
        """As a call, within the caller's memory budget and without the lock. What was found in photographs that are
        `kept` is used again."""
        config, timer = self.config, StageTimer(self.progress)
        with timer("read"):
            raster = config.raster
            images = read_image(left, "left image", raster), read_image(right, "right image", raster)
            images = kept.same(images[0]), kept.same(images[1])
        estimate.refuse_whole(config, [(image.width, image.height) for image in images], self._regions.given)
        with timer("load"):
            self._points.load()
            self._regions.load()
        looked = self._points(images, timer, kept)
        initial = looked.initial
        with timer("detect"):
            found = self._regions.detect(images, initial, kept)
        with timer("global"):
            problem = self._locate(found, initial)
        with timer("local"):
            again = found.prompted is not None and config.guided.direction == "both"
            matches: Sequence[PolygonMatch] = match_polygons(problem, config.local_match, nodes=not again)
        if again:
            with timer("guided"):
                found = self._regions.redetect(found, matches, initial)
                problem, matches = self._match(found, problem)
        with timer("verify"):
            sure, rejected = self._judged(problem, matches)
        if found.prompted is not None and config.segment.detail.level != "off":
            with timer("detail"):

                def match(more: PairRegions) -> Sequence[PolygonMatch]:
                    nonlocal found, problem, sure, rejected
                    found = more
                    problem, matches = self._match(more, problem)
                    sure, rejected = self._judged(problem, matches)
                    return sure

                self._regions.look_closer(found, sure, initial, match)
        matches = same_scene_matches(sure, initial.same_scene)
        sides, matches = found.sides(matches, config.vectorize)
        sides = self._with_reasons(sides, matches, initial)
        messages = [*looked.notes, *found.messages, *geometry_warnings(initial)]
        messages += [] if self._points_given else weights_notes(config.points)
        messages += [*location_notes(problem.locations, config.global_match), *rejected, *no_matches(matches)]
        warnings, notes = split(messages)
        return MatchResult(
            left=sides[0],
            right=sides[1],
            matches=matches,
            points=initial.points,
            fundamental=initial.fundamental,
            homography=initial.homography,
            config=config.to_dict(),
            timings=timer.seconds,
            warnings=warnings,
            notes=notes,
            same_scene=initial.same_scene,
        )

    def regions(self, image: Image, side: Literal["left", "right"] = "left") -> list[Polygon]:
        """The polygons of one photograph, segmented alone, by the segmenter of that side."""
        with self.lock:
            return self._regions.alone(image, side)

    def load(self) -> None:
        """Loads the models, which the first call does else."""
        with self.lock:
            self._points.load()
            self._regions.load()

    def segmenters(self) -> tuple[Segmenter, Segmenter]:
        """The segmenters of the left and the right image, loaded, for use in another matcher."""
        with self.lock:
            return self._regions.load()

    def points(self) -> PointFinder:
        """What finds the points of a pair, loaded, for use in another matcher."""
        with self.lock:
            self._points.load()
            return self._points

    def _match(self, found: PairRegions, before: MatchProblem) -> tuple[MatchProblem, Sequence[PolygonMatch]]:
        """The matches of regions, and what they were decided from. Pairs that the problem `before` had are known."""
        problem = self._locate(found, before.initial, before)
        problem = replace(problem, known=before.known, evidence=before.evidence)
        return problem, match_polygons(problem, self.config.local_match)

    def _judged(self, problem: MatchProblem, matches: Sequence[PolygonMatch]) -> tuple[list[PolygonMatch], list[str]]:
        """The matches that are sure enough, with their confidence, and a note on the others."""
        config = self.config.local_match
        own = all(isinstance(segmenter, PolygonSource) for segmenter in self._regions.load())
        return judged(verified(problem, matches, matches, config), config, own)

    def _locate(self, found: PairRegions, initial: InitialGeometry, before: MatchProblem | None = None) -> MatchProblem:
        """The left polygons, located in the right image, and their candidates. The first ones may be those of the
        problem `before`, which are located already."""
        config, polygons = self.config.global_match, found.polygons
        centers = polygons[0].centers
        known = 0 if before is None else len(before.polygons[0].centers)
        if before is None or not np.array_equal(centers[:known], before.polygons[0].centers):
            locations = locate(*found.images, centers, initial, config)
        else:
            more = locate(*found.images, centers[known:], initial, config)
            locations = PyramidLocations.join(before.locations, more)
        candidates = search_candidates(*polygons, locations, config)
        return MatchProblem(found.images, polygons, initial, locations, candidates, found.guided_prior)

    def _with_reasons(self, sides: Sides, matches: Sequence[PolygonMatch], initial: InitialGeometry) -> Sides:
        """Both sides, with the reason why a polygon has no partner."""
        left, right = (PolygonArrays(side.polygons) for side in sides)
        config = self.config.local_match
        warped = warp_by_points(left, *initial.forward(), config), warp_by_points(right, *initial.backward(), config)
        return with_reasons(sides, matches, warped, config)
