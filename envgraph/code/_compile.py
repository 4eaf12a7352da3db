"""Source text to functions: the only place that compiles and runs generated source."""

from __future__ import annotations

from functools import lru_cache
from types import CodeType
from typing import Any


def define_text(text: str, file: str, names: dict[str, Any]) -> dict[str, Any]:
    """Run generated definitions.

    Args:
        text: made by a printer of this project, with names of ours, numbers and operators: no text of anybody else.
        file: what tracebacks call it.
        names: what the text may use; the definitions are added.

    Returns:
        The names with the definitions.
    """
    exec(compiled(text, file), names)
    return names


@lru_cache(maxsize=4096)
def compiled(text: str, file: str) -> CodeType:
    """Compile a text; that is most of the work of making a matcher, and the same text needs it once in a process."""
    return compile(text, file, "exec")
