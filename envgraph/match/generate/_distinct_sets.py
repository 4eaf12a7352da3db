"""Emit the duplicate filters of a plan: of partial matches equal in all needed variables only the first continues."""

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
"""The key for the place after the last step, among identities of steps."""


class DistinctSets:
    """The duplicate filters of a plan in generated code: each filter is a set of seen keys.

    The place of a filter is given by the identity of the step that follows.

    Args:
        module: names the sets.
        block: receives the code.
        bindings: the variables with values.

    Attributes:
        passed: the sets that exist at the present place of the code, by the place of their filter.
        outside: the sets that must be created before a loop around the plan.
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
        """Return True if the places of the filters are known."""
        return self._places is not None

    def place(self, steps: Sequence[Step], found: Mapping[int, Distinct]) -> None:
        """Store the filters, given by the number of the step that follows, and name the sets of an outer loop."""
        places = {number: id(step) for number, step in enumerate(steps)}
        self._places = {
            places.get(number, END): (places.get(each.first, OUTSIDE), each.key)
            for number, each in found.items()
        }
        self.begin(OUTSIDE)

    def begin(self, place: int) -> None:
        """Emit code that creates the sets to be empty before a step; for `OUTSIDE`, only list them in `outside`."""
        for here, (first, _) in (self._places or {}).items():
            if first == place:
                seen = self.passed[here] = code.Local(self._module.fresh("d"))
                if place == OUTSIDE:
                    self.outside.append(seen)
                else:
                    self._block.add(code.Assign(seen, empty("set")))

    def test(self, place: int) -> None:
        """Emit the filter at a place, if any: skip a partial match whose key has been seen; otherwise add the key."""
        _, key = (self._places or {}).pop(place, (0, ()))
        if key:
            seen, values = self.passed.pop(place), value(key, self._bindings.source)
            self._block.test(code.Operation("not in", (values, seen)))
            self._block.add(code.Do(code.method(seen, "add", values)))

    def rest(self, block: code.Block, bindings: Bindings) -> DistinctSets:
        """Return a copy of the filters not emitted yet, for the rest of the plan, which becomes a function."""
        rest = DistinctSets(self._module, block, bindings)
        rest._places, rest.passed = dict(self._places or {}), dict(self.passed)
        return rest
