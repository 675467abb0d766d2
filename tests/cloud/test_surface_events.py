"""Splits and merges on a surface that is known exactly."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from clouds import looking_down, matched, squares, views_of
from meshes import grid

from zpm2.cloud import MatchedPair, PolygonCloud, build, open_caster
from zpm2.cloud.page import page
from zpm2.config import CloudConfig

CAMERAS = [looking_down(-0.5, 0.1, 2.5), looking_down(0.0, 0.0, 2.6), looking_down(0.5, -0.1, 2.5)]
CAMERAS.append(looking_down(0.2, 0.4, 2.6))
Outlines = Sequence[np.ndarray]


def halves(square: np.ndarray, gap: float = 0.02) -> list[np.ndarray]:
    """The left and the right part of a square, with a gap between them."""
    x = square[:, 0]
    low, high, share = x.min(), x.max(), (1 - gap) / 2
    return [np.c_[low + (x - low) * share, square[:, 1:]], np.c_[high - (high - x) * share, square[:, 1:]]]


def cloud(folder: Path, first: Outlines, common: Outlines, last: Outlines) -> PolygonCloud:
    """Of views 0 and 1, which see `first`, and of views 2 and 3, which see `last`. All see `common`."""
    seen = {(0, 1): [*first, *common], (1, 2): common, (2, 3): [*last, *common]}
    pairs = [MatchedPair(i, j, matched(each, (CAMERAS[i], CAMERAS[j]))) for (i, j), each in seen.items()]
    surface = grid(12)
    return build(views_of(CAMERAS, folder), pairs, surface, open_caster(surface), CloudConfig())


@pytest.mark.parametrize("kind", ["split", "merge"])
def test_several_patches_in_the_place_of_one(tmp_path: Path, kind: str) -> None:
    whole, *others = squares()
    ways = [[whole], halves(whole)] if kind == "split" else [halves(whole), [whole]]
    found = cloud(tmp_path, ways[0], others[:2], ways[1])
    (event,) = found.events
    assert event.kind == kind
    assert (event.whole_in, event.parts_in) == ((1, 2) if kind == "split" else (2, 1))
    areas = {patch.id: patch.patch.area for patch in found.patches}
    assert areas[event.whole] == pytest.approx(0.09, rel=1e-2)
    assert [areas[part] for part in event.parts] == pytest.approx([0.044, 0.044], rel=2e-2)
    document = found.to_dict()
    assert document["counts"]["events"] == 1
    assert document["events"] == [
        {"kind": kind, "whole": event.whole, "parts": list(event.parts), "whole_in": event.whole_in}
        | {"parts_in": event.parts_in}
    ]
    assert f'"whole_in":{event.whole_in}' in page(found).replace(" ", "")


def test_parts_that_do_not_fill_the_place_are_none(tmp_path: Path) -> None:
    whole, *others = squares()
    assert not cloud(tmp_path, [whole], others[:2], halves(whole, 0.5)).events
    assert not cloud(tmp_path, [whole], others[:2], halves(whole)[:1]).events


def test_a_whole_that_both_views_see_is_not_split(tmp_path: Path) -> None:
    whole, *others = squares()
    assert not cloud(tmp_path, [], [whole, *others[:2]], halves(whole)).events
