"""Runs the server until Ctrl-C."""

import contextlib
import secrets
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING

from zpm2.errors import ConfigError, MissingDependency

if TYPE_CHECKING:
    from zpm2.app.session import Session

LOCAL = "127.0.0.1"
EVERY = ("0.0.0.0", "::")  # addresses that mean all of this machine's
ENDING = 2  # seconds that answers may take when the server ends


def check_installed() -> None:
    """`MissingDependency` without the packages of the extra `app`."""
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as error:
        raise MissingDependency('zpm2 app needs starlette and uvicorn: pip install "zpm2[app]"') from error


def serve(session: "Session", host: str, port: int, most: float, ready: Callable[[str], None]) -> None:
    """Serves until an interrupt, which ends it quietly.

    port: 0 takes a free one. most: bytes of a photograph that the browser may send. `ready` receives the address once
    it can be opened. `ConfigError` where the address cannot be had, `MissingDependency`.
    """
    check_installed()
    import uvicorn

    from zpm2.app.server import Server

    token = secrets.token_urlsafe(32)
    opened = _socket(host, port)
    with contextlib.closing(opened):
        local = host == LOCAL
        names = () if local else (host, socket.gethostname())
        server = Server(session, token, most, names, any_address=not local)
        config = uvicorn.Config(
            server.application,
            log_level="error",
            access_log=False,
            lifespan="off",
            server_header=False,
            timeout_graceful_shutdown=ENDING,
        )
        ready(f"http://{_named(host)}:{opened.getsockname()[1]}/#token={token}")
        with contextlib.suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[opened])
        server.turns.close()


def _socket(host: str, port: int) -> socket.socket:
    """A listening socket."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(f"cannot listen on {host}, port {port} ({reason}): give another --port or --host") from error
    except OverflowError as error:
        raise ConfigError(f"--port {port}: give one from 0 to 65535") from error


def _named(host: str) -> str:
    """The part of an address that reaches `host` from this machine."""
    name = LOCAL if host in EVERY else host
    return f"[{name}]" if ":" in name else name
