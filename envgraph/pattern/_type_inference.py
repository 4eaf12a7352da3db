"""Infer the types of the variables of a body from the places where they occur."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Metamodel, Scalar
from envgraph.pattern._expression_data import Constant, EnumLiteral, Variable
from envgraph.pattern._feature_paths import ResolvedPath, closure_target_type, resolve_path
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import BodyVariables, grouped_relations, terms_of, variables_in
from envgraph.pattern._query_data import (
    Aggregate,
    Closure,
    ColumnMark,
    Comparison,
    Evaluation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
)
from envgraph.pattern._types import are_comparable, meet, static_type, value_type
from envgraph.pattern.expressions._expression_types import ExpressionChecker


@dataclass(frozen=True, slots=True)
class PatternSignature:
    """The interface of a pattern for its callers: its parameter types (None if unknown), and the positions to bind."""

    pattern: Pattern
    types: tuple[StaticType | None, ...]
    inputs: tuple[int, ...] = ()


CalleeLookup = Callable[[str], PatternSignature | None]
"""Returns the signature of a called pattern by the name in the call, or None if not found (reported elsewhere)."""


@dataclass(frozen=True, slots=True)
class TypeFact:
    """A place in a body that gives a type to a term.

    Attributes:
        origin: "declaration", "constraint", "call" or "value"; "value" means an eval or an aggregate.
        description: the text for the place in messages.
    """

    term: Term
    type: StaticType
    origin: str
    description: str
    span: Span | None = None


class BodyTypes:
    """The static types of the variables of a body, as far as the body determines them.

    Attributes:
        types: by variable name; united variables share a type.
        facts: every place that gave a type, in the order of the text.
    """

    def __init__(
        self,
        reading: BodyVariables,
        parameters: Sequence[Parameter],
        metamodel: Metamodel,
        callee: CalleeLookup,
    ) -> None:
        self.reading = reading
        self.metamodel = metamodel
        self.callee = callee
        self._declared = list(_declared_facts(parameters, metamodel))
        self._roots: dict[str, StaticType] = {}
        self.facts: list[TypeFact] = []
        # The types from an arrow, an eval or a union depend on the types of other variables, so each link of such a
        # chain may need one more round. Each round but the last gives at least one variable a better type.
        for _ in range(2 * len(reading.names) + 2):
            before = self._roots
            self.facts = self._collect_facts()
            self._roots = self._combine_facts()
            if self._roots == before:
                break
        self._add_quantified_types()

    @property
    def types(self) -> Mapping[str, StaticType | None]:
        """Return the type of every variable by name, None where unknown."""
        return {name: self.type_of(name) for name in self.reading.names}

    def type_of(self, name: str) -> StaticType | None:
        """Return the type of a variable, or None if unknown."""
        return self._roots.get(self.reading.representative(name))

    def type_of_term(self, term: Term) -> StaticType | None:
        """Return the type of an argument. None if unknown, and for `_`, `#` and an enum literal without its enum."""
        match term:
            case Variable():
                return None if term.is_anonymous else self.type_of(term.name)
            case Constant():
                return None if term.value is None else value_type(term.value)
            case EnumLiteral():
                return self.metamodel.enums.get(term.enum) if term.enum else None
            case Evaluation():
                scope = {
                    one.name: self.type_of(one.name) for one in variables_in(term.expression) if not one.is_anonymous
                }
                return ExpressionChecker(scope, self.metamodel, False).type_of(term.expression)
            case Aggregate():
                return self.aggregate_type(term)
            case ColumnMark():
                return None

    def resolved_path(self, path: PathConstraint) -> ResolvedPath | None:
        """Return the resolved path of a constraint, or None if its class or a feature is unknown.

        If the path names no class, it starts at the class of its source. With a closure it then starts at the class
        that owns its first feature, because later steps may start at other objects with the feature.
        """
        cls: str | None = path.type
        if not cls:
            source = self.type_of_term(path.source)
            cls = source.cls if isinstance(source, ObjectType) else None
            if cls in self.metamodel.classes and path.features and path.closure is not Closure.ONCE:
                feature = self.metamodel.feature(cls or "", path.features[0])
                cls = feature.owner if feature else cls
        if cls is None or cls not in self.metamodel.classes or not path.features:
            return None
        resolved = resolve_path(cls, path.features, self.metamodel)
        return resolved if isinstance(resolved, ResolvedPath) else None

    def column_types(self, relation: Relation) -> list[StaticType | None]:
        """Return the types that a relation requires of its arguments, None where unknown."""
        match relation:
            case TypeConstraint():
                return [static_type(relation.type, self.metamodel)]
            case PathConstraint():
                path = self.resolved_path(relation)
                if path is None:
                    known = relation.type in self.metamodel.classes
                    return [ObjectType(relation.type) if known else None, None]
                return [
                    path.source,
                    closure_target_type(path.source, path.target, relation.closure, self.metamodel),
                ]
            case PatternCall():
                return self._call_column_types(relation)

    def allows_tuple(self, relation: Relation) -> bool:
        """Return True if a relation may contain tuples of the argument types. A number is never equal to an object."""
        arguments = zip(map(self.type_of_term, terms_of(relation)), self.column_types(relation), strict=True)
        return all(
            own is None or type_ is None or are_comparable(own, type_, self.metamodel) for own, type_ in arguments
        )

    def _call_column_types(self, call: PatternCall) -> list[StaticType | None]:
        signature = self.callee(call.pattern)
        if signature is None or len(signature.types) != len(call.arguments):
            return [None] * len(call.arguments)
        types = list(signature.types)
        if call.closure is Closure.STAR and len(types) == 2 and types[0] and types[1]:
            types[1] = closure_target_type(types[0], types[1], call.closure, self.metamodel)
        return types

    def aggregate_type(self, aggregate: Aggregate) -> StaticType | None:
        """Return the type of an aggregate's result, for sum, min and max the column's type. None if unknown."""
        if aggregate.function == "count":
            return Scalar.INT
        if aggregate.function == "avg":
            return Scalar.FLOAT
        arguments = zip(terms_of(aggregate.over), self.column_types(aggregate.over), strict=True)
        return next((type_ for term, type_ in arguments if isinstance(term, ColumnMark)), None)

    def _collect_facts(self) -> list[TypeFact]:
        facts = list(self._declared)
        for constraint in self.reading.body.constraints:
            if isinstance(constraint, Comparison):
                if constraint.operator == "==":
                    facts.extend(self._comparison_facts(constraint))
            elif isinstance(constraint, TypeConstraint | PathConstraint | PatternCall):
                facts.extend(self._relation_facts(constraint))
        return facts

    def _relation_facts(self, relation: Relation) -> Iterator[TypeFact]:
        origin = "call" if isinstance(relation, PatternCall) else "constraint"
        for term, type_ in zip(terms_of(relation), self.column_types(relation), strict=True):
            if type_ is not None:
                yield TypeFact(term, type_, origin, relation_text(relation), term.span or relation.span)

    def _comparison_facts(self, comparison: Comparison) -> Iterator[TypeFact]:
        for term, other in ((comparison.left, comparison.right), (comparison.right, comparison.left)):
            if isinstance(term, Variable) and isinstance(other, Evaluation | Aggregate):
                type_ = self.type_of_term(other)
                if type_ is not None:
                    yield TypeFact(term, type_, "value", "this value", other.span or comparison.span)

    def _combine_facts(self) -> dict[str, StaticType]:
        roots: dict[str, StaticType] = {}
        for fact in self.facts:
            if isinstance(fact.term, Variable) and not fact.term.is_anonymous:
                root = self.reading.representative(fact.term.name)
                both = meet(roots[root], fact.type, self.metamodel) if root in roots else fact.type
                roots[root] = both or roots[root]
        for constraint in self.reading.body.constraints:
            # A number may be an int or a float, so a literal only decides the type of a variable without another type.
            if isinstance(constraint, Comparison) and constraint.operator == "==":
                for term, other in ((constraint.left, constraint.right), (constraint.right, constraint.left)):
                    if (
                        isinstance(term, Variable)
                        and not term.is_anonymous
                        and isinstance(other, Constant | EnumLiteral)
                    ):
                        type_ = self.type_of_term(other)
                        if type_ is not None:
                            roots.setdefault(self.reading.representative(term.name), type_)
        return roots

    def _add_quantified_types(self) -> None:
        """Infer and store the types of variables that are local to a negation or aggregate, from its relation."""
        for number, (relation, _) in enumerate(grouped_relations(self.reading.body)):
            for term, type_ in zip(terms_of(relation), self.column_types(relation), strict=True):
                if not isinstance(term, Variable) or term.is_anonymous or type_ is None:
                    continue
                if self.reading.quantifying_relation(term.name) == number:
                    known = self._roots.get(term.name, type_)
                    self._roots[term.name] = meet(known, type_, self.metamodel) or known


def _declared_facts(parameters: Sequence[Parameter], metamodel: Metamodel) -> Iterator[TypeFact]:
    for parameter in parameters:
        type_ = static_type(parameter.type, metamodel)
        if type_ is not None:
            variable = Variable(parameter.name, parameter.span)
            yield TypeFact(variable, type_, "declaration", f"parameter `{parameter.name}`", parameter.span)


def relation_text(relation: Relation) -> str:
    """Return the name of a relation for messages."""
    match relation:
        case TypeConstraint():
            return f"`{relation.type}`"
        case PathConstraint():
            return f"`{'.'.join([*([relation.type] if relation.type else []), *relation.features])}`"
        case PatternCall():
            return f"`{relation.pattern}`"
