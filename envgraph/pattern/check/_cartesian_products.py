"""Report bodies with unconnected parts, whose matches are all combinations of the matches of the parts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from envgraph.errors import Diagnostic, Severity
from envgraph.pattern._expression_data import Binary, Constant, EnumLiteral, Expression, Navigation, Variable
from envgraph.pattern._occurrences import (
    BodyVariables,
    children,
    constraint_terms,
    expressions_of,
    grouped_relations,
    positive_relations,
    terms_of,
    variable_names,
)
from envgraph.pattern._query_data import Aggregate, Check, Comparison, Evaluation, Pattern, Term


class _Partition:
    """A partition of names into connected parts."""

    def __init__(self, names: Sequence[str]) -> None:
        self._parent = {name: name for name in names}

    def root(self, name: str) -> str:
        while self._parent[name] != name:
            name = self._parent[name]
        return name

    def unite(self, names: Sequence[str]) -> None:
        present = [name for name in names if name in self._parent]
        for name in present[1:]:
            self._parent[self.root(name)] = self.root(present[0])

    def parts(self) -> list[list[str]]:
        found: dict[str, list[str]] = {}
        for name in self._parent:
            found.setdefault(self.root(name), []).append(name)
        return list(found.values())

    def are_connected(self, names: Sequence[str]) -> bool:
        return len({self.root(name) for name in names if name in self._parent}) <= 1


class _VariablePartitions:
    """The connected parts of the variables of a body.

    Variables equal to constants and variables local to a negation or an aggregate are excluded. An eval or aggregate
    determines its result, so it connects the result with its sources if the sources are connected already.

    Attributes:
        by_any_constraint: the parts if constraints of all kinds connect variables.
        by_enumeration: the parts if only constraints that enumerate values connect variables, so no filters.
    """

    def __init__(self, reading: BodyVariables, pattern: Pattern) -> None:
        self._reading = reading
        constants = _fixed_variables(reading)
        roots = dict.fromkeys(
            reading.representative(name) for name in reading.names if reading.quantifying_relation(name) is None
        )
        names = [root for root in roots if root not in constants]
        self.by_any_constraint, self.by_enumeration = _Partition(names), _Partition(names)
        self._input_roots = [reading.representative(p.name) for p in pattern.parameters if p.direction == "in"]
        self._connect_variables()

    def _connect_variables(self) -> None:
        self._connect(self._input_roots)
        computed: list[tuple[list[str], list[str]]] = []
        for relation in positive_relations(self._reading.body):
            names = self._roots_of(terms_of(relation))
            self._connect(names)
            values = [t for t in terms_of(relation) if isinstance(t, Evaluation | Aggregate)]
            computed.extend((names, self._source_roots(value)) for value in values)
        for expression, owner in expressions_of(self._reading.body):
            if isinstance(owner, Check):
                for left, right in equations(expression):
                    self._connect(
                        [self._reading.representative(name) for name in (*variable_names(left), *variable_names(right))]
                    )
        for constraint in self._reading.body.constraints:
            everything = list(self._all_roots(constraint))
            self.by_any_constraint.unite(everything)
            if isinstance(constraint, Comparison) and constraint.operator == "==":
                sides = (constraint.left, constraint.right)
                computed.extend(
                    (self._roots_of([one]), self._source_roots(other)) for one, other in (sides, sides[::-1])
                )
        # A result is connected with its sources as soon as the sources are one part. Several rounds are needed, because
        # a result may connect the sources of another one.
        waiting, before = computed, -1
        while before != (before := len(waiting)):
            tied, waiting = waiting, []
            for result, sources in tied:
                if self.by_enumeration.are_connected(sources):
                    self.by_enumeration.unite([*sources, *result])
                else:
                    waiting.append((result, sources))

    def parts(self, partition: _Partition) -> list[list[str]]:
        """Return the parts that a search has to combine, which excludes parts that only contain `in` parameters."""
        return [part for part in partition.parts() if not set(part) <= set(self._input_roots)]

    def _connect(self, names: Sequence[str]) -> None:
        self.by_any_constraint.unite(names)
        self.by_enumeration.unite(names)

    def _roots_of(self, terms: Sequence[Term]) -> list[str]:
        return [self._reading.representative(t.name) for t in terms if isinstance(t, Variable) and not t.is_anonymous]

    def _source_roots(self, term: Term) -> list[str]:
        if isinstance(term, Evaluation):
            return [self._reading.representative(name) for name in variable_names(term.expression)]
        return self._roots_of(terms_of(term.over)) if isinstance(term, Aggregate) else []

    def _all_roots(self, constraint: object) -> Iterator[str]:
        match constraint:
            case Check():
                yield from (self._reading.representative(name) for name in variable_names(constraint.expression))
            case _:
                terms = constraint_terms(constraint)  # type: ignore[arg-type]
                yield from self._roots_of(terms)
                for term in terms:
                    yield from self._source_roots(term)


def equations(expression: Expression) -> Iterator[tuple[Expression, Expression]]:
    """Yield the sides of the conjuncts `a == b` of a check, of variables or paths, which connect them like a join."""
    if isinstance(expression, Binary) and expression.operator == "&&":
        for part in children(expression):
            yield from equations(part)
    elif isinstance(expression, Binary) and expression.operator == "==":
        sides = (expression.left, expression.right)
        if all(isinstance(side, Variable | Navigation) for side in sides):
            yield sides


def _fixed_variables(reading: BodyVariables) -> set[str]:
    """Return the variables with a fixed value: equal to a literal, or computed only from such variables."""
    equal = [
        (reading.representative(term.name), other)
        for constraint in reading.body.constraints
        if isinstance(constraint, Comparison) and constraint.operator == "=="
        for term, other in ((constraint.left, constraint.right), (constraint.right, constraint.left))
        if isinstance(term, Variable) and not term.is_anonymous
    ]
    fixed: set[str] = set()
    before = -1
    while before != (before := len(fixed)):
        fixed |= {name for name, other in equal if _is_fixed(other, reading, fixed)}
    return fixed


def _is_fixed(term: Term, reading: BodyVariables, fixed: Collection[str]) -> bool:
    """Return True if a term is a literal, an eval of variables in `fixed`, or an aggregate over all tuples."""
    if isinstance(term, Evaluation):
        return all(reading.representative(name) in fixed for name in variable_names(term.expression))
    if isinstance(term, Aggregate):
        numbers = {id(relation): number for number, (relation, _) in enumerate(grouped_relations(reading.body))}
        number = numbers[id(term.over)]
        return not any(
            isinstance(t, Variable) and not t.is_anonymous and reading.quantifying_relation(t.name) != number
            for t in terms_of(term.over)
        )
    return isinstance(term, Constant | EnumLiteral)


def check_connected(reading: BodyVariables, pattern: Pattern, few_valued: Collection[str]) -> Iterator[Diagnostic]:
    """Warn if the body is a Cartesian product, or if its parts are connected only by constraints that filter.

    Args:
        reading: the body.
        pattern: the pattern of the body.
        few_valued: variables with so few values that trying all combinations is acceptable.
    """
    partitions = _VariablePartitions(reading, pattern)
    span = reading.body.span if len(pattern.bodies) > 1 and reading.body.span else pattern.span
    parts = partitions.parts(partitions.by_any_constraint)
    if len(parts) > 1:
        message = f"the constraints fall into unconnected parts: {_format_parts(parts)}"
        hint = "link the parts by a path or `find`: every match of one is combined with every match of the others"
        yield Diagnostic("cartesian-product", message, span, hint, Severity.WARNING)
        return
    parts = [part for part in partitions.parts(partitions.by_enumeration) if not set(part).issubset(few_valued)]
    if len(parts) > 1:
        message = f"only filters connect the parts: {_format_parts(parts)}"
        hint = "link the parts by a path or `find`, because `!=`, `neg`, check and aggregates only filter"
        yield Diagnostic("loose-connection", message, span, hint, Severity.WARNING)


def _format_parts(parts: Sequence[Sequence[str]]) -> str:
    return ", ".join("{" + ", ".join(part) + "}" for part in parts)
