"""Objects by the values of their attributes, for loops that ask for one value after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from envgraph.graph import Store

FEW: Final = 2
"""Questions about one state of the model that are answered by looking at all objects; for more there is an index."""


def by_value(store: Store, classes: Sequence[int], attributes: Sequence[int]) -> Callable[..., Sequence[int]]:
    """A function that gives the objects with given values, in the order of the extents.

    Args:
        store: the model; it may change between calls.
        classes: indices of concrete classes.
        attributes: indices of attributes that all these classes have; their values are the arguments of the function.
            One with many values stands alone.
    """
    extents = [store.extents[index] for index in classes]
    many = store.distinct[attributes[0]]
    first, *others = [many] if many else [store.values[index] for index in attributes]
    index: dict[Any, list[int]] = {}
    revision, asked = -1, 0

    def key(node: int) -> Any:
        return (first[node], *(column[node] for column in others)) if others else first[node]

    def look(values: tuple[Any, ...]) -> list[int]:
        value = values[0]
        if many:
            return [node for extent in extents for node in extent if value in many[node]]
        nodes = [node for extent in extents for node in extent if first[node] == value]
        return [node for node in nodes if key(node) == values] if others else nodes

    def found(*values: Any) -> Sequence[int]:
        nonlocal revision, asked
        if revision != store.revision:
            revision, asked = store.revision, 0
        asked += 1
        if asked <= FEW:
            return look(values)
        if asked == FEW + 1:
            index.clear()
            for extent in extents:
                for node in extent:
                    for one in many[node] if many else (key(node),):
                        index.setdefault(one, []).append(node)
        return index.get(values if others else values[0], ())

    return found
