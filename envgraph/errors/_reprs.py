"""Reprs that fit on a line, for people; and spellings that tell everything, for comparing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import wraps
from importlib import import_module
from typing import Any, Final

from envgraph.errors._source import visible

LONGEST: Final = 199
"""Characters of a repr."""

_PART: Final = 40
"""Characters of the value of a field, where the whole is too long."""


def shorten(names: Mapping[str, object], public: Iterable[str]) -> None:
    """Keep the reprs of a package's public classes below 200 characters, and free of control characters.

    Packages call it at their ends. A repr that is short is what it was; a longer one, which may hold a whole model,
    names what its long parts are.

    Args:
        names: the package's own.
        public: those of them that are public.
    """
    for name in public:
        cls: Any = names.get(name)  # None for what `later` will load
        own = isinstance(cls, type) and cls.__module__.startswith("envgraph.") and not issubclass(cls, Enum)
        if (
            own and ("__repr__" in vars(cls) or is_dataclass(cls)) and not hasattr(cls.__repr__, "short")
        ):  # some are in two packages
            cls.__repr__ = _short(cls.__repr__)


def later(names: dict[str, Any], homes: Mapping[str, str]) -> None:
    """Load some public names of a package when they are first used: most programs do without, and start sooner.

    Args:
        names: the package's own.
        homes: modules, and the names that are loaded from each, with blanks between them.
    """
    home = {name: module for module, found in homes.items() for name in found.split()}

    def __getattr__(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module `{names['__name__']}` has no attribute `{name}`")
        names[name] = getattr(import_module(home[name]), name)
        shorten(names, [name])
        return names[name]

    names["__getattr__"] = __getattr__
    names["__dir__"] = lambda: sorted({*names, *home})


def _short(whole: Callable[[Any], str]) -> Callable[[Any], str]:
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

    __repr__.short = True  # type: ignore[attr-defined]
    return __repr__


def _part(value: object) -> str:
    """The value of a field; of data inside, its name or nothing: it may be thousands of levels deep."""
    if is_dataclass(value):
        name = getattr(value, "name", None)
        return f"{type(value).__name__}({repr(name[:_PART]) if isinstance(name, str) else '...'})"
    if isinstance(value, str):
        return repr(value) if len(value) < _PART else repr(value[:_PART]) + "..."
    if isinstance(value, Collection) and not all(isinstance(one, str | int | float) for one in value):
        return f"<{len(value)} in a {type(value).__name__}>"
    text = repr(value)
    return text if len(text) <= _PART else f"<{type(value).__name__}>"


def spelling(item: object) -> tuple[object, ...]:
    """What tells two definitions apart that are equal but not the same: their types, and how their values are written.

    >>> spelling((1, "a")) == spelling((1.0, "a"))
    False
    """
    found: list[object] = []
    waiting: list[object] = [item]
    while waiting:  # a stack of our own: expressions may be thousands of operators deep
        one = waiting.pop()
        if is_dataclass(one) and not isinstance(one, type):
            found.append(type(one).__qualname__)
            waiting.extend(getattr(one, field.name) for field in fields(one) if field.repr)
        elif isinstance(one, tuple):
            found.append(len(one))
            waiting.extend(one)
        else:
            found.append(repr(one))
    return tuple(found)
