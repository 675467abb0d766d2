"""Fetch a file that is not here: try its sources in order, keep the first right file, report what each one answered."""

import logging
import os
import re
import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from zpm2.errors import WeightsError
from zpm2.weights import carriers
from zpm2.weights.manifest import Entry, Hub, Source
from zpm2.weights.net import QUICK, TIMEOUT, SourceError, Unreachable, answer, body, open_session, told_briefly
from zpm2.weights.store import BadCopy, Progress, cache_dir, keep, pin

_log = logging.getLogger(__name__)
_REST = 60.0  # seconds in which a hub that could not be reached is not tried again, where there is another source
_hub_rests_until = 0.0  # on the monotonic clock


def fetch(item: Entry, progress: Progress | None = None) -> Path:
    """The entry's file, fetched into the cache and verified. `WeightsError` where no source gives the right file."""
    if switch := offline():
        raise _cannot_get(item, [f"{switch} is set, so no network was asked"])
    answers: list[str] = []
    for source in item.sources:
        try:
            stated = item if item.hash_known or not isinstance(source, Hub) else _as_stated(item, source)
            with closing(_chunks(stated, source, progress)) as chunks:
                path = keep(stated, chunks, progress)
            if not item.hash_known:
                pin(stated)
        except SourceError as reason:
            answers.append(f"{source}: {reason}")
        except BadCopy as reason:
            answers.append(f"{source}: its file {reason}")
        else:
            if answers:
                _log.warning("%s comes from %s (%s)", item.name, source, "; ".join(answers))
            return path
    raise _cannot_get(item, answers)


def offline() -> str | None:
    """The environment variable that forbids the network, if one does."""
    for name in ("ZPM2_OFFLINE", "HF_HUB_OFFLINE"):
        if os.environ.get(name, "").strip().lower() in ("1", "true", "yes", "on"):
            return name
    return None


def _chunks(item: Entry, source: Source, progress: Progress | None) -> Generator[bytes]:
    if isinstance(source, Hub):
        return _from_hub(item, source)
    return carriers.read(item, source, progress)


def _as_stated(item: Entry, source: Hub) -> Entry:
    """The entry with the size and sha256 that the hub states, for a file of which we know neither."""
    with open_session(0) as session, answer(session, _address(source)) as response:
        heads = [each.headers for each in (*response.history, response)]
        sha256 = next((head["X-Linked-Etag"].strip('"') for head in heads if "X-Linked-Etag" in head), "")
        size = next((head["X-Linked-Size"] for head in heads if "X-Linked-Size" in head), "")
    if not re.fullmatch("[0-9a-f]{64}", sha256) or not re.fullmatch(r"[1-9]\d{0,11}", size):
        raise SourceError("it does not state the size and sha256 of the file, of which we know neither")
    return replace(item, size=int(size), sha256=sha256)


def _address(source: Hub) -> str:
    endpoint = os.environ.get("HF_ENDPOINT", "").strip().rstrip("/") or None
    with told_briefly(endpoint or ""):
        from huggingface_hub import hf_hub_url  # reads HF_ENDPOINT, too, and fails for what is no address

        return hf_hub_url(source.repo, source.file, endpoint=endpoint)


def _from_hub(item: Entry, source: Hub) -> Generator[bytes]:
    """The file's bytes from the hub, which must answer soon where there is another source.

    huggingface_hub says where the file is. Its own downloader is not used: it keeps a second copy in its cache, and
    asks for a host that does not resolve six times, in 23 seconds (seen with 2.4).
    """
    global _hub_rests_until
    alone = len(item.sources) == 1
    if not alone and time.monotonic() < _hub_rests_until:
        raise SourceError("could not be reached a moment ago")
    url = _address(source)
    try:
        with open_session(item.size) as session:
            yield from body(session, url, item.size, TIMEOUT if alone else QUICK)
    except Unreachable:
        _hub_rests_until = time.monotonic() + _REST
        raise


def _cannot_get(item: Entry, answers: list[str]) -> WeightsError:
    return WeightsError(
        f"cannot get {item.name} ({'; '.join(answers)}): put {item.label} by hand into {cache_dir()} or into a folder "
        f"named by --weights-dir or ZPM2_WEIGHTS; its authors offer it at {item.home}"
    )
