"""What a file asks for from other files, and what is left of it when it has errors."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import field

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Span, did_you_mean


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


def near_uri(uri: str, known: Iterable[str]) -> str | None:
    """The hint `did you mean ..?` for a uri: of those of one site, the last parts have to be alike too.

    >>> near_uri("http://example.org/libary", ["http://example.org/library", "http://example.org/city"])
    'did you mean `http://example.org/library`?'
    >>> near_uri("http://example.org/clay", ["http://example.org/shop"]) is None
    True
    """
    last = uri.rpartition("/")[2]
    ends = {one: one.rpartition("/")[2] for one in known}
    return did_you_mean(
        uri, [one for one, end in ends.items() if end == last or did_you_mean(last, [end]) is not None]
    )
