"""From the evidence of a match to the probability that it is right."""

import numpy as np
from numpy.typing import NDArray

from zpm2.config import ConfidenceConfig
from zpm2.verify.evidence import Evidence

Array = NDArray[np.float64]
FEATURES = ("content", "texture", "agreement", "motion", "flow", "width")  # and fields of `ConfidenceConfig`


def confidence(evidence: Evidence, config: ConfidenceConfig) -> Array:
    """(k,) chance that two matched polygons cover each other by more than half (IoU >= 0.5), if both photographs show
    the same scene.

    A logistic model with weights that are not negative, so that more evidence never lowers it. The weights were fitted
    to matches of real pairs with dense ground truth; `docs/confidence.md` shows the fit and how reliable it is.
    """
    weights = np.array([getattr(config, name) for name in FEATURES])
    return np.asarray(1.0 / (1.0 + np.exp(config.intercept - features(evidence, config) @ weights)))


def features(evidence: Evidence, config: ConfidenceConfig) -> Array:
    """(k, 6) what the weights of the fields `FEATURES` multiply; the more, the better."""
    agreement = np.log(evidence.agreement) - np.log1p(-evidence.agreement)
    still = config.max_motion - np.minimum(evidence.motion, config.max_motion)
    width = np.log(np.clip(evidence.width, 1.0, config.max_width))
    return np.stack([evidence.content, evidence.texture, agreement, still, evidence.flow, width], axis=1)
