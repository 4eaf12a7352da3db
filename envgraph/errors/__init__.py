"""Source spans, diagnostics as data, and the exception tree.

Every problem that a person can cause by writing a file is a `Diagnostic`: a severity, a stable code, a message,
the `Span` it is about and, where one is known, a hint. Every exception that envgraph raises on purpose descends
from `EnvgraphError`.
"""

from envgraph.errors._diagnostics import (
    Diagnostic,
    Note,
    Severity,
    defined_twice,
    has_errors,
    sort_diagnostics,
    too_many_errors,
)
from envgraph.errors._exceptions import (
    DiagnosticError,
    EnvgraphError,
    EvaluationError,
    FunctionError,
    InvalidArgument,
    LoadError,
    ResolutionError,
    RuleError,
    TraceError,
    TransactionError,
    TypeMismatch,
    check_known,
)
from envgraph.errors._limits import MOST_ERRORS, MOST_NESTED, MOST_STEPS, RAISE_LIMIT, limit, parse_within
from envgraph.errors._numbers import LARGEST_INT, parse_float, parse_int
from envgraph.errors._reprs import later, shorten, spelling
from envgraph.errors._source import Source, Span, visible
from envgraph.errors._suggest import did_you_mean, listed, name_hint, nearest, plural, quoted, with_article

__all__ = [
    "LARGEST_INT",
    "MOST_ERRORS",
    "MOST_NESTED",
    "MOST_STEPS",
    "RAISE_LIMIT",
    "Diagnostic",
    "DiagnosticError",
    "EnvgraphError",
    "EvaluationError",
    "FunctionError",
    "InvalidArgument",
    "LoadError",
    "Note",
    "ResolutionError",
    "RuleError",
    "Severity",
    "Source",
    "Span",
    "TraceError",
    "TransactionError",
    "TypeMismatch",
    "check_known",
    "defined_twice",
    "did_you_mean",
    "has_errors",
    "later",
    "limit",
    "listed",
    "name_hint",
    "nearest",
    "parse_float",
    "parse_int",
    "parse_within",
    "plural",
    "quoted",
    "shorten",
    "sort_diagnostics",
    "spelling",
    "too_many_errors",
    "visible",
    "with_article",
]

shorten(globals(), __all__)
