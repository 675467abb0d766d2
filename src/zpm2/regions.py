"""What every method of matching polygons begins with: the device, the segmenter, and the polygons of both images."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

import PIL.Image
from numpy.typing import NDArray

from zpm2.config import Config
from zpm2.detect.protocol import PolygonSource, Segmenter
from zpm2.detect.vectorize import vectorize
from zpm2.errors import ConfigError
from zpm2.model import Image, Polygon, PolygonMatch
from zpm2.result import Side

ImageLike = str | Path | NDArray[Any] | PIL.Image.Image
Progress = Callable[[str, float], None]  # stage, share that is done, 0..1


class RegionStages:
    """The stages that every method of matching polygons shares: load the segmenter, find the polygons of both images.

    Arguments are those of `PolygonMatcher`.
    """

    def __init__(
        self,
        config: Config,
        segmenter: Segmenter | tuple[Segmenter, Segmenter] | None,
        progress: Progress,
        say: Callable[[str], None],
    ) -> None:
        self.config, self.progress, self.say = config, progress, say
        self._segmenters = segmenter if isinstance(segmenter, tuple) or segmenter is None else (segmenter, segmenter)
        self._sides_done = 0

    def load(self) -> tuple[Segmenter, Segmenter]:
        """The segmenters of the left and the right image; SAM is loaded the first time, where no other was given."""
        if self._segmenters is None:
            from zpm2.detect.sam import SamSegmenter

            device = resolve_device(self.config.device)
            sam = SamSegmenter(self.config.segment, device, self.say, self._detect_progress, self.download)
            sam.load()  # now, so that the time counts as loading
            self._segmenters = (sam, sam)
        return self._segmenters

    def detect(self, images: tuple[Image, Image]) -> tuple[tuple[Side, Side], list[str]]:
        """Both sides with their polygons, and what there is to warn of."""
        self._sides_done = 0
        found = [self._polygons(s, image) for s, image in zip(self.load(), images, strict=True)]
        polygons, notes = zip(*found, strict=True)
        left, right = (Side(i.width, i.height, p, i.path, i) for i, p in zip(images, polygons, strict=True))
        return (left, right), _region_warnings(images, notes, polygons)

    def download(self, done: int, total: int) -> None:
        """Tells `progress` how many bytes of weights have come."""
        self.progress("load", done / max(total, 1))

    def _detect_progress(self, share: float) -> None:
        self.progress("detect", (self._sides_done + share) / 2)

    def _polygons(self, segmenter: Segmenter, image: Image) -> tuple[list[Polygon], list[str]]:
        """The polygons of one side, and what the segmenter has to say about them."""
        if isinstance(segmenter, PolygonSource):
            found = segmenter.polygons(image)
        else:
            size = image.width, image.height
            found = vectorize(segmenter.segment(image), self.config.vectorize, self.config.segment.min_area, size)
        self._sides_done += 1
        return found, list(getattr(segmenter, "notes", []))


def resolve_device(name: str) -> str:
    """ "cpu" or "cuda" for "auto", "cpu" or "cuda"; `ConfigError` for any other, and for cuda where there is none."""
    if name not in ("auto", "cpu", "cuda"):
        raise ConfigError(f"unknown device '{name}'; devices are: auto, cpu, cuda")
    if name == "cpu":
        return name
    import torch

    if torch.cuda.is_available():
        return "cuda"
    if name == "cuda":
        raise ConfigError("device cuda is not available to torch on this machine; use --device cpu")
    return "cpu"


class Clock:
    """Seconds by stage; tells `progress` when one begins and ends."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.progress = progress

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        self.progress(stage, 0.0)
        start = perf_counter()
        yield
        self.seconds[stage] = perf_counter() - start
        self.progress(stage, 1.0)


def no_matches(matches: Sequence[PolygonMatch]) -> list[str]:
    """The warning that nothing was matched, where that is so."""
    return [] if matches else ["no polygons were matched"]


def _region_warnings(
    images: tuple[Image, Image], notes: tuple[list[str], ...], polygons: tuple[list[Polygon], ...]
) -> list[str]:
    sides = ("left", "right")
    found = [f"{side} image: {note}" for side, image in zip(sides, images, strict=True) for note in image.notes]
    both = [note for note in notes[0] if note in notes[1]]  # said once, where it holds for both
    found += both
    found += [f"{s} regions: {note}" for s, of in zip(sides, notes, strict=True) for note in of if note not in both]
    found += [f"no regions were found in the {s} image" for s, p in zip(sides, polygons, strict=True) if not p]
    return found
