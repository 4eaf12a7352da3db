"""Check the name, parameters and annotations of a pattern, before its bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import Final

from envgraph.errors import LIMITS, Diagnostic, Note, Severity, Span, duplicate_diagnostics, name_hint
from envgraph.metamodel import SUPPRESS, Annotation, Metamodel
from envgraph.pattern._query_data import Body, Comparison, Negation, PathConstraint, Pattern
from envgraph.pattern._types import static_type, type_hint

KNOWN_ANNOTATIONS: Final = (
    "Constraint",
    "FunctionalDependency",
    "Label",
    "QueryBasedFeature",
    "SafeRecursion",
    SUPPRESS,
)

TOOL_ANNOTATIONS: Final = (
    *("Bind", "ContainsItem", "DerivedFeature", "Edge", "Format", "Item"),
    *("ObservableValue", "PatternUI", "QueryExplorer", "Tooltip"),
)
"""Annotations for the viewers of VIATRA and IncQuery, which do not affect matches."""

_CONSTRAINT_ARGUMENTS: Final = (("key", "{x}"), ("severity", '"error"'), ("message", '"..."'))
_INCQUERY_NAMES: Final = {"location": "key"}
_SEVERITIES: Final = ("error", "warning", "info")


def is_too_long(body: Body) -> bool:
    """Return True if a body has too many constraints and path steps. Inequalities are not counted."""
    steps = 0
    for constraint in body.constraints:
        relation = constraint.relation if isinstance(constraint, Negation) else constraint
        if isinstance(relation, PathConstraint):
            steps += len(relation.features)
        elif not (isinstance(relation, Comparison) and relation.operator == "!="):
            steps += 1
    return steps > LIMITS["constraints"]


def check_duplicates(patterns: Sequence[Pattern], known: Mapping[str, Pattern]) -> Iterator[Diagnostic]:
    """Report patterns whose qualified name an earlier pattern or a known pattern has."""
    named = ((one.qualified_name, one.span) for one in patterns)
    first = {name: one.span for name, one in known.items()}
    return duplicate_diagnostics(named, "pattern `{}` is defined twice", first=first)


def check_header(pattern: Pattern, metamodel: Metamodel) -> Iterator[Diagnostic]:
    """Report problems of the parameters and annotations, and missing, empty or too long bodies."""
    yield from _check_parameters(pattern, metamodel)
    for annotation in pattern.annotations:
        yield from _check_annotation(annotation, pattern)
    if not pattern.bodies and not pattern.mended:
        yield Diagnostic(
            "empty-body",
            f"pattern `{pattern.name}` has no body",
            pattern.span,
            "write `{ .. }` with a constraint after its parameters",
        )
    for body in pattern.bodies:
        if not body.constraints and not pattern.mended:
            hint = "write `check(true)` for a body that always holds"
            yield Diagnostic("empty-body", "a body needs a constraint", body.span or pattern.span, hint)
        elif is_too_long(body):
            message = f"the body has more than {LIMITS['constraints']} constraints and steps of paths"
            hint = "move a part of it into another pattern, and call that pattern with `find`"
            yield Diagnostic("body-too-long", message, body.span or pattern.span, hint)


def _check_parameters(pattern: Pattern, metamodel: Metamodel) -> Iterator[Diagnostic]:
    if not pattern.parameters:
        message = f"pattern `{pattern.name}` has no parameters: it has one match or none"
        hint = "add parameters for the objects to find, unless the pattern is a condition"
        yield Diagnostic("no-parameters", message, pattern.span, hint, Severity.WARNING)
    first: dict[str, Span | None] = {}
    for parameter in pattern.parameters:
        span = parameter.span or pattern.span
        if parameter.name in first:
            note = Note("the first one is here", first[parameter.name])
            message = f"parameter `{parameter.name}` is declared twice"
            yield Diagnostic("duplicate-parameter", message, span, "choose another name", notes=(note,))
        elif parameter.name.startswith("_"):
            message = f"parameter `{parameter.name}` starts with `_`, which marks single-use variables"
            hint = f"call it `{parameter.name.lstrip('_') or 'x'}`"
            yield Diagnostic("parameter-name", message, span, hint)
        first.setdefault(parameter.name, parameter.span)
        if parameter.type is not None and static_type(parameter.type, metamodel) is None:
            hint_ = type_hint(parameter.type, metamodel)
            where = parameter.type_span or span
            yield Diagnostic("unknown-type", f"unknown type `{parameter.type}`", where, hint_)


def _check_annotation(annotation: Annotation, pattern: Pattern) -> Iterator[Diagnostic]:
    if annotation.name in TOOL_ANNOTATIONS:
        return
    if annotation.name not in KNOWN_ANNOTATIONS:
        hint = name_hint(annotation.name, KNOWN_ANNOTATIONS)
        message = f"unknown annotation `@{annotation.name}`"
        yield Diagnostic("unknown-annotation", message, _name_span(annotation), hint, Severity.WARNING)
    elif annotation.name == "Constraint":
        yield from _check_constraint_annotation(annotation, pattern)
    elif annotation.name == "FunctionalDependency":
        for key, value, span in _named_values(annotation):
            if key in ("forEach", "determines"):
                yield from _check_parameter_names(value, span, pattern)


def _named_values(annotation: Annotation) -> Iterator[tuple[str, object, Span | None]]:
    """Yield the named values of an annotation, each with its span."""
    spans = [span for key, span in annotation.places if key != "@"]
    for (key, value), span in zip_longest(annotation.named, spans):
        yield key, value, span or annotation.span


def _name_span(annotation: Annotation) -> Span | None:
    return dict(annotation.places).get("@", annotation.span)


def _check_constraint_annotation(annotation: Annotation, pattern: Pattern) -> Iterator[Diagnostic]:
    named = {_INCQUERY_NAMES.get(key, key): value for key, value in annotation.named}
    missing = [(key, example) for key, example in _CONSTRAINT_ARGUMENTS if key not in named]
    if missing:
        message = f"`@Constraint` lacks {', '.join(f'`{key}`' for key, _ in missing)}"
        hint = f"add `{', '.join(f'{key} = {example}' for key, example in missing)}`"
        yield Diagnostic("annotation-argument", message, _name_span(annotation), hint)
    for key, value, span in _named_values(annotation):
        if key in _INCQUERY_NAMES:
            message = f"`{key}` is IncQuery's name of `{_INCQUERY_NAMES[key]}`"
            hint = f"write `{_INCQUERY_NAMES[key]} = {{{value}}}`"
            yield Diagnostic("annotation-argument", message, span, hint, Severity.WARNING)
        if _INCQUERY_NAMES.get(key, key) == "key":
            yield from _check_parameter_names(value, span, pattern)
        elif key == "severity" and value not in _SEVERITIES:
            message = f"unknown severity `{value}`"
            hint = f"write one of {', '.join(f'`{severity}`' for severity in _SEVERITIES)}"
            yield Diagnostic("annotation-argument", message, span, hint)


def _check_parameter_names(value: object, span: Span | None, pattern: Pattern) -> Iterator[Diagnostic]:
    known = [parameter.name for parameter in pattern.parameters]
    for name in value if isinstance(value, tuple) else (value,):
        if name not in known:
            message = f"`{name}` is no parameter of `{pattern.name}`"
            hint = name_hint(str(name), known)
            yield Diagnostic("annotation-argument", message, span, hint)
