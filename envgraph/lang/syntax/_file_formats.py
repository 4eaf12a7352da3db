"""Recognise the format of a file by its suffix, or else by its first bytes."""

from __future__ import annotations

import re
from collections.abc import Mapping

from envgraph.errors import Diagnostic, Source

FORMATS: Mapping[str, str] = {
    **dict.fromkeys(("metamodel", "ecore"), "a metamodel"),
    **dict.fromkeys(("model", "xmi"), "a model"),
    "json": "a file of JSON",
    **dict.fromkeys(("query", "vql"), "a file of patterns"),
    "rules": "a file of rules",
    "environment": "an environment",
    "toml": "a family file",
    "xsd": "an XML Schema",
    "family": "a family as JSON",
    "trace": "a trace",
    "sqlite": "a run store",
}
"""By suffix: a description of such a file, for messages."""

HEAD_BYTES = 4096
"""Number of bytes at the start of a file that are enough to recognise its format."""

AMBIGUOUS_SUFFIXES = ("json", "model", "metamodel")
"""Suffixes that do not determine the format: the files may also be families, traces or EMF files."""

_ECORE = "http://www.eclipse.org/emf/2002/Ecore"
_ROOT = re.compile(r"(?:<[?!].*?>\s*)*<(?:([\w.-]+):)?([\w.-]+)([^>]*)", re.DOTALL)
_OWN_JSON_FORMAT = re.compile(r'"format"\s*:\s*"envgraph-(model|family|trace)-')


_TEXT_BEFORE_DEFINITIONS = re.compile(
    r"""(?:[\s\ufeff]++|//[^\n]*+|\#[^\n]*+|/\*.*?\*/|@\w++(?:\([^)]*+\))?+
    |package\b[^\n;]*+;?|import\b[^\n;"]*+(?:"[^"\n]*+")?+(?:\s++as\s++\w++)?+;?)*+""",
    re.DOTALL | re.VERBOSE,
)
"""Matches all text allowed before the first definition: comments, annotations, the package and imports."""

_DEFINITIONS: Mapping[str, re.Pattern[str]] = {
    language: re.compile(rf"^[ \t]*(?:{words})", re.MULTILINE)
    for language, words in {
        "metamodel": r"metamodel\s+[\w.]+\b(?!\s*:)|(?:abstract\s+)?class\s+\w|enum\s+\w+\s*\{",
        "model": r"model\s+\w+\s*:",
        "query": r"(?:(?:private|incremental|search)\s+)*pattern\s+\w+\s*\(|function\s+\w+\s*\(",
        "rules": r"(?:rule|unit)\s+\w+\s*[({]|derive\s+\w+\s*=",
        "environment": r"environment\s+\w+\s*\(",
        "toml": r"\[{1,2}[\w.]+\]{1,2}\s*$|[\w.]+[ \t]*=[ \t]*[\w\"'\[{]",
        "json": r"\{\s*[\"}]",
        "xmi": r"<[?!\w]",
    }.items()
}
"""By format: matches the start of a definition at the start of a line."""


def check_language(language: str, source: Source) -> Diagnostic | None:
    """Return a diagnostic if a text has definitions of another language but none of the wanted language; else None.

    If the result is not None, all other mistakes in the text follow from it.

    >>> print(check_language("rules", Source("a.rules", "pattern p(x : Box) { }")).message)
    this seems to be a file of patterns, but must be a file of rules
    """
    text = source.text
    start = _TEXT_BEFORE_DEFINITIONS.match(text).end()  # type: ignore[union-attr]  # the pattern also matches the empty text
    held = next((one for one, words in _DEFINITIONS.items() if words.match(text[start:])), None)
    own = _DEFINITIONS.get(language)
    if held is None or own is None or own.match(text[start:]) or own.search(text):
        return None
    word = re.compile(r"\S\w*").match(text, start)
    span = source.span_between(start, word.end() if word else start + 1)
    message = f"this seems to be {FORMATS[held]}, but must be {FORMATS[language]}"
    hint = f"if it is {FORMATS[held]}, rename it to end with `.{held}`"
    if not suffix_of(source.name):  # a text passed to `from_text`
        argument = held in ("query", "rules")
        hint = f'pass `language="{held}"`' if argument else f"write it to a file `name.{held}`"
    return Diagnostic("other-language", message, span, hint)


def namespace_of(text: str) -> str | None:
    """Return the XML namespace of the first tag of a text; None if it has none.

    >>> namespace_of('<?xml version="1.0"?><xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"/>')
    'http://www.w3.org/2001/XMLSchema'
    """
    root = _ROOT.match(text.lstrip("\ufeff \t\r\n"))
    key = f"xmlns:{root[1]}" if root and root[1] else "xmlns"
    found = re.search(rf"\s{key}\s*=\s*[\"']([^\"']+)", root[3]) if root else None
    return found[1] if found else None


def suffix_of(name: str) -> str:
    """Return the text behind the last dot of a file name; "" if the name has no dot.

    >>> suffix_of("a.b/c.query"), suffix_of("a.b/c")
    ('query', '')
    """
    return name.rpartition("/")[2].rpartition(".")[2] if "." in name.rpartition("/")[2] else ""


def format_of(name: str, head: bytes) -> str | None:
    """Return the format of a file, a key of `FORMATS`: by its suffix, else by its first bytes; None if it is unknown.

    An XML file is a metamodel if its first tag is an Ecore package, else a model. Its suffix does not count, because
    EMF names the suffix of models after their metamodel, such as `.cyberphysicalsystem`.

    >>> format_of("a.query", b""), format_of("a.cps", b"<cps:System/>"), format_of("a.txt", b"Hello")
    ('query', 'xmi', None)
    """
    suffix = suffix_of(name)
    if suffix in FORMATS and suffix not in AMBIGUOUS_SUFFIXES:
        return suffix
    wide = "utf-16" if head[:2] in (b"\xff\xfe", b"\xfe\xff") else None
    wide = {b"<\0": "utf-16-le", b"\0<": "utf-16-be"}.get(head[:2], wide)
    text = head.decode(wide or "utf-8", errors="replace").lstrip("\ufeff \t\r\n")
    if text.startswith("<"):
        root = _ROOT.match(text)
        if namespace_of(text) == "http://www.w3.org/2001/XMLSchema":
            return "xsd"
        return "ecore" if root and root.group(2) == "EPackage" and _ECORE in root.group(3) else "xmi"
    if suffix in ("model", "metamodel"):
        return suffix
    if text.startswith("SQLite format 3\0"):
        return "sqlite"
    if suffix != "json" and text[:1] not in ("{", "["):
        return None
    ours = _OWN_JSON_FORMAT.search(text)
    return ours.group(1) if ours and ours.group(1) != "model" else "json"
