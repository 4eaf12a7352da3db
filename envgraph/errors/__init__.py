"""Define source spans, diagnostics as data, and all exceptions of the package.

Every mistake that a person can make in a file is reported as a `Diagnostic`: a severity, a stable code, a message, the
`Span` of the mistake and, if known, a hint. Every exception that envgraph raises on purpose derives from
`EnvgraphError`.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.code import escape_unprintable as escape_unprintable
    from envgraph.errors._diagnostics import (
        WARNING_CODES as WARNING_CODES,
        Diagnostic as Diagnostic,
        Edit as Edit,
        Note as Note,
        Severity as Severity,
        duplicate_diagnostics as duplicate_diagnostics,
        has_errors as has_errors,
        sort_diagnostics as sort_diagnostics,
        too_many_errors_diagnostic as too_many_errors_diagnostic,
    )
    from envgraph.errors._exact_key import exact_key as exact_key
    from envgraph.errors._exceptions import (
        DiagnosticError as DiagnosticError,
        EnvgraphError as EnvgraphError,
        EvaluationError as EvaluationError,
        FunctionError as FunctionError,
        InvalidArgument as InvalidArgument,
        LoadError as LoadError,
        ResolutionError as ResolutionError,
        RuleError as RuleError,
        TraceError as TraceError,
        TransactionError as TransactionError,
        TypeMismatch as TypeMismatch,
        check_known as check_known,
    )
    from envgraph.errors._input_limits import (
        LIMITS as LIMITS,
        MAX_ERRORS as MAX_ERRORS,
        MAX_NESTING as MAX_NESTING,
        RAISE_LIMIT_HINT as RAISE_LIMIT_HINT,
        parse_int_within as parse_int_within,
        scaled_limit as scaled_limit,
    )
    from envgraph.errors._numbers import (
        LARGEST_INT as LARGEST_INT,
        TOLERANCE as TOLERANCE,
        parse_float as parse_float,
        parse_int as parse_int,
    )
    from envgraph.errors._shown import SHOWN as SHOWN
    from envgraph.errors._source_text import Source as Source, Span as Span
    from envgraph.errors._suggestions import (
        ReplacementHint as ReplacementHint,
        count_with_noun as count_with_noun,
        did_you_mean as did_you_mean,
        list_names as list_names,
        most_similar as most_similar,
        name_hint as name_hint,
        quote_names as quote_names,
        quote_with_article as quote_with_article,
    )

export_lazily(globals())
