"""Compare definitions exactly, including the types of their values."""

from __future__ import annotations

from dataclasses import fields, is_dataclass


def exact_key(item: object) -> tuple[object, ...]:
    """Return a key of a definition, equal only for definitions with the same types and values: `1` differs from `1.0`.

    Data class fields with `repr=False` are skipped.

    >>> exact_key((1, "a")) == exact_key((1.0, "a"))
    False
    """
    found: list[object] = []
    waiting: list[object] = [item]
    while waiting:  # an explicit stack: expressions may be thousands of operators deep
        one = waiting.pop()
        if is_dataclass(one) and not isinstance(one, type):
            found.append(type(one).__qualname__)
            waiting.extend([getattr(one, field.name) for field in fields(one) if field.repr])
        elif isinstance(one, tuple):
            found.append(len(one))
            waiting.extend(one)
        else:
            found.append(repr(one))
    return tuple(found)
