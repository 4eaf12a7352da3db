"""The variables of a left-hand side: their order, their types in it, and which of them are equated."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import chain, combinations

from envgraph.errors import Span
from envgraph.pattern import (
    Check,
    Closure,
    Comparison,
    Constraint,
    Evaluation,
    LeftSide,
    Negation,
    ObjectType,
    Parameter,
    PathConstraint,
    RuleEdge,
    StaticType,
    Variable,
    constraint_terms,
    type_text,
    variables_in,
    variables_of_terms,
)


def is_named(name: str) -> bool:
    """Return True if a variable belongs to the match. Names that begin with `_`, and generated names (`#1`), do not."""
    return not name.startswith(("_", "#"))


def parameter_for(name: str, type_: StaticType | None) -> Parameter:
    """Return a pattern parameter for a variable of an enclosing block; data values become `in` parameters."""
    if type_ is None:
        return Parameter(name)
    return Parameter(name, type_text(type_), None if isinstance(type_, ObjectType) else "in")


def variable_occurrences(constraint: Constraint) -> Iterator[Variable]:
    """Yield every occurrence of a variable in a constraint, including quantified variables."""
    if isinstance(constraint, Check):
        yield from variables_in(constraint.expression)
    yield from variables_of_terms(constraint_terms(constraint))


def _unquantified_variables(constraint: Constraint) -> Iterator[Variable]:
    """Yield the occurrences of variables in a constraint that no negation or aggregate quantifies."""
    if isinstance(constraint, Check):
        yield from variables_in(constraint.expression)
    for term in constraint_terms(constraint):
        if isinstance(term, Evaluation):
            yield from variables_in(term.expression)
        elif isinstance(term, Variable) and not isinstance(constraint, Negation):
            yield term


def node_names(left: LeftSide) -> dict[str, Span | None]:
    """Return the named variables in nodes and edges of a left-hand side, with the span of their first occurrence."""
    found: dict[str, Span | None] = {}
    for node in left.nodes:
        found.setdefault(node.name, node.span)
    for edge in left.edges:
        found.setdefault(edge.source, edge.source_span or edge.span)
        found.setdefault(edge.target, edge.target_span or edge.span)
    return {name: span for name, span in found.items() if is_named(name)}


def path_edges(left: LeftSide) -> Iterator[RuleEdge]:
    """Yield path constraints that follow one link, such as `Item.next(a, b)`, as edges."""
    for constraint in left.constraints:
        match constraint:
            case PathConstraint(_, (reference,), Variable() as source, Variable() as target, Closure.ONCE):
                yield RuleEdge(source.name, reference, target.name)


def own_variables(left: LeftSide, outside: Iterable[str]) -> list[str]:
    """Return the named variables that a left-hand side adds to `outside`: nodes first, then variables of constraints.

    A variable that occurs only in negations and aggregates is quantified there and belongs to no match.
    """
    known = set(outside)
    found = dict.fromkeys(name for name in node_names(left) if name not in known)
    for constraint in left.constraints:
        for variable in _unquantified_variables(constraint):
            if is_named(variable.name) and variable.name not in known:
                found[variable.name] = None
    return list(found)


def all_names(left: LeftSide) -> set[str]:
    """Return all names in a left-hand side, including quantified variables."""
    return set(node_names(left)) | {v.name for c in left.constraints for v in variable_occurrences(c)}


def equated_pairs(*lefts: LeftSide) -> set[frozenset[str]]:
    """Return all pairs of variables that `==` constraints equate, transitively."""
    groups: list[set[str]] = []
    for constraint in chain.from_iterable(left.constraints for left in lefts):
        if isinstance(constraint, Comparison) and constraint.operator == "==":
            sides = {term.name for term in (constraint.left, constraint.right) if isinstance(term, Variable)}
            if len(sides) == 2:
                touching = [group for group in groups if group & sides]
                groups = [group for group in groups if not group & sides]
                groups.append(sides.union(*touching))
    return {frozenset(pair) for group in groups for pair in combinations(sorted(group), 2)}


def may_be_same(one: str, other: str, groups: Iterable[Collection[str]], same: Collection[frozenset[str]]) -> bool:
    """Return True if two variables may be one object: `==` equates them, or one of the `groups` of `@hom` has both.

    `same` contains the pairs of equated variables. A variable also belongs to the groups of variables equated with it.
    """
    if frozenset((one, other)) in same:
        return True
    first, second = ({name}.union(*(pair for pair in same if name in pair)) for name in (one, other))
    return any(not first.isdisjoint(group) and not second.isdisjoint(group) for group in groups)
