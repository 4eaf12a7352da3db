"""Trees to functions that know where their lines come from."""

from __future__ import annotations

from types import FrameType
from typing import Any, Final

from envgraph.code._compile import define_text
from envgraph.code._printer import printed
from envgraph.code._tree import Body

_ORIGINS: Final = "_origins"
"""The name of the table of lines in the namespace of generated functions."""


def define(definitions: Body, file: str, names: dict[str, Any]) -> dict[str, Any]:
    """Run generated definitions.

    Args:
        definitions: functions.
        file: what tracebacks call it.
        names: what the definitions may use; they are added.

    Returns:
        The names with the definitions.
    """
    text, names[_ORIGINS] = printed(definitions)
    return define_text(text, file, names)


def origin_of(error: BaseException) -> tuple[object, FrameType | None]:
    """Where the outermost generated line that an error has come through is from, and the frame of its function."""
    trace = error.__traceback__
    while trace is not None:
        origins = trace.tb_frame.f_globals.get(_ORIGINS)
        if origins is not None:
            return origins[trace.tb_lineno - 1], trace.tb_frame
        trace = trace.tb_next
    return None, None
