"""The variables of a left side, in order, and what is known about their types from the left side alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import chain, combinations

from envgraph.errors import Span
from envgraph.pattern import (
    Check,
    Closure,
    Comparison,
    Constraint,
    Edge,
    Evaluation,
    LeftSide,
    Negation,
    ObjectType,
    Parameter,
    PathConstraint,
    StaticType,
    Variable,
    terms_in,
    type_text,
    variables_in,
    variables_of_terms,
)


def is_named(name: str) -> bool:
    """Return whether a variable belongs to the match: `_`, names that start with it, and `#1` for a `_` do not."""
    return not name.startswith(("_", "#"))


def parameter_for(name: str, type_: StaticType | None) -> Parameter:
    """A parameter of a pattern for a variable from around it: what is no object is given."""
    if type_ is None:
        return Parameter(name)
    return Parameter(name, type_text(type_), None if isinstance(type_, ObjectType) else "in")


def mentioned(constraint: Constraint) -> Iterator[Variable]:
    """Every place of a variable in a constraint, those that are quantified in it included."""
    if isinstance(constraint, Check):
        yield from variables_in(constraint.expression)
    yield from variables_of_terms(terms_in(constraint))


def _visible(constraint: Constraint) -> Iterator[Variable]:
    """The places that a negation or an aggregate does not quantify by itself."""
    if isinstance(constraint, Check):
        yield from variables_in(constraint.expression)
    for term in terms_in(constraint):
        if isinstance(term, Evaluation):
            yield from variables_in(term.expression)
        elif isinstance(term, Variable) and not isinstance(constraint, Negation):
            yield term


def node_names(left: LeftSide) -> dict[str, Span | None]:
    """The variables that are declared or stand in an arrow, with the first place of each."""
    found: dict[str, Span | None] = {}
    for node in left.nodes:
        found.setdefault(node.name, node.span)
    for edge in left.edges:
        found.setdefault(edge.source, edge.source_span or edge.span)
        found.setdefault(edge.target, edge.target_span or edge.span)
    return {name: span for name, span in found.items() if is_named(name)}


def path_edges(left: LeftSide) -> Iterator[Edge]:
    """Path constraints along one link, such as `Item.next(a, b)`, as edges."""
    for constraint in left.constraints:
        match constraint:
            case PathConstraint(_, (reference,), Variable() as source, Variable() as target, Closure.ONCE):
                yield Edge(source.name, reference, target.name)


def own_variables(left: LeftSide, outside: Iterable[str]) -> list[str]:
    """The named variables that a left side adds to the `outside` ones: its nodes first, then those of constraints.

    A variable that stands in negations and aggregates alone is quantified there and belongs to no match.
    """
    known = set(outside)
    found = dict.fromkeys(name for name in node_names(left) if name not in known)
    for constraint in left.constraints:
        for variable in _visible(constraint):
            if is_named(variable.name) and variable.name not in known:
                found[variable.name] = None
    return list(found)


def all_names(left: LeftSide) -> set[str]:
    """Every name in a left side, quantified ones included."""
    return set(node_names(left)) | {v.name for c in left.constraints for v in mentioned(c)}


def equated(*lefts: LeftSide) -> set[frozenset[str]]:
    """Pairs of variables that `==` says are the same, transitively."""
    groups: list[set[str]] = []
    for constraint in chain.from_iterable(left.constraints for left in lefts):
        if isinstance(constraint, Comparison) and constraint.operator == "==":
            sides = {term.name for term in (constraint.left, constraint.right) if isinstance(term, Variable)}
            if len(sides) == 2:
                touching = [group for group in groups if group & sides]
                groups = [group for group in groups if not group & sides]
                groups.append(sides.union(*touching))
    return {frozenset(pair) for group in groups for pair in combinations(sorted(group), 2)}


def may_be_one(
    one: str, other: str, groups: Iterable[Collection[str]], same: Collection[frozenset[str]]
) -> bool:
    """Return whether two variables are one by `==`, or may be by `@hom`: an alias is in the groups of what it is."""
    if frozenset((one, other)) in same:
        return True
    first, second = ({name}.union(*(pair for pair in same if name in pair)) for name in (one, other))
    return any(not first.isdisjoint(group) and not second.isdisjoint(group) for group in groups)
