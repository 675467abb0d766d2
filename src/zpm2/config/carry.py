"""Regions of one photograph in another (`zpm2.carry`)."""

from dataclasses import dataclass

from zpm2.config.fields import number, share

CARRY = "tried on the pairs of docs/carry.md"
FITTED = "fitted, docs/carry.md"


@dataclass(frozen=True)
class CarryConfig:
    """`zpm2 carry`."""

    agree_px: float = number(
        3.0, "from a point's place, up to which it agrees with a region's map", unit="px", source="as epipolar_px"
    )
    agree_share: float = share(
        0.05,
        "of a region's diagonal, up to which a point agrees, where that is more",
        source="surfaces are not flat, and moving things bend",
    )
    few_points: float = number(2.0, "points that agree, of which half is trusted", source="two points are chance")
    neighbors_trust: float = share(
        0.5,
        "trust in a place without points of its own that all points around agree on",
        source="half: it may stand out",
    )
    min_trust: float = share(0.15, "in a place, from which on the segmenter is asked there", source="one point of two")
    min_pixels: int = number(
        4, "of a decoded mask that it covers, from which on it is asked for", low=1, high=10_000, source="as guided"
    )
    neighbors: int = number(
        10, "cells of the left photograph that label a cell of the right one", low=1, high=1000, source=CARRY
    )
    temperature: float = number(0.1, "of the neighbours' weights", unit="cosine", above=True, high=100.0, source=CARRY)
    cells: float = number(
        16.0, "of the embedding, from which on the likeness of a region counts in full", above=True, source="4 x 4"
    )
    min_contrast: float = number(
        2.0,
        "geometric mean of the standard deviations of both photographs in a place, under which they are not compared",
        unit="grey levels",
        above=True,
        source="a camera's noise",
    )
    samples: int = number(
        48,
        "points around which the photographs are compared, to know how alike they are",
        low=1,
        high=10_000,
        source="a median of them is stable",
    )
    least_usual: float = share(
        0.3, "correlation around the points, below which it is taken to be this", above=True, source="noise has less"
    )
    clear: float = share(
        0.6, "correlation around the points, from which on a comparison says all", above=True, source=CARRY
    )
    doubt: float = share(
        0.8, "of the trust in a place, lost where the photographs do not resemble each other at all", source=CARRY
    )
    shows: float = share(
        0.5, "resemblance in a place, from which on the outline only moved takes part", source="rather than not"
    )
    edge_px: float = number(
        0.25, "of a decoded mask, by which its outline may be off", unit="px", high=2.0, source=CARRY
    )
    min_likeness: float = share(0.2, "of the most alike cell, from which on it is asked there", source=CARRY)
    sure: float = share(0.6, "agreement of an answer with the place, from which on no other is tried", source=CARRY)
    kept: int = number(4, "answers of a region that take part in the contest", low=1, high=100, source="time grows")
    min_agreement: float = share(0.05, "of an answer with what is expected, from which on it counts", source=CARRY)
    same_place: float = share(0.7, "IoU of two masks that are one place", source="as segment.nms_iou")
    max_shared: float = share(
        0.05, "of the smaller one of two given regions in common, up to which they are disjoint", source="a px or two"
    )
    min_part: float = share(0.05, "of the largest piece of a mask, from which on another piece counts", source=CARRY)
    whole: float = share(0.85, "of a region visible, from which on it is found as a whole", source=CARRY)
    outside: float = share(
        0.1, "of a place within the photograph, below which the region is outside", source="a strip shows nothing"
    )
    trusted: float = share(
        0.5, "trust from which on points alone say where a region is", source="two points that agree"
    )
    min_confidence: float = share(
        0.5, "of an outline, under which the region is not found", source="rather wrong than right, docs/carry.md"
    )
    intercept: float = number(2.13, "subtracted in the confidence", unit="log-odds", high=100.0, source=FITTED)
    by_agreement: float = number(
        2.51, "weight of an answer's agreement in the confidence", unit="log-odds", high=100.0, source=FITTED
    )
    by_trust: float = number(
        1.03, "weight of the trust in its place in the confidence", unit="log-odds", high=100.0, source=FITTED
    )
    by_points: float = number(
        1.78, "weight of the pair's agreeing points in the confidence", unit="log-odds", high=100.0, source=FITTED
    )
    by_surrounded: float = number(
        1.49,
        "weight of the share of a region among the pair's agreeing points in the confidence",
        unit="log-odds",
        high=100.0,
        source=FITTED,
    )
    many_points: float = number(
        500.0,
        "agreeing points of a pair that count half as much as any number of them",
        above=True,
        source=CARRY,
    )
    window: int = number(
        1024, "side of the windows of large photographs", unit="px", low=256, high=16384, source="SAM sees 1024 px"
    )
    window_margin: float = share(
        0.25, "of a window, added on every side", source="points around the regions at its rim"
    )
    zoom_step: float = number(
        1.25,
        "reductions of left windows are powers of this, so that several right photographs see the same windows",
        low=1.01,
        high=4.0,
        source="points and segmenter bear half of it",
    )
