"""What keeps a behaviour from being compiled."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from contextlib import contextmanager

from envgraph.errors import Span


class NotCompiled(Exception):
    """A construct that only the live engine has.

    Attributes:
        construct: what it is, for a sentence that starts with "it has".
        span: where it stands, if that is known.
    """

    def __init__(self, construct: str, span: Span | None = None) -> None:
        self.construct = construct
        self.span = span
        super().__init__(construct)


@contextmanager
def standing(span: Span | None) -> Iterator[None]:
    """Meanwhile what is not compiled stands there, if nobody knows better."""
    try:
        yield
    except NotCompiled as reason:
        reason.span = reason.span or span
        raise


class Misfit(Exception):
    """A member of the family does not have what the program was written for, so it has to be written again.

    Attributes:
        assumption: that does not hold.
    """

    def __init__(self, assumption: Hashable) -> None:
        self.assumption = assumption
        super().__init__(str(assumption))
