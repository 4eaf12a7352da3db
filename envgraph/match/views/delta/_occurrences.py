"""The occurrences of relations in a body. A tuple that changes at an occurrence may create or remove derivations."""

from __future__ import annotations

from enum import Enum

from envgraph.code import dataclass
from envgraph.match.views.delta._view_bodies import existential_variables, local_variables, negated
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Conjunction,
    InstanceAtom,
    LinkAtom,
    RelationAtom,
    relation_variables,
    required_variables,
)


class TupleEffect(Enum):
    """The effect of a tuple at an occurrence on the derivations of the body."""

    EACH = "each"
    """Each tuple takes part in derivations of its own."""
    EXISTS = "some"
    """Only the existence of a tuple in its group matters, not their number."""
    NEGATED = "none"
    """A derivation needs that no tuple exists (negation)."""
    COUNT = "number"
    """The number of tuples in the group is the value of a variable."""


@dataclass(frozen=True, slots=True)
class RelationOccurrence:
    """An occurrence of a relation in a body.

    Attributes:
        goal: the number of its goal in the body.
        relation: the relation; of a negation or a count the inner relation.
        role: see `TupleEffect`.
        columns: the variable at each position of the relation; None for a variable local to the relation.
    """

    goal: int
    relation: RelationAtom
    role: TupleEffect
    columns: tuple[int | None, ...]


def occurrences(conjunction: Conjunction) -> list[RelationOccurrence]:
    """Return all occurrences of relations in a body, in the order of its goals. Tests and computed values have none."""
    loose = existential_variables(conjunction)
    found: list[RelationOccurrence] = []
    for number, goal in enumerate(conjunction.goals):
        match goal:
            case AbsenceAtom():
                relation = negated(goal)
                local = set(local_variables(goal))
                columns = tuple(None if v in local else v for v in relation_variables(relation))
                found.append(RelationOccurrence(number, relation, TupleEffect.NEGATED, columns))
            case AggregateAtom(_, LinkAtom() as relation):
                local = set(local_variables(goal))
                columns = tuple(None if v in local else v for v in relation_variables(relation))
                found.append(RelationOccurrence(number, relation, TupleEffect.COUNT, columns))
            case AggregateAtom():
                # An aggregate operator holds a value for each group: the columns are the group and the value.
                folded = CallAtom(aggregate_operator_of(goal), (*group_variables_of(goal), goal.result))
                found.append(RelationOccurrence(number, folded, TupleEffect.EACH, folded.arguments))
            case InstanceAtom() | AttributeAtom() | LinkAtom() | CallAtom() | ClosureAtom():
                columns = tuple(None if v in loose else v for v in relation_variables(goal))
                role = TupleEffect.EXISTS if None in columns else TupleEffect.EACH
                found.append(RelationOccurrence(number, goal, role, columns))
            case _:
                pass
    return found


def group_variables_of(goal: AggregateAtom) -> tuple[int, ...]:
    """Return the variables whose values distinguish the groups of an aggregate, each once."""
    return tuple(dict.fromkeys(required_variables(goal)))


def aggregate_operator_of(goal: AggregateAtom) -> str:
    """Return the name of the operator that holds the values of an aggregate."""
    assert isinstance(goal.relation, CallAtom)
    return goal.relation.pattern
