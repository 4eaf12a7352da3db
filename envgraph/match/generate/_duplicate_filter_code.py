"""Emit the duplicate filters of a plan: of partial matches equal in all needed variables only the first continues."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Final

from envgraph import code
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._sinks import SolutionSink, value
from envgraph.match.generate._source_builder import SourceBuilder
from envgraph.match.plan._duplicate_filters import OUTER_LOOP, DuplicateFilter, place_duplicate_filters
from envgraph.match.plan._planner import determined_variables
from envgraph.match.plan._search_plan import PlanStep
from envgraph.match.plan._size_estimates import SizeEstimates

PLAN_END: Final = 0
"""The key for the place after the last step, among identities of steps."""


class DuplicateFilterCode:
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

    def __init__(self, module: SourceBuilder, block: code.BodyBuilder, bindings: VariableBindings) -> None:
        self._module = module
        self._block = block
        self._bindings = bindings
        self._places: dict[int, tuple[int, tuple[int, ...]]] | None = None
        self.passed: dict[int, code.Local] = {}
        self.outside: list[code.Local] = []

    @property
    def is_placed(self) -> bool:
        """Return True if the places of the filters are known."""
        return self._places is not None

    def place(
        self, steps: Sequence[PlanStep], sink: SolutionSink, sizes: SizeEstimates | None, around: Sequence[int]
    ) -> None:
        """Place the filters of a plan, and name the sets of a loop around it, which binds variables.

        Without size estimates, there are no filters.
        """
        found: dict[int, DuplicateFilter] = {}
        if sizes is not None:
            of, known = (
                partial(determined_variables, sizes=sizes),
                {*self._bindings.expressions, *self._bindings.constants},
            )
            found = place_duplicate_filters(steps, sink.variables, known, of, around)
        places = {number: id(step) for number, step in enumerate(steps)}
        self._places = {
            places.get(number, PLAN_END): (places.get(each.first, OUTER_LOOP), each.key)
            for number, each in found.items()
            if number < len(steps) or sink.unique
        }
        self.emit_new_sets(OUTER_LOOP)

    def emit_new_sets(self, place: int) -> None:
        """Emit code that creates the sets to be empty before a step; for `OUTER_LOOP`, only list them in `outside`."""
        for here, (first, _) in (self._places or {}).items():
            if first == place:
                seen = self.passed[here] = code.Local(self._module.fresh_name("d"))
                if place == OUTER_LOOP:
                    self.outside.append(seen)
                else:
                    self._block.add(code.Assign(seen, code.emit_call("set")))

    def emit_filter(self, place: int) -> None:
        """Emit the filter at a place, if any: skip a partial match whose key has been seen; otherwise add the key."""
        _, key = (self._places or {}).pop(place, (0, ()))
        if key:
            seen, values = self.passed.pop(place), value(key, self._bindings.expression_of)
            self._block.open_test(code.Operation("not in", (values, seen)))
            self._block.add(code.ExpressionStatement(code.emit_method_call(seen, "add", values)))

    def filters_for_rest(self, block: code.BodyBuilder, bindings: VariableBindings) -> DuplicateFilterCode:
        """Return a copy of the filters not emitted yet, for the rest of the plan, which becomes a function."""
        rest = DuplicateFilterCode(self._module, block, bindings)
        rest._places, rest.passed = dict(self._places or {}), dict(self.passed)
        return rest
