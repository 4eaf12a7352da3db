"""A body of a pattern as the naive matcher reads it: every term is the name of a variable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import field, replace
from itertools import count

from envgraph.code import dataclass
from envgraph.metamodel import AttributeType, Value
from envgraph.pattern import (
    Aggregate,
    Body,
    Check,
    ColumnMark,
    Comparison,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    Library,
    Negation,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
    Variable,
    terms_of,
    variables_in,
)
from envgraph.pattern._enumerable_variables import enumerated_by_type


@dataclass(frozen=True, slots=True)
class Positive:
    """The values of `terms` are a tuple of the relation."""

    relation: Relation
    terms: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Negative:
    """No tuple of the relation has the values of the `terms` that are not `local`; `empty`: by their types."""

    relation: Relation
    terms: tuple[str, ...]
    local: frozenset[str]
    empty: bool


@dataclass(frozen=True, slots=True)
class Fold:
    """`result` is the aggregate over the tuples that have the values of the `terms` that are not `local`.

    There are none if it is `empty`, because of their types.
    """

    function: str
    relation: Relation
    terms: tuple[str, ...]
    local: frozenset[str]
    column: int | None
    result: str
    empty: bool


@dataclass(frozen=True, slots=True)
class Equal:
    """Both variables have the same value."""

    terms: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Unequal:
    """The variables have different values."""

    terms: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Test:
    """The expression is true."""

    expression: Expression
    terms: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Valuation:
    """`result` has the value of the expression."""

    expression: Expression
    terms: tuple[str, ...]
    result: str


@dataclass(frozen=True, slots=True)
class Values:
    """An attribute of this type has the value, at some object."""

    type: AttributeType
    terms: tuple[str, ...]


Item = Values | Positive | Negative | Fold | Equal | Unequal | Test | Valuation


@dataclass(frozen=True, slots=True)
class FlatBody:
    """The constraints of one body, the types of the parameters among them."""

    items: tuple[Item, ...]
    constants: dict[str, Value]


def flatten(pattern: Pattern, body: Body, library: Library) -> FlatBody:
    """Give every term of a body a name, and find out which variables are free inside a negative call."""
    reader = _Reader(pattern, library, library.relation_test(pattern.qualified_name, body))
    for parameter in pattern.parameters:
        if parameter.type is not None and parameter.type in library.metamodel.classes:
            reader.items.append(Positive(TypeConstraint(parameter.type, Variable(parameter.name)), (parameter.name,)))
    for constraint in body.constraints:
        reader.read(constraint)
    types = library._entry_of(pattern.qualified_name).bodies[pattern.bodies.index(body)]
    for name, type_ in enumerated_by_type(types, pattern.parameters):
        reader.items.append(Values(type_, (name,)))
    parameters = {parameter.name for parameter in pattern.parameters}
    return FlatBody(
        tuple(_with_locals(reader.items, parameters | reader.constants.keys())),
        reader.constants,
    )


@dataclass(slots=True)
class _Reader:
    pattern: Pattern
    library: Library
    may_hold: Callable[[Relation], bool]
    items: list[Item] = field(default_factory=list)
    constants: dict[str, Value] = field(default_factory=dict)
    _fresh: Iterator[int] = field(default_factory=count)

    def read(self, constraint: Constraint) -> None:
        match constraint:
            case Negation(relation):
                terms = self._relation(relation)
                self.items.append(Negative(relation, terms, frozenset(), not self.may_hold(relation)))
            case Comparison("==", left, right):
                self.items.append(Equal((self._term(left), self._term(right))))
            case Comparison("!=", left, right):
                self.items.append(Unequal((self._term(left), self._term(right))))
            case Check(expression):
                self.items.append(Test(expression, variables(expression)))
            case TypeConstraint() | PathConstraint() | PatternCall():
                self.items.append(Positive(constraint, self._relation(constraint)))

    def _relation(self, relation: Relation) -> tuple[str, ...]:
        match relation:
            case TypeConstraint():
                return (self._term(relation.term),)
            case PathConstraint():
                return (self._term(relation.source), self._term(relation.target))
            case PatternCall():
                return tuple(self._term(argument) for argument in relation.arguments)

    def _term(self, term: Term) -> str:
        match term:
            case Variable(name):
                return self._name() if term.is_anonymous else name
            case Constant(value):
                assert value is not None
                return self._constant(value)
            case EnumLiteral(_, literal):
                return self._constant(literal)
            case Evaluation(expression):
                result = self._name()
                self.items.append(Valuation(expression, variables(expression), result))
                return result
            case Aggregate(function, over):
                result = self._name()
                terms = self._relation(over)
                column = next((i for i, arg in enumerate(terms_of(over)) if isinstance(arg, ColumnMark)), None)
                empty = not self.may_hold(over)
                self.items.append(Fold(function, over, terms, frozenset(), column, result, empty))
                return result
            case ColumnMark():
                return self._name()

    def _constant(self, value: Value) -> str:
        name = self._name()
        self.constants[name] = value
        return name

    def _name(self) -> str:
        return f"#{next(self._fresh)}"


def resolved(library: Library, caller: Pattern, call: PatternCall) -> Pattern:
    """The pattern that a call means."""
    return library.callee(caller.qualified_name, call.pattern)


def variables(expression: Expression) -> tuple[str, ...]:
    """The variables of an expression, each once, in the order of the text."""
    return tuple(dict.fromkeys(one.name for one in variables_in(expression)))


def _with_locals(items: list[Item], outside: set[str]) -> Iterator[Item]:
    """The items, each negative one with the variables that no other item and no parameter mentions."""
    uses = Counter(name for item in items for name in mentioned(item))
    for item in items:
        match item:
            case Negative() | Fold():
                yield replace(item, local=_only_here(item.terms, uses, outside))
            case _:
                yield item


def mentioned(item: Item) -> set[str]:
    """Every variable of an item."""
    result = {item.result} if isinstance(item, Fold | Valuation) else set()
    return result.union(item.terms)


def _only_here(terms: Iterable[str], uses: Counter[str], outside: set[str]) -> frozenset[str]:
    return frozenset(name for name in terms if uses[name] == 1 and name not in outside)
