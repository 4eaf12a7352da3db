"""Walk through frozen data: generated code, patterns and rules."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any


@cache
def compared_fields(cls: Hashable) -> tuple[str, ...]:
    """Return the names of a data class's fields that take part in comparison; () for any other class."""
    return tuple(field.name for field in fields(cls) if field.compare) if is_dataclass(cls) else ()


def differing_fields(one: Any, other: Any) -> list[str]:
    """Return the names of the compared fields whose values in `one` and `other` differ, in field order."""
    names = compared_fields(one.__class__)
    return [name for name in names if getattr(one, name) != getattr(other, name, None)]


def walk_parts(data: Any) -> list[Any]:
    """Return `data` and, recursively, the items of tuples and the compared fields of data classes, parents first."""
    found, waiting = [], [data]
    while waiting:
        one = waiting.pop()
        found.append(one)
        if isinstance(one, tuple):
            waiting += reversed(one)
        else:
            for name in reversed(compared_fields(one.__class__)):
                waiting.append(getattr(one, name))
    return found
