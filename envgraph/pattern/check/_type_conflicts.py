"""Check that all occurrences of a variable agree about its type."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from envgraph.errors import Diagnostic, Note, Severity, Span, quote_with_article
from envgraph.metamodel import EnumType, Scalar
from envgraph.pattern._expression_data import Constant, EnumLiteral, Variable
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import terms_of
from envgraph.pattern._query_data import Aggregate, Comparison, Evaluation, Term
from envgraph.pattern._type_inference import BodyTypes, TypeFact, relation_text
from envgraph.pattern._types import (
    are_comparable,
    common_subclasses,
    enum_hint,
    have_common_instances,
    is_assignable,
    is_literal_assignable,
    is_subtype,
    meet,
    type_text,
    value_hint,
    value_type,
)
from envgraph.pattern.check._relation_check import RelationPlace
from envgraph.pattern.expressions._expression_types import ExpressionChecker

_EMPTY_HINTS: Final = {
    "": "correct the argument: the negation always holds now",
    "count": "correct the argument: the count is always 0 now",
    "sum": "correct the argument: the sum is always 0 now",
}


class TypeCheck:
    """The check for type errors of one body.

    Args:
        body_types: the body with its types.
        tainted: variables about which another error has been reported already.

    Attributes:
        contradicted_names: the variables that `check_conflicts` has reported.
    """

    def __init__(self, body_types: BodyTypes, tainted: set[str]) -> None:
        self._types = body_types
        self._reading = body_types.reading
        self._metamodel = body_types.metamodel
        self.contradicted_names: list[str] = []
        self._tainted = {self._reading.representative(name) for name in tainted if name in self._reading.occurrences}

    def check_conflicts(self) -> Iterator[Diagnostic]:
        """Report variables that need two incompatible types, but only the first contradiction of each variable."""
        first: dict[str, TypeFact] = {}
        met: dict[str, StaticType] = {}
        contradicted = set(self._tainted)
        for fact in self._types.facts:
            if not isinstance(fact.term, Variable) or fact.term.is_anonymous:
                continue
            root = self._reading.representative(fact.term.name)
            if root in contradicted:
                continue
            if root not in met:
                first[root], met[root] = fact, fact.type
                continue
            both = meet(met[root], fact.type, self._metamodel)
            if both is None:
                contradicted.add(root)
                self.contradicted_names.append(fact.term.name)
                yield self._conflict_error(fact, first[root], met[root])
            else:
                met[root] = both
                if both != first[root].type and both == fact.type:
                    first[root] = fact

    def _conflict_error(self, fact: TypeFact, earlier: TypeFact, type_: StaticType) -> Diagnostic:
        assert isinstance(fact.term, Variable)
        name = fact.term.name
        hint = None
        if {type_, fact.type} == {Scalar.INT, Scalar.FLOAT}:
            hint = "convert the int with `eval(toFloat(..))`: an int variable is never equal to a float variable"
            if earlier.origin == "declaration" and fact.origin == "value":
                hint = f"write `{name} : {type_text(fact.type)}`"
        notes = (Note(f"`{type_text(type_)}` because of {earlier.description}", earlier.span),)
        earlier_type, later_type = (
            quote_with_article(type_text(type_)),
            quote_with_article(type_text(fact.type)),
        )
        link = self._uniting_comparison(earlier.term, fact.term)
        if link is not None:
            assert isinstance(earlier.term, Variable)
            both = (*notes, Note(f"`{type_text(fact.type)}` because of {fact.description}", fact.span))
            message = f"`{earlier.term.name}`, {earlier_type}, is never equal to `{name}`, {later_type}"
            hint = hint or "compare with a variable of the same type"
            return Diagnostic("type-conflict", message, link.span, hint, notes=both)
        if fact.origin == "call":
            message = f"{fact.description} takes {later_type} here, but `{name}` is {earlier_type}"
            hint = hint or f"write a variable that stands for {later_type}, or change the type of `{name}`"
            return Diagnostic("argument-type", message, fact.span, hint, notes=notes)
        if earlier.span == fact.span:
            other = f"`{type_text(fact.type)}` because of {fact.description}"
            notes = (Note(f"`{type_text(type_)}` because of {earlier.description}, {other}"),)
        message = f"`{name}` cannot be both {earlier_type} and {later_type}"
        hint = hint or "use another variable for one of them"
        return Diagnostic("type-conflict", message, fact.span, hint, notes=notes)

    def _uniting_comparison(self, one: Term, other: Variable) -> Comparison | None:
        """Return the comparison `==` that unites two variables of different names, `one` and `other`, or None."""
        if isinstance(one, Variable) and one.name != other.name:
            for constraint in self._reading.body.constraints:
                if isinstance(constraint, Comparison) and constraint.operator == "==":
                    sides = (constraint.left, constraint.right)
                    names = {side.name for side in sides if isinstance(side, Variable)}
                    if other.name in names and len(names) == 2:
                        return constraint
        return None

    def ambiguous_types(self, name: str) -> list[StaticType]:
        """Return the classes that a variable must have, if its inferred class does not imply them all; else []."""
        found: list[StaticType] = []
        root = self._reading.representative(name)
        for fact in self._types.facts:
            if not isinstance(fact.term, Variable) or self._reading.representative(fact.term.name) != root:
                continue
            if not any(is_subtype(type_, fact.type, self._metamodel) for type_ in found):
                found = [t for t in found if not is_subtype(fact.type, t, self._metamodel)] + [fact.type]
        actual = self._types.type_of(name)
        if len(found) < 2 or actual is None or all(is_subtype(actual, t, self._metamodel) for t in found):
            return []
        return found

    def check_arguments(self, place: RelationPlace) -> Iterator[Diagnostic]:
        """Report literals, evals and aggregates of a wrong type as arguments of a relation.

        For a negated or aggregated relation also warn about arguments of a type that it never matches.
        """
        for term, type_ in zip(terms_of(place.relation), self._types.column_types(place.relation), strict=True):
            span = term.span or place.relation.span
            if isinstance(term, Constant | EnumLiteral):
                yield from self.check_literal(term, type_, span)
            elif type_ is None:
                continue
            elif place.group is None:
                if isinstance(term, Evaluation | Aggregate):
                    yield from self._check_value(term, type_, span)
            else:
                yield from self._check_never_matching(place, term, type_, span)

    def _check_value(self, term: Evaluation | Aggregate, type_: StaticType, span: Span | None) -> Iterator[Diagnostic]:
        actual = self._types.type_of_term(term)
        if actual is not None and not is_assignable(actual, type_, self._metamodel):
            message = f"expected `{type_text(type_)}`, found `{type_text(actual)}`"
            yield Diagnostic("wrong-type", message, span, value_hint(type_, actual))

    def _check_never_matching(
        self, place: RelationPlace, term: Term, type_: StaticType, span: Span | None
    ) -> Iterator[Diagnostic]:
        if isinstance(term, Variable) and (
            term.is_anonymous or self._reading.representative(term.name) in self._tainted
        ):
            return
        actual = self._types.type_of_term(term)
        if actual is None or are_comparable(actual, type_, self._metamodel):
            return
        wanted, found = quote_with_article(type_text(type_)), quote_with_article(type_text(actual))
        message = f"{relation_text(place.relation)} takes {wanted} here, so {found} never matches"
        function = place.aggregate.function if place.aggregate else ""
        hint = _EMPTY_HINTS.get(function, f"correct the argument: `{function}` of no values has no result")
        yield Diagnostic("never-matches", message, span, hint, Severity.WARNING)

    def check_literal(
        self, term: Constant | EnumLiteral, type_: StaticType | None, span: Span | None
    ) -> Iterator[Diagnostic]:
        """Report a literal that does not fit the expected type. If that is None (unknown), check only its enum."""
        if isinstance(term, EnumLiteral):
            yield from self._check_enum_literal(term, type_, span)
            return
        if term.value is None or type_ is None or is_literal_assignable(term.value, type_):
            return
        hint = None
        if isinstance(type_, EnumType) and isinstance(term.value, str):
            hint = enum_hint(term.value, type_)
        hint = hint or value_hint(type_)
        text = type_text(type_)
        expected = f"{quote_with_article(text)} object" if isinstance(type_, ObjectType) else f"`{text}`"
        message = f"expected {expected}, found `{type_text(value_type(term.value))}`"
        yield Diagnostic("wrong-type", message, span, hint)

    def _check_enum_literal(
        self, term: EnumLiteral, type_: StaticType | None, span: Span | None
    ) -> Iterator[Diagnostic]:
        if type_ is None and term.enum is None:
            return
        scope: Mapping[str, StaticType | None] = {}
        checker = ExpressionChecker(scope, self._metamodel, False)
        actual = checker.literal_type(term, type_)
        yield from checker.problems
        if actual is not None and type_ is not None and actual != type_:
            message = f"expected `{type_text(type_)}`, found the enum `{type_text(actual)}`"
            yield Diagnostic("wrong-enum", message, term.enum_span or span, value_hint(type_))

    def check_comparison(self, comparison: Comparison) -> Iterator[Diagnostic]:
        """Report comparisons of values whose types cannot be equal, and wrong enum literals in comparisons."""
        left, right = comparison.left, comparison.right
        if isinstance(left, Constant) and isinstance(right, Constant):
            yield from self._check_constants(left, right, comparison)
        for term, other in ((left, right), (right, left)):
            if isinstance(term, Constant | EnumLiteral):
                if isinstance(other, Constant | EnumLiteral):  # the comparison itself gets another warning
                    if isinstance(term, EnumLiteral):
                        yield from self.check_literal(term, self._types.type_of_term(other), term.span)
                elif not self._is_tainted(other):
                    yield from self._check_compared_literal(term, other, comparison)
                else:
                    yield from self.check_literal(term, None, term.span)
        if not isinstance(left, Constant | EnumLiteral) and not isinstance(right, Constant | EnumLiteral):
            yield from self._check_values(comparison)

    def _check_constants(self, left: Constant, right: Constant, comparison: Comparison) -> Iterator[Diagnostic]:
        one, other = self._types.type_of_term(left), self._types.type_of_term(right)
        if one and other and not are_comparable(one, other, self._metamodel):
            message = f"`{comparison.operator}` cannot compare `{type_text(one)}` with `{type_text(other)}`"
            hint = f"compare {quote_with_article(type_text(one))} with another one"
            yield Diagnostic("type-conflict", message, comparison.span, hint)

    def _check_compared_literal(
        self, term: Constant | EnumLiteral, other: Term, comparison: Comparison
    ) -> Iterator[Diagnostic]:
        type_ = self._types.type_of_term(other)
        if type_ is None and isinstance(term, EnumLiteral) and term.enum is None:
            message = f"the enum of `::{term.literal}` is not known here"
            yield Diagnostic("unknown-enum", message, term.span or comparison.span, "write the enum before `::`")
            return
        yield from self.check_literal(term, type_, term.span or comparison.span)

    def _check_values(self, comparison: Comparison) -> Iterator[Diagnostic]:
        left, right = comparison.left, comparison.right
        one, other = self._types.type_of_term(left), self._types.type_of_term(right)
        if one is None or other is None or self._is_tainted(left) or self._is_tainted(right):
            return
        computed = isinstance(left, Evaluation | Aggregate), isinstance(right, Evaluation | Aggregate)
        if comparison.operator == "==" and not all(computed):
            return  # the variable takes the type of the other side, and `check_conflicts` checks it
        if not have_common_instances(one, other, self._metamodel):
            if comparison.operator == "==":
                message = f"`==` cannot compare `{type_text(one)}` with `{type_text(other)}`"
                hint = f"compare {quote_with_article(type_text(one))} with another one"
                yield Diagnostic("type-conflict", message, comparison.span, hint)
            elif not are_comparable(one, other, self._metamodel):
                message = f"{quote_with_article(type_text(one))} is never {quote_with_article(type_text(other))}"
                hint = "this always holds: leave it out"
                yield Diagnostic("always-different", message, comparison.span, hint, Severity.WARNING)

    def _is_tainted(self, term: Term) -> bool:
        return isinstance(term, Variable) and self._reading.representative(term.name) in self._tainted


def shared_classes(types: list[StaticType], body_types: BodyTypes) -> list[str]:
    """Return the names of the concrete classes whose objects are instances of all classes among `types`."""
    classes = [type_.cls for type_ in types if isinstance(type_, ObjectType)]
    shared = common_subclasses(classes[0], classes[0], body_types.metamodel)
    return [name for name in shared if all(body_types.metamodel.is_a(name, cls) for cls in classes)]
