"""Rectified pairs: epipolar rectification and dense disparity."""

from dataclasses import dataclass
from typing import Literal

from zpm2.config.fields import number, option, share

MC_CNN, JMLR = "measured, docs/cloud.md", "Zbontar and LeCun, JMLR 2016"


@dataclass(frozen=True)
class StereoConfig:
    """Epipolar rectification, and disparity by semi-global matching (Hirschmueller, PAMI 2008; OpenCV's SGBM)."""

    rectified_size: float = number(
        2.0,
        "largest side of a rectified image, times the longer side of the original",
        source="memory; a view turned by much would grow without bound",
    )
    max_turn: float = number(
        60.0,
        "by which rectification may turn a view, and rays be seen in it",
        unit="degrees",
        high=89.0,
        source="px so far off the axis are drawn twice as wide and four times as high",
    )
    max_forward: float = share(
        0.5,
        "cosine of baseline and optical axis beyond which posed views (zpm2 reconstruct) are not rectified",
        source="60 degrees off the optical axis: the epipole comes near the image",
    )
    min_ray_depth: float = share(
        0.1,
        "depth in the rectified frame of a ray of unit depth at the border of a posed view; else not rectified",
        source="a ray 84 degrees off has no useful px",
    )
    pair_border: int = number(
        20,
        "points along each side of an image that tell how far a pair reaches",
        low=2,
        high=10_000,
        source="a straight side needs two, a distorted one some more",
    )
    view_border: int = number(
        9, "the same of a posed view", low=2, high=10_000, source="views are undistorted: their sides are straight"
    )
    window: int = number(
        5,
        "side of the blocks of SGBM",
        unit="px",
        low=1,
        high=21,
        odd=True,
        source="OpenCV's documentation of SGBM: 3 to 11",
    )
    small_step: int = number(
        8, "P1 per window px, the price of a change of disparity by one", source="OpenCV's documentation of SGBM"
    )
    large_step: int = number(32, "P2, the price of a larger change", source="OpenCV's documentation of SGBM")
    prefilter: int = number(31, "largest horizontal derivative that counts", high=1000, source="OpenCV's example: 63")
    uniqueness: int = number(
        5,
        "by which the best disparity must win over the second best",
        unit="%",
        high=100,
        source="OpenCV's documentation of SGBM: 5 to 15",
    )
    all_directions: int = number(
        4_000_000,
        "images of fewer pixels are matched along eight directions, larger ones along three",
        unit="px",
        source="memory and time: eight directions keep the cost of each px and disparity",
    )
    left_right: float = number(
        1.0,
        "difference of the disparities of both images up to which they agree",
        unit="px",
        source="one px, the resolution of the search before it is refined",
    )
    speckle: int = number(
        200,
        "smaller patches of disparity are taken for noise",
        unit="px",
        source="OpenCV's documentation of SGBM: 50 to 200",
    )
    smooth: float = number(
        3.0, "standard deviation in the image of the bilateral filter", unit="px", source="the size of a block"
    )
    smooth_range: float = number(
        1.0,
        "standard deviation in disparity of the same, so that edges stay",
        unit="px",
        source="edges of more than a px of disparity stay",
    )
    method: Literal["sgbm", "mc-cnn"] = option(
        "sgbm", "dense stereo: OpenCV's semi-global matching, or the same along eight directions of a learned cost"
    )
    weights: Literal["middlebury", "aerial"] = option("middlebury", "what the network of mc-cnn was trained on")
    small_cost: float = number(
        1.0, "P1 of mc-cnn, the price of a change of disparity by one; costs are from -1 to 1", source=MC_CNN
    )
    large_cost: float = number(5.0, "P2, the price of a larger change", source=MC_CNN)
    edge: float = number(
        0.08, "difference of neighbours, in standard deviations of the image, from which both are lower", source=JMLR
    )
    edge_discount: float = number(4.0, "by which they are divided there", low=1.0, source=JMLR)
    strip_costs: int = number(
        300_000_000,
        "costs (pixels times disparities) that mc-cnn takes at once, 8 bytes each; beyond, strips of rows",
        low=1,
        source="2.4 GB",
    )
    strip_overlap: int = number(
        32,
        "by which strips are higher on either side, so that they agree",
        unit="px",
        source="twice the paths that still matter",
    )
    outliers: float = share(
        0.01,
        "homologous points at either end that do not count for the range of the search",
        high=0.4,
        source="homologous points hold some wrong ones",
    )
    range_margin: float = number(
        0.1,
        "by which the search is wider than the points at either end, times their range",
        source="points lie on texture, seldom on what is nearest or farthest",
    )
    min_range_margin: float = number(
        8.0, "the same at least", unit="px", source="a frontal plane has no range of its own"
    )
    min_range_points: int = number(
        8, "homologous points that a range of the search needs", low=1, source="as a fundamental matrix"
    )
    max_range: float = share(
        0.5,
        "widest search, of the width of the image: beyond, the pair is not rectified",
        source="the images share less than half beyond",
    )
