"""Explore the states that rules can reach in arrays, with the result of `Engine.explore`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from itertools import compress, repeat
from sys import maxsize
from typing import Any

import numpy as np

from envgraph.behaviour import Action, Branch, KeyIndex, RuleCall
from envgraph.env.compiled.kernels._loading import has_numba
from envgraph.env.compiled.kernels._visit_kernels import DONE, FOUND
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.programs._compiled_program import CompiledProgram, compile_for_model
from envgraph.env.compiled.programs._growth import with_more_space
from envgraph.env.compiled.steps._move_code import RuleSet
from envgraph.env.compiled.visiting._state_visit import Array, NeedsSpace, StateVisit
from envgraph.metamodel import Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Ending, Engine, Exploration, ExplorationRecord, Shape, State


def explore_compiled(
    engine: Engine,
    shapes: Mapping[str, Shape],
    predicates: Mapping[str, str],
    goal: str | None,
    limit: int,
    depth: int | None,
    known: dict[Any, CompiledProgram],
    check: Callable[[], None],
) -> Exploration | str:
    """Return what `Engine.explore` finds breadth-first from the engine's state, or the reason why it is not compiled.

    Args:
        shapes: the shapes of the matches of the rules, by name.
        predicates: the patterns to test in every state, by the names of the predicates.
        goal: the pattern that ends the exploration, or None.
        limit, depth: see `Engine.explore`.
        known: a cache of programs for these rules, predicates and goal.
        check: called from time to time; it may raise an exception.
    """
    if not has_numba():
        return "numba is switched off"
    actions = tuple(Action(rule, (Branch(1.0, RuleCall(rule)),)) for rule in shapes)
    rules = RuleSet("rules", actions=actions, tests=(*predicates.values(), *([] if goal is None else [goal])))
    try:
        first_id = engine.model.graph.store.next_id
        program = compile_for_model(known, engine, rules, KeyIndex.of_model(engine.model, ()))
        if program.layout.reuses_numbers:
            return "rules delete objects of classes that they create"
        while True:
            with suppress(NeedsSpace):
                found = _RuleVisit(
                    program, tuple(shapes.values()), tuple(predicates), first_id, limit, goal is not None, check
                )
                ending = found.explore(depth)
                return Exploration(found.record, engine.model, shapes, tuple(predicates), ending, None)
            program = with_more_space(program)
    except NotCompiled as refused:
        return f"compiled environments do not support {refused.construct}"


class _RuleVisit(StateVisit):
    """A visit of the states that rules can reach.

    Args:
        shapes: the shapes of the matches of the rules, in the order of the program.
        predicates: the names of the predicates.
        first_id: the id of the first object that a rule creates.
        limit, check: see `explore_compiled`.
        has_goal: True if the last test of a state is whether it is a goal.
    """

    def __init__(
        self,
        program: CompiledProgram,
        shapes: tuple[Shape, ...],
        predicates: tuple[str, ...],
        first_id: int,
        limit: int,
        has_goal: bool,
        check: Callable[[], None],
    ) -> None:
        width = max(len(shape.names) for shape in shapes)
        floats = width * any(Scalar.FLOAT in shape.types for shape in shapes)
        goal = len(predicates) if has_goal else -1
        super().__init__(program, 0, limit, goal=goal, match=(width, floats))
        self._shapes, self._predicates, self._check_time = shapes, predicates, check
        self._ids = [*program.members[0].object_ids, *range(first_id, first_id + program.members.spare)]
        self._goal: int | None = None
        self._tried = 0  # rules in the states that are expanded

    def explore(self, depth: int | None) -> Ending:
        """Explore all states, or those of less than a depth. Return how the exploration ended.

        Raises:
            NeedsSpace, NotCompiled: a state exceeds a bound of the program, or a rule has an error.
        """
        self.visit_starts()
        for _ in range(1 if depth is None else depth):
            how, place = self.run(maxsize if depth is None else self.counts[1])
            head, states, _, _ = self.counts
            self._tried = head * len(self._shapes)
            if how != DONE:
                self._tried += place + 1
                self._goal = states - 1 if how == FOUND else None
                return "goal" if how == FOUND else "limit"
            if head == states:
                return "exhausted"
        return "depth"

    def _check(self, how: int) -> None:
        self._check_time()

    def _raise_error(self, state: int, action: int) -> None:
        self._raise_not_compiled()

    def record(self) -> ExplorationRecord:
        """Return the states and transitions as objects."""
        expanded, states, used, made = self.counts
        starts, did = (array.ravel()[: self._tried] for array in (self.rows.starts, self.rows.did))
        sources, rules = np.divmod(np.repeat(np.arange(self._tried), np.diff(starts, append=used)), len(self._shapes))
        applied, depths = list[Any](repeat((), used)), [0]
        for source in self.rows.sources[1:states].tolist():
            depths.append(depths[source] + 1)
        for number, shape in enumerate(self._shapes):
            places = np.flatnonzero(rules == number)
            columns = [
                self._decoded(cells[places, column], type_)
                for column, type_ in enumerate(shape.types)
                for cells in [self.outcomes.match_floats if type_ is Scalar.FLOAT else self.outcomes.match]
            ]
            for place, row in zip(places.tolist(), zip(*columns, strict=True), strict=False):
                applied[place] = row
        return ExplorationRecord(
            [
                State(number, depth, tuple(compress(self._predicates, tests)), None)
                for number, (depth, tests) in enumerate(
                    zip(depths, self.rows.components[:states].tolist(), strict=True)
                )
            ],
            [-1, *self.rows.found_by[1:states].tolist()],
            sources.tolist(),
            self.outcomes.to[:used].tolist(),
            [self._shapes[rule].definition for rule in rules.tolist()],
            applied,
            list(range(expanded)),
            made - used - int((did == 0).sum()),
            goal=self._goal,
        )

    def _decoded(self, cells: Array, type_: StaticType) -> Iterable[Any]:
        """Yield the ids or values of a column of matches."""
        different, places = np.unique(cells, return_inverse=True)
        member = self._program.members[0]
        decode = self._ids.__getitem__ if isinstance(type_, ObjectType) else partial(member.decode, type_=type_)
        values = [decode(cell) for cell in different.tolist()]
        return map(values.__getitem__, places.tolist())
