"""Licences that must be accepted once, and the record of it.

The record is the file `accepted-licences.txt` in the cache, one licence a line: accepting SuperPoint's licence for one
of its two files accepts it for both.
"""

import logging
from pathlib import Path

from zpm2.errors import WeightsError
from zpm2.files.reading import read_text
from zpm2.weights.manifest import Entry
from zpm2.weights.store import cache_dir

_log = logging.getLogger(__name__)


def require(item: Entry, accept: bool = False) -> None:
    """Raise `WeightsError` where an entry's licence forbids commercial use and nobody has accepted it.

    `accept` accepts it now and records that.
    """
    if item.commercial_use or item.licence in _accepted():
        return
    if not accept:
        raise WeightsError(
            f"{item.name} is under the {item.licence}, see {item.terms}: "
            f"to accept it once, run: zpm2 weights get {item.name} --accept-licence"
        )
    try:
        cache_dir().mkdir(parents=True, exist_ok=True)
        with _record().open("a", encoding="utf-8") as file:
            file.write(item.licence + "\n")
    except OSError as error:
        _log.warning(
            "cannot record in %s that the licence of %s was accepted (%s): it will be asked for again",
            _record(),
            item.name,
            error.strerror,
        )


def _record() -> Path:
    return cache_dir() / "accepted-licences.txt"


def _accepted() -> list[str]:
    try:
        return read_text(_record()).splitlines()
    except (OSError, ValueError):
        return []
