"""Explore the states that rules can reach in arrays, with the result of `Engine.explore`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import compress, repeat
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import Action, Branch, KeyIndex, RuleCall
from envgraph.env.compiled._batch import padded_to
from envgraph.env.compiled._batch_arrays import zero_row_buffers
from envgraph.env.compiled._compiled_costs import COSTS
from envgraph.env.compiled._compiled_program import CompiledProgram, compile_for_model
from envgraph.env.compiled._exploration_kernels import DEEP, DONE, FOUND, MANY, PAUSED, SPACE
from envgraph.env.compiled._growth import with_more_space
from envgraph.env.compiled._loading import has_numba
from envgraph.env.compiled._move_code import RuleSet
from envgraph.env.compiled._not_compiled import NotCompiled
from envgraph.env.compiled._program_layout import ERROR
from envgraph.env.compiled.kernels import FULL
from envgraph.errors import LIMITS
from envgraph.metamodel import Scalar
from envgraph.pattern import ObjectType, StaticType
from envgraph.rewrite import Ending, Engine, Exploration, ExplorationRecord, Shape, State

ENDINGS: Final[Mapping[int, Ending]] = {DONE: "exhausted", FOUND: "goal", MANY: "limit", DEEP: "depth"}
Numbers = NDArray[Any]


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
        program: CompiledProgram | None = compile_for_model(known, engine, rules, KeyIndex.of_model(engine.model, ()))
        if program and program.layout.reuses_numbers:
            raise NotCompiled("explorations of rules that delete objects of classes that they create")
        while program:
            found = _Found(program, tuple(shapes.values()), tuple(predicates), engine.model.graph.store.next_id)
            numbers = limit, -1 if depth is None else depth, 0 if goal is None else len(rules.tests)
            ending, program = found.explore(numbers, check)
    except NotCompiled as refused:
        return f"compiled environments do not support {refused.construct}"
    return Exploration(found.record, engine.model, shapes, tuple(predicates), ending, None)


class _Found:
    """The states and transitions found so far by a program, in growing arrays; see `explore` of the program.

    Args:
        shapes: the shapes of the matches of the rules, in the order of the program.
        predicates: the names of the predicates.
        first_id: the id of the first object that a rule creates.
    """

    def __init__(
        self, program: CompiledProgram, shapes: tuple[Shape, ...], predicates: tuple[str, ...], first_id: int
    ) -> None:
        self._program, self._shapes, self._predicates = program, shapes, predicates
        self._ids = [*program.members[0].object_ids, *range(first_id, first_id + program.spare)]
        width, kinds = max(len(shape.names) for shape in shapes), {type_ for shape in shapes for type_ in shape.types}
        ints, floats, rows = program.arrays.ints, program.arrays.floats, COSTS.first
        self._states = [padded_to(ints, rows), padded_to(floats, rows)]
        self._states.append(np.zeros((rows, len(program.observation_shape)), dtype=np.int64))
        self._moves = [np.zeros((rows, 3 + width), dtype=np.int64), np.zeros((rows, width * (Scalar.FLOAT in kinds)))]
        self._counts: tuple[int, ...] = 0, 0, 0, 0
        self._goal: int | None = None

    def explore(
        self, numbers: tuple[int, int, int], check: Callable[[], None]
    ) -> tuple[Ending, CompiledProgram | None]:
        """Explore, and return how the exploration ended. Return another program if created objects need more space.

        Args:
            numbers: limit, maximal depth, and column of the goal.
            check: called from time to time.

        Raises:
            NotCompiled: a state exceeds a bound of the program, or a rule has an error.
        """
        program, functions, hashed = self._program, self._program.functions_for("explore"), np.zeros(0)
        fixed = program.tables, program.arrays.reals, program.arrays.offsets
        space, rules = (*zero_row_buffers(program.row_buffer_shape), np.zeros(1)), len(self._shapes)
        while True:
            states, floats, components = self._states
            bits = floats.view(np.int64)
            if len(hashed) != 4 * len(states):
                hashed = np.full(4 * len(states), -1, dtype=np.int64)
                functions["hash_all"](states, bits, hashed, 0, self._counts[1])
            known = *fixed, states, floats, *space, bits, hashed, components, *self._moves
            wanted = self._counts[2] + COSTS.progress_interval
            how, *counts = functions["explore"](*known, *self._counts, rules, *numbers, wanted)
            self._counts = tuple(counts)
            check()
            if how in ENDINGS:
                self._goal = counts[1] - 1 if how == FOUND else None
                return ENDINGS[how], None
            if how == SPACE:
                grown = self._states if counts[1] + 1 >= len(states) else self._moves
                grown[:] = [padded_to(array, 4 * len(array)) for array in grown]
            elif how != PAUSED:
                if states[counts[1], ERROR] == FULL and program.spare < LIMITS["created objects"]:
                    return "limit", with_more_space(program)
                raise NotCompiled("states with errors, or that exceed one of the limits")

    def record(self) -> ExplorationRecord:
        """Return the states and transitions as objects."""
        expanded, states, transitions, refused = self._counts
        components, (moves, reals) = self._states[2][:states], [array[:transitions] for array in self._moves]
        found_by, applied = np.full(states, -1), list[Any](repeat((), transitions))
        targets, firsts = np.unique(moves[:, 1], return_index=True)
        found_by[targets] = firsts
        found_by[0] = -1
        for number, shape in enumerate(self._shapes):
            places = np.flatnonzero(moves[:, 2] == number)
            columns = [
                self._decoded((reals[:, column] if type_ is Scalar.FLOAT else moves[:, 3 + column])[places], type_)
                for column, type_ in enumerate(shape.types)
            ]
            for place, row in zip(places.tolist(), zip(*columns, strict=True), strict=False):
                applied[place] = row
        return ExplorationRecord(
            [
                State(number, depth, tuple(compress(self._predicates, tests)), None)
                for number, (depth, *tests) in enumerate(components.tolist())
            ],
            found_by.tolist(),
            moves[:, 0].tolist(),
            moves[:, 1].tolist(),
            [self._shapes[rule].definition for rule in moves[:, 2].tolist()],
            applied,
            list(range(expanded)),
            refused,
            goal=self._goal,
        )

    def _decoded(self, cells: Numbers, type_: StaticType) -> Iterable[Any]:
        """Yield the ids or values of a column of matches."""
        different, places = np.unique(cells, return_inverse=True)
        member = self._program.members[0]
        decode = self._ids.__getitem__ if isinstance(type_, ObjectType) else partial(member.decode, type_=type_)
        values = [decode(cell) for cell in different.tolist()]
        return map(values.__getitem__, places.tolist())
