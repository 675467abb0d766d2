"""Regions as vectors: the segmenter's own features of the photograph, averaged over each region."""

from collections.abc import Callable

import numpy as np
import shapely

from zpm2 import weights
from zpm2.baselines.method import Array, Both, Shapes
from zpm2.config import Config
from zpm2.errors import ConfigError
from zpm2.model import Image
from zpm2.model.messages import Note
from zpm2.polygons.rasterize import cell_shares
from zpm2.runtime import resolve_device
from zpm2.segment.protocol import EmbeddedView, PromptedSegmenter, Segmenter
from zpm2.segment.registry import create


class Encoder:
    """The embeddings of the two photographs of a pair, made when the first ones are asked for.

    They are those of the segmenter in use. One that has none (regions from a file, or of an earlier evaluation) is
    helped out by the configured one, which is loaded for that; `notes` says so.
    """

    def __init__(self, config: Config, say: Callable[[str], None], download: weights.Progress) -> None:
        self.config, self.say, self.download = config, say, download
        self.notes: list[str] = []
        self._images: tuple[Image, ...] = ()
        self._segmenters: tuple[Segmenter, ...] = ()
        self._features: list[tuple[Array, float]] = []
        self._own: Segmenter | None = None

    def begin(self, images: Both[Image], segmenters: Both[Segmenter]) -> None:
        """Turn to another pair."""
        self._images, self._segmenters = images, segmenters
        self._features, self.notes = [], []

    def embed(self, shapes: Both[Shapes]) -> Both[Array]:
        """(n, c) and (m, c) vectors of length 1 for shapes of the left and of the right image.

        The vectors of all cells of both images have their common mean taken off, so that a cosine says how much two
        regions have in common beyond what the whole scene has, and an encoder's constant part does not count.
        `ConfigError` where no segmenter gives embeddings.
        """
        if not self._features:
            views = [self._view(*side) for side in zip(self._images, self._segmenters, strict=True)]
            cells = [view.embedding().astype(np.float64) for view in views]
            mean = np.concatenate([each.reshape(len(each), -1) for each in cells], axis=1).mean(axis=1)
            self._features = [
                (each - mean[:, None, None], view.embedding_scale) for each, view in zip(cells, views, strict=True)
            ]
        left, right = (pooled(*each, side) for each, side in zip(self._features, shapes, strict=True))
        return left, right

    def _view(self, image: Image, segmenter: Segmenter) -> EmbeddedView:
        view = segmenter.view(image) if isinstance(segmenter, PromptedSegmenter) else None
        if isinstance(view, EmbeddedView):
            return view
        config = self.config.segment
        if self._own is None:
            self._own = create(config, resolve_device(self.config.device), self.say, download=self.download)
        view = self._own.view(image) if isinstance(self._own, PromptedSegmenter) else None
        if not isinstance(view, EmbeddedView):
            raise ConfigError(
                f"segmenter '{config.model}' gives no embeddings, which this method needs: use mobile_sam"
            )
        self.notes = [Note(f"regions embedded by {config.model}: their own segmenter gives no embeddings")]
        return view


def pooled(features: Array, scale: float, shapes: Shapes) -> Array:
    """(n, c) mean of the (c, h, w) `features` over each of (n,) shapes in image px, divided by its length.

    Each cell counts by its share inside the shape; `scale` is cells per image px. A shape without a sample takes the
    cell in which it lies.
    """
    c, h, w = features.shape
    if not len(shapes):
        return np.zeros((0, c))
    share = cell_shares(shapes, scale, (w, h))
    empty = np.flatnonzero(~share.any((1, 2)))
    inner = (shapely.get_coordinates(shapely.point_on_surface(shapes[empty])) * scale).astype(np.intp)
    share[empty, np.clip(inner[:, 1], 0, h - 1), np.clip(inner[:, 0], 0, w - 1)] = 1
    mean = share.reshape(len(shapes), -1) @ features.reshape(c, -1).T
    return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12))
