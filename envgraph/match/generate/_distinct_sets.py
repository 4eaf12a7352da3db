"""Partial matches that agree in all that is still needed are alike: the first goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from envgraph import code
from envgraph.match.generate._bindings import Bindings
from envgraph.match.generate._sinks import empty, value
from envgraph.match.generate._write import Module
from envgraph.match.plan._distinct import OUTSIDE, Distinct
from envgraph.match.plan._plan import Step

END: Final = 0
"""Stands for the place behind the last step, among identities of steps."""


class DistinctSets:
    """The places of a plan where partial matches are told apart, each by a set of what has passed.

    A place is given by the identity of the step that stands there.

    Args:
        module: names the sets.
        block: where the code goes.
        bindings: what has a value.

    Attributes:
        passed: the sets that there are at the present place, by the places where they are asked.
        outside: those that have to be made before a loop around the plan.
    """

    def __init__(self, module: Module, block: code.Block, bindings: Bindings) -> None:
        self._module = module
        self._block = block
        self._bindings = bindings
        self._places: dict[int, tuple[int, tuple[int, ...]]] | None = None
        self.passed: dict[int, code.Local] = {}
        self.outside: list[code.Local] = []

    @property
    def placed(self) -> bool:
        """Whether the places are known."""
        return self._places is not None

    def place(self, steps: Sequence[Step], found: Mapping[int, Distinct]) -> None:
        """Take the places in, by the numbers of the steps."""
        places = {number: id(step) for number, step in enumerate(steps)}
        self._places = {
            places.get(number, END): (places.get(each.first, OUTSIDE), each.key)
            for number, each in found.items()
        }
        self.begin(OUTSIDE)

    def begin(self, place: int) -> None:
        """Before what stands at a place, make the sets that are empty there."""
        for here, (first, _) in (self._places or {}).items():
            if first == place:
                seen = self.passed[here] = code.Local(self._module.fresh("d"))
                if place == OUTSIDE:
                    self.outside.append(seen)
                else:
                    self._block.add(code.Assign(seen, empty("set")))

    def test(self, place: int) -> None:
        """Before what stands at a place, leave out what has been there."""
        _, key = (self._places or {}).pop(place, (0, ()))
        if key:
            seen, values = self.passed.pop(place), value(key, self._bindings.source)
            self._block.test(code.Operation("not in", (values, seen)))
            self._block.add(code.Do(code.method(seen, "add", values)))

    def rest(self, block: code.Block, bindings: Bindings) -> DistinctSets:
        """Those of the rest of the plan, in a function of its own."""
        rest = DistinctSets(self._module, block, bindings)
        rest._places, rest.passed = dict(self._places or {}), dict(self.passed)
        return rest
