"""Dataclasses to plain JSON values and back, by their fields and type hints.

Each field is written under its name and read back by its type hint, so a new field needs no further code. `Layout`
describes where the JSON of a class differs from that.
"""

import dataclasses
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from operator import index
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
Members = dict[str, Any]  # of a JSON object; a file may hold any values
Reader = Callable[[Any], object]  # a JSON value -> the value of a field; raises for one of another type


@dataclasses.dataclass(frozen=True)
class Layout:
    """How the JSON object of a dataclass differs from its fields."""

    names: Mapping[str, str] = dataclasses.field(default_factory=dict)  # field -> member of another name
    order: Sequence[str] = ()  # of members; others follow in the order of the fields
    sparse: Sequence[str] = ()  # fields that are left out where they are None or empty
    optional: Sequence[str] = ()  # fields that earlier versions did not write: their default is read
    unsaved: Sequence[str] = ()  # fields that files do not have
    shapes: Mapping[str, tuple[int, ...]] = dataclasses.field(default_factory=dict)  # of arrays; -1: any length
    decimals: Mapping[str, int] = dataclasses.field(default_factory=dict)  # of arrays that are rounded
    fold: Callable[[Any, Members], Members] | None = None  # changes an object's members before they are written
    unfold: Callable[[Members], Members] | None = None  # undoes `fold`
    check: Callable[[Any], None] | None = None  # raises `ValueError` for an object with invalid values


@dataclasses.dataclass(frozen=True)
class _Plan:
    """What is needed to convert a dataclass, prepared once."""

    kind: type
    layout: Layout
    read_as: Callable[[object, tuple[int, ...] | None], Reader]

    @cached_property
    def fields(self) -> list[tuple[str, str]]:
        """Field and member names."""
        names = [f.name for f in dataclasses.fields(self.kind) if f.name not in self.layout.unsaved]
        return [(name, self.layout.names.get(name, name)) for name in names]

    @cached_property
    def readers(self) -> dict[str, Reader]:
        """How to read each field."""
        hints = typing.get_type_hints(self.kind)
        return {name: self.read_as(hints[name], self.layout.shapes.get(name)) for name, _ in self.fields}


class Converter:
    """Converts dataclasses, by their layouts where they have one."""

    def __init__(self, layouts: Mapping[type, Layout]) -> None:
        self.layouts = layouts
        self._plans: dict[type, _Plan] = {}

    def to_plain(self, value: "DataclassInstance") -> Members:
        """A dataclass as a JSON object; dataclasses in it are objects too, arrays nested lists."""
        plan = self._plan(type(value))
        layout, members = plan.layout, Members()
        for name, member in plan.fields:
            held = getattr(value, name)
            if name in layout.sparse and (held is None or not len(held)):
                continue
            members[member] = self._value(held, layout.decimals.get(name))
        if layout.fold is not None:
            members = layout.fold(value, members)
        first = {name: members[name] for name in layout.order if name in members}
        return first | members

    def _value(self, value: object, decimals: int | None = None) -> object:
        """What a field holds, as JSON has it."""
        if value is None or isinstance(value, str | int | float):
            return value
        if isinstance(value, np.ndarray):
            return (value if decimals is None else value.round(decimals)).tolist()
        if isinstance(value, Mapping):
            return dict(value)
        if isinstance(value, list | tuple):
            return [self._value(item) for item in value]
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self.to_plain(value)
        return value  # plain JSON already; `json.dumps` refuses anything else

    def from_plain(self, kind: type[T], members: Members) -> T:
        """The dataclass that `to_plain` wrote. `LookupError`, `TypeError` or `ValueError` for members that are missing
        or of another type."""
        plan = self._plan(kind)
        layout = plan.layout
        if layout.unfold is not None:
            members = layout.unfold(dict(members))
        may_lack = {*layout.sparse, *layout.optional}
        found = {
            name: plan.readers[name](members[member])
            for name, member in plan.fields
            if name not in may_lack or member in members
        }
        made = kind(**found)
        if layout.check is not None:
            layout.check(made)
        return made

    def _plan(self, kind: type) -> _Plan:
        if kind not in self._plans:
            self._plans[kind] = _Plan(kind, self.layouts.get(kind, Layout()), self._reader)
        return self._plans[kind]

    def _reader(self, hint: object, shape: tuple[int, ...] | None = None) -> Reader:
        """Reads a value of a type hint."""
        origin, arguments = typing.get_origin(hint), typing.get_args(hint)
        if origin is not None and hasattr(
            origin, "__value__"
        ):  # NDArray of numpy 2.5 is an alias by the statement `type`
            return self._reader(origin.__value__[arguments], shape)
        if origin in (types.UnionType, typing.Union):
            return self._union_reader(arguments, shape)
        if origin is np.ndarray:
            dtype = typing.get_args(arguments[1])[0]
            if shape is None:
                return lambda value: np.array(value, dtype)
            return lambda value: np.array(value, dtype).reshape(shape)
        if origin is tuple:
            each = self._reader(arguments[0])
            return lambda value: tuple(each(item) for item in value)
        if isinstance(origin, type) and issubclass(origin, Mapping):
            key, held = self._reader(arguments[0]), self._reader(arguments[1])
            return lambda value: {key(name): held(item) for name, item in dict(value).items()}
        if isinstance(origin, type) and issubclass(origin, Sequence):
            item_reader = self._reader(arguments[0])
            return lambda value: [item_reader(item) for item in value]
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            return lambda value: self.from_plain(hint, value)
        if origin is typing.Literal:
            return _text
        return _SCALARS.get(hint, _unchanged)

    def _union_reader(self, kinds: Sequence[object], shape: tuple[int, ...] | None) -> Reader:
        """For a field of several types. `unfold` may have replaced null by an object of one of the classes."""
        done = tuple(kind for kind in kinds if isinstance(kind, type) and _is_made(kind))
        (other,) = (kind for kind in kinds if kind not in done)
        read = self._reader(other, shape)
        return lambda value: value if isinstance(value, done) else read(value)


def _is_made(kind: type) -> bool:
    return kind is type(None) or dataclasses.is_dataclass(kind)


def _unchanged(value: object) -> object:
    return value


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r:.40} is not a number")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r:.40} is not text")
    return value


def _truth(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{value!r:.40} is neither true nor false")
    return value


_SCALARS: Mapping[object, Reader] = {int: index, float: _number, str: _text, bool: _truth}
