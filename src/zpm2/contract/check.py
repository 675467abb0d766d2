"""A check, and how checks are run."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

Subject = TypeVar("Subject")


class Broken(Exception):
    """A part does not keep its contract. The text says what is wrong and what to do."""


@dataclass(frozen=True)
class Finding:
    """What a check found."""

    check: str
    problem: str | None  # None: nothing wrong


def run(checks: Mapping[str, Callable[[Subject], None]], subject: Subject) -> Iterator[Finding]:
    """Each check in turn. An error of any other kind is a problem, too: a part may be wrong in any way."""
    for name, check in checks.items():
        try:
            check(subject)
        except Broken as broken:
            yield Finding(name, str(broken))
        except Exception as error:  # of somebody's own code
            told = " ".join(str(error).split())
            yield Finding(name, f"raises {type(error).__name__}: {told}".rstrip(": "))
        else:
            yield Finding(name, None)


def expect(good: bool, problem: str) -> None:
    """`Broken` with that text unless `good`."""
    if not good:
        raise Broken(problem)
