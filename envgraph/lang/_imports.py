"""What a file asks for from other files, and what is left of it when it has errors."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from envgraph.errors import Diagnostic, Span


@dataclass(frozen=True, slots=True)
class Import:
    """`import "path"`: the path as written, relative to the importing file."""

    path: str
    span: Span = field(compare=False, repr=False)
    alias: str | None = None


def without_consequences(diagnostics: Iterable[Diagnostic], lost: frozenset[str]) -> list[Diagnostic]:
    """Leaves out what follows from other errors: names that may be defined in what could not be read."""
    return [
        one
        for one in diagnostics
        if not (one.code.startswith("unknown-") and one.span and _simple(one.span.text) in lost)
    ]


def _simple(text: str) -> str:
    """The last part of a name as it stands in a file: in quotes in a family file, behind a prefix or a path in XML."""
    return re.split("[.:/]", text.strip("\"'").removeprefix("^"))[-1]
