"""Dataclasses to JSON and back, whatever fields they have."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from zpm2.formats.convert import Converter, Layout


@dataclass(frozen=True, eq=False)
class Inner:
    ring: NDArray[np.float64]
    name: str | None = None


@dataclass(frozen=True, eq=False)
class Outer:
    count: int
    share: float
    kind: Literal["a", "b"]
    inner: Inner
    rows: Sequence[Inner]
    corners: tuple[NDArray[np.int64], ...] = ()
    by_stage: Mapping[str, float] = field(default_factory=dict)
    done: bool = False
    cache: object = None


CONVERTER = Converter(
    {
        Inner: Layout(names={"ring": "vertices"}, sparse=("name",), shapes={"ring": (-1, 2)}, decimals={"ring": 1}),
        Outer: Layout(order=("kind",), optional=("done",), unsaved=("cache",)),
    }
)
OUTER = Outer(
    *(3, 0.5, "b", Inner(np.array([[0.25, 1]]), "x"), [Inner(np.zeros((0, 2)))], (np.array([1, 2]),)),
    *({"read": 1.5}, True, object()),
)


def test_every_field_is_written_and_read() -> None:
    plain = json.loads(json.dumps(CONVERTER.to_plain(OUTER)))
    assert next(iter(plain)) == "kind"
    assert plain["inner"] == {"vertices": [[0.2, 1.0]], "name": "x"}
    assert plain["rows"] == [{"vertices": []}]
    assert "cache" not in plain
    again = CONVERTER.from_plain(Outer, plain)
    assert (again.count, again.share, again.kind, again.by_stage, again.done) == (3, 0.5, "b", {"read": 1.5}, True)
    assert again.rows[0].ring.shape == (0, 2)
    assert again.rows[0].name is None
    assert again.corners[0].dtype == np.int64
    assert CONVERTER.to_plain(again) == plain


def test_an_optional_member_may_be_missing_and_no_other() -> None:
    plain = CONVERTER.to_plain(OUTER)
    assert not CONVERTER.from_plain(Outer, {k: v for k, v in plain.items() if k != "done"}).done
    with pytest.raises(KeyError, match="by_stage"):
        CONVERTER.from_plain(Outer, {k: v for k, v in plain.items() if k != "by_stage"})


@pytest.mark.parametrize(
    ("member", "value"),
    [
        *(("count", 1.5), ("count", "1"), ("share", "half"), ("share", True), ("share", None), ("kind", 3)),
        *(("inner", 3), ("inner", None), ("rows", 3), ("corners", [["a"]]), ("by_stage", [1]), ("done", "yes")),
        *(("inner", {"vertices": [1, 2, 3]}), ("inner", {"vertices": [[1, 2]], "name": 3})),
    ],
)
def test_a_value_of_another_type_is_refused(member: str, value: object) -> None:
    with pytest.raises((TypeError, ValueError, LookupError)):
        CONVERTER.from_plain(Outer, {**CONVERTER.to_plain(OUTER), member: value})
