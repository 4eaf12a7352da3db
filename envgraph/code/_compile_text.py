"""Compile and run generated source text; no other module does."""

from __future__ import annotations

from functools import lru_cache
from types import CodeType
from typing import Any


def execute_text(text: str, file: str, namespace: dict[str, Any]) -> dict[str, Any]:
    """Execute generated source text in the namespace `namespace`, and return the namespace.

    Args:
        text: source text that this project generated from its own names, numbers and operators. It must contain no text
            from users.
        file: the file name shown in tracebacks.
        namespace: the namespace: the values that the text may use. The definitions of the text are added to it.

    Returns:
        `namespace`.
    """
    exec(compile_cached(text, file), namespace)
    return namespace


@lru_cache(maxsize=4096)
def compile_cached(text: str, file: str) -> CodeType:
    """Compile a source text, or return its code object from the cache, because compiling is slow."""
    return compile(text, file, "exec")
