"""Limit reprs to 199 characters, two lines of a terminal."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields, is_dataclass
from functools import wraps
from typing import Any, Final, TypeVar

T = TypeVar("T")

MAX_REPR_LENGTH: Final = 199
"""Maximal length of a repr, in characters."""

_MAX_FIELD_LENGTH: Final = 40
"""Maximal length of a field's value, in characters, if the whole repr is too long."""


def shorten_repr(cls: type[T]) -> type[T]:
    """Replace the `__repr__` of a class so that reprs have at most 199 characters, all printable, and return the class.

    Shorter reprs do not change. Longer reprs are cut. A longer repr of a data class first replaces its long fields by
    their types or sizes. `dataclass` applies this decorator to all data classes.
    """
    whole = cls.__repr__

    @wraps(whole)
    def __repr__(self: Any) -> str:
        text = whole(self)
        if len(text) <= MAX_REPR_LENGTH and text.isprintable():
            return text
        if is_dataclass(self):
            parts = (f"{one.name}={_field_repr(getattr(self, one.name))}" for one in fields(self) if one.repr)
            text = f"{type(self).__qualname__}({', '.join(parts)})"
        text = escape_unprintable(text)
        return text if len(text) <= MAX_REPR_LENGTH else text[: MAX_REPR_LENGTH - 4] + " ..."

    cls.__repr__ = __repr__  # type: ignore[method-assign]
    return cls


def _field_repr(value: object) -> str:
    """Return a short repr of a field's value; of a data class type and name, of a collection of objects its size."""
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return f"{type(value).__name__}({repr(name[:_MAX_FIELD_LENGTH]) if isinstance(name, str) else '...'})"
    if isinstance(value, str):
        return repr(value) if len(value) < _MAX_FIELD_LENGTH else repr(value[:_MAX_FIELD_LENGTH]) + "..."
    if isinstance(value, Collection) and not all(isinstance(one, str | int | float) for one in value):
        return f"<{len(value)} in a {type(value).__name__}>"
    text = repr(value)
    return text if len(text) <= _MAX_FIELD_LENGTH else f"<{type(value).__name__}>"


def escape_unprintable(text: str) -> str:
    r"""Return the text as one line of printable characters: all other characters are replaced by backslash escapes.

    Use it for terminals, which obey control characters, for logs and for pictures.

    >>> print(escape_unprintable("a\n\x00b\x1b[31m"))
    a\n\x00b\x1b[31m
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
