"""The properties of a polygon in every output format: our own, and those of the file that the region came from."""

import math
from collections.abc import Collection, Mapping
from typing import overload

from zpm2.model import Counterpart, Polygon

PREFIX = "source_"  # of a given property that has the name of one of ours
OURS = frozenset(
    (
        *("area", "area_m2", "score", "parent", "label", "match", "match_id"),
        *("confidence", "unmatched", "source_id"),
    )
)


def polygon_properties(polygon: Polygon, partner: Counterpart | None, unmatched: str | None) -> dict[str, object]:
    """Our properties: area in px^2, the partner's id, the match's id, ...; "source_id" of given regions only."""
    return {
        "area": polygon.area,
        "score": polygon.score,
        "parent": polygon.parent,
        "label": polygon.label,
        "match": partner and partner.polygon_id,
        "match_id": partner and partner.match_id,
        "confidence": partner and partner.confidence,
        "unmatched": unmatched,
        **({} if polygon.source_id is None else {"source_id": polygon.source_id}),
    }


def prefixed(properties: Mapping[str, object], ours: Collection[str]) -> dict[str, object]:
    """Given properties, with a prefix where a name is one of `ours` (lower case), so that both fit into one table.
    `unprefixed` undoes it."""
    return {PREFIX + name if _taken(name, ours) else name: value for name, value in properties.items()}


def unprefixed(values: Mapping[str, object], ours: Collection[str]) -> dict[str, object]:
    """The given properties of a table, without the prefixes of `prefixed`."""
    own = {name: value for name, value in values.items() if name.lower() not in ours}
    cut = len(PREFIX)
    return {
        name[cut:] if name.startswith(PREFIX) and _taken(name[cut:], ours) else name: value
        for name, value in own.items()
    }


@overload
def plain(value: str) -> str: ...
@overload
def plain(value: dict[str, object]) -> dict[str, object]: ...
@overload
def plain(value: object) -> object: ...
def plain(value: object) -> object:
    """A JSON value that every format can hold: null for numbers that are not finite, "?" for lone surrogates."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, list):
        return [plain(item) for item in value]
    return {plain(name): plain(item) for name, item in value.items()} if isinstance(value, dict) else value


def _taken(name: str, ours: Collection[str]) -> bool:
    """Whether a name is ours, or looks like one of ours with the prefix."""
    name = name.lower()
    while name not in ours and name.startswith(PREFIX):
        name = name[len(PREFIX) :]
    return name in ours
