"""Find the names in a family file: of patterns, rules, classes, references, measures and files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache

from envgraph.editor._mention_data import Mention, PartNames
from envgraph.errors import LoadError, Source, Span
from envgraph.lang.syntax._toml_parser import TomlText, parse_toml

_KINDS = {
    ("constraints", "require"): "pattern",
    ("constraints", "forbid"): "pattern",
    ("mutation", "rules"): "rule",
    ("optimise", "maximise"): "measure",
    ("optimise", "minimise"): "measure",
    ("samples", "maximise"): "measure",
    ("samples", "minimise"): "measure",
    ("samples", "cover"): "measure",
    ("curriculum", "order"): "measure",
    ("diversity", "of"): "measure",
    ("audit", "sees"): "pattern",
    ("ga4cl", "rewards"): "class",
    ("model",): "file",
    ("environment",): "file",
    ("imports",): "file",
}
"""By the path of keys to a text or a list of texts: the kind of definition that it names."""
_MEASURE_OPTIONS = {
    "of": "pattern",
    "guide": "pattern",
    "from": "class",
    "to": "class",
    "avoid": "class",
    "along": "step",
}
"""By option of a measure: the kind of definition that it names."""

_WORD = re.compile(r"[^\W\d]\w*")


@lru_cache(maxsize=64)
def family_mentions(source: Source) -> PartNames:
    """Return the names in a family file; none if it is not valid TOML."""
    try:
        text = parse_toml(source)
    except LoadError:
        return PartNames.of(())
    return PartNames.of(_mentions(text))


def _mentions(text: TomlText) -> Iterator[Mention]:
    for path, span in text.keys.items():
        words = tuple(one for one in path if isinstance(one, str))
        if len(words) == 2 and words[0] == "measures" and path == words:
            yield Mention("measure", words[1], span.start, span.end, True, tree_start=span.start, tree_end=span.end)
        elif len(words) == 3 and words[:2] == ("constraints", "count"):
            yield from _dotted("pattern", words[2], span)
        elif len(words) == 3 and words[:2] == ("samples", "cover"):
            yield from _dotted("measure", words[2], span)
    for path, span in text.values.items():
        words = tuple(one for one in path if isinstance(one, str))
        kind = _KINDS.get(words)
        if kind is None and len(words) == 3 and words[0] == "measures":
            kind = _MEASURE_OPTIONS.get(words[2])
        if span.text[:1] not in ('"', "'"):
            continue
        inner = Span(span.source, span.start + 1, span.end - 1)
        if kind is None and words[-1] not in ("kind", "name"):
            for word in _WORD.finditer(inner.text):
                yield Mention("unknown", word.group(), inner.start + word.start(), inner.start + word.end())
        elif kind == "file":
            yield Mention("file", inner.text, inner.start, inner.end)
        elif kind is not None:
            yield from _dotted(kind, inner.text, inner)


def _dotted(kind: str, name: str, span: Span) -> Iterator[Mention]:
    """Yield a mention of the last part of a name such as `package.pattern` or `Class.feature`.

    A rule may be a member of a derived group, so yield a mention of the part before the last dot, too.
    """
    start = span.start + span.text.startswith(('"', "'"))
    before, _, last = name.rpartition(".")
    place = start + len(name) - len(last)
    if kind == "step":
        yield Mention(kind, last, place, place + len(last), holder=("class", before))
        return
    yield Mention(kind, last, place, place + len(last), qualifier=before)
    if kind == "rule" and before:
        package, _, group = before.rpartition(".")
        yield Mention(kind, group, place - 1 - len(group), place - 1, qualifier=package)
