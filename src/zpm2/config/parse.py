"""Values of a configuration from plain ones: of the command line, of TOML and of JSON."""

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, TypeVar

from zpm2.config.fields import short
from zpm2.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def overlay(base: T, values: object, where: str = "") -> T:
    """The dataclass `base` with `values` laid over it, a nested mapping of field names; `where` is their place, as
    "stage.". Unknown names and wrong types raise `ConfigError`."""
    if not isinstance(values, Mapping):
        raise ConfigError(
            f"option '{where.rstrip('.')}' is a stage; set one of its fields: "
            f"{', '.join(f.name for f in dataclasses.fields(base))}"
        )
    types_of = typing.get_type_hints(type(base))
    changed: dict[str, object] = {}
    for name, value in values.items():
        if name not in types_of:
            raise ConfigError(
                f"unknown option '{where}{name}'{did_you_mean(name, types_of)}; known here: {', '.join(types_of)}"
            )
        current = getattr(base, name)
        if dataclasses.is_dataclass(current) and not isinstance(current, type):
            changed[name] = overlay(current, value, f"{where}{name}.")
        elif isinstance(current, Mapping):
            changed[name] = {**current, **_words(value, f"{where}{name}")}
        else:
            changed[name] = _convert(value, types_of[name], f"{where}{name}")
    return dataclasses.replace(base, **changed)


def check_type(name: str, value: object, kind: object) -> None:
    """`ConfigError` for a value that is not of its field's type, where nothing is converted. A float may be an int, a
    tuple a list."""
    if type(value) is not kind and not _is(value, kind):
        _convert(value, kind, name)  # says what is wrong, unless it would take that value from a file
        wanted = typing.get_origin(kind) or kind
        raise ConfigError(
            f"{name} must be of type {getattr(wanted, '__name__', wanted)}, got '{short(value)}' of type "
            f"{type(value).__name__}"
        )


def _is(value: object, kind: object) -> bool:
    """Whether a value is of a field's type."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is Literal:
        return isinstance(value, str) and value in arguments
    if origin is tuple:
        return isinstance(value, list | tuple) and all(_is(part, arguments[0]) for part in value)
    if origin in (types.UnionType, typing.Union):
        return any(_is(value, each) for each in arguments)
    wanted = origin or kind
    assert isinstance(wanted, type)
    if isinstance(value, bool):
        return kind is bool
    return isinstance(value, int | float if kind is float else wanted)


def known(base: "DataclassInstance", values: Mapping[str, object]) -> dict[str, object]:
    """Those of `values` that the dataclass `base` has fields for, and so on in the stages that are dataclasses."""
    kept = {f.name: values[f.name] for f in dataclasses.fields(base) if f.name in values}
    for name, value in kept.items():
        stage = getattr(base, name)
        if dataclasses.is_dataclass(stage) and not isinstance(stage, type) and isinstance(value, Mapping):
            kept[name] = known(stage, value)
    return kept


def _words(values: object, name: str) -> dict[str, object]:
    """Options whose names and types are free. A text that reads as a number, true or false is one."""
    if not isinstance(values, Mapping):
        raise ConfigError(f"{name} holds options by name; set one of them: {name}.NAME=VALUE")
    return {key: _word(value) if isinstance(value, str) else _plain(value) for key, value in values.items()}


def _word(text: str) -> bool | int | float | str:
    """The value that a text stands for.

    >>> [_word(text) for text in ("3", "0.5", "true", "fast", "nan")]
    [3, 0.5, True, 'fast', 'nan']
    """
    switch = {"true": True, "false": False}.get(text.lower())
    if switch is not None:
        return switch
    for kind in (int, float):
        try:
            value = kind(text)
        except ValueError:
            continue
        if math.isfinite(value):
            return value
    return text


def _plain(value: object) -> object:
    """A scalar or an array of numpy as Python's own value or list."""
    return value.tolist() if hasattr(value, "tolist") else value  # numpy takes 0.1 s to load


def _convert(value: object, kind: object, name: str) -> object:
    """`value` (a string from the command line, a parsed TOML/JSON value, or one of numpy) as the field's type."""
    value, origin = _plain(value), typing.get_origin(kind)
    if origin is Literal:
        choices = typing.get_args(kind)
        if value in choices:
            return value
        raise ConfigError(f"{name} must be one of {', '.join(choices)}, got '{short(value)}'")
    if origin is tuple:
        if isinstance(value, str):
            value = [] if value == "-" else value.split(",")
        parts = (value,) if isinstance(value, int | float) else value
        if not isinstance(parts, list | tuple):
            raise ConfigError(f"{name} must be a list, got '{short(value)}'")
        return tuple(_convert(p.strip() if isinstance(p, str) else p, typing.get_args(kind)[0], name) for p in parts)
    if origin is Mapping:
        return _words(value, name)
    if origin in (types.UnionType, typing.Union):
        if value is None or value == "none":
            return None
        return _convert(value, next(a for a in typing.get_args(kind) if a is not type(None)), name)
    assert isinstance(kind, type)
    try:
        if kind is bool and isinstance(value, str):
            return {"true": True, "false": False}[value.lower()]
        if isinstance(value, bool) and kind is not bool:
            raise ValueError
        if kind is int and isinstance(value, float) and not value.is_integer():
            raise ValueError
        if isinstance(value, str) or (isinstance(value, int | float) and kind in (int, float, bool)):
            return kind(value)
    except (ValueError, KeyError, OverflowError):
        pass
    raise ConfigError(f"{name} must be of type {kind.__name__}, got '{short(value)}'")
