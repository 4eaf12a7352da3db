"""Compute aggregates over the nodes that a closure reaches, for many starts, by counting bits instead of nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import compress
from typing import Any, Final

from envgraph.code import dataclass
from envgraph.match._aggregate_values import aggregate, total
from envgraph.match._match_costs import DEMAND

Number = int | float
EndRows = Iterable[tuple[Any, ...]]
"""The rows of the aggregate's relation: first the end of the closure, then the other columns."""

_SELECTED: Final = bytes(digit == ord("1") for digit in range(256))


@dataclass(frozen=True, slots=True)
class ClosureAggregation:
    """The definition of an aggregate over reached nodes.

    Attributes:
        function: count, sum, avg, min or max.
        column: the position of the aggregated value in a row; 0 for count.
        rows: returns all rows, for values of the bound positions other than the start.
    """

    function: str
    column: int
    rows: Callable[..., EndRows]


class ClosureAggregate:
    """The values of one aggregate for any sets of reached nodes.

    Nodes that contribute the same value form a class, of which only the number of reached nodes matters. A tuple that
    several nodes contribute is a class of its own, which counts once if at least one of them is reached.

    >>> kinds = ClosureAggregate("count", 0, [(7, "red"), (8, "red"), (9, "blue")])
    >>> kinds.assign_bits([9, 8, 7])
    >>> kinds.number_of_classes, kinds.sum_up(0b110), kinds.sum_up(0b111)
    (2, 1, 2)

    Args:
        function, column: see `ClosureAggregation`.
        rows: the rows, each once.
    """

    def __init__(self, function: str, column: int, rows: EndRows) -> None:
        ends: dict[tuple[Any, ...], list[Any]] = {}
        for end, *others in rows:
            ends.setdefault(tuple(others), []).append(end)
        tuples = [(each[column - 1] if column else 1, nodes) for each, nodes in ends.items()]
        self._function = function
        self._adds = function == "count" or (
            function == "sum" and not any(isinstance(value, float) for value, _ in tuples)
        )
        self._classes: dict[tuple[Number, int], int] = {}
        """The number of each class, by its members' value and by a layer that distinguishes classes of equal value."""
        self._members: dict[Any, list[int]] = {}
        alone: dict[Any, list[Number]] = {}
        for number, (value, nodes) in enumerate(tuples):
            if len(nodes) == 1:
                alone.setdefault(nodes[0], []).append(value)
            else:
                self._add(value, -1 - number, nodes)
        weights = {node: self._combine_values(values) for node, values in alone.items()}
        for node, values in weights.items():
            for layer, value in enumerate(values):
                self._add(value, layer, [node])
        is_unweighted = all(len(values) == 1 for values in weights.values()) and all(
            layer == 0 for _, layer in self._classes
        )
        self._weights = {node: values[0] for node, values in weights.items()} if is_unweighted else None
        self._masks = [0] * self.number_of_classes if self.number_of_classes <= DEMAND.most_classes else []
        self._weighted = 0
        self._column: list[Number] = []

    def _add(self, value: Number, layer: int, nodes: Sequence[Any]) -> None:
        """Add nodes to the class with a value and a layer; negative layers are for tuples of several nodes."""
        number = self._classes.setdefault((value, layer), len(self._classes))
        for node in nodes:
            self._members.setdefault(node, []).append(number)

    def _combine_values(self, values: list[Number]) -> list[Number]:
        """Return the values that one node contributes, combined into as few values as possible."""
        if self._adds:
            return [sum(values)]
        return [min(values)] if self._function == "min" else [max(values)] if self._function == "max" else values

    @property
    def number_of_classes(self) -> int:
        """Return the number of classes of nodes."""
        return len(self._classes)

    def assign_bits(self, nodes: Sequence[Any]) -> None:
        """Assign bits to nodes: the bit of a node is its position in `nodes`, which may only grow between calls."""
        for place in range(len(self._column), len(nodes)):
            node = nodes[place]
            if self._masks:
                for number in self._members.get(node, ()):
                    self._masks[number] |= 1 << place
            weight = self._weights.get(node) if self._weights else None
            if weight is not None:
                self._weighted |= 1 << place
            self._column.append(0 if weight is None else weight)  # last: safe if interrupted before

    def value(self, reached: int) -> tuple[Number | None] | None:
        """Return the value for a bit set of reached nodes as a 1-tuple; None if a new search is cheaper."""
        number = reached.bit_count()
        if self._masks and len(self._masks) * (DEMAND.class_cost + len(self._column) // DEMAND.slow_bits) <= number:
            return (self.sum_up(reached),)
        if self._weights is not None and len(self._column) <= DEMAND.dense * number:
            return (self._look_at_all(reached),)
        return None

    def sum_up(self, reached: int) -> Number | None:
        """Return the value for a bit set of reached nodes, computed class by class; None if there is no value."""
        function, extreme = self._function, self._function in ("min", "max")
        numbers = (
            (value, mask & reached > 0 if extreme or layer < 0 else (mask & reached).bit_count())
            for (value, layer), mask in zip(self._classes, self._masks, strict=True)
        )
        if not self._adds:
            return aggregate(function, [value for value, number in numbers for _ in range(number)])  # type: ignore[return-value]
        result = sum(value * number for value, number in numbers)
        return result if function == "count" else total((result,))

    def _look_at_all(self, reached: int) -> Number | None:
        """Return the value for a bit set of reached nodes, computed node by node; None if there is no value."""
        bits = bin(reached & self._weighted)[:1:-1].encode().translate(_SELECTED)
        values = compress(self._column, bits)
        if not self._adds:
            return aggregate(self._function, list(values))  # type: ignore[return-value]
        result = sum(values)
        return result if self._function == "count" else total((result,))
