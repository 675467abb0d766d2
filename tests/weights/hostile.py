"""A server on the loopback interface that sends what it likes, as fast as it likes."""

import ssl
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from socketserver import StreamRequestHandler, ThreadingTCPServer
from threading import Thread

Reply = Callable[[str, str], Iterable[bytes]]  # (path, value of Range or "") -> what is sent, piece by piece


@contextmanager
def replying(reply: Reply, tls: ssl.SSLContext | None = None) -> Iterator[str]:
    """Its address. It hangs up after each reply."""

    class Handler(StreamRequestHandler):
        def handle(self) -> None:
            lines = [line.strip().decode() for line in iter(self.rfile.readline, b"\r\n") if line]
            headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in lines[1:])}
            with suppress(OSError):  # a client that has had enough hangs up
                for piece in reply(lines[0].split()[1], headers.get("range", "")):
                    self.wfile.write(piece)
                    self.wfile.flush()

    class Server(ThreadingTCPServer):
        daemon_threads = True
        block_on_close = False

        def handle_error(self, *_: object) -> None:
            """Nor is that one here."""

    with Server(("127.0.0.1", 0), Handler) as server:
        if tls:
            server.socket = tls.wrap_socket(server.socket, server_side=True)
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        yield f"{'https' if tls else 'http'}://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
    thread.join()


def drip(content: bytes) -> Iterator[bytes]:
    """A byte at a time, for 10 s."""
    for byte in content[:500]:
        yield bytes([byte])
        time.sleep(0.02)


def ok(body: bytes, *headers: str) -> bytes:
    """A good answer."""
    head = ["HTTP/1.1 200 OK", "Connection: close", "Content-Type: text/html", *headers]
    if not any(line.lower().startswith(("content-length", "transfer")) for line in headers):
        head.append(f"Content-Length: {len(body)}")
    return "\r\n".join([*head, "", ""]).encode("latin-1") + body
