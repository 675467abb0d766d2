"""Who may ask the server, and what its pages may do.

The server is for one person on one machine, but every web page that this person opens can send requests to it. So:
the name by which it is called must be its own (else another name could have been pointed at this machine: DNS
rebinding), requests that other pages start are refused, and all but the empty page itself needs the token, in a header
that no other page can send.
"""

import ipaddress
import secrets
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN = "x-zpm2-token"  # the header
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Guard:
    """Refuses requests before `app` sees them, and adds the headers that make browsers strict.

    names: of this machine, apart from those of its loopback interface. any_address: whether numeric addresses are its
    own, too (they cannot be rebound). policy: the Content-Security-Policy of all answers.
    """

    def __init__(self, app: ASGIApp, token: str, policy: str, names: Iterable[str], any_address: bool) -> None:
        self.app, self.token, self.any_address = app, token.encode(), any_address
        self.names = {name.lower() for name in (*LOOPBACK, *names)}
        self.headers = {
            "content-security-policy": policy,
            "x-content-type-options": "nosniff",
            "x-frame-options": "DENY",
            "referrer-policy": "no-referrer",
            "cross-origin-opener-policy": "same-origin",
            "cross-origin-resource-policy": "same-origin",
            "cache-control": "no-store",
        }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As every ASGI application."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def strict(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(self.headers)
            await send(message)

        refused = self._refused(Headers(scope=scope), scope["path"])
        if refused is None:
            await self.app(scope, receive, strict)
            return
        status, reason = refused
        await JSONResponse({"error": reason}, status)(scope, receive, strict)

    def _refused(self, headers: Headers, path: str) -> tuple[int, str] | None:
        """Status and reason; None where the request may pass."""
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._own(hosts[0]):
            return 403, "this server does not have that name: open the address that zpm2 app printed"
        origins = headers.getlist("origin")
        if any(origin != f"http://{hosts[0]}" for origin in origins):
            return 403, "requests from other pages are refused"
        if path != "/" and headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            return 403, "requests from other pages are refused"
        if path.startswith("/api/") and not secrets.compare_digest(headers.get(TOKEN, "").encode(), self.token):
            return 401, "the token is missing or wrong: open the address that zpm2 app printed, with all that follows #"
        return None

    def _own(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
            if name in self.names:
                return True
            return self.any_address and bool(ipaddress.ip_address(name))
        except ValueError:
            return False
