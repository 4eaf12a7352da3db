"""Spellings of definitions, which tell everything, for comparing."""

from __future__ import annotations

from dataclasses import fields, is_dataclass


def spelling(item: object) -> tuple[object, ...]:
    """Return the types and the written values of a definition, which differ for 1 and 1.0 although these are equal.

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
