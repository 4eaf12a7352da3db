"""Compile syntax trees to functions, and find the tree node that a generated line came from."""

from __future__ import annotations

from types import FrameType
from typing import Any, Final

from envgraph.code._compile_text import execute_text
from envgraph.code._printer import print_source
from envgraph.code._syntax_tree import Body

_ORIGINS_KEY: Final = "_origins"
"""Key of the tuple of line origins in the namespace of generated functions."""


def define_functions(definitions: Body, file: str, namespace: dict[str, Any]) -> dict[str, Any]:
    """Compile and execute generated definitions in the namespace `namespace`, and return the namespace.

    Args:
        definitions: the functions to define.
        file: the file name shown in tracebacks.
        namespace: the namespace: the values that the definitions may use. The functions and the origins of their
            lines are added to it.

    Returns:
        `namespace`.
    """
    text, namespace[_ORIGINS_KEY] = print_source(definitions)
    return execute_text(text, file, namespace)


def origin_of(error: BaseException) -> tuple[object, FrameType | None]:
    """Return the origin and the frame of the outermost generated line in the traceback of an error.

    Both are None if the traceback contains no generated line.
    """
    trace = error.__traceback__
    while trace is not None:
        origins = trace.tb_frame.f_globals.get(_ORIGINS_KEY)
        if origins is not None:
            return origins[trace.tb_lineno - 1], trace.tb_frame
        trace = trace.tb_next
    return None, None
