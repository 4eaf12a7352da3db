"""Checks that rules, units and derived groups share: annotations, weights and parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Final

from envgraph.errors import Diagnostic, Severity, Span, duplicate_diagnostics, name_hint
from envgraph.metamodel import SUPPRESS, Annotation
from envgraph.pattern import Parameter

_GENERATED_NAME: Final = re.compile(r"(?<=`)#\d+(?=`)")
"""Matches the generated name of a `_` in a message."""


def check_weight(weight: float, annotations: Sequence[Annotation], span: Span | None) -> Iterable[Diagnostic]:
    """Report a weight that is not a finite number above 0."""
    if not (isfinite(weight) and weight > 0):
        where = annotation_span(annotations, "weight") or span
        hint = "remove the rule if it should never be chosen"
        yield Diagnostic("bad-weight", f"the weight is {weight}, but must be a finite number above 0", where, hint)


def check_annotations(annotations: Sequence[Annotation], known: Sequence[str]) -> Iterable[Diagnostic]:
    """Warn about annotations whose names are neither in `known` nor `suppress`."""
    for annotation in annotations:
        if annotation.name not in (*known, SUPPRESS):
            message = f"annotation `@{annotation.name}` has no effect here"
            hint = name_hint(annotation.name, known)
            yield Diagnostic("unknown-annotation", message, annotation.span, hint, Severity.WARNING)


def annotation_span(annotations: Sequence[Annotation], name: str) -> Span | None:
    """Return the span of the first annotation with this name, or None."""
    return next((annotation.span for annotation in annotations if annotation.name == name), None)


def check_duplicate_parameters(parameters: Sequence[Parameter]) -> Iterable[Diagnostic]:
    """Report parameters that share a name."""
    named = ((one.name, one.span) for one in parameters)
    return duplicate_diagnostics(named, "parameter `{}` is declared twice", "choose another name")


def without_generated_names(problem: Diagnostic) -> Diagnostic:
    """Return a diagnostic in which generated names of `_` variables (such as `#1`) are replaced with `_`."""
    hint = problem.hint
    if hint is not None and _GENERATED_NAME.search(hint):  # an unchanged `ReplacementHint` keeps its correction
        hint = _GENERATED_NAME.sub("_", hint)
    return replace(problem, message=_GENERATED_NAME.sub("_", problem.message), hint=hint)
