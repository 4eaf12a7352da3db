"""Define source spans, diagnostics as data, and all exceptions of the package.

Every mistake that a person can make in a file is reported as a `Diagnostic`: a severity, a stable code, a message, the
`Span` of the mistake and, if known, a hint. Every exception that envgraph raises on purpose derives from
`EnvgraphError`.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.code import visible as visible
    from envgraph.errors._diagnostics import (
        Diagnostic as Diagnostic,
        Note as Note,
        Severity as Severity,
        defined_twice as defined_twice,
        has_errors as has_errors,
        sort_diagnostics as sort_diagnostics,
        too_many_errors as too_many_errors,
    )
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
    from envgraph.errors._limits import (
        LIMITS as LIMITS,
        MOST_ERRORS as MOST_ERRORS,
        MOST_NESTED as MOST_NESTED,
        RAISE_LIMIT as RAISE_LIMIT,
        limit as limit,
        parse_within as parse_within,
    )
    from envgraph.errors._numbers import (
        LARGEST_INT as LARGEST_INT,
        TOLERANCE as TOLERANCE,
        parse_float as parse_float,
        parse_int as parse_int,
    )
    from envgraph.errors._shown import SHOWN as SHOWN
    from envgraph.errors._source import Source as Source, Span as Span
    from envgraph.errors._spelling import spelling as spelling
    from envgraph.errors._suggest import (
        did_you_mean as did_you_mean,
        listed as listed,
        name_hint as name_hint,
        nearest as nearest,
        plural as plural,
        quoted as quoted,
        with_article as with_article,
    )

later(globals())
