"""Classical shape matching as a method of its own: every left polygon against every right one, by outline alone."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from zpm2 import config as configuration
from zpm2 import estimate, memory
from zpm2.baselines.histograms import Costs, Counts, compare
from zpm2.baselines.inner_distance import InnerDistance
from zpm2.baselines.shape_context import ShapeContext
from zpm2.config import Config
from zpm2.errors import ConfigError, Failed
from zpm2.guided.regions import RegionFinder, no_matches
from zpm2.model import Image, PointMatches, Polygon, PolygonMatch
from zpm2.model.messages import split
from zpm2.photos.source import ImageLike, opened
from zpm2.result import MatchResult
from zpm2.runtime import Progress, StageTimer
from zpm2.segment.protocol import Segmenter
from zpm2.tiled.whole import in_tiles, match_whole

NOT_ESTIMATED = Failed("not estimated by this method")


class ShapeMethod(Protocol):
    """How outlines are described and how two descriptions are compared."""

    name: ClassVar[str]

    @property
    def limit(self) -> float:
        """Distance from which a pair stays unmatched."""
        ...

    def describe(self, polygons: Sequence[Polygon]) -> Counts:
        """(p, n, b) histograms of each polygon's n samples."""
        ...

    def align(self, costs: Costs) -> NDArray[np.float64]:
        """(c,) distances 0..1 of c pairs from the (c, n, n) chi-square costs of their samples."""
        ...


METHODS: dict[str, ShapeMethod] = {"shape-context": ShapeContext(), "idsc": InnerDistance()}


class BaselineMatcher:
    """Matches the polygons of image pairs by shape alone, as the paper's classical baselines do.

        result = BaselineMatcher("shape-context")("left.png", "right.png")

    `method` is a name of `METHODS`, or a `ShapeContext` or `InnerDistance` with settings of its own. The polygons are
    those that `PairMatcher` finds with the same `config` and `segmenter`; points and geometry are not estimated.
    """

    def __init__(
        self,
        method: str | ShapeMethod,
        config: Config | str = "default",
        *,
        segmenter: Segmenter | tuple[Segmenter, Segmenter] | None = None,
        progress: Progress = lambda stage, share: None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        if isinstance(method, str) and method not in METHODS:
            raise ConfigError(f"unknown baseline '{method}'; baselines are: {', '.join(METHODS)}")
        self.method = METHODS[method] if isinstance(method, str) else method
        self.config = configuration.as_config(config)
        self.progress = progress
        self._regions = RegionFinder(self.config, segmenter, progress, say)

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair. Inputs and errors are those of `Matcher`. Large pairs are matched as a whole, too, with a
        warning where the configuration wants tiles.

        A match's `cost` is the distance of the two shapes. Its `confidence`, 1 - cost / limit, ranks the matches
        of one method; it is no probability.
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
        method, timer = self.method, StageTimer(self.progress)
        with timer("load"):
            self._regions.load()
        with timer("detect"):
            found = self._regions.detect((left, right))
            sides, _ = found.sides((), self.config.vectorize)
        with timer("describe"):
            shapes = method.describe(sides[0].polygons), method.describe(sides[1].polygons)
        with timer("compare"):
            distance = compare(*shapes, method.align, lambda share: self.progress("compare", share))
            matches = [
                PolygonMatch(
                    left=sides[0].polygons[i].id,
                    right=sides[1].polygons[j].id,
                    confidence=float(1 - distance[i, j] / method.limit),
                    cost=float(distance[i, j]),
                    dsf=0,
                    stage="global",
                )
                for i, j in one_to_one(distance, method.limit)
            ]
        warnings, notes = split([*found.messages, *no_matches(matches)])
        return MatchResult(
            left=sides[0],
            right=sides[1],
            matches=sorted(matches, key=lambda match: match.left),
            points=PointMatches.empty(),
            fundamental=NOT_ESTIMATED,
            homography=NOT_ESTIMATED,
            config={**self.config.to_dict(), "baseline": {"method": method.name, **vars(method)}},
            timings=timer.seconds,
            warnings=warnings,
            notes=notes,
        )


def one_to_one(distance: NDArray[np.float64], limit: float) -> NDArray[np.int64]:
    """(k, 2) rows and columns of a (p, q) matrix that are matched, each at most once: the optimal assignment.

    Its cost is the sum of the matched distances plus `limit` for each row or column of the smaller side that stays
    unmatched. A pair as far apart as `limit` is never matched.
    """
    rows, columns = linear_sum_assignment(np.minimum(distance, limit))
    pairs = np.c_[rows, columns].astype(np.int64)
    return np.asarray(pairs[distance[rows, columns] < limit])
