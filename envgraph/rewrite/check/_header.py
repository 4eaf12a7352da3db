"""Checks that rules, units and derivations share: annotations, weights, parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Final

from envgraph.errors import Diagnostic, Severity, Span, defined_twice, name_hint
from envgraph.metamodel import SUPPRESS, Annotation
from envgraph.pattern import Parameter

_HIDDEN: Final = re.compile(r"(?<=`)#\d+(?=`)")
"""In a text: the name of a `_` in an arrow."""


def check_weight(weight: float, annotations: Sequence[Annotation], span: Span | None) -> Iterable[Diagnostic]:
    """A weight has to be a positive number."""
    if not (isfinite(weight) and weight > 0):
        where = annotation_span(annotations, "weight") or span
        hint = "leave the rule out where it shall never be chosen"
        yield Diagnostic("bad-weight", f"a weight is a number above 0, not {weight}", where, hint)


def check_annotations(annotations: Sequence[Annotation], known: Sequence[str]) -> Iterable[Diagnostic]:
    """Warn of annotations that mean nothing at this place."""
    for annotation in annotations:
        if annotation.name not in (*known, SUPPRESS):
            message = f"`@{annotation.name}` means nothing here"
            hint = name_hint(annotation.name, known)
            yield Diagnostic("unknown-annotation", message, annotation.span, hint, Severity.WARNING)


def annotation_span(annotations: Sequence[Annotation], name: str) -> Span | None:
    """Return where an annotation stands."""
    return next((annotation.span for annotation in annotations if annotation.name == name), None)


def duplicate_parameters(parameters: Sequence[Parameter]) -> Iterable[Diagnostic]:
    """Two parameters of one name."""
    named = ((one.name, one.span) for one in parameters)
    return defined_twice(named, "parameter `{}` is declared twice", "choose another name")


def plain(problem: Diagnostic) -> Diagnostic:
    """Return what a library says about a pattern, without the names of those `_` that it knows by a number."""
    hint = None if problem.hint is None else _HIDDEN.sub("_", problem.hint)
    return replace(problem, message=_HIDDEN.sub("_", problem.message), hint=hint)
