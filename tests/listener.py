"""A server on the loopback interface that counts who calls: a test for what must not touch a network."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Thread


@dataclass
class Listener:
    """Its address, and the first line of every call."""

    address: str
    calls: list[str] = field(default_factory=list)


@contextmanager
def listening() -> Iterator[Listener]:
    """It answers 404 to everything."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        state = Listener(f"http://127.0.0.1:{server.getsockname()[1]}")

        def serve() -> None:
            while True:
                try:
                    call, _ = server.accept()
                except OSError:  # it was closed
                    return
                with call:
                    call.settimeout(1)
                    line = call.recv(4096).split(b"\r\n")[0].decode(errors="replace")
                    state.calls.append(line)
                    call.sendall(b"HTTP/1.0 404 none\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")

        thread = Thread(target=serve, daemon=True)
        thread.start()
        yield state
        server.shutdown(socket.SHUT_RDWR)
    thread.join()
