"""The routes of the server."""

import base64
import hashlib
import json
from collections.abc import Callable, Iterable
from functools import partial
from importlib import resources

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from zpm2.app.guard import Guard
from zpm2.app.session import Answer, Message, Session
from zpm2.app.turns import Replaced, Turns
from zpm2.errors import InputError, Zpm2Error
from zpm2.files.reading import parse_json
from zpm2.memory import in_words
from zpm2.model import SIDES

FOLDERS = {"report": "zpm2.view.report", "app": "zpm2.app"}  # whose `page` holds what the page loads
KINDS = {"js": "text/javascript", "css": "text/css"}
MOST_JSON = 64_000_000  # bytes of a request: the outlines of some ten thousand regions


class Server:
    """Answers the page of one `Session`. `application` is what an ASGI server runs.

    names, any_address: those of `Guard`. most: bytes of a photograph that the browser sends.
    """

    def __init__(
        self, session: Session, token: str, most: float, names: Iterable[str] = (), any_address: bool = False
    ) -> None:
        self.session, self.most, self.turns = session, most, Turns()
        self._files = {
            f"{folder}/{each.name}": (KINDS[each.name.rpartition(".")[2]], each.read_bytes())
            for folder, package in FOLDERS.items()
            for each in resources.files(package).joinpath("page").iterdir()
            if each.name.rpartition(".")[2] in KINDS
        }
        modules = sorted(name for name in self._files if name.endswith(".js"))
        imports = json.dumps({"imports": {f"#{name}": f"/static/{name}" for name in modules}})
        digest = base64.b64encode(hashlib.sha256(imports.encode()).digest()).decode()
        policy = (
            f"default-src 'none'; script-src 'self' 'sha256-{digest}'; style-src 'self'; img-src blob:; "
            "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        text = resources.files("zpm2.app").joinpath("page", "app.html").read_text(encoding="utf-8")
        self._page = text.replace("{{ imports }}", imports)
        self.application = Starlette(
            routes=[
                Route("/", self._first),
                Route("/static/{name:path}", self._static),
                Route("/api/state", self._state),
                Route("/api/progress", self._progress),
                Route("/api/photograph/{side}", self._picture),
                Route("/api/photograph/{side}", self._receive, methods=["POST"]),
                Route("/api/prepare", partial(self._work, session.prepare), methods=["POST"]),
                Route("/api/draw", partial(self._prompt, session.draw), methods=["POST"]),
                Route("/api/carry", partial(self._prompt, session.carry), methods=["POST"]),
                Route("/api/export", self._export, methods=["POST"]),
            ],
            middleware=[Middleware(Guard, token=token, policy=policy, names=names, any_address=any_address)],
            exception_handlers={Zpm2Error: _misuse, HTTPException: _no_route, Exception: _fault},
        )

    async def _first(self, request: Request) -> Response:
        return HTMLResponse(self._page)

    async def _static(self, request: Request) -> Response:
        name = request.path_params["name"]  # a key of a table, never a path
        if name not in self._files:
            raise HTTPException(404)
        kind, content = self._files[name]
        return Response(content, media_type=kind)

    async def _state(self, request: Request) -> Response:
        return JSONResponse({**self.session.describe(), "most": self.most})

    async def _progress(self, request: Request) -> Response:
        return JSONResponse({"stage": self.session.progress.stage, "share": self.session.progress.share})

    async def _picture(self, request: Request) -> Response:
        side = _side(request)
        return Response(await self.turns.one(lambda: self.session.picture(side)), media_type="image/webp")

    async def _receive(self, request: Request) -> Response:
        side, name = _side(request), request.query_params.get("name", "")
        content = await _body(request, self.most, "the file", "give a smaller one, or start zpm2 app with --max-upload")
        return JSONResponse(await self.turns.one(lambda: self.session.receive(side, name, content)))

    async def _work(self, work: Callable[[Message], Answer], request: Request) -> Response:
        message = await _message(request)
        return JSONResponse(await self.turns.one(lambda: work(message)))

    async def _prompt(self, work: Callable[[Message], Answer], request: Request) -> Response:
        message = await _message(request)
        region = str(message.get("region"))[:100]
        return JSONResponse(await self.turns.newest(region, lambda: work(message)))

    async def _export(self, request: Request) -> Response:
        message = await _message(request)
        return Response(await self.turns.one(lambda: self.session.export(message)), media_type="application/zip")


class TooLarge(InputError):
    """A request has more bytes than allowed."""


def _side(request: Request) -> int:
    if request.path_params["side"] not in SIDES:
        raise HTTPException(404)
    return SIDES.index(request.path_params["side"])


async def _message(request: Request) -> Message:
    content = await _body(request, MOST_JSON, "the request", "export fewer regions at a time")
    try:
        found = parse_json(content)
    except ValueError as error:
        raise InputError(f"the request is no JSON: {error}") from error
    if not isinstance(found, dict):
        raise InputError("the request is no JSON object")
    return found


async def _body(request: Request, most: float, what: str, way_out: str) -> bytes:
    """The body of a request; no more than `most` bytes of it are taken."""
    parts, length = [], 0
    async for part in request.stream():
        length += len(part)
        if length > most:
            raise TooLarge(f"{what} has more than {in_words(most)}: {way_out}")
        parts.append(part)
    return b"".join(parts)


def _misuse(request: Request, error: Exception) -> Response:
    status = 409 if isinstance(error, Replaced) else 413 if isinstance(error, TooLarge) else 400
    return JSONResponse({"error": str(error)}, status)


def _no_route(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 404
    return JSONResponse({"error": "there is nothing at this address"}, status)


def _fault(request: Request, error: Exception) -> Response:
    """For an error of zpm2's own; the terminal has the rest of it."""
    return JSONResponse({"error": f"zpm2 app failed ({type(error).__name__}): the terminal says more"}, 500)
