"""Whatever a result holds comes back from its file: all fields of all data classes that it is made of."""

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zpm2.errors import Failed
from zpm2.model import Georeference, ImagePolygons, PointMatches, Polygon, PolygonMatch
from zpm2.result import MatchResult

NOT_SAVED = {(ImagePolygons, "image")}  # pixels stay in the photographs
SQUARE = np.array([[0, 0], [30, 0], [30, 30], [0, 30.0]])
RPC = {"height_off": 12.5, "lat_off": 47.0, "line_num_coeff": [0.0, 1 / 3, *[0.0] * 18], "err_bias": None}


def everything(folder: Path) -> MatchResult:
    """A result of which every field has another value than its default, in one place at least."""
    given = {"name": "Hof", "storeys": 3, "area": None, "tags": ["a", {"b": 0.5}]}
    hole = SQUARE[::-1] / 6 + 5
    left = ImagePolygons(
        200,
        100,
        [Polygon(7, SQUARE + 1 / 3, (hole,), 1 / 3, 9, "roof", "way/123", given), Polygon(9, SQUARE * 2)],
        str(folder / "left.png"),
        geo=Georeference("EPSG:32632", np.array([[0.5, 0, 5e5], [0, -0.5, 5.3e6]]), 0.5, RPC),
        unmatched={9: "occluded"},
    )
    match = PolygonMatch(
        7, 0, 0.75, 1 / 7, 12, "guided", 0.8, np.array([[0, 1], [2, 3]]), np.array([[0.123, 2, 3, 4, 5]] * 2), 0.4
    )
    return MatchResult(
        left=left,
        right=ImagePolygons(200, 100, [Polygon(0, SQUARE)], None),
        matches=[match],
        points=PointMatches(SQUARE / 7, SQUARE / 3, np.arange(4) / 9),
        fundamental=np.arange(9.0).reshape(3, 3) / 7,
        homography=Failed("only 5 of 9 homologous points agree on a homography"),
        config={"segment": {"min_area": 0.0}},
        timings={"read": 0.25},
        warnings=["said"],
        notes=["done"],
        version="0.0.1",
        non_overlapping=True,
        same_scene=0.75,
    )


def parts(value: Any) -> Iterator[Any]:
    """All data classes in a value."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield value
        for field in dataclasses.fields(value):
            yield from parts(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield from parts(list(value.values()))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for item in value:
            yield from parts(item)


def same(a: Any, b: Any, where: str) -> None:
    assert type(a) is type(b), where
    if isinstance(a, np.ndarray):
        assert np.array_equal(a, b), where
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            if (type(a), field.name) not in NOT_SAVED:
                same(getattr(a, field.name), getattr(b, field.name), f"{where}.{field.name}")
    elif isinstance(a, Mapping):
        assert list(a) == list(b), where
        for key in a:
            same(a[key], b[key], f"{where}[{key!r}]")
    elif isinstance(a, list | tuple):
        assert len(a) == len(b), where
        for k, (one, other) in enumerate(zip(a, b, strict=True)):
            same(one, other, f"{where}[{k}]")
    else:
        assert a == b, where


def is_default(field: dataclasses.Field[Any], value: Any) -> bool:
    if field.default_factory is not dataclasses.MISSING:
        return not len(value) if isinstance(value, Mapping | Sequence | np.ndarray) else not any(vars(value).values())
    if field.default is dataclasses.MISSING:
        return False
    return value is field.default or (not isinstance(value, np.ndarray) and value == field.default)


def test_no_field_is_forgotten_here(tmp_path: Path) -> None:
    found = list(parts(everything(tmp_path)))
    kinds = {type(part) for part in found}
    assert {MatchResult, ImagePolygons, Polygon, PolygonMatch, PointMatches, Georeference, Failed} <= kinds
    for kind in kinds:
        for field in dataclasses.fields(kind):
            if (kind, field.name) not in NOT_SAVED:
                values = [getattr(part, field.name) for part in found if type(part) is kind]
                tried = not all(is_default(field, value) for value in values)
                assert tried, f"set {kind.__name__}.{field.name} in everything()"


def test_every_field_comes_back(tmp_path: Path) -> None:
    before = everything(tmp_path)
    (tmp_path / "matches.json").write_text(json.dumps(before.to_dict(), allow_nan=False))
    same(before, MatchResult.load(tmp_path), "result")
