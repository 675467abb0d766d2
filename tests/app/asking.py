"""Requests to an ASGI application, without a network and without a client."""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from starlette.types import ASGIApp, Message

TOKEN = "a-token-of-the-tests"
OWN = {"host": "127.0.0.1:8000"}
CLEARED = {**OWN, "x-zpm2-token": TOKEN}


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def error(self) -> str:
        return str(self.json["error"])


async def answer(
    app: ASGIApp, path: str, body: bytes | None = None, headers: Mapping[str, str] = CLEARED, more: bytes | None = None
) -> Answer:
    """The answer to a GET, or with a `body` to a POST, of which `more` is a second part."""
    parts = [part for part in (body, more) if part is not None] or [b""]
    sent: list[Message] = []

    async def receive() -> Message:
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message: Message) -> None:
        sent.append(message)

    name, _, query = path.partition("?")
    scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "scheme": "http",
        "method": "GET" if body is None else "POST",
        "path": name,
        "raw_path": name.encode(),
        "query_string": query.encode(),
        "headers": [(key.encode(), value.encode("latin-1")) for key, value in headers.items()],
        "server": ("127.0.0.1", 8000),
        "root_path": "",
    }
    await app(scope, receive, send)
    found = {key.decode(): value.decode() for key, value in sent[0]["headers"]}
    return Answer(sent[0]["status"], found, b"".join(each.get("body", b"") for each in sent[1:]))


def asked(app: ASGIApp, path: str, body: bytes | None = None, headers: Mapping[str, str] = CLEARED) -> Answer:
    return asyncio.run(answer(app, path, body, headers))


def told(app: ASGIApp, path: str, **values: object) -> Answer:
    """The answer to a POST of a JSON object."""
    return asked(app, path, json.dumps(values).encode())
