"""Check single relations: their names, the number and kind of their arguments, and their closures and aggregates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import (
    Diagnostic,
    Severity,
    Span,
    did_you_mean,
    has_errors,
    name_hint,
    quote_with_article,
)
from envgraph.metamodel import Metamodel, Reference, Scalar
from envgraph.pattern._analysis import PatternNames
from envgraph.pattern._expression_data import Constant, Variable
from envgraph.pattern._feature_paths import (
    InvalidPath,
    ResolvedPath,
    closure_target_type,
    resolve_path,
)
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import BodyVariables, terms_of
from envgraph.pattern._query_data import (
    Aggregate,
    Closure,
    ColumnMark,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
)
from envgraph.pattern._type_inference import BodyTypes, PatternSignature
from envgraph.pattern._types import NUMBERS, have_common_instances, static_type, type_hint, type_text
from envgraph.pattern.expressions._expression_types import subclass_hint

_ONCE_VERBS: Final = {"count": "counted", "sum": "added", "avg": "taken"}
"""The aggregates whose result depends on duplicates, and the verb for messages."""


@dataclass(frozen=True, slots=True)
class RelationPlace:
    """A relation of a body, and where it occurs.

    Attributes:
        group: its number among the negated and aggregated relations of the body; None for a positive relation.
        aggregate: the aggregate over it, or None.
    """

    relation: Relation
    group: int | None = None
    aggregate: Aggregate | None = None


class RelationCheck:
    """The check of the relations of one body.

    Args:
        pattern: the pattern.
        body_types: the body with its types.
        names: the lookup of all patterns by name.
    """

    def __init__(self, pattern: Pattern, body_types: BodyTypes, names: PatternNames) -> None:
        self._pattern = pattern
        self._types = body_types
        self._names = names
        self._metamodel: Metamodel = body_types.metamodel
        self._reading: BodyVariables = body_types.reading

    def problems(self, place: RelationPlace) -> list[Diagnostic]:
        """Return the diagnostics of a relation."""
        match place.relation:
            case TypeConstraint():
                found = list(self._check_type(place.relation, place))
            case PathConstraint():
                found = list(self._check_path(place.relation))
            case PatternCall():
                found = list(self._check_call(place.relation))
        found.extend(self._check_arguments(place))
        if not has_errors(found):
            found.extend(self._check_closure(place))
        if not has_errors(found) and place.aggregate:
            found.extend(self._check_aggregate(place.aggregate))
        return found

    # --- names

    def _check_type(self, constraint: TypeConstraint, place: RelationPlace) -> Iterator[Diagnostic]:
        span = constraint.type_span or constraint.span
        type_ = static_type(constraint.type, self._metamodel)
        if type_ is None:
            yield self._unknown_type_error(constraint.type, span)
        elif place.group is not None and not isinstance(type_, ObjectType):
            what = "aggregated" if place.aggregate else "negated"
            message = f"`{constraint.type}` is a data type, which cannot be {what}"
            hint = "write a class, or a path to the value: `Class.feature(object, value)`"
            if not place.aggregate:
                hint = "write a class, or compare the value in `check(..)`"
            yield Diagnostic("data-type-group", message, span, hint)

    def _unknown_type_error(self, name: str, span: Span | None) -> Diagnostic:
        hint = type_hint(name, self._metamodel)
        if name in self._names.visible_names(self._pattern.package, self._pattern):
            hint = f"`{name}` is a pattern: write `find {name}(..)`"
        return Diagnostic("unknown-type", f"unknown type `{name}`", span, hint)

    def _check_path(self, path: PathConstraint) -> Iterator[Diagnostic]:
        if not isinstance(path.source, Variable):
            span = getattr(path.source, "span", None) or path.span
            hint = "name the object that has the feature: `Class.feature(object, value)`"
            yield Diagnostic("path-source", "a path starts at a variable, not at a value", span, hint)
            return
        cls = path.type or self._source_class(path)
        if cls is None:
            yield self._untyped_source_error(path)
            return
        if cls not in self._metamodel.classes:
            span = path.type_span or path.span
            if static_type(cls, self._metamodel) is None:
                yield self._unknown_type_error(cls, span)
            else:
                hint = "write the class that has the feature: `Class.feature(object, value)`"
                message = f"`{cls}` is a data type: a path starts at a class"
                yield Diagnostic("unknown-type", message, span, hint)
            return
        if not path.features:
            yield Diagnostic("empty-path", "a path needs a feature", path.span, f"write `{cls}.feature(..)`")
            return
        resolved = resolve_path(cls, path.features, self._metamodel)
        if isinstance(resolved, InvalidPath):
            yield self._broken_path_error(path, resolved)

    def _source_class(self, path: PathConstraint) -> str | None:
        source = self._types.type_of_term(path.source)
        return source.cls if isinstance(source, ObjectType) else None

    def _untyped_source_error(self, path: PathConstraint) -> Diagnostic:
        assert isinstance(path.source, Variable)
        name, type_ = path.source.name, self._types.type_of_term(path.source)
        span = path.source.span or path.span
        if type_ is not None:
            message = f"`{name}` is {quote_with_article(type_text(type_))}, which has no features"
            return Diagnostic("unknown-feature", message, span, "start the path at an object")
        hint = f"write `{name} : Class`"
        message = f"the class of `{name}` is unknown"
        return Diagnostic("untyped-source", message, span, hint, subject=(name,))

    def _broken_path_error(self, path: PathConstraint, broken: InvalidPath) -> Diagnostic:
        name = path.features[broken.position]
        span = path.feature_spans[broken.position] if path.feature_spans else path.span
        if broken.attribute is not None:
            message = f"`{broken.attribute}` is an attribute: no feature can follow it in a path"
            return Diagnostic("attribute-in-path", message, span, f"end the path with `{broken.attribute.name}`")
        hint = self._metamodel.left_out_reason(broken.cls, name)
        hint = hint or did_you_mean(name, self._metamodel.features(broken.cls))
        hint = hint or subclass_hint(broken.cls, name, self._metamodel)
        hint = hint or name_hint(name, self._metamodel.features(broken.cls))
        return Diagnostic("unknown-feature", f"`{broken.cls}` has no feature `{name}`", span, hint)

    def _check_call(self, call: PatternCall) -> Iterator[Diagnostic]:
        span = call.pattern_span or call.span
        package = self._pattern.package
        found, hidden = self._names.find_candidates(call.pattern, package, self._pattern)
        if len(found) == 1:
            yield from self._check_arity(call, found[0])
        elif found:
            names = " or ".join(f"`{pattern.qualified_name}`" for pattern in found)
            yield Diagnostic(
                "ambiguous-pattern",
                f"`{call.pattern}` is the name of several patterns",
                span,
                f"write {names}",
            )
        elif hidden:
            message = f"pattern `{hidden[0].qualified_name}` is private"
            yield Diagnostic("private-pattern", message, span, "call it from its own file, or remove `private`")
        else:
            hint = name_hint(call.pattern, self._names.visible_names(package, self._pattern))
            yield Diagnostic("unknown-pattern", f"unknown pattern `{call.pattern}`", span, hint)

    def _check_arity(self, call: PatternCall, callee: Pattern) -> Iterator[Diagnostic]:
        wanted, given = len(callee.parameters), len(call.arguments)
        if call.closure is not Closure.ONCE and wanted != 2:
            message = f"`{call.pattern}{call.closure}` needs a pattern of two parameters, `{callee.name}` has {wanted}"
            hint = f"apply `{call.closure}` to a pattern of two parameters that calls `{callee.name}`"
            yield Diagnostic("closure-not-binary", message, call.span, hint)
        elif wanted != given:
            parameters = ", ".join(parameter.name for parameter in callee.parameters)
            message = f"`{callee.name}` takes {wanted} argument{'s' * (wanted != 1)}, not {given}"
            yield Diagnostic("wrong-arity", message, call.span, f"write `{call.pattern}({parameters})`")

    # --- arguments

    def _check_arguments(self, place: RelationPlace) -> Iterator[Diagnostic]:
        marks: list[ColumnMark] = []
        for term in terms_of(place.relation):
            if isinstance(term, ColumnMark):
                marks.append(term)
            elif isinstance(term, Constant) and term.value is None:
                hint = "write `neg` before the constraint and `_` as the argument to test for a missing value"
                yield Diagnostic("none-argument", "`none` is no value", term.span or place.relation.span, hint)
        yield from self._check_marks(place, marks)

    def _check_marks(self, place: RelationPlace, marks: list[ColumnMark]) -> Iterator[Diagnostic]:
        aggregate = place.aggregate
        if aggregate is None or aggregate.function == "count":
            if marks:
                what = "`count` aggregates no column" if aggregate else "`#` marks the column of an aggregate"
                yield Diagnostic("stray-hash", what, marks[0].span or place.relation.span, "write `_`")
        elif not marks:
            message = f"`{aggregate.function}` needs a column"
            yield Diagnostic(
                "missing-hash", message, aggregate.span or place.relation.span, "mark one argument with `#`"
            )
        elif len(marks) > 1:
            message = f"`{aggregate.function}` aggregates one column, but several are marked with `#`"
            yield Diagnostic("second-hash", message, marks[1].span or place.relation.span, "write `_`")
        elif marks[0].name in self._reading.occurrences:
            message = f"`#{marks[0].name}` is a column of the aggregate, and `{marks[0].name}` a variable outside of it"
            yield Diagnostic("named-hash", message, marks[0].span or place.relation.span, "write `#`")

    # --- closures

    def _check_closure(self, place: RelationPlace) -> Iterator[Diagnostic]:
        relation = place.relation
        if isinstance(relation, TypeConstraint) or relation.closure is Closure.ONCE:
            return
        if place.group is not None:
            what = "an aggregate" if place.aggregate else "`neg`"
            hint = "move the closure into another pattern, and call that pattern here"
            yield Diagnostic("closure-in-group", f"a closure cannot be used under {what}", relation.span, hint)
            return
        source, target = self._step_types(relation)
        if source is None or target is None:
            return
        if not have_common_instances(source, target, self._metamodel):
            message = f"a step leads from `{type_text(source)}` to `{type_text(target)}`: no second step can follow"
            hint = f"leave the `{relation.closure}` out, or follow steps that lead back to `{type_text(source)}`"
            yield Diagnostic("closure-ends", message, relation.span, hint)
        elif closure_target_type(source, target, relation.closure, self._metamodel) is None:
            message = f"`*` needs a common supertype of `{type_text(source)}` and `{type_text(target)}`"
            yield Diagnostic("closure-ends", message, relation.span, "use `+`")
        elif relation.closure is Closure.STAR and not isinstance(source, ObjectType):
            message = f"`*` relates every `{type_text(source)}` to itself, but these values cannot be enumerated"
            yield Diagnostic("closure-reflexive", message, relation.span, "use `+`")

    def _step_types(self, relation: PathConstraint | PatternCall) -> tuple[StaticType | None, StaticType | None]:
        """Return the source type and the target type of one step of a closure, None where unknown."""
        if isinstance(relation, PathConstraint):
            path = self._types.resolved_path(relation)
            return (path.source, path.target) if path else (None, None)
        signature: PatternSignature | None = self._types.callee(relation.pattern)
        return (signature.types[0], signature.types[1]) if signature else (None, None)

    # --- aggregates

    def _check_aggregate(self, aggregate: Aggregate) -> Iterator[Diagnostic]:
        if aggregate.function != "count":
            yield from self._check_column(aggregate)
        if isinstance(aggregate.over, PathConstraint) and aggregate.function in _ONCE_VERBS:
            path = self._types.resolved_path(aggregate.over)
            many = (step for step in path.steps[:-1] if isinstance(step, Reference) and step.many) if path else ()
            between = list(dict.fromkeys(step.target for step in many))
            if path and between:
                message = _counted_once_message(path, aggregate.function)
                names = " and ".join(f"the `{name}`" for name in between)
                hint = f"to include duplicates, aggregate over a pattern that has {names} as a parameter, too"
                span = aggregate.over.span or aggregate.span
                yield Diagnostic("chain-aggregate", message, span, hint, Severity.WARNING)

    def _check_column(self, aggregate: Aggregate) -> Iterator[Diagnostic]:
        type_ = (
            self._types.aggregate_type(aggregate)
            if aggregate.function != "avg"
            else self._marked_column_type(aggregate)
        )
        ordered = aggregate.function in ("min", "max") and type_ is Scalar.STRING
        if type_ is not None and type_ not in NUMBERS and not ordered:
            mark: Term = next(term for term in terms_of(aggregate.over) if isinstance(term, ColumnMark))
            what = "numbers or strings" if aggregate.function in ("min", "max") else "numbers"
            message = f"`{aggregate.function}` aggregates {what}, not `{type_text(type_)}`"
            hint = "use `count` for the number of values"
            yield Diagnostic("aggregate-type", message, mark.span or aggregate.span, hint)

    def _marked_column_type(self, aggregate: Aggregate) -> StaticType | None:
        columns = zip(terms_of(aggregate.over), self._types.column_types(aggregate.over), strict=True)
        return next((type_ for term, type_ in columns if isinstance(term, ColumnMark)), None)


def _counted_once_message(path: ResolvedPath, function: str) -> str:
    """Return the message that an aggregate takes equal elements once, although a path reaches them repeatedly."""
    last = path.steps[-1]
    if isinstance(last, Reference):
        return f"a `{last.target}` that `{path}` reaches in several ways is {_ONCE_VERBS[function]} only once"
    return (
        f"equal values are {_ONCE_VERBS[function]} only once for each `{path.cls}`, "
        f"however many `{last.owner}` objects have that `{last.name}`"
    )
