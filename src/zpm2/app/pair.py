"""Two photographs on which a person points at regions: encoded once, their points found once."""

import contextlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zpm2 import estimate, memory
from zpm2.app.photograph import Photograph
from zpm2.app.prompt import Prompt
from zpm2.carry import Outcome
from zpm2.carry import pair as carrying
from zpm2.config import Config
from zpm2.errors import ConfigError, Failed, InputError
from zpm2.features import weights_notes
from zpm2.formats.regions.region import Shape
from zpm2.global_match import InitialGeometry, initial_geometry
from zpm2.model import Image, PointMatches
from zpm2.photos.kept import KeptPhotos
from zpm2.pipeline import PairMatcher
from zpm2.runtime import Progress, StageTimer
from zpm2.segment.predictions import MaskPredictions, MaskThresholds
from zpm2.segment.protocol import PromptedSegmenter, PromptedView, notes_of
from zpm2.segment.suppression import boxes, leaders, pack
from zpm2.segment.view_of import view_of

ANY = MaskThresholds(0.0, 0.0)  # the person judges


@dataclass(frozen=True, eq=False)
class Drawn:
    """What the segmenter says to a prompt."""

    shape: Shape  # px of the photograph
    score: float  # 0..1, its own estimate of the quality
    size: int  # which one of `sizes` answers, the smallest first
    sizes: int


class Pair:
    """Both photographs. Not for several threads at a time.

    `InputError` where both do not fit into the memory budget, `ConfigError` for a segmenter that takes no prompts.
    """

    def __init__(self, photographs: tuple[Photograph, Photograph], matcher: PairMatcher, progress: Progress) -> None:
        self.photographs, self.config = photographs, matcher.config
        self._matcher, self._progress = matcher, progress
        self._kept = KeptPhotos(2)
        self._images = self._kept.same(photographs[0].image), self._kept.same(photographs[1].image)
        with memory.within(self.config.max_memory):
            estimate.refuse_whole(self.config, [(image.width, image.height) for image in self._images], False)

    @cached_property
    def _segmenter(self) -> PromptedSegmenter:
        found = self._matcher.segmenters()[1]
        if not isinstance(found, PromptedSegmenter):
            raise ConfigError(f"segmenter '{self.config.segment.model}' takes no prompts: use --segmenter mobile_sam")
        return found

    @cached_property
    def _looked(self) -> tuple[InitialGeometry, list[str]]:
        """The geometry from left to right, px of the images, and notes."""
        found = self._matcher.points()(self._images, StageTimer(self._progress), self._kept)
        return found.initial, found.notes

    @cached_property
    def _initial(self) -> tuple[InitialGeometry, InitialGeometry]:
        """The geometry from the left and from the right photograph to the other one."""
        points = self._looked[0].points
        swapped = PointMatches(points.right, points.left, points.score)
        return self._looked[0], initial_geometry(swapped, self.config.global_match, self.config.seed)

    def prepare(self) -> None:
        """Finds the points, encodes both photographs, and asks once, as networks are slow at their first answer."""
        with memory.within(self.config.max_memory):
            assert self._initial
            for k, image in enumerate(self._images):
                self._progress("encode", k / 2)
                self._view(image)
            left = self.photographs[0]
            middle = Prompt(np.array([[left.width / 2, left.height / 2]]), np.zeros((0, 2)), None, None)
            with contextlib.suppress(InputError):
                self.carry(0, self.draw(0, middle).shape)
            self._progress("encode", 1.0)

    def draw(self, side: int, prompt: Prompt) -> Drawn:
        """The region of one photograph that a prompt asks for. `InputError` where there is none.

        Of all answers those count that hold as many of the points as they should; of these the one with the best score,
        unless the prompt asks for another size. Answers with IoU `carry.same_place` are one.
        """
        with memory.within(self.config.max_memory):
            photograph = self.photographs[side]
            view = self._view(self._images[side])
            found = view.predict(prompt.prompts(photograph.scale), ANY)
            rows = _distinct(found[_right_side(found, prompt, photograph.scale * view.mask_scale)], self.config)
            best = int(np.argmax(rows.score)) if len(rows) else 0
            size = best if prompt.size is None else int(np.clip(prompt.size, 0, max(0, len(rows) - 1)))
            shape = carrying.outline(view, rows[np.array([size])], self.config) if len(rows) else None
            if shape is None:
                raise InputError("the segmenter finds nothing there: click elsewhere, or draw a box or an outline")
            return Drawn(photograph.from_image(shape), float(rows.score[size]), size, len(rows))

    def carry(self, side: int, shape: Shape) -> Outcome:
        """What became of a region of one photograph, px of it, in the other one, px of that; as `zpm2 carry` says of
        that region alone."""
        with memory.within(self.config.max_memory):
            there, images = self.photographs[1 - side], self._images
            shapes = np.array([self.photographs[side].to_image(shape)], object)
            (found,) = carrying.carry(
                (images[side], images[1 - side]),
                shapes,
                ["1"],
                self._initial[side],
                self._segmenter,
                self.config,
                self._kept,
            )
            return _in_photograph(found, there)

    @property
    def points(self) -> PointMatches:
        """The homologous points that agree with the geometry, px of the photographs."""
        initial = self._looked[0]
        found = initial.points[initial.consistent]
        return self._full(found)

    @property
    def every_point(self) -> PointMatches:
        """All homologous points, px of the photographs."""
        return self._full(self._looked[0].points)

    def _full(self, points: PointMatches) -> PointMatches:
        left, right = (photograph.scale for photograph in self.photographs)
        return PointMatches(points.left / left, points.right / right, points.score)

    @property
    def fundamental(self) -> NDArray[np.float64] | Failed:
        """3 x 3, of px of the photographs."""
        matrix = self._looked[0].fundamental
        left, right = self._scalings
        return matrix if isinstance(matrix, Failed) else np.asarray(right.T @ matrix @ left, np.float64)

    @property
    def homography(self) -> NDArray[np.float64] | Failed:
        """3 x 3, of px of the photographs."""
        matrix = self._looked[0].homography
        left, right = self._scalings
        return matrix if isinstance(matrix, Failed) else np.asarray(np.linalg.inv(right) @ matrix @ left, np.float64)

    @property
    def messages(self) -> list[str]:
        """What there is to tell about this pair."""
        told = [*self._looked[1], *weights_notes(self.config.points), *notes_of(self._matcher.segmenters()[1])]
        told += [each for photograph in self.photographs for each in photograph.messages]
        if not self._looked[0].supported:
            told.append("the photographs have too few points in common: what looks alike decides alone")
        return told

    @property
    def _scalings(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        left, right = (np.diag([*photograph.scale, 1.0]) for photograph in self.photographs)
        return left, right

    def _view(self, image: Image) -> PromptedView:
        return view_of(self._segmenter, image, self._kept)


def _right_side(found: MaskPredictions, prompt: Prompt, scale: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) the masks with the fewest points on the wrong side; `scale` is px of a mask per px of the photograph."""
    bits = found.bits
    height, width = bits.shape[1:]

    def held(points: NDArray[np.float64]) -> NDArray[np.intp]:
        x, y = np.clip((points * scale).astype(np.intp), 0, [width - 1, height - 1]).T
        return np.asarray(np.count_nonzero(bits[:, y, x], axis=1), np.intp)

    wrong = len(prompt.inside) - held(prompt.inside) + held(prompt.outside)
    return np.asarray(wrong == wrong.min(initial=len(prompt.inside) + len(prompt.outside)))


def _distinct(found: MaskPredictions, config: Config) -> MaskPredictions:
    """The masks without those that a better one has the place of, the smallest first."""
    if len(found) == 0:
        return found
    bits, area = found.bits, found.extent.area
    same = leaders(pack(bits), boxes(bits), area, found.score.astype(np.float64), config.carry.same_place)
    kept = np.flatnonzero(same == np.arange(len(found)))
    return found[kept[np.argsort(area[kept], kind="stable")]]


def _in_photograph(found: Outcome, photograph: Photograph) -> Outcome:
    """An outcome, px of the photograph's image, in px of the photograph."""

    def point(x: float, y: float) -> tuple[float, float]:
        x, y = np.array([x, y]) / photograph.scale
        return float(x), float(y)

    return replace(
        found,
        shape=None if found.shape is None else photograph.from_image(found.shape),
        place=None if found.place is None else point(*found.place),
        sigma=None if found.sigma is None else found.sigma / float(photograph.scale.mean()),
        alternatives=tuple((*point(x, y), agreement) for x, y, agreement in found.alternatives),
    )
