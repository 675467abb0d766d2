"""Messages of a run: warnings and notes.

A message is a warning unless it is a `Note`. A warning says that the result may be wrong, is not complete, or is not
what was asked for, so that a user can do something about it; it is printed. A note says what was done on the way, as in
every run of the kind; it is only kept with the result.
"""

from collections.abc import Iterable


class Note(str):
    """A message on which nobody has to act."""


def about(subject: str, messages: Iterable[str]) -> list[str]:
    """The messages with what they are about in front; notes stay notes."""
    return [type(message)(f"{subject}: {message}") for message in messages]


def split(messages: Iterable[str]) -> tuple[list[str], list[str]]:
    """The warnings and the notes among messages, each once, as plain text."""
    each = list(dict.fromkeys(messages))
    notes = [str(message) for message in each if isinstance(message, Note)]
    return [str(message) for message in each if not isinstance(message, Note)], notes
