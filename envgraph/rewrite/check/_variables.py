"""The variables of a left side, in order, and what is known about their types from the left side alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import chain, combinations

from envgraph.errors import Span
from envgraph.metamodel import Attribute, Metamodel, Reference
from envgraph.pattern import (
    Aggregate,
    Check,
    Closure,
    Comparison,
    Constraint,
    Edge,
    Evaluation,
    LeftSide,
    Library,
    Negation,
    ObjectType,
    Parameter,
    PathConstraint,
    PatternCall,
    StaticType,
    Term,
    TypeConstraint,
    Variable,
    static_type,
    terms_in,
    terms_of,
    variables_in,
)

Types = dict[str, StaticType | None]
"""Type of each variable in the order of the match; None where it is not known."""


def is_named(name: str) -> bool:
    """Whether a variable belongs to the match: `_`, names that start with it, and `#1` for a `_` do not."""
    return not name.startswith(("_", "#"))


def mentioned(constraint: Constraint) -> Iterator[Variable]:
    """Every place of a variable in a constraint, those that are quantified in it included."""
    if isinstance(constraint, Check):
        yield from variables_in(constraint.expression)
    yield from _in_terms(terms_in(constraint))


def _in_terms(terms: Iterable[Term]) -> Iterator[Variable]:
    for term in terms:
        match term:
            case Variable():
                yield term
            case Evaluation():
                yield from variables_in(term.expression)
            case Aggregate():
                yield from _in_terms(terms_of(term.over))
            case _:
                pass


def _visible(constraint: Constraint) -> Iterator[Variable]:
    """The places that a negation or an aggregate does not quantify by itself."""
    if isinstance(constraint, Check):
        yield from variables_in(constraint.expression)
    elif isinstance(constraint, Negation):
        for term in terms_in(constraint):
            if isinstance(term, Evaluation):
                yield from variables_in(term.expression)
    else:
        for term in terms_in(constraint):
            if isinstance(term, Variable):
                yield term
            elif isinstance(term, Evaluation):
                yield from variables_in(term.expression)


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
    """Whether two variables are the same by `==`, or may be by `@hom`: an alias is in the groups of what it is."""
    if frozenset((one, other)) in same:
        return True
    first, second = ({name}.union(*(pair for pair in same if name in pair)) for name in (one, other))
    return any(not first.isdisjoint(group) and not second.isdisjoint(group) for group in groups)


class TypeReader:
    """Works out the types of variables from declarations, arrows, paths and calls.

    It is forgiving: what makes no sense says nothing about a type. The library reports it.
    """

    def __init__(self, library: Library, package: str) -> None:
        self.library = library
        self.metamodel: Metamodel = library.metamodel
        self.package = package

    def parameters(self, parameters: Iterable[Parameter]) -> Types:
        """Types of declared parameters."""
        return {p.name: static_type(p.type, self.metamodel) if p.type else None for p in parameters}

    def left_side(self, left: LeftSide, outside: Mapping[str, StaticType | None]) -> Types:
        """Types of all variables of a left side: the outside ones, narrowed by it, then its own."""
        types: Types = dict(outside)
        types.update((name, None) for name in own_variables(left, outside))
        for node in left.nodes:
            if node.type:
                self._narrow(types, node.name, static_type(node.type, self.metamodel))
        for constraint in left.constraints:
            self._constraint(types, constraint)
        for _ in range(len(left.edges) + 1):  # an arrow types its target once its source has a type
            before = dict(types)
            for edge in left.edges:
                feature = self.feature(types.get(edge.source), edge.reference)
                if isinstance(feature, Reference):
                    self._narrow(types, edge.target, self._end(types[edge.source], feature, edge.closure))
            if types == before:
                break
        return types

    def feature(self, type_: StaticType | None, name: str) -> Attribute | Reference | None:
        """A feature of the class that a type is, if it has it."""
        if isinstance(type_, ObjectType) and type_.cls in self.metamodel.classes:
            return self.metamodel.feature(type_.cls, name)
        return None

    def _narrow(self, types: Types, name: str, type_: StaticType | None) -> None:
        if name not in types or type_ is None:
            return
        old = types[name]
        if old is None:
            types[name] = type_
        elif isinstance(old, ObjectType) and isinstance(type_, ObjectType):
            types[name] = type_ if self.metamodel.is_a(type_.cls, old.cls) else old

    def _constraint(self, types: Types, constraint: Constraint) -> None:
        match constraint:
            case TypeConstraint():
                self._term(types, constraint.term, static_type(constraint.type, self.metamodel))
            case PathConstraint():
                self._path(types, constraint)
            case PatternCall():
                called = self.library.resolve(constraint.pattern, self.package)
                if called is not None and len(called.parameters) == len(constraint.arguments):
                    known = self.library.parameter_types(called.qualified_name)
                    for term, type_ in zip(constraint.arguments, known, strict=True):
                        self._term(types, term, type_)
            case _:
                pass

    def _term(self, types: Types, term: Term, type_: StaticType | None) -> None:
        if isinstance(term, Variable):
            self._narrow(types, term.name, type_)

    def _path(self, types: Types, path: PathConstraint) -> None:
        if path.type not in self.metamodel.classes:
            return
        start = ObjectType(path.type)
        end: StaticType | None = start
        for name in path.features:
            feature = self.feature(end, name)
            if isinstance(feature, Reference):
                end = ObjectType(feature.target)
            else:
                end = None if feature is None else feature.type
        self._term(types, path.source, start)
        if path.closure == Closure.STAR:
            end = self._join(start, end) if isinstance(end, ObjectType) else None
        self._term(types, path.target, end)

    def _end(self, start: StaticType | None, reference: Reference, closure: str) -> StaticType | None:
        """Type of what an arrow leads to."""
        end = ObjectType(reference.target)
        return self._join(start, end) if closure == Closure.STAR and isinstance(start, ObjectType) else end

    def _join(self, start: ObjectType, end: ObjectType) -> StaticType | None:
        """Type of what is the start itself, or an end: the first class that both are, if there is one."""
        if end.cls not in self.metamodel.classes or start.cls not in self.metamodel.classes:
            return None
        above = self.metamodel.supertypes(start.cls)
        return next((ObjectType(cls) for cls in above if self.metamodel.is_a(end.cls, cls)), None)
