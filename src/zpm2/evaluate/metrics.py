"""How good matches are: each metric with its definition and unit, and `score`, which computes all of one result.

Pairs of polygons are (k, 2) rows into the lists of left and right polygons. "Scored" matches are those that the ground
truth can judge (`Overlap.enough`); sky without lidar and areas seen once do not count. "Good" ones reach an IoU of t
over the co-visible points. Areas are pixels of the image, by the rule of `label_raster.polygon_pixels`.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from zpm2.errors import InputError
from zpm2.evaluate.ground_truth import CoVisible, Overlap, center_pairs, covisible, mutual_best, overlap
from zpm2.evaluate.label_raster import LabelRaster, Rows
from zpm2.evaluate.pairs import Truth
from zpm2.model import Polygon, PolygonMatch
from zpm2.result import MatchResult

IOU_THRESHOLDS = (0.4, 0.5, 0.8)  # IoU, the paper's MAS 40, 50 and 80
SMALL_SHARE = 0.05  # of the left image: the largest polygon that CCR5 counts, part of its definition


@dataclass(frozen=True)
class Scores:
    """All metrics of one result at one IoU threshold; shares are 0..1."""

    iou: float | None  # t; None for the paper's protocol, which has none
    left: int  # polygons in the left image, matched or not
    right: int  # polygons in the right image
    scored: int  # matches that can be judged
    unscored: int  # matches that cannot
    good: int  # scored matches that are right
    gt: int  # pairs of polygons that are true
    P: float  # `precision`
    R: float  # `recall`
    F1: float  # `f1`
    MAS: float  # `matching_area_score`
    ACR: float  # `area_coverage_ratio`, above 1 where more is matched than is true
    AOR: float  # `area_overlap_ratio`
    CCR: float  # `correct_coverage`
    CCR5: float  # the same, only polygons of at most 5 % of the left image
    points: int  # co-visible points

    def to_dict(self) -> dict[str, float | None]:
        """The fields by name, as they are."""
        return asdict(self)


def score(result: MatchResult, truth: Truth | CoVisible, t: float = 0.5) -> Scores:
    """All metrics of a result at IoU t. `InputError` where the truth does not fit the result; see `covisible`."""
    return scores(result, truth, (t,))[0]


def scores(
    result: MatchResult, truth: Truth | CoVisible, thresholds: Sequence[float] = IOU_THRESHOLDS
) -> tuple[Scores, ...]:
    """`score` at several thresholds, in little more time than for one."""
    overlaps, _ = _measured(result, truth)
    matches = match_rows(result.left.polygons, result.right.polygons, result.matches)
    return tuple(score_overlap(overlaps, matches, t) for t in thresholds)


def score_overlap(overlaps: Overlap, matches: Rows, t: float) -> Scores:
    """All metrics of (k, 2) matched rows at IoU t, against the dense ground truth."""
    scored = matches[overlaps.enough(matches)]
    good = scored[overlaps.iou(scored) >= t]
    return _scores(overlaps, scored, good, mutual_best(overlaps, t), len(matches), t)


def score_centers(result: MatchResult, truth: Truth | CoVisible) -> Scores:
    """All metrics by the paper's ground truth, `center_pairs`; `iou` is None. Good matches are true pairs."""
    overlaps, points = _measured(result, truth)
    left, right = result.left, result.right
    sizes = (left.width, left.height), (right.width, right.height)
    true = center_pairs(left.polygons, right.polygons, points, *sizes)
    matches = match_rows(left.polygons, right.polygons, result.matches)
    scored = matches[overlaps.enough(matches)]
    return _scores(overlaps, scored, scored[_among(scored, true)], true, len(matches), None)


def match_rows(left: Sequence[Polygon], right: Sequence[Polygon], matches: Sequence[PolygonMatch]) -> Rows:
    """(k, 2) rows of the matched polygons. `InputError` for an id that no polygon has, or that two matches have."""
    by_left, by_right = ({p.id: k for k, p in enumerate(polygons)} for polygons in (left, right))
    for match in matches:
        if match.left not in by_left or match.right not in by_right:
            raise InputError(f"match {match.left} - {match.right} names a polygon that is not in the lists given")
    rows = np.array([(by_left[m.left], by_right[m.right]) for m in matches], np.intp).reshape(-1, 2)
    if any(len(np.unique(column)) < len(rows) for column in rows.T):
        raise InputError("a polygon appears in more than one match: give matches that are one-to-one")
    return rows


def precision(good: int, scored: int) -> float:
    """Share of the scored matches that are good; 0 where nothing is scored."""
    return good / max(scored, 1)


def recall(scored: Rows, true: Rows) -> float:
    """Share of the true pairs that are among the scored matches; 0 where nothing is true."""
    return int(_among(scored, true).sum()) / max(len(true), 1)


def f1(precision: float, recall: float) -> float:
    """Harmonic mean of precision and recall; 0 where both are."""
    return 2 * precision * recall / max(precision + recall, 1e-9)


def matching_area_score(left: LabelRaster, right: LabelRaster, scored: Rows, true: Rows) -> float:
    """MAS (paper, "Matching area score"), 0..1: IoU of the matched with the truly matchable area, mean of both images.

    In each image the IoU of the union of all scored polygons with the union of all true ones, in pixels; 0 where both
    are empty. It does not depend on the partners being right: read it beside precision.
    """
    return 0.5 * (_area_iou(left, scored[:, 0], true[:, 0]) + _area_iou(right, scored[:, 1], true[:, 1]))


def area_coverage_ratio(left: LabelRaster, scored: Rows, true: Rows) -> float:
    """ACR (paper, "Area coverage ratio"): area of the scored left polygons / area of the true left polygons, px / px.

    Above 1 where more is matched than is true. Where nothing is true the divisor is 1 px.
    """
    return int(left.pixels[scored[:, 0]].sum()) / max(int(left.pixels[true[:, 0]].sum()), 1)


def area_overlap_ratio(left: LabelRaster, right: LabelRaster, scored: Rows) -> float:
    """AOR, 0..1: share of the image that lies in scored polygons, mean of both images.

    The paper's description of MESA's Area of Overlap Ratio ("matched area against the total image area"), which rewards
    covering much, rightly or wrongly. Nested polygons are counted once.
    """
    covered = [
        cells.sizes[cells.union(scored[:, k])].sum() / cells.labels.size for k, cells in enumerate((left, right))
    ]
    return float(np.mean(covered))


def correct_coverage(overlaps: Overlap, good: Rows) -> float:
    """CCR, 0..1: share of the co-visible points that lie in both polygons of a good match; 0 where there are none."""
    if not len(good) or not overlaps.points:
        return 0.0
    together = overlaps.left.members[good[:, 0]].T @ overlaps.right.members[good[:, 1]]  # pairs of cells that agree
    return int(overlaps.counts.multiply(together > 0).sum()) / overlaps.points


def _scores(overlaps: Overlap, scored: Rows, good: Rows, true: Rows, matches: int, t: float | None) -> Scores:
    left, right = overlaps.left, overlaps.right
    small = left.pixels[good[:, 0]] <= SMALL_SHARE * left.labels.size
    p, r = precision(len(good), len(scored)), recall(scored, true)
    return Scores(
        iou=t,
        left=len(left.pixels),
        right=len(right.pixels),
        scored=len(scored),
        unscored=matches - len(scored),
        good=len(good),
        gt=len(true),
        P=p,
        R=r,
        F1=f1(p, r),
        MAS=matching_area_score(left, right, scored, true),
        ACR=area_coverage_ratio(left, scored, true),
        AOR=area_overlap_ratio(left, right, scored),
        CCR=correct_coverage(overlaps, good),
        CCR5=correct_coverage(overlaps, good[small]),
        points=overlaps.points,
    )


def _measured(result: MatchResult, truth: Truth | CoVisible) -> tuple[Overlap, CoVisible]:
    left, right = result.left, result.right
    sizes = (left.width, left.height), (right.width, right.height)
    points = truth if isinstance(truth, CoVisible) else covisible(truth, *sizes)
    return overlap(left.polygons, right.polygons, points, *sizes), points


def _among(pairs: Rows, others: Rows) -> NDArray[np.bool_]:
    """(k,) whether each pair is one of the others."""
    known = {tuple(pair) for pair in others.tolist()}
    return np.array([tuple(pair) in known for pair in pairs.tolist()], bool)


def _area_iou(cells: LabelRaster, first: Rows, second: Rows) -> float:
    a, b = cells.union(first), cells.union(second)
    return int(cells.sizes[a & b].sum()) / max(int(cells.sizes[a | b].sum()), 1)
