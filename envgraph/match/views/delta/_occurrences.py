"""The places of a body where a relation stands: there a changed tuple may begin or end derivations."""

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
    """How a tuple of a relation counts where it occurs."""

    EACH = "each"
    """Every tuple is a derivation of its own."""
    SOME = "some"
    """Only whether there is any."""
    NONE = "none"
    """Only whether there is none."""
    NUMBER = "number"
    """Their number is the value of a variable."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """A place of a body where a relation stands.

    Attributes:
        goal: its goal, by position in the body.
        relation: the atom; for a negation or a number the one inside.
        role: see `Role`.
        columns: number of the variable at each position of the relation; None for one that has no value outside.
    """

    goal: int
    relation: RelationAtom
    role: Role
    columns: tuple[int | None, ...]


def occurrences(conjunction: Conjunction) -> list[Occurrence]:
    """All places of a body where a relation stands, in the order of its goals."""
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
                # A value that a view holds for each group: the columns are the group and the value.
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
    """The variables whose values tell the groups of an aggregate apart."""
    return tuple(dict.fromkeys(inputs(goal)))


def fold_of(goal: AggregateAtom) -> str:
    """Name of the view that holds the values of an aggregate over a view."""
    assert isinstance(goal.relation, CallAtom)
    return goal.relation.pattern
