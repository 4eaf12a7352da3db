"""Find the variables of a body whose values can be enumerated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from envgraph.metamodel import AttributeType, EnumType, Metamodel
from envgraph.pattern._expression_data import Variable
from envgraph.pattern._goals import ObjectType
from envgraph.pattern._occurrences import (
    VariableUse,
    expressions_of,
    grouped_relations,
    positive_relations,
    terms_of,
    variable_names,
    variable_occurrences,
)
from envgraph.pattern._query_data import (
    Aggregate,
    ColumnMark,
    Comparison,
    Evaluation,
    Parameter,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
)
from envgraph.pattern._type_inference import BodyTypes
from envgraph.pattern._types import static_type


class Binding:
    """The set of variables of a body whose values can be enumerated.

    Positive relations bind their variables. An eval or aggregate binds its result as soon as all variables that it
    reads are bound. A call of a pattern with `in` parameters binds its other arguments as soon as the `in` arguments
    are bound.

    Args:
        body_types: the body with its types.
        parameters: the parameters of the pattern.
        given: names of parameters that the caller binds.
        by_type: True if the type of a variable may enumerate its values; see `enumerated_by_type`.
    """

    def __init__(
        self,
        body_types: BodyTypes,
        parameters: Sequence[Parameter],
        given: Sequence[str],
        by_type: bool = True,
    ) -> None:
        self._types = body_types
        self._enumerates_by_type = by_type
        self._reading = body_types.reading
        self._groups = {id(rel): number for number, (rel, _) in enumerate(grouped_relations(self._reading.body))}
        self._input_roots = {self._reading.representative(one.name) for one in parameters if one.direction == "in"}
        self.bound = {self._reading.representative(name) for name in given}
        self.bound.update(self._reading.representative(name) for name in self._initially_bound(parameters))
        before = -1
        while before < len(self.bound):
            before = len(self.bound)
            self._bind_by_relations()
            self._bind_by_comparisons()

    def binds(self, name: str) -> bool:
        """Return True if the values of a variable can be enumerated, by the body or because the caller binds it."""
        return self._reading.representative(name) in self.bound

    def _initially_bound(self, parameters: Sequence[Parameter]) -> Iterator[str]:
        for parameter in parameters:
            if parameter.type in self._types.metamodel.classes or (
                self._enumerates_by_type and declared_enum(parameter, self._types.metamodel)
            ):
                yield parameter.name
        for expression, _ in expressions_of(self._reading.body):
            for occurrence in variable_occurrences(expression):
                if occurrence.use is VariableUse.POSITIVE and not occurrence.variable.is_anonymous:
                    yield occurrence.variable.name

    def _bind_by_relations(self) -> None:
        for relation in positive_relations(self._reading.body):
            terms = terms_of(relation)
            if is_data_type(relation, self._types.metamodel):
                if self._enumerates_by_type and self._root_of(terms[0]) not in self._input_roots:
                    self._bind(terms[0])
                continue
            if all(self._is_bound(terms[position]) for position in inputs_of(relation, self._types)):
                for term in terms:
                    self._bind(term)

    def _bind_by_comparisons(self) -> None:
        for constraint in self._reading.body.constraints:
            if isinstance(constraint, Comparison) and constraint.operator == "==":
                for term, other in ((constraint.left, constraint.right), (constraint.right, constraint.left)):
                    if not isinstance(other, Variable) and self._is_bound(other):
                        self._bind(term)

    def _root_of(self, term: Term) -> str | None:
        return self._reading.representative(term.name) if isinstance(term, Variable) and not term.is_anonymous else None

    def _bind(self, term: Term) -> None:
        root = self._root_of(term)
        if root is not None:
            self.bound.add(root)

    def _is_bound(self, term: Term) -> bool:
        match term:
            case Variable():
                return not term.is_anonymous and self.binds(term.name)
            case Evaluation():
                return all(self.binds(name) for name in variable_names(term.expression))
            case Aggregate():
                number = self._groups[id(term.over)]
                return all(
                    self._is_local(argument, number) or self._is_bound(argument) for argument in terms_of(term.over)
                )
            case _:
                return True

    def _is_local(self, term: Term, number: int) -> bool:
        if isinstance(term, Variable):
            return term.is_anonymous or self._reading.quantifying_relation(term.name) == number
        return isinstance(term, ColumnMark)


def declared_enum(parameter: Parameter, metamodel: Metamodel) -> EnumType | None:
    """Return the enum that is the declared type of a parameter. None for other types and for `in` parameters."""
    if parameter.type is None or parameter.direction == "in":
        return None
    type_ = static_type(parameter.type, metamodel)
    return type_ if isinstance(type_, EnumType) else None


def enumerated_by_type(body_types: BodyTypes, parameters: Sequence[Parameter]) -> tuple[tuple[str, AttributeType], ...]:
    """Return the variables that only their type enumerates, each with the type.

    The type is a data type or an enum, from a type constraint (`Kind(k)`, `int(n)`) or, for an enum, from the
    declaration of a parameter that is not `in`. The variable takes all values of this type that occur in the model.
    """
    metamodel, reading = body_types.metamodel, body_types.reading
    found: list[tuple[str, AttributeType]] = [
        (p.name, enum) for p in parameters if (enum := declared_enum(p, metamodel))
    ]
    for relation in positive_relations(reading.body):
        if isinstance(relation, TypeConstraint) and isinstance(relation.term, Variable):
            type_ = static_type(relation.type, metamodel)
            if not (type_ is None or isinstance(type_, ObjectType) or relation.term.is_anonymous):
                found.append((relation.term.name, type_))
    if not found:
        return ()
    given = [parameter.name for parameter in parameters if parameter.direction == "in"]
    others = Binding(body_types, parameters, given, by_type=False)
    unbound = {reading.representative(name): (name, type_) for name, type_ in reversed(found) if not others.binds(name)}
    return tuple(reversed(unbound.values()))


def is_data_type(relation: Relation, metamodel: Metamodel) -> bool:
    """Return True if a relation is a type constraint with a data type or an enum, such as `int(n)`."""
    if not isinstance(relation, TypeConstraint):
        return False
    type_ = static_type(relation.type, metamodel)
    return type_ is not None and not isinstance(type_, ObjectType)


def inputs_of(relation: Relation, body_types: BodyTypes) -> tuple[int, ...]:
    """Return the positions of the arguments that must be bound before a relation can be evaluated.

    Only a call of a pattern with inputs has such positions, if the number of its arguments is correct.
    """
    if not isinstance(relation, PatternCall):
        return ()
    signature = body_types.callee(relation.pattern)
    if signature is None or len(signature.types) != len(relation.arguments):
        return ()
    return signature.inputs
