"""Links two layers of polygons without photographs."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from zpm2 import memory
from zpm2.config import Config, as_config
from zpm2.errors import Failed
from zpm2.linking.fit import first_fit
from zpm2.linking.layer import Layer, Shapes, in_meters, local_frame, open_layer
from zpm2.linking.links import Links, link_polygons
from zpm2.linking.result import Link, LinkResult
from zpm2.model.messages import split
from zpm2.runtime import Progress, StageTimer

NO_AREA = "it has no area, or lies beyond the reach of its reference system"
NO_GEOMETRY = "no shift and turn between the layers was found"


def link(
    left: str | Path | Layer,
    right: str | Path | Layer,
    config: Config | str = "default",
    *,
    progress: Progress = lambda stage, share: None,
) -> LinkResult:
    """Which polygon of one layer is which of another one, by shape and neighbourhood only.

    Both are GeoPackages, shapefiles or GeoJSONs on the ground, in any reference systems; of several layers in a file,
    one is named as `FILE|layername=NAME`. The right layer may be shifted and turned against the left one, as far as
    `config.link` says. Where no shift and turn stands out, the result has no links, and a warning says why.
    `InputError` for files that are no such layers.
    """
    chosen, timer = as_config(config), StageTimer(progress)
    with memory.within(chosen.max_memory):
        with timer("read"):
            first, second = _opened(left), _opened(right)
            frame = local_frame(first)
            a, b = in_meters(first, frame), in_meters(second, frame)
        with timer("fit"):
            fitted = first_fit(a, b, chosen.link)
        warnings, notes = split([*first.notes, *second.notes])
        more = chosen.to_dict(), timer.seconds
        if isinstance(fitted, Failed):
            unmatched = _unmatched(first, a, None), _unmatched(second, b, None)
            warnings = [f"no links: {fitted}", *warnings]
            return LinkResult(first, second, frame, fitted, None, [], unmatched, ({}, {}), *more, warnings, notes)
        with timer("link"):
            found = link_polygons(a, b, fitted, chosen.link)
        unmatched = _unmatched(first, a, found.unmatched[0]), _unmatched(second, b, found.unmatched[1])
        parts = _parts(found.parts[0], a, b), _parts(found.parts[1], b, a)
        estimate = fitted.similarity, fitted.uncertainty
        links = _links(a, b, found)
        return LinkResult(first, second, frame, *estimate, links, unmatched, parts, *more, warnings, notes)


def _opened(layer: str | Path | Layer) -> Layer:
    return layer if isinstance(layer, Layer) else open_layer(layer)


def _links(left: Shapes, right: Shapes, found: Links) -> list[Link]:
    """With rows of the layers."""
    measured = zip(
        left.rows[found.left].tolist(),
        right.rows[found.right].tolist(),
        found.confidence.tolist(),
        left.centers[found.left].tolist(),
        right.centers[found.right].tolist(),
        found.distance.tolist(),
        found.same_shape.tolist(),
        strict=True,
    )
    return [
        Link(i, j, sure, (start[0], start[1]), (end[0], end[1]), off, alike)
        for i, j, sure, start, end, off, alike in measured
    ]


def _unmatched(layer: Layer, shapes: Shapes, found: Mapping[int, str] | None) -> dict[int, str]:
    """Row of the layer -> why it has no link; without `found`, no polygon has one."""
    usable = {row: k for k, row in enumerate(shapes.rows.tolist())}
    reasons = dict[int, str]()
    for row in range(len(layer.regions)):
        if row not in usable:
            reasons[row] = NO_AREA
        elif found is None:
            reasons[row] = NO_GEOMETRY
        elif usable[row] in found:
            reasons[row] = found[usable[row]]
    return reasons


def _parts(parts: Mapping[int, Sequence[int]], of: Shapes, other: Shapes) -> dict[int, list[int]]:
    """With rows of the layers."""
    return {int(of.rows[row]): other.rows[each].tolist() for row, each in parts.items()}
