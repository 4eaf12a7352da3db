"""The exception tree: one root, children by cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph.errors._diagnostics import Diagnostic


class EnvgraphError(Exception):
    """Root of every exception that envgraph raises on purpose."""


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


class ResolutionError(DiagnosticError):
    """A name in a definition made in Python (pattern, rule, behaviour) means nothing, or a type is wrong."""


class TraceError(DiagnosticError):
    """A recorded run does not lead where it did, or something changed the model that no rule did."""


class TypeMismatch(EnvgraphError):
    """A value, class or reference that the metamodel does not allow at that place of a model."""


class RuleError(EnvgraphError):
    """A rule cannot be applied at a match; `reason` says which condition fails.

    Attributes:
        rule: name of the rule, or None.
        reason: stable word for programs: "dangling", "multiplicity", "identification", "stale-match", "full",
            "containment", "ambiguous", "lost-link", "missing-link".
        details: one line for each offending element.
    """

    def __init__(
        self, message: str, *, rule: str | None = None, reason: str, details: Sequence[str] = ()
    ) -> None:
        self.rule = rule
        self.reason = reason
        self.details = tuple(details)
        self._message = message
        super().__init__("\n  ".join([message, *details]))

    def __reduce__(self) -> tuple[Callable[..., EnvgraphError], tuple[object, ...]]:
        """Errors cross from worker processes; by default they would be made again from their text."""
        return _rule_error, (self._message, self.rule, self.reason, self.details)


def _rule_error(message: str, rule: str | None, reason: str, details: Sequence[str]) -> RuleError:
    return RuleError(message, rule=rule, reason=reason, details=details)


class TransactionError(EnvgraphError):
    """Savepoints closed out of order, a version of another model, a checkout inside a transaction."""


class EvaluationError(EnvgraphError):
    """An expression has no value: division by zero, overflow, a step limit that is used up."""


class InvalidArgument(EnvgraphError, ValueError):
    """An argument of a Python call is outside what its docstring allows."""
