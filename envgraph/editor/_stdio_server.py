"""Serve an editor over standard input and output."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import sys
import threading
from collections import deque
from functools import partial
from typing import Any, Final

from pygls.io_ import StdinAsyncReader, StdoutWriter, run_async

from envgraph.editor._checked_files import CheckResult
from envgraph.editor._documents import JsonObject
from envgraph.editor._language_service import METHODS, LanguageService
from envgraph.editor._match_counts import MatchCounts
from envgraph.editor._stoppable_call import StoppableCall, StoppedError
from envgraph.errors import EnvgraphError

_LOG: Final = logging.getLogger("envgraph.editor")
_PAUSE: Final = 0.02
"""Seconds after the last change before files are checked."""
_INVALID_REQUEST, _METHOD_NOT_FOUND, _INTERNAL_ERROR = -32600, -32601, -32603
_NOT_INITIALIZED, _CANCELLED, _FAILED = -32002, -32800, -32803
_MATCHING: Final = ("envgraph/preview", "envgraph/whyNot")
"""Methods that search for matches, or draw a model; others only read texts."""
_LONGEST: Final = 10.0
"""Seconds after which such a request is stopped, because others wait for it."""
_SERVER_REQUESTS: Final = (
    "workspace/codeLens/refresh",
    "workspace/semanticTokens/refresh",
    "client/registerCapability",
)
"""Methods that are requests to the editor, not notifications."""


def serve_stdio() -> int:
    """Answer an editor until it says `exit` or closes the connection; return the exit code that the protocol wants.

    Nothing but messages may be written to standard output, so other output goes to standard error.
    """
    logging.basicConfig(stream=sys.stderr, format="%(message)s")
    gc.set_threshold(100_000)  # syntax trees are many objects that live long: by default, a fifth of the time is lost
    output, sys.stdout = sys.stdout, sys.stderr
    try:
        return asyncio.run(_EditorConnection(StdoutWriter(output.buffer)).serve(StdinAsyncReader(sys.stdin.buffer)))
    except BrokenPipeError:
        return 1
    finally:
        sys.stdout = output


class _EditorConnection:
    """A connection with one editor. Messages are answered one after the other; checks run in a thread."""

    def __init__(self, writer: StdoutWriter) -> None:
        self._writer = writer
        self._service = LanguageService(self._notify)
        self._stop = threading.Event()
        self._waiting: deque[JsonObject] = deque()
        self._arrived = asyncio.Event()
        self._changed = asyncio.Event()
        self._cancelled: set[Any] = set()
        self._state = "new"
        self._last_id = 0

    async def serve(self, reader: StdinAsyncReader) -> int:
        """Read and answer messages until the input ends or the editor sends `exit`; return the exit code."""
        tasks = [asyncio.create_task(self._answer_all()), asyncio.create_task(self._check_all())]
        await run_async(self._stop, reader, self, _LOG)  # type: ignore[arg-type]  # it needs only the two methods below
        while self._waiting:  # The connection is closed: answer what was sent before.
            self._answer(self._waiting.popleft())
        for task in tasks:
            task.cancel()
        return 0 if self._state == "shut down" else 1

    # --- the protocol of `run_async` ---

    def structure_message(self, data: JsonObject) -> JsonObject:
        """Return a message as it is."""
        return data

    def handle_message(self, message: Any) -> None:
        """Queue a message; `$/cancelRequest` and `exit` take effect at once."""
        if not isinstance(message, dict) or "method" not in message:
            return  # the editor's answer to a request of ours
        if not isinstance(message.get("params"), dict):
            message = {**message, "params": {}}
        if message["method"] == "$/cancelRequest":
            self._cancelled.add(str(message["params"].get("id")))
        elif message["method"] == "exit":
            self._stop.set()
        else:
            self._waiting.append(message)
            self._arrived.set()

    # --- answers ---

    async def _answer_all(self) -> None:
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            while self._waiting:
                self._answer(self._waiting.popleft())
                await asyncio.sleep(0)  # Read what has arrived meanwhile; it may cancel the next request.

    def _answer(self, message: JsonObject) -> None:
        method, id_ = str(message["method"]), message.get("id")
        error = self._refusal(method, id_)
        result = None
        if error is None:
            call = StoppableCall[Any](partial(self._service.answer, method, message["params"]))
            timer = threading.Timer(_LONGEST, call.stop)
            try:
                if method in _MATCHING:
                    timer.start()
                result = call()
            except StoppedError:
                reason = f"this took more than {_LONGEST:g} s; connect the variables of the pattern by links"
                error = {"code": _FAILED, "message": reason}
            except EnvgraphError as problem:
                error = {"code": _FAILED, "message": str(problem)}
            except Exception as problem:  # the editor must not lose the connection
                _LOG.exception("%s failed", method)
                error = {"code": _INTERNAL_ERROR, "message": f"internal error: {type(problem).__name__}: {problem}"}
            finally:
                timer.cancel()
        if method == "initialize" and error is None:
            self._state = "open"
        elif method == "shutdown" and error is None:
            self._state = "shut down"
        if id_ is not None:
            self._send({"id": id_, "error": error} if error else {"id": id_, "result": result})
        self._changed.set()

    def _refusal(self, method: str, id_: Any) -> JsonObject | None:
        """Return an error for a message that cannot be answered now; None if it can."""
        if str(id_) in self._cancelled:
            self._cancelled.discard(str(id_))
            return {"code": _CANCELLED, "message": "the request was cancelled"}
        if self._state == "new" and method != "initialize":
            return {"code": _NOT_INITIALIZED, "message": "the first request must be `initialize`"}
        if self._state == "shut down":
            return {"code": _INVALID_REQUEST, "message": "the server was shut down"}
        if method not in METHODS:
            return {"code": _METHOD_NOT_FOUND, "message": f"there is no method `{method}`"}
        return None

    # --- checks ---

    async def _check_all(self) -> None:
        while True:
            await self._changed.wait()
            self._changed.clear()
            await asyncio.sleep(_PAUSE)
            if self._changed.is_set():
                continue
            job = self._service.next_job()
            if job is not None:
                try:
                    call = StoppableCall[CheckResult | MatchCounts | None](job.run)
                    self._service.record(job, await call.run_in(None, job.seconds))
                except Exception:  # an error in a check must not end all later checks
                    _LOG.exception("the check of %s failed", ", ".join(job.roots))
                self._changed.set()

    # --- output ---

    def _notify(self, method: str, params: JsonObject) -> None:
        if method in _SERVER_REQUESTS:
            self._last_id += 1
            given = {"params": params} if params else {}
            self._send({"id": f"envgraph-{self._last_id}", "method": method, **given})
        else:
            self._send({"method": method, "params": params})

    def _send(self, message: JsonObject) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}, separators=(",", ":")).encode("utf-8")
        self._writer.write(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))
