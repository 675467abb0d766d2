"""One entry for any two photographs: `match` for a pair, `Matcher` for many, and the methods by name.

Commands and the other rooms of the package match pairs through this module only, so that none of them can miss an
option.
"""

import dataclasses
import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

from zpm2 import baselines, estimate, memory
from zpm2 import carry as carrying
from zpm2 import config as configuration
from zpm2.config import Config
from zpm2.errors import ConfigError, Zpm2Error, did_you_mean
from zpm2.features import PointMatcher
from zpm2.files.photo_paths import are_swapped, has_content
from zpm2.model import SIDES
from zpm2.photos.kept import KeptPhotos
from zpm2.photos.shelf import Shelf
from zpm2.photos.source import ImageLike, Source, opened
from zpm2.pipeline import PairMatcher
from zpm2.result import MatchResult, read_result
from zpm2.runtime import Progress
from zpm2.segment.protocol import PolygonSource, PromptedSegmenter, Segmenter
from zpm2.segment.registry import SEGMENTERS
from zpm2.tiled.elsewhere import TileWorkers
from zpm2.tiled.run import TiledRun
from zpm2.tiled.whole import in_tiles, match_whole, min_areas

PRECOMPUTED = "precomputed"  # the segmenter's name where regions are given
METHODS = ("zpm2", *baselines.METHODS)
LAST_TWO = 2  # photographs that stay encoded while regions are carried: the left one, and one right one after the other

PairFunction = Callable[[ImageLike, ImageLike], MatchResult]


class Matcher:
    """Finds and matches the polygons of pairs of any size. Arguments are those of `PairMatcher`.

    Files are read by windows where that pays (`photos.source.open_source`); georeferences are kept. `tiles.mode`
    decides whether a pair is matched whole or in tiles. `kept` is a folder for finished tiles, of methods of the
    configuration or given regions: an interrupted run goes on from there if photographs, configuration and code are the
    same, and `say` is told how many tiles it took. The `photographs` that were used last are not looked at again when
    they come in another pair; each takes some 30 MB. What networks found in earlier ones, and in windows of photographs
    whose regions are carried, is put into the folder `aside`, which the caller makes and removes. `workers` are
    processes that make the tiles of large pairs (`zpm2.batch.TileEngine`); they need `kept`.
    """

    def __init__(
        self,
        config: Config | str = "default",
        *,
        segmenter: Segmenter | tuple[Segmenter, Segmenter] | None = None,
        points: PointMatcher | None = None,
        progress: Progress = lambda stage, share: None,
        say: Callable[[str], None] = lambda text: None,
        kept: str | Path | None = None,
        photographs: int = 0,
        aside: str | Path | None = None,
        workers: TileWorkers | None = None,
    ) -> None:
        self.config = configuration.as_config(config)
        self.progress, self.say = progress, say
        self.kept = None if kept is None else Path(kept)
        self._whole = PairMatcher(self.config, segmenter=segmenter, points=points, progress=self._tell, say=say)
        self._quiet = 0  # how many iterations over many pairs are going on
        self._points, self._segmenter_given = points, segmenter is not None
        own = segmenter if isinstance(segmenter, tuple) else (segmenter,)
        foreign = points is not None or not all(each is None or isinstance(each, PolygonSource) for each in own)
        if foreign and not (workers is None and kept is None):
            raise unnamed("kept tiles" if workers is None else "workers")
        self._workers = workers
        self.keep(photographs, aside)

    def keep(self, photographs: int, aside: str | Path | None = None) -> None:
        """Forget all photographs; from now on keep so many, and put others `aside`, as when the matcher was made."""
        shelf = None if aside is None else Shelf(Path(aside), 1e9 * self.config.tracks.on_disk)
        self._photographs = KeptPhotos(photographs, shelf)
        self._carried = self._photographs if self._photographs.most >= LAST_TWO else KeptPhotos(LAST_TWO)
        self._windows = KeptPhotos(1, shelf)  # of left photographs too large to be seen as a whole

    def __call__(self, left: ImageLike, right: ImageLike) -> MatchResult:
        """Match one pair. Inputs are those of `PairMatcher`, and rasters of any size (extra `geo`).

        Raises `InputError` for what cannot be read as a photograph, `OutputError` where `kept` cannot be written.
        Threads and forks are as with `PairMatcher`.
        """
        limit = memory.within(self.config.max_memory)
        with self._whole.lock, limit, opened(left, right, self.config.raster) as sources:
            tiles, said = self._by_tiles(sources)
            return self._in_tiles(sources, said) if tiles else self._as_a_whole(sources, self._photographs)

    def match_many(
        self, pairs: Iterable[tuple[ImageLike, ImageLike]], *, at_once: int = 2, photographs: int = 8
    ) -> Iterator[MatchResult | Zpm2Error]:
        """The results of many pairs, one after the other, in their order; each the same as that of a call.

        Of a pair that fails, its error takes the place of the result, and the iteration goes on. What is wrong with all
        pairs (weights that cannot be had) is raised. `pairs` may be endless: `at_once` of them are in work, and further
        ones are taken when the results before them were. Do not change arrays before that.

        While one pair is compared on the processor, the networks look at the next. They look at a photograph once,
        however many pairs it is in, as long as it is one of the last `photographs` that were used; each takes some 30
        MB. A matcher that was made with as many `photographs` keeps them for the next call, too. Pairs are matched one
        at a time where segmenters or point matchers are not zpm2's own, where two would not fit into `max_memory`, and
        in tiles. `progress` is not told; stages of a result's `timings` include waiting for other pairs. `ConfigError`
        for an `at_once` or a number of `photographs` under 1.
        """
        if min(at_once, photographs) < 1:
            raise ConfigError(
                f"match_many takes at least 1 pair at once and 1 photograph, not {at_once}, {photographs}"
            )
        at_once = at_once if self._whole.takes_threads else 1
        most = max(photographs, 2 * at_once)
        return self._many(pairs, at_once, self._photographs if self._photographs.most >= most else KeptPhotos(most))

    def _many(
        self, pairs: Iterable[tuple[ImageLike, ImageLike]], at_once: int, kept: KeptPhotos
    ) -> Iterator[MatchResult | Zpm2Error]:
        self._whole.load()
        self._quiet += 1
        running: deque[Future[MatchResult | Zpm2Error]] = deque()
        pool = ThreadPoolExecutor(at_once, thread_name_prefix="zpm2")
        try:
            for left, right in pairs:
                running.append(pool.submit(self._one_of_many, left, right, kept, at_once))
                if len(running) == at_once:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)
            self._quiet -= 1

    def _one_of_many(
        self, left: ImageLike, right: ImageLike, kept: KeptPhotos, at_once: int
    ) -> MatchResult | Zpm2Error:
        limit = memory.within(self.config.max_memory)
        try:
            with limit, opened(left, right, self.config.raster) as sources:
                tiles, said = self._by_tiles(sources)
                if tiles:
                    with self._whole.lock:
                        return self._in_tiles(sources, said)
                sizes = [(source.width, source.height) for source in sources]
                all_of_them = at_once * estimate.whole(self.config, sizes, self._segmenter_given)
                with self._whole.lock if all_of_them > memory.budget() else nullcontext():
                    return self._as_a_whole(sources, kept)
        except Zpm2Error as error:
            return error

    def _as_a_whole(self, sources: tuple[Source, Source], kept: KeptPhotos) -> MatchResult:
        return match_whole(functools.partial(self._whole.one_of_many, kept=kept), sources, self.config)

    def _in_tiles(self, sources: tuple[Source, Source], said: list[str]) -> MatchResult:
        smallest = min_areas(sources, self.config)
        run = TiledRun(sources, smallest, self._whole, self._points, self.say, self.kept, said, self._workers)
        return run.result().with_gis_messages()

    def _tell(self, stage: str, share: float) -> None:
        if not self._quiet:
            self.progress(stage, share)

    def carry(
        self, left: ImageLike, right: ImageLike, regions: carrying.Regions, *, rigid: bool = False
    ) -> carrying.CarryResult:
        """Each given region of the left photograph in the right one: its outline there, or why it has none.

        `regions` is a file that `zpm2 match --left-regions` takes too, or polygons in px of the left photograph. The
        segmenter snaps outlines to the right photograph; `rigid` only moves the given ones. Photographs of any size;
        the last two stay encoded, so that several right ones, or regions, of one left one cost less.
        Errors are those of `__call__`, `InputError` for a file without regions, and `ConfigError` for a segmenter that
        takes no prompts.
        """
        opened_file = carrying.opened_regions(regions)
        limit = memory.within(self.config.max_memory)
        with self._whole.lock, limit, opened(left, right, self.config.raster) as sources:
            return carrying.carry(
                sources,
                opened_file,
                self._whole.points,
                lambda: self._whole.segmenters()[1],
                self._carried,
                self.config,
                rigid,
                self.progress,
                self._windows,
            )

    @property
    def has_objects(self) -> bool:
        """Whether its segmenter or point matcher is an object, so that its configuration does not say what it finds."""
        return self._segmenter_given or self._points is not None

    @property
    def takes_prompts(self) -> bool:
        """Whether its segmenter can look for a region, as `carry` needs it."""
        return isinstance(self._whole.segmenters()[1], PromptedSegmenter)

    def _by_tiles(self, sources: Sequence[Source]) -> tuple[bool, list[str]]:
        """Whether a pair is matched in tiles, and a warning where only the memory budget demands it. `InputError` where
        the pair does not fit into the budget either way."""
        config, given = self.config, self._segmenter_given
        sizes = [(source.width, source.height) for source in sources]
        tiles, said = in_tiles(sources, config), []
        needed = estimate.whole(config, sizes, given)
        held = sum(source.held for source in sources)
        less = config.tiles.mode == "auto" and estimate.in_tiles(config, sizes, held, given) < needed
        if not tiles and less and needed > memory.budget():
            tiles = True
            said.append(
                f"matched in tiles, as it needs about {memory.in_words(needed)} of memory as a whole, more than "
                f"{memory.whose()}"
            )
        if tiles:
            estimate.refuse_in_tiles(config, sizes, held, given)
        else:
            estimate.refuse_whole(config, sizes, given)
        return tiles, said


def unnamed(what: str) -> ConfigError:
    """The error where `what` would have to tell a segmenter or point matcher that is an object from another one."""
    return ConfigError(f"{what} cannot take a segmenter or point matcher that is an object: name it instead")


def match(
    left: ImageLike,
    right: ImageLike,
    config: Config | str | None = None,
    *,
    preset: str = "default",
    segmenter: str | None = None,
    quality: str | None = None,
    detail: str | None = None,
    left_regions: str | Path | None = None,
    right_regions: str | Path | None = None,
    method: str = "zpm2",
    points: str | Sequence[str] | None = None,
    non_overlapping: bool = False,
    outlines: bool = False,
    tiles: str | None = None,
    bands: str | int | Sequence[int] | None = None,
    gsd: str | float | Sequence[float] | None = None,
    min_area_m2: float | None = None,
    device: str | None = None,
    seed: int | None = None,
    max_memory: str | None = None,
    kept: str | Path | None = None,
    workers: TileWorkers | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> MatchResult:
    """Match the polygons of one pair of photographs of any size. For many pairs, keep a `Matcher`.

    The options are those of `zpm2 match`. `config` is a whole configuration or the name of a preset, and takes the
    place of `preset`; the other options are laid over it. `kept`, `workers`, `progress` and `say` are those of
    `Matcher`.
    `ConfigError` for a value that does not exist; other errors as from `Matcher`.
    """
    check_method(method)
    if segmenter is not None:
        check_segmenter(segmenter)
    base = preset if config is None else config
    chosen = configuration.with_options(
        configuration.as_config(base),
        {
            "segmenter": None if segmenter == PRECOMPUTED else segmenter,
            "quality": quality,
            "detail": detail,
            "points": points,
            "tiles": tiles,
            "bands": bands,
            "gsd": gsd,
            "min_area_m2": min_area_m2,
            "device": device,
            "seed": seed,
            "max_memory": max_memory,
        },
    )
    own = own_regions(segmenter, left_regions, right_regions, chosen)
    opened_method = open_method(method, chosen, segmenter=own, kept=kept, workers=workers, progress=progress, say=say)
    result = opened_method(left, right)
    result = result.flatten() if non_overlapping else result
    return result.with_outlines() if outlines else result


def own_regions(
    segmenter: str | None, left: str | Path | None, right: str | Path | None, config: Config
) -> tuple[Segmenter, Segmenter] | None:
    """The segmenters that read the regions of two files; None where no file is named. `ConfigError` where only one is,
    or another segmenter is named too."""
    if segmenter != PRECOMPUTED and left is None and right is None:
        return None
    if segmenter not in (None, PRECOMPUTED) or left is None or right is None:
        raise ConfigError("own regions need all of: --segmenter precomputed --left-regions FILE --right-regions FILE")
    from zpm2.segment.given.precomputed import PrecomputedSegmenter

    sides = [PrecomputedSegmenter(path, config.vectorize, config.segment.min_area) for path in (left, right)]
    return sides[0], sides[1]


def segmenters() -> tuple[str, ...]:
    """The names of all segmenters, and `PRECOMPUTED`."""
    return (*SEGMENTERS, PRECOMPUTED)


def check_segmenter(name: str) -> None:
    """`ConfigError` for what is neither one of the names `segmenters` nor a dotted path."""
    if not isinstance(name, str):
        raise ConfigError(
            f"segmenter is a name, got {type(name).__name__}: give an object to zpm2.Matcher(config, segmenter=...)"
        )
    if name != PRECOMPUTED and name not in SEGMENTERS:
        raise SEGMENTERS.unknown(name, [PRECOMPUTED])


def check_method(name: str) -> None:
    """`ConfigError` for what is not in `METHODS`."""
    if name not in METHODS:
        raise ConfigError(f"unknown method '{name}'{did_you_mean(name, METHODS)}; methods are: {', '.join(METHODS)}")


def finds_points(method: str) -> bool:
    """Whether the results of a method (`METHODS`) have homologous points, from which a pose can be found."""
    return method == "zpm2" or baselines.METHODS[method].uses_points


def open_method(
    name: str,
    config: Config,
    *,
    segmenter: Segmenter | tuple[Segmenter, Segmenter] | None = None,
    kept: str | Path | None = None,
    workers: TileWorkers | None = None,
    progress: Progress = lambda stage, share: None,
    say: Callable[[str], None] = lambda text: None,
) -> PairFunction:
    """The method of that name (`METHODS`) as a function of two photographs. Arguments are those of `Matcher`; a
    baseline knows no tiles, and needs neither `kept` nor `workers`. `ConfigError` for an unknown name."""
    check_method(name)
    if name == "zpm2":
        return Matcher(config, segmenter=segmenter, progress=progress, say=say, kept=kept, workers=workers)
    return baselines.BaselineMatcher(name, config, segmenter=segmenter, progress=progress, say=say)


def saved_matches(
    folder: str | Path, photographs: Sequence[str | Path], sizes: Sequence[tuple[int, int]]
) -> MatchResult:
    """The matches that `MatchResult.save` wrote into `folder`, for two photographs of `sizes` (width, height) px.

    `ConfigError` where the matches are of photographs of another size, or of these in the other order. A file of the
    right size with other content may be the same photograph, better exposed for instance: the result gets a warning.
    """
    matched, document = read_result(folder)
    noted = [document[name] for name in SIDES]
    if are_swapped(noted, photographs):
        raise ConfigError(f"--matches {folder} is of these images the other way round: exchange them")
    warnings = list(matched.warnings)
    for k, (name, side) in enumerate(zip(SIDES, (matched.left, matched.right), strict=True)):
        size, path = sizes[k], photographs[k]
        if (side.width, side.height) != size:
            raise ConfigError(
                f"--matches {folder} is of a {name} image of {side.width} x {side.height} px, this one has "
                f"{size[0]} x {size[1]} px: give the images that were matched"
            )
        if not has_content(noted[k], path):
            warnings.append(
                f"{path} is not the file that was matched in {folder}, it only has the same size: where it shows "
                "anything else, the result is wrong"
            )
    return dataclasses.replace(matched, warnings=warnings)
