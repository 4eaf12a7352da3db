"""Complete the lowering of a body: number the variables, remove implied goals, and build the conjunction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from envgraph.errors import Span, spelling
from envgraph.metamodel import Metamodel, Value
from envgraph.pattern._bodies import children, with_children
from envgraph.pattern._inference import BodyTypes
from envgraph.pattern._lowered import (
    Condition,
    Conjunction,
    Goal,
    InstanceAtom,
    StaticType,
    UnequalAtom,
    Valuation,
    mentioned,
    renumbered,
)
from envgraph.pattern._queries import Parameter
from envgraph.pattern._terms import Expression, Variable
from envgraph.pattern.lowering._implied import Types, implied_classes, is_implied
from envgraph.pattern.lowering._lowering import BodyLowering, Generate
from envgraph.pattern.lowering._slots import Slots, Unsatisfiable


def lower_body(
    parameters: Sequence[Parameter], body_types: BodyTypes, generate: Generate, types_of: Types
) -> Conjunction | None:
    """Return the lowered form of a checked body, or None if no model can satisfy the body."""
    try:
        lowering = BodyLowering(parameters, body_types, generate)
        return _Normaliser(lowering.slots, parameters, body_types.metamodel, types_of).body(lowering.goals)
    except Unsatisfiable:
        return None


class _Normaliser:
    """A renumbering of the slots of one body to final numbers, which also removes implied and repeated goals."""

    def __init__(
        self, slots: Slots, parameters: Sequence[Parameter], metamodel: Metamodel, types_of: Types
    ) -> None:
        self._slots = slots
        self._parameters = parameters
        self._metamodel = metamodel
        self._types_of = types_of
        self._roots = {slot: slots.root(slot) for slot in range(len(slots))}

    def body(self, raw: Sequence[tuple[Goal, Span | None]]) -> Conjunction:
        written = [
            *self._declared(),
            *((kept, span) for goal, span in raw for kept in self._resolved(goal)),
        ]
        # Goals are compared by their text: the constants 1 and 1.0 are equal, but 1 / 2 and 1.0 / 2 are not.
        written = list({spelling(goal): (goal, span) for goal, span in written}.values())
        goals = [goal for goal, _ in written]
        known = implied_classes(goals, self._metamodel, self._types_of)
        written = [
            (goal, span) for goal, span in written if not is_implied(goal, goals, known, self._metamodel)
        ]
        order = self._order(goal for goal, _ in written)
        numbers = {slot: number for number, slot in enumerate(order)}
        names = tuple(self._slots.name(slot) or f"#{number}" for slot, number in numbers.items())
        return Conjunction(
            tuple(self._type(slot) for slot in order),
            tuple((numbers[slot], value) for slot in order if (value := self._fixed(slot)) is not None),
            tuple(numbers[self._slots.root(number)] for number in range(len(self._parameters))),
            tuple(_named(renumbered(goal, numbers), names) for goal, _ in written),
            names,
            tuple(span for _, span in written),
        )

    def _type(self, slot: int) -> StaticType:
        type_ = self._slots.type(slot)
        assert type_ is not None, f"no type for variable {self._slots.name(slot) or slot}"
        return type_

    def _fixed(self, slot: int) -> Value | None:
        return self._slots.value(slot) if self._slots.root(slot) == slot else None

    def _declared(self) -> Iterator[tuple[Goal, Span | None]]:
        for number, parameter in enumerate(self._parameters):
            if parameter.type in self._metamodel.classes:
                assert parameter.type is not None
                yield InstanceAtom(parameter.type, self._slots.root(number)), parameter.span

    def _resolved(self, goal: Goal) -> Iterator[Goal]:
        """Yield the goal with united variables replaced by their representative, or nothing if the goal always holds.

        The goal always holds if it is an inequality of two different constants.

        Raises:
            Unsatisfiable: an inequality of a variable with itself, or of equal constants.
        """
        if isinstance(goal, UnequalAtom):
            left, right = self._roots[goal.left], self._roots[goal.right]
            one, other = self._slots.value(left), self._slots.value(right)
            if left == right or (one is not None and one == other):
                raise Unsatisfiable
            if one is not None and other is not None:
                return
        yield _named(renumbered(goal, self._roots), {root: str(root) for root in self._roots.values()})

    def _order(self, goals: Iterable[Goal]) -> list[int]:
        """Return the slots in their final order: the parameters, then the other variables of goals by number."""
        count = len(self._parameters)
        slots = {slot for goal in goals for slot in mentioned(goal)}
        return [*range(count), *sorted(slot for slot in slots if slot >= count)]


def _named(goal: Goal, names: Sequence[str] | Mapping[int, str]) -> Goal:
    """Return the goal with the variables of its expression renamed: `names` has the new name for each number."""
    if not isinstance(goal, Condition | Valuation):
        return goal
    expression = _spelled(goal.expression, {name: names[number] for name, number in goal.reads})
    reads = tuple({number: (names[number], number) for _, number in goal.reads}.values())
    return replace(goal, expression=expression, reads=reads)


def _spelled(expression: Expression, names: Mapping[str, str]) -> Expression:
    if isinstance(expression, Variable):
        return Variable(names[expression.name], expression.span)
    return with_children(expression, [_spelled(child, names) for child in children(expression)])
