"""How sure a match is, 0..1."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zpm2.model import PolygonMatch

Array = NDArray[np.float64]

# Logistic weights of: intercept, overlap of the rectified shapes, log(1 + DSF), texture correlation, area ratio.
WEIGHTS = np.array([-3.4, 3.4, 0.46, 3.0, 1.8])
UNSUPPORTED = 0.1  # factor where the points agree no better than by chance: then the photographs show different scenes


def confidence(overlap: Array, dsf: NDArray[np.int64], texture: Array, area_ratio: Array) -> Array:
    """(c,) chance that two matched polygons cover each other by more than half (IoU >= 0.5).

    A logistic model of four pieces of evidence that do not depend on the cost's branch. Its weights were fitted once to
    matches of real pairs with dense ground truth; `docs/confidence.md` shows the fit and how reliable it is.
    """
    evidence = np.c_[np.ones(len(overlap)), overlap, np.log1p(dsf), np.maximum(texture, 0.0), area_ratio]
    return np.asarray(1.0 / (1.0 + np.exp(-(evidence @ WEIGHTS))))


def unsupported(matches: Sequence[PolygonMatch]) -> list[PolygonMatch]:
    """The matches of two photographs that may show different scenes (`InitialGeometry.supported`), as sure as that
    leaves them. It is for the pair as a whole to say: a cell of a large one may have few points."""
    return [dataclasses.replace(match, confidence=UNSUPPORTED * match.confidence) for match in matches]
