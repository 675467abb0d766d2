"""The one way in which bytes come over the network: short waits, and failures told in a few words."""

import http.client
import tarfile
import zipfile
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from zpm2.weights.store import Progress

TIMEOUT = (10.0, 30.0)  # seconds, to connect (each address of the host) and between two reads
QUICK = (2.0, 5.0)  # the same where another source stands by
_BLOCK = 1 << 18


class SourceError(Exception):
    """One source did not give the file; the text says why in a few words."""


class Unreachable(SourceError):
    """The source's host could not be reached at all."""


def open_session() -> Any:
    """A requests session. Proxies and certificates come from the environment, as usual with requests."""
    import requests

    session = requests.Session()
    session.headers["Accept-Encoding"] = "identity"
    return session


def body(
    session: Any, url: str, timeout: tuple[float, float] = TIMEOUT, progress: Progress | None = None
) -> Generator[bytes]:
    """The bytes behind a URL, in order. `SourceError` if they do not all come.

    `progress` is told of them where the server says how many there are.
    """
    with told_briefly(url), session.get(url, stream=True, timeout=timeout) as response:
        response.raise_for_status()
        done, total = 0, int(response.headers.get("Content-Length", 0))
        for chunk in response.iter_content(_BLOCK):
            yield chunk
            done += len(chunk)
            if progress and total:
                progress(done, total)


@contextmanager
def told_briefly(url: str) -> Iterator[None]:
    """Turn what network, archives and servers raise into a `SourceError` of a few words."""
    import requests
    import urllib3

    host = urlsplit(url).hostname or url
    damaged = (
        requests.exceptions.ChunkedEncodingError,
        urllib3.exceptions.ProtocolError,
        http.client.HTTPException,
        EOFError,
        tarfile.TarError,
        zipfile.BadZipFile,
        zlib.error,
    )
    late = (requests.exceptions.Timeout, urllib3.exceptions.TimeoutError, TimeoutError)
    try:
        yield
    except damaged as error:
        raise SourceError(f"the download from {host} broke off or is damaged") from error
    except requests.exceptions.SSLError as error:
        raise SourceError(f"the certificate of {host} was not accepted") from error
    except late as error:
        raise Unreachable(f"{host} did not answer in time") from error
    except requests.exceptions.ConnectionError as error:
        raise Unreachable(f"no connection to {host}") from error
    except requests.exceptions.HTTPError as error:
        code = error.response.status_code if error.response is not None else "with an error"
        raise SourceError(f"{host} answered {code}") from error
    except (requests.exceptions.RequestException, urllib3.exceptions.HTTPError, OSError) as error:
        raise SourceError(f"{host}: {type(error).__name__}: {' '.join(str(error).split())[:120]}") from error
