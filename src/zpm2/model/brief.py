"""How data classes print themselves: on one line, however much they hold."""

import dataclasses
from collections.abc import Mapping, Sized
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

LONGEST = 60  # characters of a text


def brief(data: "DataclassInstance") -> str:
    """The `repr` of a dataclass that holds arrays or lists.

    It shows numbers and names, the shape of arrays, and the length of lists and tables. Fields with their default value
    and fields with repr=False are left out.
    """
    shown = []
    for field in dataclasses.fields(data):
        value = getattr(data, field.name)
        if field.repr and not _usual(field, value):
            shown.append(_shown(field.name, value))
    return f"{type(data).__name__}({', '.join(shown)})"


def _usual(field: "dataclasses.Field[object]", value: object) -> bool:
    if field.default is not dataclasses.MISSING:
        return value is field.default or (isinstance(value, str | int | float | tuple) and value == field.default)
    made = field.default_factory is not dataclasses.MISSING and field.default_factory()
    return made is not False and (len(value) == 0 if isinstance(value, Sized) else repr(value) == repr(made))


def _shown(name: str, value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{name} {' x '.join(map(str, value.shape))}"
    if isinstance(value, str):
        return f"{name}={value if len(value) <= LONGEST else '...' + value[-LONGEST:]!r}"
    if isinstance(value, tuple) and all(isinstance(part, int | float | str) for part in value):
        return f"{name}={value}"
    if isinstance(value, Mapping | Sized) and not dataclasses.is_dataclass(value):
        return f"{len(value)} {name}"
    return f"{name}={value:.4g}" if isinstance(value, float) else f"{name}={value}"
