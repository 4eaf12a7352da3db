"""Imports of other files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field

from envgraph.code import dataclass
from envgraph.errors import Span, did_you_mean


@dataclass(frozen=True, slots=True)
class Import:
    """An import of a file: `import "path"`, with the path as written, relative to the importing file."""

    path: str
    span: Span = field(compare=False, repr=False)
    alias: str | None = None


def similar_uri_hint(uri: str, known: Iterable[str]) -> str | None:
    """Return the hint "did you mean ..?" for an unknown URI; None if no known URI is similar.

    The last segments of two URIs must be similar too, because URIs of one server share their beginnings.

    >>> similar_uri_hint("http://example.org/libary", ["http://example.org/library", "http://example.org/city"])
    'did you mean `http://example.org/library`?'
    >>> similar_uri_hint("http://example.org/clay", ["http://example.org/shop"]) is None
    True
    """
    last = uri.rpartition("/")[2]
    ends = {one: one.rpartition("/")[2] for one in known}
    return did_you_mean(uri, [one for one, end in ends.items() if end == last or did_you_mean(last, [end]) is not None])
