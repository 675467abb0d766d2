"""Every download passes through here: bounded in time and size, and with short error messages.

No server is trusted. Every byte of every answer, its head included, passes a meter (`_Metered`), which cuts answers
that come slower than `SLOWEST` or do not end. So an answer is over after `WINDOW` + its bound / `SLOWEST`
seconds, whatever is sent; a server that sends a byte a second is cut after `WINDOW`.
"""

import gzip
import http.client
import io
import logging
import re
import socket
import tarfile
import time
import zipfile
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, cast
from urllib.parse import urlsplit

from zpm2.errors import Zpm2Error
from zpm2.weights.store import Progress

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer
    from requests import PreparedRequest, Response, Session
    from urllib3 import HTTPConnectionPool

TIMEOUT = (10.0, 30.0)  # seconds, to connect (each address of the host) and between two reads
QUICK = (2.0, 5.0)  # the same where another source stands by
WINDOW = 30.0  # seconds of waiting, in each of which an answer must come on by WINDOW * SLOWEST bytes, or it is cut
SLOWEST = 2000  # bytes a second: a slow line has 50,000, so that it may even fall silent for most of a window
_REDIRECTS = 5
_HEAD = 2**20  # bytes that heads and the lengths of chunks may add to a body, which may double by the latter
_BLOCK = 1 << 18

_log = logging.getLogger(__name__)


class SourceError(Zpm2Error):
    """One source did not give the file; the text says why in a few words."""


class Unreachable(SourceError):
    """The source's host could not be reached, or was too slow."""


class NotThere(SourceError):
    """The host was reached and does not have it (404)."""


class NoRanges(SourceError):
    """The host does not send parts of files."""


class _TooSlow(Exception):
    """An answer came slower than `SLOWEST`."""


class _TooMuch(Exception):
    """An answer had more bytes than it may have."""


def open_session(most: int) -> "Session":
    """A requests session whose answers are metered; the body of none may have more than `most` bytes.

    Proxies and certificates come from the environment, as usual with requests.
    """
    import requests
    from requests.adapters import HTTPAdapter

    class Answer(http.client.HTTPResponse):
        def __init__(
            self, sock: socket.socket, debuglevel: int = 0, method: str | None = None, url: str | None = None
        ) -> None:
            super().__init__(sock, debuglevel, method, url)
            self.fp = io.BufferedReader(_Metered(self.fp.detach(), 2 * most + _HEAD))

    class Adapter(HTTPAdapter):
        def get_connection_with_tls_context(
            self,
            request: "PreparedRequest",
            verify: bool | str,
            proxies: dict[str, str] | None = None,
            cert: tuple[str, str] | str | None = None,
        ) -> "HTTPConnectionPool":
            pool = super().get_connection_with_tls_context(request, verify, proxies, cert)
            connection = cast("type[http.client.HTTPConnection]", pool.ConnectionCls)  # which urllib3's are, too
            if connection.response_class is not Answer:
                pool.ConnectionCls = type("Connection", (pool.ConnectionCls,), {"response_class": Answer})
            return pool

    session = requests.Session()
    session.headers["Accept-Encoding"] = "identity"
    session.max_redirects = _REDIRECTS
    for scheme in ("http://", "https://"):
        session.mount(scheme, Adapter())
    return session


@contextmanager
def answer(
    session: "Session", url: str, timeout: tuple[float, float] = TIMEOUT, headers: dict[str, str] | None = None
) -> Iterator["Response"]:
    """The answer to GET, its body not yet read. `SourceError` if it reports a failure."""
    with told_briefly(url):
        response = session.get(url, stream=True, timeout=timeout, headers=headers)
    with response:
        with told_briefly(url):
            response.raise_for_status()
        yield response


def content(response: "Response", url: str, most: int, progress: Progress | None = None) -> Generator[bytes]:
    """The bytes of an answer's body, in order. `SourceError` if they do not all come, or are more than `most`.

    `progress` is called where the server announces their number.
    """
    done, total = 0, response.raw.length_remaining or 0  # as urllib3 reads Content-Length, doubled or bad ones too
    chunks = response.iter_content(_BLOCK)
    while max(done, total) <= most:
        with told_briefly(url):
            chunk = next(chunks, b"")
        if not chunk:
            return
        done += len(chunk)
        yield chunk
        if progress and total:
            progress(done, total)
    raise SourceError(f"{host_of(url)} sends more than {most} bytes")


def body(
    session: "Session", url: str, most: int, timeout: tuple[float, float] = TIMEOUT, progress: Progress | None = None
) -> Generator[bytes]:
    """The bytes behind a URL; see `content`."""
    with answer(session, url, timeout) as response:
        yield from content(response, url, most, progress)


class RemoteFile(io.RawIOBase):
    """A file on a server, of which only those bytes travel that are read; to be buffered, as each read is a request.

    `NoRanges` if the server does not send parts of it, `SourceError` if it sends others than asked for, or if more
    than `most` bytes are read altogether.
    """

    def __init__(self, session: "Session", url: str, most: int) -> None:
        self._session, self._url, self._left = session, url, most
        self._at, self._size = 0, 0
        self._size = self._part(0, 0)[1]

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        if self._at < 0:
            raise OSError("a position before the beginning of the file")
        return self._at

    def readinto(self, buffer: "WriteableBuffer") -> int:
        view = memoryview(buffer).cast("B")
        count = min(len(view), self._size - self._at)
        if count <= 0:
            return 0
        view[:count] = self._part(self._at, self._at + count - 1)[0]
        self._at += count
        return count

    def _part(self, first: int, last: int) -> tuple[bytes, int]:
        """The bytes from `first` to `last`, both included, and the file's size."""
        self._left -= last - first + 1
        if self._left < 0:
            raise SourceError(f"the archive at {host_of(self._url)} has more before the file than it may have")
        with answer(self._session, self._url, headers={"Range": f"bytes={first}-{last}"}) as response:
            span = re.fullmatch(r"bytes (\d{1,15})-(\d{1,15})/(\d{1,15})", response.headers.get("Content-Range", ""))
            if response.status_code != 206 or not span:
                raise NoRanges(f"{host_of(self._url)} does not send parts of files")
            part = b"".join(content(response, self._url, last - first + 1))
        if (int(span[1]), int(span[2]), len(part)) != (first, last, last - first + 1):
            raise SourceError(f"{host_of(self._url)} sends other bytes than asked for")
        return part, int(span[3])


class _Metered(io.RawIOBase):
    """The bytes of one answer. Raises `_TooSlow` and `_TooMuch`.

    Only time spent waiting counts, not the processing of the bytes.
    """

    def __init__(self, raw: io.RawIOBase, most: int) -> None:
        self._raw, self._left = raw, most
        self._came, self._waited = 0, 0.0  # in this window

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: "WriteableBuffer") -> int | None:
        began = time.monotonic()
        count = self._raw.readinto(buffer)
        self._waited += time.monotonic() - began
        self._came += count or 0
        self._left -= count or 0
        if self._left < 0:
            raise _TooMuch
        if count and self._waited > WINDOW:
            if self._came < WINDOW * SLOWEST:
                raise _TooSlow
            self._came, self._waited = 0, 0.0
        return count

    def close(self) -> None:
        self._raw.close()
        super().close()


@contextmanager
def told_briefly(url: str) -> Iterator[None]:
    """Turn every exception of the network, of archives and of the libraries that read them into a `SourceError`.

    That includes exceptions which those libraries do not raise on purpose, as foreign bytes may cause any; the log has
    their traceback at the level DEBUG. So only calls that read foreign bytes belong inside.
    """
    import requests
    import urllib3
    from requests import exceptions

    host = host_of(url)
    damaged = (
        exceptions.ChunkedEncodingError,
        exceptions.ContentDecodingError,
        urllib3.exceptions.ProtocolError,
        urllib3.exceptions.DecodeError,
        http.client.HTTPException,
        EOFError,
        gzip.BadGzipFile,
        tarfile.TarError,
        zipfile.BadZipFile,
        zlib.error,
    )
    late = (exceptions.Timeout, urllib3.exceptions.TimeoutError, TimeoutError)
    no_address = (exceptions.InvalidURL, exceptions.MissingSchema, exceptions.InvalidSchema)
    try:
        yield
    except Zpm2Error:
        raise
    except _TooSlow as error:
        raise Unreachable(f"{host} sends less than {SLOWEST} bytes a second") from error
    except _TooMuch as error:
        raise SourceError(f"the answer of {host} does not end") from error
    except damaged as error:
        raise SourceError(f"the download from {host} broke off or is damaged") from error
    except exceptions.SSLError as error:
        raise SourceError(f"the certificate of {host} was not accepted") from error
    except late as error:
        raise Unreachable(f"{host} did not answer in time") from error
    except exceptions.ConnectionError as error:
        raise Unreachable(f"no connection to {host}") from error
    except exceptions.HTTPError as error:
        code = error.response.status_code if error.response is not None else "with an error"
        raise (NotThere if code == 404 else SourceError)(f"{host} answered {code}") from error
    except exceptions.TooManyRedirects as error:
        raise SourceError(f"{host} redirects too often") from error
    except no_address as error:
        raise SourceError(f"{host} is no web address, or redirects to what is none") from error
    except (requests.RequestException, urllib3.exceptions.HTTPError) as error:  # its text may hold credentials
        raise SourceError(f"{host}: {type(error).__name__}") from error
    except OSError as error:
        raise SourceError(f"{host}: {type(error).__name__}: {str(error)[:200]}") from error
    except Exception as error:
        _log.debug("what %s sent cannot be read", host, exc_info=True)
        raise SourceError(f"what {host} sent cannot be read ({type(error).__name__})") from error


def host_of(url: str) -> str:
    """The server's name for messages, without credentials."""
    try:
        return (urlsplit(url).hostname or "")[:100] or "an address without a host"
    except ValueError:
        return "an address that is none"
