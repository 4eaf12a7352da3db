"""Occurrences of the variables of a body, and traversals of constraints and expressions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from typing import Any, Final, TypeVar

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.pattern._expression_data import (
    Binary,
    Conditional,
    Constant,
    Expression,
    FunctionCall,
    Navigation,
    Unary,
    Variable,
)
from envgraph.pattern._query_data import (
    Aggregate,
    Body,
    Check,
    Comparison,
    Constraint,
    Evaluation,
    Negation,
    Parameter,
    PathConstraint,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
)

Data = TypeVar("Data")

MAX_NESTED_OPERATORS: Final = 4
"""Chains with at most this many operators are compiled to nested operations; longer chains have one level."""


class VariableUse(Enum):
    """The way in which an occurrence uses a variable."""

    POSITIVE = "positive"
    """The occurrence binds it: type, path, positive find, `==` with a constant, an eval or an aggregate, `x.attr`."""
    NEGATIVE = "negative"
    """An argument of a negation or an aggregate, or `x.attr == none`."""
    READ = "read"
    """The occurrence needs its value: check, eval, `!=`, variable == variable."""


@dataclass(frozen=True, slots=True)
class VariableOccurrence:
    """An occurrence of a variable in a body.

    Attributes:
        relation: the number of the negated or aggregated relation (see `grouped_relations`) that has this argument, or
            None.
    """

    variable: Variable
    use: VariableUse
    relation: int | None = None


def terms_of(relation: Relation) -> tuple[Term, ...]:
    """Return the arguments of a relation, in order."""
    match relation:
        case TypeConstraint():
            return (relation.term,)
        case PathConstraint():
            return (relation.source, relation.target)
        case PatternCall():
            return relation.arguments


def constraint_terms(constraint: Constraint) -> tuple[Term, ...]:
    """Return the terms that a constraint contains directly, not terms nested in aggregates. A check has none."""
    match constraint:
        case Negation():
            return terms_of(constraint.relation)
        case Comparison():
            return (constraint.left, constraint.right)
        case Check():
            return ()
        case _:
            return terms_of(constraint)


def subterms(terms: Sequence[Term]) -> list[Term]:
    """Return the given terms, and after each aggregate the terms inside it."""
    found: list[Term] = []
    for term in terms:
        found.append(term)
        if isinstance(term, Aggregate):
            found += subterms(terms_of(term.over))
    return found


def grouped_relations(body: Body) -> list[tuple[Relation, Aggregate | None]]:
    """Return the negated relations (with None) and the aggregated relations (with the aggregate), in text order.

    A relation's number is its position in this list.
    """
    found: list[tuple[Relation, Aggregate | None]] = []
    for constraint in body.constraints:
        if isinstance(constraint, Negation):
            found.append((constraint.relation, None))
        for term in subterms(constraint_terms(constraint)):
            if isinstance(term, Aggregate):
                found.append((term.over, term))
    return found


def positive_relations(body: Body) -> list[Relation]:
    """Return the relations that are constraints of a body by themselves, not inside a negation or an aggregate."""
    return [c for c in body.constraints if isinstance(c, TypeConstraint | PathConstraint | PatternCall)]


def relations_of(body: Body) -> Iterator[tuple[Relation, str]]:
    """Yield all relations of a body, each with its context: "neg", the name of an aggregate, or "" if positive."""
    yield from ((relation, "") for relation in positive_relations(body))
    yield from ((one, fold.function if fold else "neg") for one, fold in grouped_relations(body))


def expressions_of(body: Body) -> Iterator[tuple[Expression, Check | Evaluation]]:
    """Yield the expressions of all checks and evals with their owners, in the order of the text."""
    for constraint in body.constraints:
        if isinstance(constraint, Check):
            yield constraint.expression, constraint
        for term in subterms(constraint_terms(constraint)):
            if isinstance(term, Evaluation):
                yield term.expression, term


def children(expression: Expression) -> tuple[Expression, ...]:
    """Return the operands of an expression, in the order of the text. A chain `a + b - c` has three operands."""
    match expression:
        case Navigation():
            return (expression.object,)
        case Unary():
            return (expression.operand,)
        case Binary():
            first, links = expression.chain()
            return (first, *(link.right for link in links))
        case Conditional():
            return (expression.test, expression.then, expression.otherwise)
        case FunctionCall():
            return expression.arguments
        case _:
            return ()


def with_children(expression: Expression, parts: Sequence[Expression]) -> Expression:
    """Return a copy of an expression whose operands (see `children`) are replaced by `parts`."""
    match expression:
        case Navigation():
            return replace(expression, object=parts[0])
        case Unary():
            return replace(expression, operand=parts[0])
        case Binary():
            built, (_, links) = parts[0], expression.chain()
            for link, right in zip(links, parts[1:], strict=True):
                built = replace(link, left=built, right=right)
            return built
        case Conditional():
            return replace(expression, test=parts[0], then=parts[1], otherwise=parts[2])
        case FunctionCall():
            return replace(expression, arguments=tuple(parts))
        case _:
            return expression


def rewrite_expressions(data: Data, change: Callable[[Expression], Expression]) -> Data:
    """Return a definition, or a part of it, with its expressions rewritten.

    Return the same object if nothing changes, or if the data are nested too deeply.

    Args:
        data: frozen data, also tuples of frozen data.
        change: returns the replacement of an expression, whose operands have been replaced already.
    """
    try:
        return _rewrite_part(data, change)  # type: ignore[no-any-return]
    except RecursionError:  # too deeply nested expressions are reported by their check
        return data


def _rewrite_part(data: Any, change: Callable[[Expression], Expression]) -> Any:
    if isinstance(data, tuple):
        parts = tuple(_rewrite_part(part, change) for part in data)
        return data if _all_identical(parts, data) else parts
    if isinstance(data, Expression):
        operands = children(data)
        parts = tuple(_rewrite_part(part, change) for part in operands)
        return change(data if _all_identical(parts, operands) else with_children(data, parts))
    if not is_dataclass(data) or isinstance(data, type):
        return data
    changed = {}
    for part in fields(data):
        if part.compare:
            old = getattr(data, part.name)
            new = _rewrite_part(old, change)
            if new is not old:
                changed[part.name] = new
    return replace(data, **changed) if changed else data


def _all_identical(parts: Sequence[object], others: Sequence[object]) -> bool:
    return all(one is other for one, other in zip(parts, others, strict=True))


def variables_in(expression: Expression) -> Iterator[Variable]:
    """Yield the variables of an expression, every occurrence, in the order of the text."""
    if isinstance(expression, Variable):
        yield expression
    for child in children(expression):
        yield from variables_in(child)


def variables_of_terms(terms: Sequence[Term]) -> Iterator[Variable]:
    """Yield every occurrence of a variable in terms, also inside aggregates and evals."""
    for term in subterms(terms):
        if isinstance(term, Variable):
            yield term
        elif isinstance(term, Evaluation):
            yield from variables_in(term.expression)


def nesting_depth(expression: Expression) -> int:
    """Return the number of nesting levels. A chain with many operators, such as `a + b - c ...`, counts as one level.

    In a chain of at most `MAX_NESTED_OPERATORS` operators each operator is a level. No recursion is used, because deep
    input would exhaust the stack.
    """
    deepest = 0
    waiting = [(expression, 1)]
    while waiting:
        node, level = waiting.pop()
        deepest = max(deepest, level)
        parts = children(node)
        levels = len(parts) - 1 if isinstance(node, Binary) and len(parts) - 1 <= MAX_NESTED_OPERATORS else 1
        waiting += [(part, level + levels) for part in parts]
    return deepest


def expression_size(expression: Expression) -> int:
    """Return the number of operands and operators. No recursion is used, as in `nesting_depth`."""
    count = 0
    waiting = [expression]
    while waiting:
        parts = children(waiting.pop())
        count += max(1, len(parts) - 1)
        waiting += parts
    return count


def none_test_path(expression: Expression) -> Navigation | None:
    """Return the path in a test `x.f == none` or `x.f != none`. Return None for any other expression."""
    if isinstance(expression, Binary) and expression.operator in ("==", "!="):
        sides = (expression.left, expression.right)
        for side, other in (sides, sides[::-1]):
            if isinstance(side, Navigation) and isinstance(other, Constant) and other.value is None:
                return side
    return None


def base_of(path: Expression) -> tuple[Expression, tuple[str, ...]]:
    """Return the start of a path `x.f.g`, and its features in order."""
    features: list[str] = []
    while isinstance(path, Navigation):
        features.append(path.feature)
        path = path.object
    return path, tuple(reversed(features))


def required_paths(expression: Expression) -> list[Navigation]:
    """Return the longest paths that must have a value, each once. The path of a `none` test is excluded."""
    chain = none_test_path(expression) or expression
    if isinstance(chain, Navigation):
        base = base_of(chain)[0]
        found = dict.fromkeys([chain] if chain is expression else [])
        return list(found | dict.fromkeys(required_paths(base)))
    return list(dict.fromkeys(path for child in children(expression) for path in required_paths(child)))


def variable_occurrences(expression: Expression) -> Iterator[VariableOccurrence]:
    """Yield the occurrences of variables in an expression, also of `_`, in the order of the text.

    A variable is used positively at the start of a path, negatively in a `none` test, and else read.
    """
    if isinstance(expression, Variable):
        yield VariableOccurrence(expression, VariableUse.READ)
        return
    chain = none_test_path(expression) or expression
    if isinstance(chain, Navigation):
        base = base_of(chain)[0]
        if isinstance(base, Variable):
            yield VariableOccurrence(base, VariableUse.POSITIVE if chain is expression else VariableUse.NEGATIVE)
        else:
            yield from variable_occurrences(base)
        return
    for child in children(expression):
        yield from variable_occurrences(child)


def variable_names(expression: Expression) -> list[str]:
    """Return the names of the variables of an expression, once for each occurrence, without `_`."""
    return [o.variable.name for o in variable_occurrences(expression) if not o.variable.is_anonymous]


class BodyVariables:
    """The occurrences of every variable of a body, and the groups of variables that `==` between variables unites.

    Attributes:
        names: parameters first, then local variables in the order of the text; without `_`.
        occurrences: the occurrences by name, in the order of the text.
    """

    def __init__(self, body: Body, parameters: Sequence[Parameter]) -> None:
        self.body = body
        self.parameters = tuple(dict.fromkeys(parameter.name for parameter in parameters))
        self.occurrences: dict[str, list[VariableOccurrence]] = {name: [] for name in self.parameters}
        self._parent: dict[str, str] = {}
        self._relations = 0
        for constraint in body.constraints:
            self._read_constraint(constraint)
        self.names = tuple(self.occurrences)
        self._groups: dict[str, list[str]] = {}
        for name in self.names:
            self._groups.setdefault(self.representative(name), []).append(name)

    def _read_constraint(self, constraint: Constraint) -> None:
        match constraint:
            case Check():
                for occurrence in variable_occurrences(constraint.expression):
                    self._record(occurrence)
            case Negation():
                self._read_group(terms_of(constraint.relation))
            case Comparison():
                self._read_comparison(constraint)
            case _:
                self._read_terms(terms_of(constraint), VariableUse.POSITIVE)

    def _read_comparison(self, comparison: Comparison) -> None:
        left, right = comparison.left, comparison.right
        linked = isinstance(left, Variable) and isinstance(right, Variable)
        use = VariableUse.READ if linked or comparison.operator == "!=" else VariableUse.POSITIVE
        self._read_terms((left, right), use)
        if isinstance(left, Variable) and isinstance(right, Variable) and comparison.operator == "==":
            self._unite(left, right)

    def _read_terms(self, terms: Sequence[Term], use: VariableUse, relation: int | None = None) -> None:
        nested: list[Aggregate] = []
        for term in terms:
            match term:
                case Variable():
                    self._record(VariableOccurrence(term, use, relation))
                case Evaluation():
                    for occurrence in variable_occurrences(term.expression):
                        self._record(occurrence)
                case Aggregate():
                    nested.append(term)
                case _:
                    pass
        for aggregate in nested:
            self._read_group(terms_of(aggregate.over))

    def _read_group(self, terms: Sequence[Term]) -> None:
        number = self._relations
        self._relations += 1
        self._read_terms(terms, VariableUse.NEGATIVE, number)

    def _record(self, occurrence: VariableOccurrence) -> None:
        if not occurrence.variable.is_anonymous:
            self.occurrences.setdefault(occurrence.variable.name, []).append(occurrence)

    def _unite(self, left: Variable, right: Variable) -> None:
        if not left.is_anonymous and not right.is_anonymous:
            one, other = self.representative(left.name), self.representative(right.name)
            if one != other:
                self._parent[other] = one

    def representative(self, name: str) -> str:
        """Return the representative of the group of united variables that contains the name."""
        while name in self._parent:
            name = self._parent[name]
        return name

    def united_names(self, name: str) -> list[str]:
        """Return the names united with this one, the name included, in the order of `names`."""
        return self._groups[self.representative(name)]

    def quantifying_relation(self, name: str) -> int | None:
        """Return the number of the negated or aggregated relation that a variable is local to, or None.

        A variable is local to (quantified inside) a relation if it occurs nowhere else. Parameters and united variables
        are never local.
        """
        if name in self.parameters or len(self.united_names(name)) > 1:
            return None
        places = {(occurrence.use, occurrence.relation) for occurrence in self.occurrences[name]}
        if len(places) == 1:
            use, relation = places.pop()
            return relation if use is VariableUse.NEGATIVE else None
        return None

    def first_span(self, name: str) -> Span | None:
        """Return the span of the first occurrence of a variable in the body, or None."""
        return next((o.variable.span for o in self.occurrences[name] if o.variable.span), None)
