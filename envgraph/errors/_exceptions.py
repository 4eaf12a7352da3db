"""Define the exceptions of the package: one root class, with one subclass for each cause."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence

from envgraph.code import escape_unprintable, shorten_repr
from envgraph.errors._diagnostics import Diagnostic, Note
from envgraph.errors._shown import SHOWN
from envgraph.errors._source_text import Span
from envgraph.errors._suggestions import did_you_mean, quote_names


@shorten_repr
class EnvgraphError(Exception):
    """The base class of all exceptions that envgraph raises on purpose.

    Attributes:
        message: what is wrong.
        hint: how to correct the problem, or None.
    """

    def __init__(self, message: str = "", hint: str | None = None) -> None:
        super().__init__(*((message, hint) if hint else (message,)))
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message}; {self.hint}" if self.hint else self.message

    def __repr__(self) -> str:
        """Return the class name and the first line of the message, shortened; `str()` returns the whole message."""
        text = escape_unprintable(str(self).partition("\n")[0])
        return f"{type(self).__name__}({text if len(text) <= SHOWN.exception else text[: SHOWN.exception] + ' ...'})"


class DiagnosticError(EnvgraphError):
    """An error that consists of one or more diagnostics. `str()` returns them as text, `diagnostics` as data."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n\n".join(str(diagnostic) for diagnostic in self.diagnostics))

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Return the class and the diagnostics to pickle the error, so that a worker process can send it back."""
        return type(self), (self.diagnostics,)


class LoadError(DiagnosticError):
    """An error raised if a file cannot be loaded. It reports all problems of the file and of its imports."""

    @classmethod
    def from_problem(cls, code: str, message: str, span: Span | None = None, hint: str | None = None) -> LoadError:
        """Return an error with one diagnostic."""
        return cls([Diagnostic(code, message, span, hint)])

    def _render_traceback_(self) -> list[str]:
        """Return the lines that IPython shows: the mistakes are in a text, so that no line of Python explains them."""
        return str(self).splitlines()


class ResolutionError(DiagnosticError):
    """An error in a definition made in Python (pattern, rule, behaviour): an unknown name or a wrong type."""


class TraceError(DiagnosticError):
    """An error in recording or replaying a run: a step's result differs, or the model was changed outside rules."""


class TypeMismatch(EnvgraphError):
    """An error raised for a value, class or reference that the metamodel does not allow at this place of the model."""


class _ErrorWithSpan(EnvgraphError):
    """A run-time error with the span of the failed element, if known; `str()` shows this place."""

    details: tuple[str, ...] = ()

    def __init__(
        self, message: str, span: Span | None, hint: str | None, code: str, notes: Iterable[Note] = ()
    ) -> None:
        super().__init__(message, hint)
        self.span, self.notes, self._code = span, tuple(notes), code

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return the error as one diagnostic; () if the error has no span."""
        if self.span is None:
            return ()
        return (Diagnostic(self._code, self.message, self.span, self.hint, notes=self.notes),)

    def __str__(self) -> str:
        for one in self.diagnostics:
            return str(one)
        return "\n  ".join([self.message, *self.details]) + (f"\nhint: {self.hint}" if self.hint else "")


class RuleError(_ErrorWithSpan):
    """An error raised because a rule cannot be applied at a match; `reason` names the condition that fails.

    Attributes:
        message: what is wrong, in one line.
        rule: name of the rule, or None.
        reason: stable word for programs: "dangling", "multiplicity", "identification", "stale-match", "full",
            "containment", "ambiguous", "lost-link", "missing-link".
        details: one line for each offending element.
        span: the refused action, or the rule; None if the rule was not read from a text.
        hint: how to correct the problem, or None.
    """

    def __init__(
        self,
        message: str,
        *,
        rule: str | None = None,
        reason: str,
        details: Sequence[str] = (),
        span: Span | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(message, span, hint, reason, map(Note, details))
        self.rule = rule
        self.reason = reason
        self.details = tuple(details)

    def refused_everywhere(self, where: str) -> RuleError:
        """Return a copy of the error whose message adds where else the rule is refused, as described by `where`."""
        message = f"{self.message}; it is refused at {where}"
        return _make_rule_error(message, self.rule, self.reason, self.details, self.span, self.hint)

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Return the function and all fields to pickle the error, so that a worker process can send it back."""
        return _make_rule_error, (self.message, self.rule, self.reason, self.details, self.span, self.hint)


def _make_rule_error(
    message: str, rule: str | None, reason: str, details: Sequence[str], span: Span | None, hint: str | None
) -> RuleError:
    return RuleError(message, rule=rule, reason=reason, details=details, span=span, hint=hint)


class TransactionError(EnvgraphError):
    """An error in using transactions: savepoints closed in the wrong order, or a checkout inside a transaction.

    Checking out a version of another model is reported as this error too.
    """


class EvaluationError(_ErrorWithSpan):
    """An error raised if a computation fails while it runs, for example by division by zero, overflow, or at a limit.

    Attributes:
        message: what is wrong, in one line.
        span: the expression or step; None if it was not read from a text.
        hint: how to correct the problem, or None.
        notes: other places that explain the error.
    """

    def __init__(
        self,
        message: str,
        span: Span | None = None,
        hint: str | None = None,
        notes: Sequence[Note] = (),
    ) -> None:
        super().__init__(message, span, hint, "no-value", notes)

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Return the class and all fields to pickle the error, so that a worker process can send it back."""
        return EvaluationError, (self.message, self.span, self.hint, self.notes)


class FunctionError(_ErrorWithSpan):
    """An error in calling a user's function: it is not registered, it raised, or it returned a value of a wrong type.

    Unlike an `EvaluationError` this error always stops matching and rule application. If the function raised an
    exception, it is the `__cause__`.

    Attributes:
        message: what is wrong, in one line, with the arguments.
        function: name of the function.
        span: the call; None if it was not read from a text.
        hint: how to correct the problem, or None.
    """

    def __init__(self, message: str, function: str, span: Span | None = None, hint: str | None = None) -> None:
        super().__init__(message, span, hint, "function-failed")
        self.function = function

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Return the class and all fields to pickle the error, so that a worker process can send it back."""
        return FunctionError, (self.message, self.function, self.span, self.hint)


class InvalidArgument(EnvgraphError, ValueError):
    """An error raised for an argument of a Python call that its docstring does not allow."""


def check_known(name: object, known: Collection[str], message: str) -> None:
    """Raise `InvalidArgument` with `message` if `name` is not in `known`; the hint is a similar name or all names.

    >>> check_known("full", ("full", "direct"), "unknown kind `full`")
    >>> check_known("fast", ("full", "direct"), "unknown kind `fast`")
    Traceback (most recent call last):
    envgraph.errors._exceptions.InvalidArgument: unknown kind `fast`; there are `full`, `direct`
    """
    if name not in known:
        there_are = (
            f"there is only {quote_names(known)}" if len(known) == 1 else f"there are {quote_names(known) or 'none'}"
        )
        raise InvalidArgument(message, did_you_mean(str(name), known) or there_are)
