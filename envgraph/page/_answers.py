"""Turn exceptions into errors of JSON-RPC, and places in texts into those of the page."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from typing import Final

from envgraph.editor import StoppedError, TookTooLongError
from envgraph.errors import Diagnostic, EnvgraphError, InvalidArgument, Span
from envgraph.page._work import JsonObject

PARSE_ERROR, INVALID_REQUEST, UNKNOWN_METHOD, INVALID_PARAMS, INTERNAL, REFUSED, STOPPED = (
    -32700,
    -32600,
    -32601,
    -32602,
    -32603,
    -32000,
    -32800,
)
"""Codes of JSON-RPC; the last two are our own, and that of the Language Server Protocol for cancelled requests."""

Locate = Callable[[Span], JsonObject]
"""A function that returns the URI and the range of a span."""

_LOG: Final = logging.getLogger("envgraph")


def error_object(error: BaseException, locate: Locate, code: int | None = None) -> JsonObject:
    """Return an exception as an error of JSON-RPC, with its hint and its places.

    The page is not shown the traceback of an unexpected exception; it is written to the log.
    """
    if isinstance(error, TookTooLongError):
        advice = "connect the variables of patterns and rules by links, so that fewer combinations are tried"
        return {"code": STOPPED, "message": "this took too long, and was stopped", "hint": advice, "spans": []}
    if isinstance(error, StoppedError):
        return {"code": STOPPED, "message": "this was stopped", "hint": None, "spans": []}
    if isinstance(error, OSError):
        message = f"`{error.filename}`: {error.strerror}" if error.filename else str(error)
        return {"code": REFUSED, "message": message, "hint": None, "spans": []}
    if not isinstance(error, EnvgraphError):
        _LOG.error("a request of the page failed", exc_info=error)
        message = f"internal error: {type(error).__name__}"
        return {"code": INTERNAL, "message": message, "hint": "the terminal shows more", "spans": []}
    found: Iterable[Diagnostic] = getattr(error, "diagnostics", ())
    problems = list(found)
    message, hint = error.message, error.hint
    if problems:
        message = "; ".join(dict.fromkeys(one.message for one in problems))
        hint = hint or problems[0].hint
    spans = [locate(one.span) for one in problems if one.span is not None and one.span.source.text]
    own = INVALID_PARAMS if isinstance(error, InvalidArgument) else REFUSED
    return {"code": code or own, "message": message, "hint": hint, "spans": spans}
