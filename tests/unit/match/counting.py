"""A matcher that counts how often it reads links."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from envgraph.graph import IndexedSet, Model
from envgraph.match import CompiledMatcher
from envgraph.match.demand._compiled_functions import CompiledProgram
from envgraph.match.generate._symbols import StoreColumn, Symbol
from envgraph.pattern import Library


class CountingMatcher(CompiledMatcher):
    """Counts the objects whose links are read, or with `ends=True` the ends that are read.

    Attributes:
        looks: how many there were.
    """

    def __init__(self, model: Model, library: Library, *, ends: bool = False) -> None:
        super().__init__(model, library)
        self.looks, self.ends = 0, ends
        self._program = CountedProgram(model, library)
        self._program.matcher = self


class CountedProgram(CompiledProgram):
    """Functions that read counted links."""

    matcher: CountingMatcher

    def _value(self, symbol: Symbol, component: frozenset[str]) -> object:
        found: Any = super()._value(symbol, component)
        if not (isinstance(symbol, StoreColumn) and symbol.kind in ("forward", "backward")):
            return found
        if self.matcher.ends:
            return [CountedEnds(self.matcher, each) for each in found]
        return CountedLinks(self.matcher, found)


class CountedLinks:
    """The links of all objects by one reference; counts the objects."""

    def __init__(self, matcher: CountingMatcher, links: Any) -> None:
        self.matcher, self.links = matcher, links

    def __getitem__(self, node: int) -> object:
        self.matcher.looks += 1
        return self.links[node]


class CountedEnds(IndexedSet[int]):
    """The ends of the links of one object; counts the ends."""

    __slots__ = ("matcher",)

    def __init__(self, matcher: CountingMatcher, ends: Any) -> None:
        super().__init__(tuple(ends))
        self.matcher = matcher

    def __iter__(self) -> Iterator[int]:
        for end in super().__iter__():
            self.matcher.looks += 1
            yield end
