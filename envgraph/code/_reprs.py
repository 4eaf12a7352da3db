"""Reprs that fit on two lines of a terminal, for people."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, Final, TypeVar

T = TypeVar("T")

LONGEST: Final = 199
"""Characters of a repr."""

_PART: Final = 40
"""Characters of the value of a field, where the whole is too long."""


def short_repr(cls: type[T]) -> type[T]:
    """Keep the reprs of a class below 200 characters, and free of control characters.

    A repr that is short is what it was. A longer one, which may hold a whole model, is cut; that of a data class names
    what its long parts are. All data classes are decorated by `dataclass`.
    """
    whole = cls.__repr__

    @wraps(whole)
    def __repr__(self: Any) -> str:
        text = whole(self)
        if len(text) <= LONGEST and text.isprintable():
            return text
        if is_dataclass(self):
            parts = (f"{one.name}={_part(getattr(self, one.name))}" for one in fields(self) if one.repr)
            text = f"{type(self).__qualname__}({', '.join(parts)})"
        text = visible(text)
        return text if len(text) <= LONGEST else text[: LONGEST - 4] + " ..."

    cls.__repr__ = __repr__  # type: ignore[method-assign]
    return cls


def _part(value: object) -> str:
    """Return the value of a field; of data inside, its name or nothing: it may be thousands of levels deep."""
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return f"{type(value).__name__}({repr(name[:_PART]) if isinstance(name, str) else '...'})"
    if isinstance(value, str):
        return repr(value) if len(value) < _PART else repr(value[:_PART]) + "..."
    if isinstance(value, Collection) and not all(isinstance(one, str | int | float) for one in value):
        return f"<{len(value)} in a {type(value).__name__}>"
    text = repr(value)
    return text if len(text) <= _PART else f"<{type(value).__name__}>"


def visible(text: str) -> str:
    r"""Return a text in one line whose characters all show: what is not printable becomes an escape.

    For terminals, which obey control characters, for logs and for pictures.

    >>> print(visible("a\n\x00b\x1b[31m"))
    a\n\x00b\x1b[31m
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
