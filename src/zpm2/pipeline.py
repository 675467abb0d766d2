"""The method on one screen: points -> regions -> places -> matches (paper Fig. 3). Stages are arguments.

Points come first, because with guided re-detection they say where the regions of one image are asked for in the other.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from zpm2 import config as configuration
from zpm2 import estimate, memory
from zpm2.config import Config
from zpm2.errors import Failed
from zpm2.features import PointMatcher, check_methods
from zpm2.global_match import Candidates, InitialGeometry, PyramidLocations, initial_geometry, place, search_candidates
from zpm2.global_match.chance import MIRRORED
from zpm2.guided.regions import PairRegions, RegionStages, no_matches
from zpm2.local_match import match_polygons
from zpm2.local_match.confidence import unsupported
from zpm2.local_match.unmatched import reasons, visible
from zpm2.model import Image, ImagePolygons, PointMatches, Polygon, PolygonArrays, PolygonMatch
from zpm2.model.messages import Note, split
from zpm2.photos.images import read_image
from zpm2.photos.source import ImageLike
from zpm2.polygons.warp import WarpedPolygons, warp_by_points
from zpm2.result import MatchResult
from zpm2.runtime import Progress, StageTimer, resolve_device
from zpm2.segment.protocol import Segmenter


class PairMatcher:
    """Finds and matches the polygons of image pairs. Loads its models once, on first use.

        matcher = PairMatcher("paper")
        result = matcher("left.png", "right.png")

    `config` is a preset's name or a `Config`. `segmenter` replaces SAM, one for both images or a (left, right) pair;
    `points` replaces the configured point matcher. `progress(stage, share)` and `say(text)` are told how a run gets on.
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
        self.config = configuration.preset(config) if isinstance(config, str) else config
        self.device = resolve_device(self.config.device)
        self.config.check_together()
        if points is None:
            check_methods(self.config.points)
        self.progress = progress
        self._regions = RegionStages(self.config, segmenter, progress, say)
        self._points = points
        self.turns = self._regions.turns

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair as a whole. Inputs are paths, arrays (grey, RGB, 8 or 16 bit), PIL images, or an `Image`;
        `Matcher` also takes large pairs, and keeps georeferences.

        Raises `InputError` for what cannot be read as a photograph, or does not fit into `max_memory`. Everything else
        that goes wrong with a pair (no overlap, no texture, no regions) is in the result: fewer matches, `Failed`
        geometry, `warnings`.

        Threads may share a matcher: it takes their pairs one after the other. `ForkError` in a process that was forked
        from one that had loaded networks (`zpm2.runtime`).
        """
        with self.turns, memory.within(self.config.max_memory):
            return self._call(left, right)

    def _call(self, left: ImageLike, right: ImageLike) -> MatchResult:
        config, clock = self.config, StageTimer(self.progress)
        with clock("read"):
            raster = config.raster
            images = read_image(left, "left image", raster), read_image(right, "right image", raster)
        estimate.refuse_whole(config, [(image.width, image.height) for image in images], self._regions.given)
        with clock("load"):
            matcher = self._load_points()
            self._regions.load()
        with clock("points"):
            points = on_data(matcher.match(*images), images)
            initial = initial_geometry(points, config.global_match, config.seed)
        with clock("detect"):
            found = self._regions.detect(images, initial)
        with clock("global"):
            locations, candidates = self._place(found, initial)
        with clock("local"):
            matches = self._match(found, initial, locations, candidates)
        if found.pair is not None and config.guided.direction == "both":
            with clock("guided"):
                found = self._regions.redetect(found, matches, initial)
                locations, candidates = self._place(found, initial)
                matches = self._match(found, initial, locations, candidates)
        sides, matches = found.sides(matches)
        matches = matches if initial.supported else unsupported(matches)
        sides = self._explained(sides, matches, initial)
        said = [*found.messages, *geometry_warnings(initial), *_placement_note(locations, config)]
        warnings, notes = split([*said, *no_matches(matches)])
        return MatchResult(
            left=sides[0],
            right=sides[1],
            matches=matches,
            points=points,
            fundamental=initial.fundamental,
            homography=initial.homography,
            config=config.to_dict(),
            timings=clock.seconds,
            warnings=warnings,
            notes=notes,
        )

    def regions(self, image: Image, side: Literal["left", "right"] = "left") -> list[Polygon]:
        """The polygons of one photograph, segmented alone, by the segmenter of that side."""
        with self.turns:
            return self._regions.alone(image, side)

    def segmenters(self) -> tuple[Segmenter, Segmenter]:
        """Those of the left and the right image, loaded, to be given to another matcher."""
        with self.turns:
            return self._regions.load()

    def _explained(
        self, sides: tuple[ImagePolygons, ImagePolygons], matches: Sequence[PolygonMatch], initial: InitialGeometry
    ) -> tuple[ImagePolygons, ImagePolygons]:
        """Both sides, with the reason why a polygon has no partner."""
        left, right = (PolygonArrays(side.polygons) for side in sides)
        config = self.config.local_match
        there, here = (
            warp_by_points(arrays, *carrier, config.gamma)
            for arrays, carrier in ((left, initial.forward()), (right, initial.backward()))
        )
        return explained(sides, (left, right), matches, (there, here), config.min_overlap)

    def _place(self, found: PairRegions, initial: InitialGeometry) -> tuple[PyramidLocations, Candidates]:
        config, polygons = self.config.global_match, found.polygons
        locations = place(*found.images, polygons[0].centers, initial, config)
        return locations, search_candidates(*polygons, locations, config)

    def _match(
        self, found: PairRegions, initial: InitialGeometry, locations: PyramidLocations, candidates: Candidates
    ) -> Sequence[PolygonMatch]:
        config = self.config.local_match
        return match_polygons(found.images, found.polygons, initial, locations, candidates, config, found.guided_prior)

    def _load_points(self) -> PointMatcher:
        if self._points is None:
            from zpm2 import features

            self._points = features.create(self.config.points, self.device, progress=self._regions.download)
        return self._points


def on_data(points: PointMatches, images: tuple[Image, Image]) -> PointMatches:
    """The points that lie on pixels that hold data, in both images."""
    for side, image in zip(("left", "right"), images, strict=True):
        if image.valid is not None:
            column, row = np.clip(getattr(points, side), 0, [image.width - 1, image.height - 1]).astype(np.intp).T
            points = points[image.valid[row, column]]
    return points


def explained(
    sides: tuple[ImagePolygons, ImagePolygons],
    polygons: tuple[PolygonArrays, PolygonArrays],
    matches: Sequence[PolygonMatch],
    warped: tuple[WarpedPolygons, WarpedPolygons],
    min_overlap: float,
) -> tuple[ImagePolygons, ImagePolygons]:
    """Both sides with their `unmatched`. `warped` are the left polygons in the right image, and the right ones in the
    left; a side's `image` may be a reduced one."""
    rows = [{int(id): k for k, id in enumerate(arrays.ids)} for arrays in polygons]
    partners = np.full(len(polygons[0]), -1, np.int64), np.full(len(polygons[1]), -1, np.int64)
    for match in matches:
        i, j = rows[0][match.left], rows[1][match.right]
        partners[0][i], partners[1][j] = j, i
    found = []
    for k, side in enumerate(sides):
        other = sides[1 - k]
        seen = visible(warped[k], (other.width, other.height), None if other.image is None else other.image.valid)
        why = reasons(polygons[k], polygons[1 - k], partners[k], warped[k], seen, min_overlap)
        found.append(replace(side, unmatched=why))
    return found[0], found[1]


def _placement_note(locations: PyramidLocations, config: Config) -> list[str]:
    """How many polygons the pyramid could not confirm and left where H predicts them."""
    predicted = ~locations.found
    if config.global_match.search == "fixed" or not predicted.any():
        return []
    count, outside = int(predicted.sum()), int((predicted & locations.outside).sum())
    return [
        Note(
            f"{count} of {len(predicted)} left polygons stay where the geometry predicts them: {outside} beyond the "
            f"right image, {count - outside} without texture that correlates"
        )
    ]


def geometry_warnings(initial: InitialGeometry) -> list[str]:
    """A warning for each of F and H that could not be estimated, with the reason."""
    found = []
    for name, estimated in (("fundamental matrix", initial.fundamental), ("homography", initial.homography)):
        if isinstance(estimated, Failed):
            found.append(f"no {name}: {estimated.reason}")
    if not initial.supported:
        found.append(
            "the photographs may not show the same scene: "
            f"{initial.agreeing} of {len(initial.points)} homologous points agree on one geometry, which may be chance"
        )
    if initial.mirrored:
        found.append(MIRRORED)
    return found
