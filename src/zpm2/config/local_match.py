"""Which polygon is which (paper 3.4), and guided re-detection."""

from dataclasses import dataclass, field
from typing import Literal

from zpm2.config.fields import number, option, share

FITTED = "fitted to real pairs with dense ground truth, docs/confidence.md"
BLOBS = "measured, docs/optimisation.md"


@dataclass(frozen=True)
class HomographyConfig:
    """A polygon's own homography, fitted to the points in it (`polygons.local_homography`, paper 3.4.1)."""

    residual: float = number(
        2.0,
        "at which a point's weight has fallen to a half (Cauchy)",
        unit="px",
        above=True,
        source="the noise of learned points, docs/points.md",
    )
    iterations: int = number(7, "of reweighted least squares", low=1, high=1000)
    wide_iterations: int = number(
        3,
        "of these, the first ones, in which `residual` is the points' median where that is larger",
        high=1000,
        source="a start that is off by more than the noise still finds its points",
    )
    affine_prior: float = number(
        1e-3,
        "weight of the prior's linear part",
        unit="points, in normalised coordinates",
        source="counts where there are fewer points than the map needs",
    )
    projective_prior: float = number(
        1e-1,
        "weight of a projective part of 0",
        unit="the same",
        source="stronger: a small polygon shows no perspective",
    )


@dataclass(frozen=True)
class VerifyConfig:
    """The evidence of a match that did not make it, and the judge who rejects matches by it (`verify`)."""

    min_confidence: float = share(
        0.86, "under which the judge rejects a match", source="precision of 0.98 and 0.97, docs/confidence.md"
    )
    patch: int = number(
        32,
        "cells across a polygon, in which the insides are compared; as many around it",
        low=8,
        high=128,
        source="as `local_match.patch`",
    )
    light: int = number(
        9,
        "side of the window in which light and contrast are taken out, odd",
        unit="cells",
        low=3,
        high=63,
        odd=True,
        source="a quarter of a polygon: shading is smoother, texture finer",
    )
    noise: float = number(
        1.0, "standard deviation there that is noise", unit="grey levels", above=True, source="8-bit rounding"
    )
    min_contrast: float = number(
        0.05,
        "standard deviation of an inside without light, under which it has no texture",
        unit="of its window's",
        source="a twentieth of what texture has",
    )
    min_cells: int = number(12, "that both polygons cover, under which the insides are not compared", low=1)
    near: int = number(
        2, "shift that still counts as in place", unit="cells", low=0, high=8, source="outlines are a px or two off"
    )
    rival: float = share(
        0.98, "quantile of the other shifts that the place must beat", source="the best of all would be noise"
    )
    flow_window: int = number(
        7,
        "side of the window over which the flow is averaged, odd",
        unit="cells",
        low=3,
        high=63,
        odd=True,
        source="5 to 9 order matches as well, 15 less so",
    )
    round_trip: float = number(
        1.5,
        "by which the flow forth and back may miss",
        unit="cells",
        above=True,
        source="each is up to half a cell off, and outlines by one",
    )
    neighbors: int = number(8, "nearest matches whose motion is compared", low=3, high=1000, source="as nearest_points")
    min_neighbors: int = number(5, "with fewer, the motion is not known", low=3, high=1000, source="half may be wrong")
    unknown_motion: float = number(
        0.3,
        "distance from where the neighbours are taken, where it is not known",
        unit="sides of the polygon",
        source="between those of right and of wrong ones",
    )


@dataclass(frozen=True)
class ConfidenceConfig:
    """The chance that a match is right: a logistic model of its evidence (`verify.confidence`)."""

    intercept: float = number(4.38, "subtracted", unit="log-odds", high=100, source=FITTED)
    content: float = number(
        2.69, "weight of how much better the insides correlate in place than shifted", high=100, source=FITTED
    )
    texture: float = number(0.94, "weight of the correlation R of the stretched insides", high=100, source=FITTED)
    agreement: float = number(
        0.4, "weight of the log-odds that a point in either polygon is in both", high=100, source=FITTED
    )
    motion: float = number(
        4.53, "weight of being near where the neighbours are taken, nearer than `max_motion`", high=100, source=FITTED
    )
    flow: float = number(3.13, "weight of the overlap where a dense flow puts both polygons", high=100, source=FITTED)
    width: float = number(1.22, "weight of the logarithm of the narrower polygon's width", high=100, source=FITTED)
    max_motion: float = number(
        0.5,
        "beyond which more distance from there says no more",
        unit="sides of the polygon",
        source="thin things in front move apart from what is behind them",
    )
    max_width: float = number(
        20.0, "beyond which more width says no more", unit="px", low=1.0, source="an outline a px off costs 10 %"
    )


@dataclass(frozen=True)
class UnmatchedConfig:
    """Why a polygon has no partner (`local_match.unmatched`)."""

    min_visible: float = share(
        0.5, "of a warped polygon in the other image, under which it is outside the overlap", source="most of it"
    )
    min_hidden: float = share(
        0.5, "of a warped polygon under polygons from elsewhere, above which it is occluded", source="most of it"
    )
    max_shared: float = share(
        0.1,
        "of two polygons of one image in common, up to which they lie beside each other",
        source="outlines of neighbours overlap by a px or two",
    )


@dataclass(frozen=True)
class ExclusiveConfig:
    """Matched regions that share no pixel (`local_match.exclusive`)."""

    min_part: float = share(
        0.5, "of a polygon's pixels in a larger one, above which it is a part of that one", source="most of it"
    )
    min_overlap: float = share(
        0.5, "IoU of what a match keeps in both images, from which on the match stays", source="as a match is scored"
    )
    min_kept: float = share(
        0.8,
        "of the whole polygons' IoU, from which on it stays, too",
        source="a pair that overlapped less from the start must not lose much",
    )
    max_pieces: int = number(
        200, "of one polygon that are compared, the largest ones", low=1, high=254, source="254 labels fit into a byte"
    )


@dataclass(frozen=True)
class VisibleConfig:
    """Polygons that a border of a photograph cuts off are compared over what both photographs can show
    (`polygons.visible`)."""

    on: bool = option(False, "else over all of both", source="paper: off")
    min_points: int = number(
        5,
        "homologous points in a pair or a polygon, from which on its map is known well enough to cut it",
        high=10_000,
        source="four fix a homography, one more confirms it",
    )
    border: float = share(
        1 / 256,
        "of a photograph's longer side, as near as which a polygon touches its border",
        source="a px of a decoded mask",
    )
    min_share: float = share(
        0.25,
        "of either polygon that both can show, under which they cannot match",
        source="of a smaller part the outline says little",
    )


@dataclass(frozen=True)
class OutlineConfig:
    """Homologous points along two outlines (`local_match.outline`)."""

    min_samples: int = number(12, "of an outline", low=3, high=10_000, source="three for each side of a box")
    max_samples: int = number(1500, "of an outline", low=3, high=10_000, source="time grows with the square")
    epipolar: float = number(2.0, "cost of a pair 1 px off its epipolar line", unit="px")
    direction: float = number(4.0, "cost of a pair where the outlines are at right angles", unit="px")
    chord: int = number(
        2,
        "samples ahead and behind, between which an outline's direction is taken",
        low=1,
        high=100,
        source="directions between neighbours along pixel edges are multiples of 45 degrees",
    )
    start_window: int = number(
        5,
        "pairs ahead and behind that must fit where an alignment starts",
        high=100,
        source="a single cheap pair may be chance",
    )
    restart_margin: float = share(
        0.25,
        "of an alignment at either end, where the next one must not start",
        high=0.4,
        source="the start itself is there, and would be found again",
    )
    max_starts: int = number(3, "alignments that are tried", low=1, high=100, source="time grows with them")


@dataclass(frozen=True)
class LocalConfig:
    """Local matcher (paper 3.4): shape, texture, cost and assignment."""

    shape: Literal["graph", "overlap"] = option(
        "graph", "psi from the paper's graph descriptor, or from rectified overlap", source="paper 3.4.1"
    )
    assign: Literal["optimal", "greedy"] = option(
        "optimal", "greedy: highest psi, one polygon after the other (4.4.2)", source="paper 3.4.3"
    )
    neighbors: int = number(8, "k of the node embedding", low=1, high=10_000, source="not printed in the paper")
    z: float = number(5.0, "scaling factor of beta", source="paper 4.1.3")
    gamma: int = number(8, "DSF from which a local homography is estimated", source="paper 4.1.3")
    few_points: bool = option(
        False, "below gamma, DSF counts for its share where it says more than texture", source="paper: off"
    )
    iota: float = number(5.0, "similarity threshold: a pair that costs more stays unmatched", source="paper 4.1.3")
    epsilon: float = number(1e-6, "of the cost", source="paper 3.4.2: a small constant, against division by 0")
    patch: int = number(
        32, "side of the resampled texture patches", unit="px", low=4, high=256, source="not printed in the paper"
    )
    min_contrast: float = number(
        0.5,
        "geometric mean of both patches' standard deviations, under which R is 0",
        unit="grey levels",
        source="rounding to whole grey levels has 0.3",
    )
    min_overlap: float = share(
        0.3,
        "IoU of the rectified polygon with its candidate under which they cannot match",
        source="paper 3.1, docs/method.md",
    )
    nearest_points: int = number(
        8,
        "that move a polygon without points of its own",
        low=1,
        high=10_000,
        source="outweighs wrong ones, and stays near",
    )
    nearest_matches: int = number(
        5,
        "matched polygons that move an unmatched one",
        low=1,
        high=10_000,
        source="as nearest_points; matches are more certain than points",
    )
    second_window: float = number(
        1.0,
        "side of the window in which the second round searches",
        unit="shorter sides of the polygon",
        source="as the window of 4.4.1, search=fixed",
    )
    max_halvings: int = number(
        6,
        "of an image before a patch of a large polygon is sampled, so that it does not alias",
        high=30,
        source="64 px of the image in one of the patch: polygons of 2000 px",
    )
    judge: Literal["off", "on"] = option(
        "off", "on: matches that are not sure enough are rejected", source="beyond the paper, docs/confidence.md"
    )
    verify: VerifyConfig = field(default_factory=VerifyConfig)
    homography: HomographyConfig = field(default_factory=HomographyConfig)
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)
    unmatched: UnmatchedConfig = field(default_factory=UnmatchedConfig)
    visible: VisibleConfig = field(default_factory=VisibleConfig)
    exclusive: ExclusiveConfig = field(default_factory=ExclusiveConfig)
    outline: OutlineConfig = field(default_factory=OutlineConfig)


@dataclass(frozen=True)
class GuidedConfig:
    """Guided re-detection: polygons of one image become prompts in the other."""

    direction: Literal["off", "forward", "both"] = option(
        "off", "forward: left polygons in the right image only", source="beyond the paper, docs/method.md"
    )
    left_blobs: float = number(
        0.75,
        "times as many prompts at blobs in the left image as `segment.prompts` says",
        high=100,
        source=BLOBS,
    )
    right_blobs: float = number(
        2.0, "the same in the right image, whose known regions keep prompts away", high=100, source=BLOBS
    )
    min_visible: float = share(
        0.25,
        "of a warped polygon's area in the other image, from which on it is a prompt",
        source="as `local_match.visible`: of a smaller part the outline says little",
    )
    min_pixels: int = number(
        4,
        "of a decoded mask that it covers, from which on it is a prompt",
        low=1,
        high=10_000,
        source="fewer have no shape",
    )
    min_overlap: float = share(
        0.7,
        "IoU of a mask with the warped polygon that it was prompted with",
        source="docs/method.md: higher than a match needs, as the mask was asked for there",
    )
    points: int = number(
        3,
        "inside a warped polygon, with which it is asked for again where one found no mask; 1: it is not",
        low=1,
        high=100,
        source="docs/method.md",
    )
    min_checked_overlap: float = share(
        0.5,
        "the same of a mask that leads back to a polygon with `min_points`; at `min_overlap` there are no such masks",
        source="as a match is scored",
    )
    min_points: int = number(
        3,
        "in a polygon; with fewer, its mask must lead back to it",
        high=10_000,
        source="three points fix an affine map",
    )
    min_return_overlap: float = share(
        0.5, "IoU of a polygon with the mask that its mask leads back to", source="as a match is scored"
    )
    min_predicted_iou: float = share(0.7, "lower than `segment`'s: agreement between the images is evidence too")
    min_stability: float = share(0.85, "lower than `segment`'s, too")
    min_match_overlap: float = share(
        0.5,
        "`local_match.min_overlap` of pairs in which one mask was below `segment`'s",
        source="as a match is scored: masks in doubt must fit better",
    )
    min_agreement: float = share(1 / 3, "of the points in either polygon of such a pair, those in both")
