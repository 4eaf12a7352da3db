"""The occurrences of relations in a body. A tuple that changes at an occurrence may create or remove derivations."""

from __future__ import annotations

from enum import Enum

from envgraph.code import dataclass
from envgraph.match.views.delta._bodies import existential, free_inside, negated
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Conjunction,
    InstanceAtom,
    LinkAtom,
    RelationAtom,
    arguments,
    inputs,
)


class Role(Enum):
    """The effect of a tuple at an occurrence on the derivations of the body."""

    EACH = "each"
    """Each tuple takes part in derivations of its own."""
    SOME = "some"
    """Only the existence of a tuple in its group matters, not their number."""
    NONE = "none"
    """A derivation needs that no tuple exists (negation)."""
    NUMBER = "number"
    """The number of tuples in the group is the value of a variable."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """An occurrence of a relation in a body.

    Attributes:
        goal: the number of its goal in the body.
        relation: the relation; of a negation or a count the inner relation.
        role: see `Role`.
        columns: the variable at each position of the relation; None for a variable local to the relation.
    """

    goal: int
    relation: RelationAtom
    role: Role
    columns: tuple[int | None, ...]


def occurrences(conjunction: Conjunction) -> list[Occurrence]:
    """Return all occurrences of relations in a body, in the order of its goals. Tests and computed values have none."""
    loose = existential(conjunction)
    found: list[Occurrence] = []
    for number, goal in enumerate(conjunction.goals):
        match goal:
            case Absence():
                relation = negated(goal)
                local = set(free_inside(goal))
                columns = tuple(None if v in local else v for v in arguments(relation))
                found.append(Occurrence(number, relation, Role.NONE, columns))
            case AggregateAtom(_, LinkAtom() as relation):
                local = set(free_inside(goal))
                columns = tuple(None if v in local else v for v in arguments(relation))
                found.append(Occurrence(number, relation, Role.NUMBER, columns))
            case AggregateAtom():
                # An aggregate operator holds a value for each group: the columns are the group and the value.
                folded = CallAtom(fold_of(goal), (*group_of(goal), goal.result))
                found.append(Occurrence(number, folded, Role.EACH, folded.arguments))
            case InstanceAtom() | AttributeAtom() | LinkAtom() | CallAtom() | ClosureAtom():
                columns = tuple(None if v in loose else v for v in arguments(goal))
                role = Role.SOME if None in columns else Role.EACH
                found.append(Occurrence(number, goal, role, columns))
            case _:
                pass
    return found


def group_of(goal: AggregateAtom) -> tuple[int, ...]:
    """Return the variables whose values distinguish the groups of an aggregate, each once."""
    return tuple(dict.fromkeys(inputs(goal)))


def fold_of(goal: AggregateAtom) -> str:
    """Return the name of the operator that holds the values of an aggregate."""
    assert isinstance(goal.relation, CallAtom)
    return goal.relation.pattern
