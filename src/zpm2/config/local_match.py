"""Which polygon is which (paper 3.4), and regions asked for again."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option, share


@dataclass(frozen=True)
class LocalConfig:
    """Local matcher (paper 3.4): shape, texture, cost and assignment."""

    shape: Literal["graph", "overlap"] = option(
        "graph", "psi from the paper's graph descriptor, or from rectified overlap"
    )
    assign: Literal["optimal", "greedy"] = option("optimal", "greedy: highest psi, one polygon after the other (4.4.2)")
    neighbors: int = number(8, "k of the node embedding", low=1, high=10_000)
    z: float = number(5.0, "scaling factor of beta")
    gamma: int = number(8, "DSF from which a local homography is estimated")
    few_points: bool = option(False, "below gamma, DSF counts for its share where it says more than texture")
    iota: float = number(5.0, "similarity threshold: a pair that costs more stays unmatched")
    epsilon: float = number(1e-6, "of the cost")
    patch: int = number(32, "side of the resampled texture patches", unit="px", low=4, high=256)
    min_overlap: float = share(0.3, "IoU of the rectified polygon with its candidate under which they cannot match")


@dataclass(frozen=True)
class GuidedConfig:
    """Guided re-detection: the segmenter is asked in one image about the polygons of the other."""

    direction: Literal["off", "forward", "both"] = option("off", "forward: left polygons in the right image only")
    min_overlap: float = share(0.7, "IoU of an answer with the warped polygon that it was asked for")
    min_predicted_iou: float = share(0.7, "lower than `segment`'s: agreement between the images is evidence too")
    min_stability: float = share(0.85, "the same")
    min_match_overlap: float = share(0.5, "`local_match.min_overlap` of pairs in which one mask was below `segment`'s")
