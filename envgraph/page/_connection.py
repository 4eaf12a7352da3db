"""Answer the messages of one page: JSON-RPC 2.0 for the page and for its editor, whatever carries the messages."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final

from envgraph.editor import CheckResult, LanguageService
from envgraph.errors import EnvgraphError, InvalidArgument
from envgraph.page._answers import (
    INVALID_REQUEST,
    PARSE_ERROR,
    UNKNOWN_METHOD,
    error_object,
)
from envgraph.page._page_session import METHODS
from envgraph.page._targets import Target
from envgraph.page._work import Work

Send = Callable[[str], None]
"""A function that sends a message as JSON text. Any thread may call it."""

_EDITOR: Final = ("textDocument/", "workspace/", "envgraph/", "completionItem/", "$/")
_EDITOR_METHODS: Final = ("initialize", "initialized", "shutdown", "exit")
_STOP: Final = "page/stop"


def is_stop(text: str) -> bool:
    """Return True if a message is the notification that stops what runs for the requests before it."""
    return len(text) < 100 and f'"{_STOP}"' in text


class Connection:
    """The two services behind one page, and the messages to and from it.

    The owner passes each message to `receive`, one after the other, and calls `next_work` when no message waits. Both
    may return work, which the owner runs where it likes, and whose `finish` it calls between two messages.

    Args:
        send: sends a message to the page.
        target: what the page shows.
    """

    def __init__(self, send: Send, target: Target) -> None:
        self._send = send
        self.service = LanguageService(self._notify, target.files)
        self.session = target.open_session(self.service, self._notify)

    def receive(self, text: str) -> Work | None:
        """Answer a message. If this takes long, return work instead, whose `finish` sends the answer."""
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            self._fail(None, PARSE_ERROR, "the message is not JSON, or has too many brackets inside each other")
            return None
        if not isinstance(message, dict) or not isinstance(message.get("method"), str):
            if not (isinstance(message, dict) and ("result" in message or "error" in message)):
                self._fail(None, INVALID_REQUEST, "the message is not a request of JSON-RPC")
            return None
        params = message.get("params")
        if not isinstance(params, dict):
            params = {}
        return self._answer(message.get("id"), message["method"], params)

    def _answer(self, id_: Any, method: str, params: dict[str, Any]) -> Work | None:
        try:
            if method == _STOP:
                return None  # The owner has stopped what was running.
            if method in METHODS:
                result = self.session.answer(method, params)
            elif method in _EDITOR_METHODS or method.startswith(_EDITOR):
                self._check_place(params)
                result = self.service.answer(method, params)
                self.service.folders = (self.session.folder,)  # the page opens no others
            else:
                self._fail(id_, UNKNOWN_METHOD, f"there is no method `{method}`")
                return None
        except Exception as error:
            self._send_error(id_, error)
            return None
        if not isinstance(result, Work):
            self._reply(id_, result)
            return None
        return self._work_with_answer(id_, result)

    def _check_place(self, params: dict[str, Any]) -> None:
        """Raise InvalidArgument if a request is about a file outside of the folder."""
        document = params.get("textDocument")
        uri = document.get("uri") if isinstance(document, dict) else None
        if uri is not None and not self.session.contains(self.service.name_of(str(uri))):
            raise InvalidArgument(f"`{uri}` is not in the folder that is open")

    def _work_with_answer(self, id_: Any, work: Work) -> Work:
        """Return the work; at its end, the result or the error is sent."""

        def run() -> tuple[Any, BaseException | None]:
            try:
                return work.run(), None
            except Exception as error:
                return None, error

        def finish(found: tuple[Any, BaseException | None]) -> None:
            value, error = found
            if error is None:
                try:
                    self._reply(id_, work.finish(value))
                    return
                except Exception as raised:
                    error = raised
            self._send_error(id_, error)

        return Work(run, finish, work.stopped)

    def next_work(self) -> Work | None:
        """Return the next work of the language server, such as a check of edited texts; None if there is none."""
        job = self.service.next_job()
        if job is None:
            return None

        def finish(result: Any) -> None:
            self.service.record(job, result)
            if isinstance(result, CheckResult) and job.roots == (self.session.folder,):
                self.session.show_edited(result.workspace)

        return Work(job.run, finish, seconds=job.seconds)

    def close(self) -> None:
        """Stop what runs for the page."""
        self.session.close()

    # --- messages

    def _notify(self, method: str, params: Any) -> None:
        self._send(json.dumps({"jsonrpc": "2.0", "method": method, "params": params}))

    def _reply(self, id_: Any, result: Any) -> None:
        if id_ is not None:  # a notification gets no answer
            self._send(json.dumps({"jsonrpc": "2.0", "id": id_, "result": result}, allow_nan=False))

    def _send_error(self, id_: Any, error: BaseException) -> None:
        found = error_object(error, self.session.locate)
        if id_ is not None:
            self._send(json.dumps({"jsonrpc": "2.0", "id": id_, "error": found}))

    def _fail(self, id_: Any, code: int, message: str) -> None:
        found = error_object(EnvgraphError(message), self.session.locate, code)
        self._send(json.dumps({"jsonrpc": "2.0", "id": id_, "error": found}))
