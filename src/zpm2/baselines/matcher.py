"""Other methods on the regions that zpm2 itself would match, so that only the matching differs."""

from collections.abc import Callable
from dataclasses import replace

from zpm2 import config as configuration
from zpm2 import estimate, memory
from zpm2.baselines.embeddings import Encoder
from zpm2.baselines.inner_distance import InnerDistance
from zpm2.baselines.masa import Masa
from zpm2.baselines.mesa import Mesa
from zpm2.baselines.method import Method, Pairing, RegionPair
from zpm2.baselines.sgam import Sgam
from zpm2.baselines.shape_context import ShapeContext
from zpm2.baselines.vote import Vote
from zpm2.config import Config
from zpm2.errors import ConfigError, Failed
from zpm2.features import PointMatcher, check_methods, weights_notes
from zpm2.global_match import Candidates
from zpm2.global_match.pair_points import PointFinder
from zpm2.guided.regions import RegionFinder, no_matches
from zpm2.local_match.shared_points import lookup
from zpm2.model import Image, PointMatches, PolygonMatch
from zpm2.model.messages import Note, split
from zpm2.photos.source import ImageLike, opened
from zpm2.result import MatchResult
from zpm2.runtime import Progress, StageTimer, resolve_device
from zpm2.segment.protocol import Segmenter
from zpm2.tiled.whole import in_tiles, match_whole

NOT_ESTIMATED = Failed("not estimated by this method")
METHODS: dict[str, Method] = {
    method.name: method for method in (ShapeContext(), InnerDistance(), Vote(), Masa(), Sgam(), Mesa())
}


class BaselineMatcher:
    """Matches the polygons of image pairs by another method than ours.

        result = BaselineMatcher("shape-context")("left.png", "right.png")

    `method` is a name of `METHODS`, or an object with settings of its own, as `Vote(min_points=5)`. The polygons are
    those that `PairMatcher` finds with the same `config` and `segmenter`, before its last look for polygons without a
    partner; a method that uses points gets those of `config`, or of `points`, and has the right image's regions guided
    by them as ours. One that uses no points gets each image segmented alone. No geometry is estimated.
    """

    def __init__(
        self,
        method: str | Method,
        config: Config | str = "default",
        *,
        segmenter: Segmenter | tuple[Segmenter, Segmenter] | None = None,
        points: PointMatcher | None = None,
        progress: Progress = lambda stage, share: None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        if isinstance(method, str) and method not in METHODS:
            raise ConfigError(f"unknown baseline '{method}'; baselines are: {', '.join(METHODS)}")
        self.method = METHODS[method] if isinstance(method, str) else method
        self.config = configuration.as_config(config)
        if points is None and self.method.uses_points:
            check_methods(self.config.points)
        self.progress = progress
        self._regions = RegionFinder(self.config, segmenter, progress, say)
        self._encoder = Encoder(self.config, say, self._regions.download)
        self._points_given = points is not None
        self._points = PointFinder(self.config, resolve_device(self.config.device), points, self._regions.download, say)

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair. Inputs and errors are those of `Matcher`. Large pairs are matched as a whole, too, with a
        warning where the configuration wants tiles.

        A match's `cost` is the method's own, the smaller the better. Its `confidence` ranks the matches of one method;
        it is no probability.
        """
        limit = memory.within(self.config.max_memory)
        with self._regions.lock, limit, opened(left, right, self.config.raster) as sources:
            sizes = [(source.width, source.height) for source in sources]
            estimate.refuse_whole(self.config, sizes, self._regions.given)
            result = match_whole(self._match, sources, self.config)
            if in_tiles(sources, self.config):
                result = replace(
                    result, warnings=[*result.warnings, "matched as a whole: baselines do not work in tiles"]
                )
            return result

    def _match(self, left: Image, right: Image) -> MatchResult:
        method, images, timer = self.method, (left, right), StageTimer(self.progress)
        with timer("load"):
            if method.uses_points:
                self._points.load()
            segmenters = self._regions.load()
        looked = self._points(images, timer) if method.uses_points else None
        points, initial = (looked.initial.points, looked.initial) if looked else (PointMatches.empty(), None)
        with timer("detect"):
            found = self._regions.detect(images, initial)
        self._encoder.begin(images, segmenters)
        pair = RegionPair(images, found.polygons, points, self._encoder.embed, self.config.seed)
        pairing = method.match(pair, timer)
        sides, matches = found.sides(_matches(pair, pairing), self.config.vectorize)
        messages = [
            *(looked.notes if looked else []),
            *found.messages,
            *map(Note, method.notes),
            *self._encoder.notes,
            *no_matches(matches),
        ]
        if method.uses_points and not self._points_given:
            messages += weights_notes(self.config.points)
        warnings, notes = split(messages)
        return MatchResult(
            left=sides[0],
            right=sides[1],
            matches=sorted(matches, key=lambda match: match.left),
            points=points,
            fundamental=NOT_ESTIMATED,
            homography=NOT_ESTIMATED,
            config={**self.config.to_dict(), "baseline": {"method": method.name, **vars(method)}},
            timings=timer.seconds,
            warnings=warnings,
            notes=notes,
        )


def _matches(pair: RegionPair, pairing: Pairing) -> list[PolygonMatch]:
    """The matches by the ids of their polygons."""
    shared = pair.shared
    dsf = lookup(shared.counts, shared.pairs, Candidates(pairing.rows[:, 0], pairing.rows[:, 1]))
    return [
        PolygonMatch(
            left=int(pair.polygons[0].ids[i]),
            right=int(pair.polygons[1].ids[j]),
            confidence=float(confidence),
            cost=float(cost),
            dsf=max(int(points), 0),
            stage="global",
        )
        for (i, j), cost, confidence, points in zip(pairing.rows, pairing.cost, pairing.confidence, dsf, strict=True)
    ]
