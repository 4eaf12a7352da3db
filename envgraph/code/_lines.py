"""Compile syntax trees to functions, and find the tree node that a generated line came from."""

from __future__ import annotations

from types import FrameType
from typing import Any, Final

from envgraph.code._compile import define_text
from envgraph.code._printer import printed
from envgraph.code._tree import Body

_ORIGINS: Final = "_origins"
"""Key of the tuple of line origins in the namespace of generated functions."""


def define(definitions: Body, file: str, names: dict[str, Any]) -> dict[str, Any]:
    """Compile and execute generated definitions in the namespace `names`, and return the namespace.

    Args:
        definitions: the functions to define.
        file: the file name shown in tracebacks.
        names: the namespace: the values that the definitions may use. The functions and the origins of their lines are
            added to it.

    Returns:
        `names`.
    """
    text, names[_ORIGINS] = printed(definitions)
    return define_text(text, file, names)


def origin_of(error: BaseException) -> tuple[object, FrameType | None]:
    """Return the origin and the frame of the outermost generated line in the traceback of an error.

    Both are None if the traceback contains no generated line.
    """
    trace = error.__traceback__
    while trace is not None:
        origins = trace.tb_frame.f_globals.get(_ORIGINS)
        if origins is not None:
            return origins[trace.tb_lineno - 1], trace.tb_frame
        trace = trace.tb_next
    return None, None
