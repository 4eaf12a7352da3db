"""The exception tree: one root, children by cause."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from envgraph.code import short_repr, visible
from envgraph.errors._diagnostics import Diagnostic, Note
from envgraph.errors._source import Span
from envgraph.errors._suggest import did_you_mean, quoted

_LONGEST = 140
"""Of a message in a repr."""


@short_repr
class EnvgraphError(Exception):
    """Root of every exception that envgraph raises on purpose.

    Attributes:
        message: what is wrong.
        hint: how to mend it, if that is known.
    """

    def __init__(self, message: str = "", hint: str | None = None) -> None:
        super().__init__(*((message, hint) if hint else (message,)))
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message}; {self.hint}" if self.hint else self.message

    def __repr__(self) -> str:
        """The class and the first line of the message; `str` has all."""
        text = visible(str(self).partition("\n")[0])
        return f"{type(self).__name__}({text if len(text) <= _LONGEST else text[:_LONGEST] + ' ...'})"


class DiagnosticError(EnvgraphError):
    """One or more diagnostics; `str()` shows them all, `diagnostics` holds them as data."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n\n".join(str(diagnostic) for diagnostic in self.diagnostics))

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Errors cross from worker processes; by default they would be made again from their text."""
        return type(self), (self.diagnostics,)


class LoadError(DiagnosticError):
    """A file, or several that import each other, cannot be loaded; all their problems together."""

    @classmethod
    def of(cls, code: str, message: str, span: Span | None = None, hint: str | None = None) -> LoadError:
        """One problem."""
        return cls([Diagnostic(code, message, span, hint)])


class ResolutionError(DiagnosticError):
    """A name in a definition made in Python (pattern, rule, behaviour) means nothing, or a type is wrong."""


class TraceError(DiagnosticError):
    """A recorded run does not lead where it did, or something changed the model that no rule did."""


class TypeMismatch(EnvgraphError):
    """A value, class or reference that the metamodel does not allow at that place of a model."""


class _PlacedError(EnvgraphError):
    """An error at run time; where what failed was read from a text, `str()` shows the place like a diagnostic."""

    def __init__(self, message: str, span: Span | None, hint: str | None) -> None:
        super().__init__(message, hint)
        self.span = span

    @property
    def _advice(self) -> str:
        return f"\nhint: {self.hint}" if self.hint else ""

    def _diagnostic(self, code: str, notes: Sequence[Note] = ()) -> tuple[Diagnostic, ...]:
        if self.span is None:
            return ()
        return (Diagnostic(code, self.message, self.span, self.hint, notes=tuple(notes)),)


class RuleError(_PlacedError):
    """A rule cannot be applied at a match; `reason` says which condition fails.

    Attributes:
        message: what is wrong, in one line.
        rule: name of the rule, or None.
        reason: stable word for programs: "dangling", "multiplicity", "identification", "stale-match", "full",
            "containment", "ambiguous", "lost-link", "missing-link".
        details: one line for each offending element.
        span: the action that is refused, or the rule; None where they were not read from a text.
        hint: how to mend it, if that is known.
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
        super().__init__(message, span, hint)
        self.rule = rule
        self.reason = reason
        self.details = tuple(details)

    def everywhere(self, where: str) -> RuleError:
        """The last refusal of several, saying so: `where` is what the rule was refused at."""
        message = f"{self.message}; it is refused at {where}"
        return _rule_error(message, self.rule, self.reason, self.details, self.span, self.hint)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The error as a diagnostic; empty without a place."""
        return self._diagnostic(self.reason, [Note(detail) for detail in self.details])

    def __str__(self) -> str:
        found = self.diagnostics
        return str(found[0]) if found else "\n  ".join([self.message, *self.details]) + self._advice

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Errors cross from worker processes; by default they would be made again from their text."""
        return _rule_error, (self.message, self.rule, self.reason, self.details, self.span, self.hint)


def _rule_error(
    message: str, rule: str | None, reason: str, details: Sequence[str], span: Span | None, hint: str | None
) -> RuleError:
    return RuleError(message, rule=rule, reason=reason, details=details, span=span, hint=hint)


class TransactionError(EnvgraphError):
    """Savepoints closed out of order, a version of another model, a checkout inside a transaction."""


class EvaluationError(_PlacedError):
    """An expression has no value: division by zero, overflow, a step limit that is used up.

    Attributes:
        message: what is wrong, in one line.
        span: the expression or step; None where it was not read from a text.
        hint: how to mend it, if that is known.
        notes: other places that explain it.
    """

    def __init__(
        self,
        message: str,
        span: Span | None = None,
        hint: str | None = None,
        notes: Sequence[Note] = (),
    ) -> None:
        super().__init__(message, span, hint)
        self.notes = tuple(notes)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The error as a diagnostic; empty without a place."""
        return self._diagnostic("no-value", self.notes)

    def __str__(self) -> str:
        found = self.diagnostics
        return str(found[0]) if found else self.message + self._advice

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Errors cross from worker processes; by default they would be made again from their text."""
        return EvaluationError, (self.message, self.span, self.hint, self.notes)


class FunctionError(_PlacedError):
    """A function that was registered with an engine has no code, raised an exception, or returned something else.

    Unlike an `EvaluationError` it is never taken for "no value": matching, applying and running stop. An exception that
    the function raised is the `__cause__`.

    Attributes:
        message: what is wrong, in one line, with the arguments.
        function: name of the function.
        span: the call; None where it was not read from a text.
        hint: how to mend it.
    """

    def __init__(
        self, message: str, function: str, span: Span | None = None, hint: str | None = None
    ) -> None:
        super().__init__(message, span, hint)
        self.function = function

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The error as a diagnostic; empty without a place."""
        return self._diagnostic("function-failed")

    def __str__(self) -> str:
        found = self.diagnostics
        return str(found[0]) if found else self.message + self._advice

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Errors cross from worker processes; by default they would be made again from their text."""
        return FunctionError, (self.message, self.function, self.span, self.hint)


class InvalidArgument(EnvgraphError, ValueError):
    """An argument of a Python call is outside what its docstring allows."""


def check_known(name: object, known: Collection[str], message: str) -> None:
    """Raise `InvalidArgument` with a message unless a name is known; the hint says which names there are.

    >>> check_known("full", ("full", "direct"), "unknown kind `full`")
    >>> check_known("fast", ("full", "direct"), "unknown kind `fast`")
    Traceback (most recent call last):
    envgraph.errors._exceptions.InvalidArgument: unknown kind `fast`; there are `full`, `direct`
    """
    if name not in known:
        there_are = (
            f"there is only {quoted(known)}" if len(known) == 1 else f"there are {quoted(known) or 'none'}"
        )
        raise InvalidArgument(message, did_you_mean(str(name), known) or there_are)
