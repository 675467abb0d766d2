"""Carries the regions of a file, or of a list, from one photograph to others: whole, or by windows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from zpm2 import estimate
from zpm2.carry import pair, windows
from zpm2.carry.outcome import Outcome, missing
from zpm2.carry.result import CarryResult, Side
from zpm2.config import Config
from zpm2.errors import ConfigError, InputError
from zpm2.features import weights_notes
from zpm2.formats.regions.outlines import shape_of
from zpm2.formats.regions.region import GivenRegion, RegionFile
from zpm2.formats.regions.registry import open_regions
from zpm2.global_match import InitialGeometry, initial_geometry
from zpm2.global_match.pair_points import PointFinder
from zpm2.model import Image, Polygon
from zpm2.model.messages import split
from zpm2.photos.images import whole
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.photos.source import Source
from zpm2.runtime import Progress, StageTimer
from zpm2.segment.protocol import PromptedSegmenter, Segmenter, notes_of

Regions = str | Path | RegionFile | Sequence[Polygon]


def opened_regions(regions: Regions) -> RegionFile | Sequence[Polygon]:
    """The file, opened, or the polygons. `InputError` for a file that holds no regions."""
    return open_regions(regions) if isinstance(regions, str | Path) else regions


def carry(
    sources: tuple[Source, Source],
    regions: RegionFile | Sequence[Polygon],
    finder: Callable[[], PointFinder],
    segmenter: Callable[[], Segmenter],
    kept: KeptPhotos,
    config: Config,
    rigid: bool,
    progress: Progress,
    kept_windows: KeptPhotos = NOTHING_KEPT,
) -> CarryResult:
    """The regions of the left photograph in the right one. See `zpm2.Matcher.carry`. What was found in
    photographs that are `kept`, and in windows of left ones, is used again."""
    timer, notes = StageTimer(progress), list[str]()
    left, right = sources
    with timer("read"):
        file = None if isinstance(regions, Sequence) else regions
        given = _of_polygons(regions) if isinstance(regions, Sequence) else _of_file(regions, left, notes)
        shapes = [shape_of(region) for region in given]
        box = shapely.box(0, 0, left.width, left.height)
        usable = [k for k, shape in enumerate(shapes) if shape is not None and shape.intersects(box)]
        if not usable:
            raise InputError(
                f"{'the list' if file is None else file.path} has no region with an area in the {left.width} x "
                f"{left.height} px left photograph: check that its coordinates are pixels of this photograph"
            )
    with timer("load"):
        points = finder()
        own = None if rigid else segmenter()
        prompted = None if own is None else _prompted(own, config)
    names = [given[k].source_id or str(given[k].row) for k in usable]
    small = max(left.width, left.height, right.width, right.height) <= 2 * config.carry.window
    seen = kept if small else kept_windows
    job = _Job(
        sources, np.array([shapes[k] for k in usable], object), names, points, prompted, seen, config, timer, notes
    )
    found = job.whole() if small else job.by_windows()
    nothing = Outcome("not found", "it has no area in the left photograph", None, 0.0, None)
    by_row = dict(zip(usable, found, strict=True))
    outcomes = [by_row.get(k, nothing) for k in range(len(given))]
    messages = [*notes, *left.notes, *right.notes, *weights_notes(config.points)]
    messages += notes_of(own) if own is not None else []
    if not any(outcome.shape is not None for outcome in outcomes):
        messages.append("no region was found in the right photograph")
    warnings, told = split(messages)
    return CarryResult(
        Side(left.path, left.width, left.height, left.geo),
        Side(right.path, right.width, right.height, right.geo),
        given,
        shapes,
        outcomes,
        config.to_dict(),
        timer.seconds,
        warnings,
        told,
        file,
    )


@dataclass(frozen=True, eq=False)
class _Job:
    """The regions of one pair, and all that is needed to carry them."""

    sources: tuple[Source, Source]
    shapes: NDArray[np.object_]  # (n,) left px
    names: Sequence[str]  # of each, for reasons
    finder: PointFinder
    segmenter: PromptedSegmenter | None  # None: outlines are only moved
    kept: KeptPhotos  # photographs, or windows of left ones
    config: Config
    timer: StageTimer
    notes: list[str]  # of the run, added to

    def whole(self) -> list[Outcome]:
        """Both photographs are seen as a whole."""
        sizes = [(source.width, source.height) for source in self.sources]
        estimate.refuse_whole(self.config, sizes, self.segmenter is None)
        with self.timer("read"):
            images = whole(self.sources[0], "left image"), whole(self.sources[1], "right image")
            images = self.kept.same(images[0]), self.kept.same(images[1])
        looked = self.finder(images, self.timer, self.kept)
        self.notes.extend(looked.notes)
        rows = np.arange(len(self.shapes))
        with self.timer("carry"):
            return self._carried(images, rows, self.shapes, looked.initial, _ground_map(self.sources), self._progress)

    def by_windows(self) -> list[Outcome]:
        """Windows around the regions are seen one by one."""
        config = self.config
        initial, told = windows.overview(self.sources, self.finder, config, self.timer)
        self.notes.extend(told)
        found: dict[int, Outcome] = {}
        with self.timer("carry"):
            for rows, views in windows.window_pairs(self.sources, self.shapes, initial, config):
                if views is None:
                    size = self.sources[1].width, self.sources[1].height
                    unseen = missing(shapely.Polygon(), 0.0, size, None, config.carry)
                    found |= {int(row): Outcome(*unseen, None, 0.0, None) for row in rows}
                    continue
                images = self.kept.same(views[0].image), views[1].image
                points = self.finder.first_look(images, self.kept)
                here = initial_geometry(points, config.global_match, config.seed)
                made = self._carried(images, rows, windows.to_view(self.shapes[rows], views[0]), here)
                found |= {int(row): windows.from_view(each, views[1]) for row, each in zip(rows, made, strict=True)}
                self._progress(len(found) / len(self.shapes))
        return [found[k] for k in range(len(self.shapes))]

    def _carried(
        self,
        images: tuple[Image, Image],
        rows: NDArray[np.intp],
        shapes: NDArray[np.object_],
        initial: InitialGeometry,
        linear: NDArray[np.float64] | None = None,
        progress: Callable[[float], None] = lambda share: None,
    ) -> list[Outcome]:
        """The regions `rows`, whose `shapes` are px of the left one of two images."""
        if self.segmenter is None:
            return pair.moved_only((images[1].width, images[1].height), shapes, initial, self.config, linear)
        names = [self.names[row] for row in rows]
        return pair.carry(images, shapes, names, initial, self.segmenter, self.config, self.kept, progress)

    def _progress(self, share: float) -> None:
        self.timer.progress("carry", share)


def _of_file(file: RegionFile, left: Source, notes: list[str]) -> list[GivenRegion]:
    read = file.read(left)
    notes += read.notes
    if not read.regions:
        raise InputError(f"{file.path} holds no region of the left photograph: give a file with at least one")
    return read.regions


def _of_polygons(polygons: Sequence[Polygon]) -> list[GivenRegion]:
    return [
        GivenRegion(
            ([each.exterior, *each.holes],), each.id, str(each.id), each.score, each.label, each.properties, row
        )
        for row, each in enumerate(polygons)
    ]


def _prompted(segmenter: Segmenter, config: Config) -> PromptedSegmenter:
    if not isinstance(segmenter, PromptedSegmenter):
        raise ConfigError(
            f"segmenter '{config.segment.model}' takes no prompts, so it cannot look for a region: use mobile_sam, or "
            "--rigid, which only moves outlines"
        )
    return segmenter


def _ground_map(sources: tuple[Source, Source]) -> NDArray[np.float64] | None:
    """(2, 2) from left to right px by two affine georeferences of one reference system; None where they have none."""
    left, right = (source.geo for source in sources)
    if not (left.located and right.located and left.crs == right.crs):
        return None
    assert left.transform is not None
    assert right.transform is not None
    return np.asarray(np.linalg.inv(right.transform[:, :2]) @ left.transform[:, :2])
