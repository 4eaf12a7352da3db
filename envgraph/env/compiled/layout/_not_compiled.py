"""Exceptions for behaviours that cannot be compiled, and for members that a compiled program does not fit."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from contextlib import contextmanager

from envgraph.errors import Span


class NotCompiled(Exception):
    """A construct that the compiler does not support, so that only the live engine can run the behaviour.

    Attributes:
        construct: a noun phrase, which the message completes to a sentence.
        span: the source position of the construct, or None if it is unknown.
    """

    def __init__(self, construct: str, span: Span | None = None) -> None:
        self.construct = construct
        self.span = span
        super().__init__(construct)

    def __str__(self) -> str:
        return f"compiled environments do not support {self.construct}"


@contextmanager
def add_missing_span(span: Span | None) -> Iterator[None]:
    """Add this span to each `NotCompiled` raised in the `with` block that has no span."""
    try:
        yield
    except NotCompiled as reason:
        reason.span = reason.span or span
        raise


class AssumptionViolated(Exception):
    """A member violates an assumption of the program, which must be generated again without the assumption.

    Attributes:
        assumption: the violated assumption.
    """

    def __init__(self, assumption: Hashable) -> None:
        self.assumption = assumption
        super().__init__(str(assumption))
