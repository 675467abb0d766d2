"""The polygons of both images, for every method that matches them: segmented alone, or guided by each other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from zpm2.config import Config, VectorizeConfig
from zpm2.files.photo_paths import absolute
from zpm2.global_match import InitialGeometry
from zpm2.guided import detail, redetection
from zpm2.guided.prior import GuidedPrior
from zpm2.model import Image, ImagePolygons, Polygon, PolygonArrays, PolygonMatch
from zpm2.model.messages import about
from zpm2.photos.kept import NOTHING_KEPT, KeptPhotos
from zpm2.polygons.vectorize import vectorize
from zpm2.runtime import ForkAwareLock, Progress, resolve_device
from zpm2.segment import registry
from zpm2.segment.answers import masks_of, polygons_of
from zpm2.segment.checked_view import views_of
from zpm2.segment.protocol import JointSegmenter, PolygonSource, PromptedSegmenter, PromptedView, Segmenter, notes_of
from zpm2.segment.view_of import view_of


@dataclass(frozen=True, eq=False)
class PairRegions:
    """The regions of a pair: what the matcher needs."""

    images: tuple[Image, Image]
    polygons: tuple[PolygonArrays, PolygonArrays]
    messages: list[str]  # warnings, and notes (`messages`)
    prompted: redetection.DetectedPair | None = None  # where the segmenter takes prompts
    guided_prior: GuidedPrior | None = None

    def sides(
        self, matches: Sequence[PolygonMatch], config: VectorizeConfig
    ) -> tuple[tuple[ImagePolygons, ImagePolygons], Sequence[PolygonMatch]]:
        """Both sides of a result, and the matches by the ids of their polygons there."""
        polygons: Sequence[Sequence[Polygon]] = [arrays.polygons for arrays in self.polygons]
        if self.prompted is not None:
            polygons, matches = redetection.drop_unconfirmed(self.prompted, matches, config)
        left, right = (
            ImagePolygons(i.width, i.height, p, absolute(i.path), i) for i, p in zip(self.images, polygons, strict=True)
        )
        return (left, right), matches


class RegionFinder:
    """Loads the segmenter and finds the polygons of both images.

    The arguments are those of `PairMatcher`. `given` is True for a segmenter other than the configured one. Threads
    that use one finder take turns by its `lock`.
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
        self.given = segmenter is not None
        if not self.given:
            registry.check_segmenter(config.segment)
        self._sides_done = 0
        self.lock = ForkAwareLock()

    def load(self) -> tuple[Segmenter, Segmenter]:
        """The segmenters of the left and the right image. The configured one is loaded at the first call,
        if no other was given."""
        if self._segmenters is None:
            device = resolve_device(self.config.device)
            made = registry.create(self.config.segment, device, self.say, self._detect_progress, self.download)
            self._segmenters = (made, made)
        return self._segmenters

    def detect(
        self, images: tuple[Image, Image], initial: InitialGeometry | None = None, kept: KeptPhotos = NOTHING_KEPT
    ) -> "PairRegions":
        """The polygons of both images. The right image is guided by the left one if there is `initial` geometry, the
        configuration says so and the segmenter takes prompts; else each image is segmented alone. What a photograph
        that is `kept` shows alone is not looked for again."""
        segmenters, why_not, no_detail = self.load(), None, "it needs guided re-detection"
        if initial is not None and self.config.guided.direction != "off":
            prompted = [segmenter for segmenter in segmenters if isinstance(segmenter, PromptedSegmenter)]
            if any(isinstance(segmenter, PolygonSource) for segmenter in segmenters):
                no_detail = "regions are given"  # and matched as they are
            elif len(prompted) < 2:
                why_not = "the segmenter takes no prompts: no guided re-detection"
            elif not initial.supported:
                why_not = "no geometry for guided re-detection: each image was segmented alone"
            else:
                left, right = _views(prompted, images, kept)
                known = kept.found(
                    images[0],
                    ("everything", id(prompted[0])),
                    lambda: redetection.everything(left, self.config, lambda share: self._share(share / 2)),
                )
                pair = redetection.detect((left, right), initial, self.config, self._share, known)
                return self._guided(images, pair, initial)
        self._sides_done = 0
        found = [self._polygons(s, image) for s, image in zip(segmenters, images, strict=True)]
        (left, right), notes = zip(*found, strict=True)
        messages = _messages(images, notes, (left, right)) + ([why_not] if why_not else [])
        if initial is not None and self.config.segment.detail.level == "high":
            messages.append(f"no closer look (--detail high): {no_detail}")
        return PairRegions(images, (PolygonArrays(left), PolygonArrays(right)), messages)

    def alone(self, image: Image, side: Literal["left", "right"]) -> list[Polygon]:
        """The polygons of one image, segmented alone by the segmenter of that side."""
        return self._polygons(self.load()[side == "right"], image)[0]

    def redetect(
        self, found: "PairRegions", matches: Sequence[PolygonMatch], initial: InitialGeometry
    ) -> "PairRegions":
        """`found`, and the left regions that the unmatched right polygons find as prompts."""
        assert isinstance(found.prompted, redetection.PromptedPair)
        return self._guided(found.images, redetection.redetect(found.prompted, matches, initial, self.config), initial)

    def look_closer(
        self,
        found: "PairRegions",
        matches: Sequence[PolygonMatch],
        initial: InitialGeometry,
        match: Callable[["PairRegions"], Sequence[PolygonMatch]],
    ) -> None:
        """Looks closer where it pays (`detail`). `found` has the `matches`. After each window, `match` receives `found`
        with the regions that were found so far, and returns the matches of these."""
        assert found.prompted is not None
        prompted = [segmenter for segmenter in self.load() if isinstance(segmenter, PromptedSegmenter)]
        detail.look_closer(
            found.prompted,
            found.images,
            lambda first, second: _views(prompted, (first, second)),
            initial,
            matches,
            lambda pair: match(self._guided(found.images, pair, initial)),
            self.config,
            lambda share: self.progress("detail", share),
        )

    def _guided(
        self, images: tuple[Image, Image], pair: redetection.DetectedPair, initial: InitialGeometry
    ) -> "PairRegions":
        polygons = pair.left.polygons, pair.right.polygons
        left, right = PolygonArrays(polygons[0]), PolygonArrays(polygons[1])
        left_notes, right_notes = (notes_of(segmenter) for segmenter in self.load())
        messages = _messages(images, (left_notes, right_notes), polygons)
        guided_prior = redetection.guided_prior(pair, left, initial, self.config)
        return PairRegions(images, (left, right), messages, pair, guided_prior)

    def download(self, done: int, total: int) -> None:
        """Reports to `progress` how many bytes of the weights have been downloaded: half of the stage, as they are then
        loaded, and converted once."""
        self.progress("load", done / max(total, 1) / 2)

    def _share(self, share: float) -> None:
        self.progress("detect", share)

    def _detect_progress(self, share: float) -> None:
        self._share((self._sides_done + share) / 2)

    def _polygons(self, segmenter: Segmenter, image: Image) -> tuple[list[Polygon], list[str]]:
        """The polygons of one side, and the segmenter's notes."""
        if isinstance(segmenter, PolygonSource):
            found = polygons_of(segmenter, image)
        else:
            size = image.width, image.height
            found = vectorize(masks_of(segmenter, image), self.config.vectorize, self.config.segment.min_area, size)
        self._sides_done += 1
        return found, notes_of(segmenter)


def _views(
    segmenters: Sequence[PromptedSegmenter], images: tuple[Image, Image], kept: KeptPhotos = NOTHING_KEPT
) -> tuple[PromptedView, PromptedView]:
    """Both photographs, encoded: together where one segmenter can and none is kept for other pairs."""
    one, other = segmenters
    if one is other and isinstance(one, JointSegmenter) and not kept.most:
        left, right = views_of(one, images, lambda: one.views_together(images))
        return left, right
    return view_of(one, images[0], kept), view_of(other, images[1], kept)


def no_matches(matches: Sequence[PolygonMatch]) -> list[str]:
    """A warning if there are no matches."""
    return [] if matches else ["no polygons were matched"]


def _messages(
    images: tuple[Image, Image], notes: tuple[list[str], ...], polygons: tuple[list[Polygon], ...]
) -> list[str]:
    sides = ("left", "right")
    found = [text for side, image in zip(sides, images, strict=True) for text in about(f"{side} image", image.notes)]
    both = [note for note in notes[0] if note in notes[1]]  # listed once
    found += both
    for side, own in zip(sides, notes, strict=True):
        found += about(f"{side} regions", [note for note in own if note not in both])
    found += [f"no regions were found in the {s} image" for s, p in zip(sides, polygons, strict=True) if not p]
    return found
