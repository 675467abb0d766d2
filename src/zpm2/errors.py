"""What can go wrong, by name.

Misuse (an unreadable file, an unknown option, missing weights) raises a `Zpm2Error` whose message is one line that
says what is wrong and what to do; the command line prints it and leaves with exit code 2. An estimate that does not
exist (no homography from three points) is not misuse: it is a `Failed`, which is falsy and carries its reason.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches


class Zpm2Error(Exception):
    """Base of every error that zpm2 raises on purpose. Its text is one line, whatever names it holds."""

    def __str__(self) -> str:
        text = " ".join(super().__str__().splitlines())
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class InputError(Zpm2Error):
    """An input cannot be used: missing, damaged, of a wrong kind, too small, not finite."""


class ConfigError(Zpm2Error):
    """An option, preset or configuration file does not exist or has a value that cannot be used."""


class WeightsError(Zpm2Error):
    """Pre-trained weights are not available: no source answered, or a file differs from the manifest."""


class OutputError(Zpm2Error):
    """A result cannot be written."""


class PointMatcherError(Zpm2Error):
    """A point matcher of another package failed, or returned what cannot be used; or one that runs in a process of its
    own has stopped, and the message holds its last words."""


class SegmenterError(Zpm2Error):
    """A segmenter of another package failed, or returned what cannot be used."""


class WorkerError(Zpm2Error):
    """Processes that do a part of a run's work end again and again."""


class ForkError(Zpm2Error):
    """Networks are used in a process that was forked after they were loaded."""


class MissingDependency(Zpm2Error):
    """An optional package is needed; the message holds the install command."""


class PluginWarning(UserWarning):
    """A segmenter, point matcher, data set or format of another package is left out. Its text is one line."""


@dataclass(frozen=True)
class Failed:
    """An estimate that does not exist. Falsy, so that `if geometry.homography:` reads as it should."""

    reason: str

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.reason


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """The hint " (did you mean ...?)" for a message if one of the `known` names is close; otherwise empty."""
    close = get_close_matches(str(name), list(known), n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""
