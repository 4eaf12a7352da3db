"""Serve the page to browsers on this machine: static files, and one WebSocket for each page."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from hmac import compare_digest
from pathlib import Path
from typing import Any, Final, TypeVar

from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send as SendMessage
from starlette.websockets import WebSocket, WebSocketDisconnect

from envgraph.editor import StoppableCall, StoppedError
from envgraph.page._connection import Connection, is_stop
from envgraph.page._targets import Target
from envgraph.page._work import Work

MAX_MESSAGE: Final = 20 * 2**20
"""Characters of a message from a page: the largest text of a domain, and what JSON adds to it."""

_PAUSE: Final = 0.02
"""Seconds without a message after which edited texts are checked."""

_LONGEST: Final = 20.0
"""Seconds after which a request is stopped, because the others of the page wait for it."""

_MAX_WAITING: Final = 4 * MAX_MESSAGE
"""Characters of all messages of a page that wait; no page sends so many."""

_HEADERS: Final = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self'; worker-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}

_TYPES: Final = {".js": "text/javascript", ".wasm": "application/wasm", ".svg": "image/svg+xml", ".css": "text/css"}
"""Media types of files, because the tables of some systems have others."""

_Result = TypeVar("_Result")

_FIRST: Final = (
    '<!doctype html><title>envgraph</title><link rel=icon href=icon.svg><meta http-equiv=refresh content="0; url=/">'
)
"""The page of the first address, which leads to the address without the token."""

_FORGED: Final = "this address belongs to another page"
_LOG: Final = logging.getLogger("envgraph")


def make_app(target: Target, built: Path, token: str, port: int) -> Starlette:
    """Return the application that serves a page.

    Args:
        target: what the page shows.
        built: the directory of the static files.
        token: the secret in the first address; it allows to read and write the folder.
        port: the port at which the application is served.
    """
    cookie = f"envgraph-{port}"  # browsers send cookies to all ports

    async def page(request: Request) -> Response:
        given = request.query_params.get("token")
        if given is not None:
            # Browsers send the cookie with the next request only if this page asks for it, not the one with the link.
            answer = HTMLResponse(_FIRST)
            answer.set_cookie(cookie, given, httponly=True, samesite="strict")
            return answer
        return FileResponse(built / "index.html")

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        files = {file.name: file for file in built.iterdir() if file.is_file() and not file.is_symlink()}
        if name not in files:
            return PlainTextResponse("there is no such file", 404)
        return FileResponse(files[name], media_type=_TYPES.get(files[name].suffix))

    async def socket(websocket: WebSocket) -> None:
        await websocket.accept()
        await _Socket(websocket, target).run()

    routes = [Route("/", page), Route("/{name}", static), WebSocketRoute("/socket", socket)]
    app = Starlette(routes=routes)
    app.add_middleware(_Guard, token=token, cookie=cookie, port=port)
    return app


class _Guard:
    """Middleware that refuses requests without the token or from other pages, and adds headers to all responses."""

    def __init__(self, app: ASGIApp, token: str, cookie: str, port: int) -> None:
        self._app, self._token, self._cookie = app, token, cookie
        ends = [f":{port}", ""] if port == 80 else [f":{port}"]  # browsers leave out `:80`
        self._hosts = {name + end for name in ("127.0.0.1", "localhost") for end in ends}

    async def __call__(self, scope: Scope, receive: Receive, send: SendMessage) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        refusal = self._refusal(HTTPConnection(scope))
        if refusal is None:
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": refusal})
        else:
            await PlainTextResponse(refusal, 403)(scope, receive, send_with_headers)

    def _refusal(self, request: HTTPConnection) -> str | None:
        """Return why a request is refused; None if it is allowed."""
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if host not in self._hosts:  # a foreign name that leads to this machine
            return _FORGED
        if origin is not None and origin != f"http://{host}":
            return _FORGED
        given = request.query_params.get("token") if request.url.path == "/" else None
        if given is None:
            given = request.cookies.get(self._cookie, "")
        if not compare_digest(given.encode(), self._token.encode()):
            return "open the address that `envgraph serve` printed"
        return None


class _Socket:
    """The WebSocket of one page: passes messages on in their order, and does long work beside them."""

    def __init__(self, websocket: WebSocket, target: Target) -> None:
        self._websocket, self._target = websocket, target
        self._loop = asyncio.get_running_loop()
        self._incoming: asyncio.Queue[str | None] = asyncio.Queue()
        self._waiting = 0
        self._outgoing: asyncio.Queue[str] = asyncio.Queue()
        self._in_order = ThreadPoolExecutor(1, "envgraph page")
        self._beside = ThreadPoolExecutor(4, "envgraph work")
        self._tasks: dict[asyncio.Task[None], Work] = {}
        self._calls: dict[StoppableCall[Any], bool] = {}
        self._check: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Answer messages until the page is closed."""
        make = partial(Connection, self._send, self._target)
        connection = await self._loop.run_in_executor(self._in_order, make)
        others = [asyncio.create_task(self._read()), asyncio.create_task(self._write())]
        try:
            await self._answer_all(connection)
        finally:
            connection.close()
            self._stop_calls(checks=True)
            for task in (*others, *self._tasks):
                task.cancel()
            self._in_order.shutdown(wait=False, cancel_futures=True)
            self._beside.shutdown(wait=False, cancel_futures=True)

    def _send(self, text: str) -> None:
        with suppress(RuntimeError):  # the server has stopped
            self._loop.call_soon_threadsafe(self._outgoing.put_nowait, text)

    async def _read(self) -> None:
        try:
            while True:
                text = await self._websocket.receive_text()
                self._waiting += len(text)
                if len(text) > MAX_MESSAGE or self._waiting > _MAX_WAITING:
                    await self._websocket.close(1009, "the message is too long")
                    break
                if is_stop(text):  # what it stops keeps other messages waiting
                    self._stop_calls(checks=False)
                self._incoming.put_nowait(text)
        except (WebSocketDisconnect, KeyError, RuntimeError):  # closed, or a message that is no text
            with suppress(RuntimeError):
                await self._websocket.close(1003)
        self._stop_calls(checks=True)
        self._incoming.put_nowait(None)

    async def _write(self) -> None:
        with suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await self._websocket.send_text(await self._outgoing.get())

    async def _answer_all(self, connection: Connection) -> None:
        changed = False
        while True:
            try:
                text = await asyncio.wait_for(self._incoming.get(), _PAUSE if changed else None)
            except TimeoutError:
                changed = False
                self._begin_check(connection)
                continue
            if text is None:
                return
            changed = True
            self._waiting -= len(text)
            work = None
            with suppress(StoppedError):  # before or after the request itself
                work = await self._call(self._in_order, partial(connection.receive, text), _LONGEST)
            if work is not None:
                self._begin(self._do(work), work)

    def _begin(self, task: Coroutine[Any, Any, None], work: Work) -> asyncio.Task[None]:
        begun = asyncio.create_task(task)
        self._tasks[begun] = work
        begun.add_done_callback(lambda done: self._tasks.pop(done, None))
        return begun

    def _begin_check(self, connection: Connection) -> None:
        """Check edited texts, unless a check runs; another one follows as long as there is something to check."""
        if self._check is not None and not self._check.done():
            return

        async def check() -> None:
            while (work := await self._loop.run_in_executor(self._in_order, connection.next_work)) is not None:
                await self._do(work, is_check=True)

        self._check = self._begin(check(), Work(lambda: None))

    async def _do(self, work: Work, is_check: bool = False) -> None:
        try:
            value = await self._call(self._beside, work.run, work.seconds, is_check)
            await self._call(self._in_order, partial(work.finish, value), None, is_check)
        except (RuntimeError, StoppedError):  # the page was closed
            pass
        except Exception as error:
            _LOG.error("work for the page failed", exc_info=error)

    async def _call(
        self, pool: ThreadPoolExecutor, function: Callable[[], _Result], seconds: float | None, is_check: bool = False
    ) -> _Result:
        """Return the result of a function that runs in a thread, until it is stopped, or for some seconds."""
        call = StoppableCall(function)
        self._calls[call] = is_check
        try:
            return await call.run_in(pool, seconds)
        finally:
            del self._calls[call]

    def _stop_calls(self, *, checks: bool) -> None:
        """Stop what runs for requests and, with `checks`, the checks of texts, too."""
        for work in self._tasks.values():
            work.stopped.set()
        for call, is_check in self._calls.items():
            if checks or not is_check:
                call.stop()
