"""Complete the lowering of a body: number the variables, remove implied goals, and build the conjunction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from envgraph.errors import Span, exact_key
from envgraph.metamodel import Metamodel, Value
from envgraph.pattern._expression_data import Expression, Variable
from envgraph.pattern._goals import (
    ConditionAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    StaticType,
    UnequalAtom,
    ValuationAtom,
    all_variables,
    renumber_goal,
)
from envgraph.pattern._occurrences import children, with_children
from envgraph.pattern._query_data import Parameter
from envgraph.pattern._type_inference import BodyTypes
from envgraph.pattern.lowering._body_lowering import BodyLowering, PatternGenerator
from envgraph.pattern.lowering._implied_classes import ParameterTypes, implied_classes, is_implied
from envgraph.pattern.lowering._variable_slots import Slots, Unsatisfiable


def lower_body(
    parameters: Sequence[Parameter],
    body_types: BodyTypes,
    generate: PatternGenerator,
    types_of: ParameterTypes,
) -> Conjunction | None:
    """Return the lowered form of a checked body, or None if no model can satisfy the body."""
    try:
        lowering = BodyLowering(parameters, body_types, generate)
        return _Normaliser(lowering.slots, parameters, body_types.metamodel, types_of).conjunction(lowering.goals)
    except Unsatisfiable:
        return None


class _Normaliser:
    """A renumbering of the slots of one body to final numbers, which also removes implied and repeated goals."""

    def __init__(
        self, slots: Slots, parameters: Sequence[Parameter], metamodel: Metamodel, types_of: ParameterTypes
    ) -> None:
        self._slots = slots
        self._parameters = parameters
        self._metamodel = metamodel
        self._types_of = types_of
        self._roots = {slot: slots.representative(slot) for slot in range(len(slots))}

    def conjunction(self, raw: Sequence[tuple[Goal, Span | None]]) -> Conjunction:
        written = [
            *self._declared_types(),
            *((kept, span) for goal, span in raw for kept in self._resolve_goal(goal)),
        ]
        # Goals are compared by their text: the constants 1 and 1.0 are equal, but 1 / 2 and 1.0 / 2 are not.
        written = list({exact_key(goal): (goal, span) for goal, span in written}.values())
        goals = [goal for goal, _ in written]
        known = implied_classes(goals, self._metamodel, self._types_of)
        written = [(goal, span) for goal, span in written if not is_implied(goal, goals, known, self._metamodel)]
        count = len(self._parameters)
        order = [*range(count), *sorted({v for goal, _ in written for v in all_variables(goal) if v >= count})]
        numbers = {slot: number for number, slot in enumerate(order)}
        names = tuple(self._slots.name_of(slot) or f"#{number}" for slot, number in numbers.items())
        return Conjunction(
            tuple(self._type_of(slot) for slot in order),
            tuple((numbers[slot], value) for slot in order if (value := self._fixed_value(slot)) is not None),
            tuple(numbers[self._slots.representative(number)] for number in range(len(self._parameters))),
            tuple(_with_names(renumber_goal(goal, numbers), names) for goal, _ in written),
            names,
            tuple(span for _, span in written),
        )

    def _type_of(self, slot: int) -> StaticType:
        type_ = self._slots.type_of(slot)
        assert type_ is not None, f"no type for variable {self._slots.name_of(slot) or slot}"
        return type_

    def _fixed_value(self, slot: int) -> Value | None:
        return self._slots.fixed_value(slot) if self._slots.representative(slot) == slot else None

    def _declared_types(self) -> Iterator[tuple[Goal, Span | None]]:
        for number, parameter in enumerate(self._parameters):
            if parameter.type in self._metamodel.classes:
                assert parameter.type is not None
                yield InstanceAtom(parameter.type, self._slots.representative(number)), parameter.span

    def _resolve_goal(self, goal: Goal) -> Iterator[Goal]:
        """Yield the goal with united variables replaced by their representative, or nothing if the goal always holds.

        The goal always holds if it is an inequality of two different constants.

        Raises:
            Unsatisfiable: an inequality of a variable with itself, or of equal constants.
        """
        if isinstance(goal, UnequalAtom):
            left, right = self._roots[goal.left], self._roots[goal.right]
            one, other = self._slots.fixed_value(left), self._slots.fixed_value(right)
            if left == right or (one is not None and one == other):
                raise Unsatisfiable
            if one is not None and other is not None:
                return
        yield _with_names(renumber_goal(goal, self._roots), {root: str(root) for root in self._roots.values()})


def _with_names(goal: Goal, names: Sequence[str] | Mapping[int, str]) -> Goal:
    """Return the goal with the variables of its expression renamed: `names` has the new name for each number."""
    if not isinstance(goal, ConditionAtom | ValuationAtom):
        return goal
    expression = _rename_variables(goal.expression, {name: names[number] for name, number in goal.reads})
    reads = tuple({number: (names[number], number) for _, number in goal.reads}.values())
    return replace(goal, expression=expression, reads=reads)


def _rename_variables(expression: Expression, names: Mapping[str, str]) -> Expression:
    if isinstance(expression, Variable):
        return Variable(names[expression.name], expression.span)
    return with_children(expression, [_rename_variables(child, names) for child in children(expression)])
