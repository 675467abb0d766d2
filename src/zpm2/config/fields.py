"""How a field of the configuration is declared: its meaning, unit, range and source beside its value, and their check.

grid: int = number(32, "prompts along each image side, grid x grid in all", low=1, high=1000)
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from zpm2.errors import ConfigError

T = TypeVar("T")
Number = TypeVar("Number", bound=float)

Word = bool | int | float | str  # the value of an option of another package's part
LARGEST = 2**31 - 1  # what OpenCV takes for a number, a seed for instance


@dataclasses.dataclass(frozen=True)
class Rule:
    """What a field means and which values it may have."""

    meaning: str
    unit: str = ""
    low: float = 0.0
    high: float = LARGEST
    above: bool = False  # `low` itself is not allowed
    odd: bool = False
    share: bool = False  # from 0 to `high`, of a whole
    source: str = ""  # paper, publication or measurement that the value comes from
    check: Callable[[str, Any], None] | None = None  # raises `ConfigError` for what the rest cannot say

    def __str__(self) -> str:
        """Unit, meaning and source in one line."""
        text = ", ".join(part for part in (self.unit, self.meaning) if part)
        return f"{text} ({self.source})" if self.source else text


def number(
    default: Number,
    meaning: str,
    *,
    unit: str = "",
    low: float = 0.0,
    high: float = LARGEST,
    above: bool = False,
    odd: bool = False,
    source: str = "",
) -> Number:
    """A field that is a number from `low` (above it, where `above`) to `high`."""
    return _field(default, Rule(meaning, unit, low, high, above, odd, source=source))


def share(default: float, meaning: str, *, high: float = 1.0, above: bool = False, source: str = "") -> float:
    """A field that is a share of a whole, from 0 to `high`."""
    return _field(default, Rule(meaning, f"0..{high:g}", 0.0, high, above, share=True, source=source))


def option(
    default: T, meaning: str, *, unit: str = "", source: str = "", check: Callable[[str, T], None] | None = None
) -> T:
    """A field that is a word, a switch or a list. `check(name, value)` raises `ConfigError`."""
    return _field(default, Rule(meaning, unit, source=source, check=check))


def options(meaning: str) -> dict[str, Word]:
    """A field that holds the options of a part which another package may have written: its names are free, its values
    numbers, words and switches."""
    rule = Rule(meaning, check=_words)
    made: dict[str, Word] = dataclasses.field(default_factory=dict, hash=False, metadata={"rule": rule})
    return made


def named(name: str, value: str) -> None:
    """`ConfigError` for an empty name."""
    if not value:
        raise ConfigError(f"{name} is empty: give a name")


def _words(name: str, values: Mapping[object, object]) -> None:
    for key, value in values.items():
        if not isinstance(key, str) or not key.isidentifier():
            raise ConfigError(f"{name}.{short(key)} is not the name of an option: letters, digits and _ only")
        if not isinstance(value, bool | int | float | str):
            raise ConfigError(f"{name}.{key} must be a number, a word, true or false, got '{short(value)}'")
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"{name}.{key} must be finite, got {value}")


def rule_of(item: "dataclasses.Field[object]") -> Rule:
    """The rule that a field was declared with."""
    rule: Rule = item.metadata["rule"]
    return rule


def check(name: str, value: object, rule: Rule) -> None:
    """`ConfigError` for a value that its rule does not allow."""
    numbers = [v for v in (value if isinstance(value, list | tuple) else (value,)) if isinstance(v, int | float)]
    if any(v != v or v < 0 or v == float("inf") for v in numbers):
        raise ConfigError(f"{name} must be a finite number >= 0, got {value}")
    unit = f" {rule.unit}" if rule.unit == "px" else ""
    for v in numbers:
        if rule.share and v > rule.high:
            raise ConfigError(f"{name} is a share from 0 to {rule.high:g}, got {short(v)}")
        if v > rule.high:
            raise ConfigError(f"{name} must be at most {rule.high:.10g}, got {short(v)}")
        if rule.odd and (v < rule.low or v % 2 == 0):
            raise ConfigError(f"{name} must be odd and at least {rule.low:g}{unit}, got {v}")
        if rule.above and v <= rule.low:
            raise ConfigError(f"{name} must be above {rule.low:g}, got {v}")
        if v < rule.low:
            raise ConfigError(f"{name} must be at least {rule.low:g}{unit}, got {v}")
    if rule.check is not None:
        rule.check(name, value)


def short(value: object) -> str:
    """What a message says of a value. Python does not write out integers of more than 4300 digits."""
    try:
        text = str(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _field(default: T, rule: Rule) -> T:
    return dataclasses.field(default=default, metadata={"rule": rule})
