"""The confidence of a match, 0..1."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.config import ConfidenceConfig
from zpm2.model import PolygonMatch

Array = NDArray[np.float64]


def confidence(
    overlap: Array, dsf: NDArray[np.int64], texture: Array, area_ratio: Array, config: ConfidenceConfig
) -> Array:
    """(c,) chance that two matched polygons cover each other by more than half (IoU >= 0.5).

    A logistic model of evidence that does not depend on which branch of the cost was used: overlap of the rectified
    shapes (IoU), shared points, texture correlation, ratio of areas. Its weights were fitted once to matches of real
    pairs with dense ground truth; `docs/confidence.md` shows the fit and how reliable it is.
    """
    weights = np.array([-config.intercept, config.overlap, config.points, config.texture, config.area])
    evidence = np.c_[np.ones(len(overlap)), overlap, np.log1p(dsf), np.maximum(texture, 0.0), area_ratio]
    return np.asarray(1.0 / (1.0 + np.exp(-(evidence @ weights))))


def lower_confidence(matches: Sequence[PolygonMatch], config: ConfidenceConfig) -> list[PolygonMatch]:
    """The matches of two photographs that may show different scenes (not `InitialGeometry.supported`), each with the
    share `config.unsupported` of its confidence. For a whole pair only: a part of a large one may just have few points.
    """
    return [dataclasses.replace(match, confidence=config.unsupported * match.confidence) for match in matches]
