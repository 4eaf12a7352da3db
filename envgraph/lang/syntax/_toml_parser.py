"""Parse TOML with the position of every key and value.

`tomllib` reads the data and rejects invalid TOML. A second pass over the same text records the positions, and may
assume valid TOML.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from dataclasses import field
from typing import Any

from envgraph.code import dataclass
from envgraph.errors import LARGEST_INT, RAISE_LIMIT_HINT, Diagnostic, LoadError, Source, Span, scaled_limit
from envgraph.lang.syntax._file_formats import check_language

TomlPath = tuple[str | int, ...]
"""The keys and list indices from the root to a value."""

_BLANK = re.compile(r"(?:[ \t\r\n]|#[^\n]*)+")
_KEY = re.compile(r"[A-Za-z0-9_-]+|\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*'")
_STRING = re.compile(r"\"\"\"(?:\\.|[^\\])*?\"{3,5}|'''[\s\S]*?'{3,5}|\"(?:\\.|[^\"\\\n])*\"|'[^'\n]*'", re.DOTALL)
_INTEGER = re.compile("[+-]?[0-9][0-9_]*|0[xob][0-9a-fA-F_]+")
_PLAIN = re.compile(r"[^,\]}#\n]+")
_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
_PARTS = r"(?<![\w.-])(?:(?:[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"
"""Matches one leading part of a dotted key; it also matches in strings and comments, but rarely many times."""
_INT_SIZE_HINT = f"an int has 64 bits: write {LARGEST_INT} at most"
_WORD = re.compile(r"[A-Za-z_][\w./-]*")
_UNQUOTED_VALUES = ("true", "false", "inf", "nan")
SETTING_SOURCE_NAME = "--set"
"""The name that diagnostics show for the text of a setting."""

_HINTS = {
    "unclosed array": "end the list with `]`, and write commas between its values",
    "unclosed inline": "end the table with `}`, and write commas between its entries",
    "unterminated string": 'close it with `"`',
    "not closed on its line": 'close it with `"`',
    "expected '=' after": "write `key = value`; a section is `[name]`",
    "expected ']": "write a section as `[name]`",
    "expected ''": "close it with `'`",
    "expected newline": 'write one `key = value` on each line, and texts between `"`',
    "unescaped '": "write `\\\\` for a backslash, or write the text between `'`",
    "key part": "write a name of letters, digits, `_` and `-`; remove a comma at the end of a table",
    "invalid value": 'write a number, `true`, `false`, a text between `"`, a list or a table',
}
"""By part of an error message of tomllib: the hint."""


@dataclass(slots=True)
class TomlText:
    """A TOML text as data, with the spans of its keys and values.

    Attributes:
        source: the text.
        data: the tables and values.
        keys: the span of the last part of each key and table header.
        values: the span of each value; for a table with a header, the header.
    """

    source: Source
    data: dict[str, Any]
    keys: dict[TomlPath, Span] = field(default_factory=dict)
    values: dict[TomlPath, Span] = field(default_factory=dict)

    def key_span(self, *path: str | int) -> Span:
        """Return the span of a key; if the key is missing, the span of the innermost existing table around it."""
        return self._nearest(self.keys, path)

    def value_span(self, *path: str | int) -> Span:
        """Return the span of a value; if the value is missing, the span of the innermost existing table around it."""
        return self._nearest(self.values, path)

    def _nearest(self, spans: dict[TomlPath, Span], path: TomlPath) -> Span:
        while path and path not in spans:
            path = path[:-1]
        return spans[path] if path else self.source.span_between(0, 0)


def parse_toml(source: Source) -> TomlText:
    r"""Parse a TOML text.

    Raises:
        LoadError: the text is not valid TOML; the diagnostic has the position.

    >>> text = parse_toml(Source("a.toml", "[search]\nparents = { name = 'random' }"))
    >>> str(text.value_span("search", "parents", "name")), text.value_span("search", "parents", "name").text
    ('a.toml:2:20', "'random'")
    """
    _check_depth(source)
    try:
        # Offsets refer to the unchanged text, although tomllib replaces "\r\n".
        text = TomlText(source, tomllib.loads(source.text))
        _SpanIndexer(text).index_text()
    except tomllib.TOMLDecodeError as error:
        other = check_language("toml", source)
        raise LoadError([other or _syntax_error(source, str(error))]) from None
    except (ValueError, RecursionError):
        # caused by a number of thousands of digits, or by arrays nested over many lines
        found = re.search("[0-9][0-9_]{4299,}", source.text)
        span = source.span_between(*found.span() if found else (0, 0))
        if found is None:
            raise LoadError.from_problem("syntax", "a list is nested too deeply", span, "use fewer levels") from None
        raise LoadError.from_problem("syntax", "the number is too large", span, _INT_SIZE_HINT) from None
    return text


def _check_depth(source: Source) -> None:
    """Reject text that tomllib cannot handle: too many brackets on a line, or keys with too many parts.

    tomllib recurses into arrays and inline tables, and takes quadratic time in the number of parts of a key.

    Raises:
        LoadError: a line or a key exceeds the limit.
    """
    deepest = scaled_limit("nesting of TOML")
    at = 0
    for line in source.text.split("\n"):
        if line.count("[") + line.count("{") > deepest:
            message = f"this line has more than {deepest} opening brackets"
            span = source.span_between(at, at + len(line))
            raise LoadError.from_problem("nested-too-deeply", message, span, RAISE_LIMIT_HINT)
        at += len(line) + 1
    found = re.search(_PARTS + f"{{{deepest}}}", source.text)
    if found:
        raise LoadError.from_problem(
            "nested-too-deeply",
            f"a key has more than {deepest} parts",
            source.span_between(*found.span()),
            RAISE_LIMIT_HINT,
        )


def apply_overrides(toml: TomlText, overrides: Iterable[str]) -> None:
    r"""Replace values of a TOML text by settings such as `search.population=10`; later settings win.

    A value is written as in TOML, but a string that is a simple word or path needs no quotation marks.

    Raises:
        LoadError: settings are invalid; contains all of their errors.

    >>> text = parse_toml(Source("a.toml", "[search]\nparents = 'random'"))
    >>> apply_overrides(text, ["search.parents=elitist", "search.population=10"])
    >>> text.data, text.value_span("search", "population").text
    ({'search': {'parents': 'elitist', 'population': 10}}, '10')
    """
    problems: list[Diagnostic] = []
    for setting in overrides:
        try:
            _apply_setting(toml, _parse_setting(setting))
        except LoadError as error:
            problems += error.diagnostics
    if problems:
        raise LoadError(problems)


def _parse_setting(text: str) -> TomlText:
    key, equals, value = text.partition("=")
    if not equals or "\n" in text:
        source = Source(SETTING_SOURCE_NAME, text)
        hint = "write a key of the file and its value: `--set search.population=10`"
        raise LoadError.from_problem("syntax", "a setting must be `key=value`", source.span_between(0, len(text)), hint)
    if _WORD.fullmatch(value.strip()) and value.strip() not in _UNQUOTED_VALUES:
        value = f'"{value.strip()}"'
    return parse_toml(Source(SETTING_SOURCE_NAME, f"{key}={value}"))


def _apply_setting(toml: TomlText, setting: TomlText) -> None:
    path = min(setting.values, key=len)  # paths of inner values are longer
    value: Any = setting.data
    table: Any = toml.data
    for size, key in enumerate(path, start=1):
        value = value[key]
        if size == len(path):
            table[key] = value
            break
        table = table.setdefault(key, {})
        if not isinstance(table, dict):
            where = ".".join(map(str, path[:size]))
            message, hint = (
                f"`{where}` is not a table",
                f"set the whole table: `--set '{where}={{ name = \"...\" }}'`",
            )
            raise LoadError.from_problem("wrong-type", message, setting.key_span(*path[:size]), hint)
    for spans, others in ((toml.keys, setting.keys), (toml.values, setting.values)):
        for place in [one for one in spans if one[: len(path)] == path]:
            del spans[place]
        for place, span in others.items():
            spans.setdefault(place, span)


def _syntax_error(source: Source, message: str) -> Diagnostic:
    place = _PLACE.search(message)
    start = len(source.text)
    if place and place.group(1):
        line, column = int(place.group(1)), int(place.group(2))
        # tomllib counts in the text without "\r".
        offsets = [0, *(found.end() for found in re.finditer("\n", source.text))]
        start = offsets[line - 1] + column - 1
    text = message[: place.start()] if place else message
    if text == "Illegal character '\\n'":
        text = "The string is not closed on its line"
    text = text[0].lower() + text[1:]
    repeated = re.fullmatch(r"cannot (?:overwrite a value|declare \((.*?),?\) twice)", text)
    if repeated:
        # tomllib stops behind the second definition, which is alone on its line.
        start = source.text.rfind("\n", 0, max(start - 1, 0)) + 1
        key = re.match(r"[^=\n]*[^=\s]", source.text[start:])
        what = key.group() if key else "this"
        return Diagnostic(
            "duplicate-key",
            f"`{what}` is defined twice",
            source.span_between(start, start + len(what)),
            "leave one out, or merge the two",
        )
    word = re.compile(r"[^\W\d]\w*").match(source.text, start) if text == "invalid value" else None
    if word:
        meant = word.group().lower()
        hint = f"write `{meant}`" if meant in {"true", "false"} else f'write `"{word.group()}"` for a string'
        return Diagnostic("syntax", text, source.span_between(start, word.end()), hint)
    return Diagnostic("syntax", text, source.span_between(start, start + 1), _hint_for(text))


def _hint_for(text: str) -> str:
    """Return a hint for an error message of tomllib."""
    for part, hint in _HINTS.items():
        if part in text:
            return hint
    return 'write `key = value`, and texts between `"`'


class _SpanIndexer:
    def __init__(self, text: TomlText) -> None:
        self._toml = text
        self._text = text.source.text
        self._at = 0
        self._table: TomlPath = ()
        self._counts: dict[TomlPath, int] = {}

    def index_text(self) -> None:
        self._skip_blanks()
        while self._at < len(self._text):
            if self._text[self._at] == "[":
                self._read_header()
            else:
                self._read_pair(self._table)
            self._skip_blanks()

    def _skip_blanks(self) -> None:
        found = _BLANK.match(self._text, self._at)
        if found:
            self._at = found.end()

    def _read_header(self) -> None:
        start = self._at
        array = self._text.startswith("[[", start)
        self._at += 2 if array else 1
        path = self._read_key(())
        self._skip_blanks()
        self._at += 2 if array else 1
        span = self._toml.source.span_between(start, self._at)
        for size in range(1, len(path) + 1):
            self._toml.values.setdefault(path[:size], span)
        if array:
            self._counts[path] = self._counts.get(path, -1) + 1
            path = (*path, self._counts[path])
            self._toml.keys[path] = self._toml.values[path] = span
        self._table = path

    def _read_pair(self, table: TomlPath) -> None:
        path = self._read_key(table)
        self._skip_blanks()
        self._at += 1  # the equals sign
        self._read_value(path)

    def _read_key(self, table: TomlPath) -> TomlPath:
        """Read a dotted key, record the spans of its parts, and return its path from the root.

        A part that names an array of tables refers to its last table.
        """
        path = table
        while True:
            self._skip_blanks()
            found = _KEY.match(self._text, self._at)
            assert found is not None
            if path != table and path in self._counts:
                path = (*path, self._counts[path])
            path = (*path, _unquoted_key(found.group()))
            self._toml.keys.setdefault(path, self._toml.source.span_between(found.start(), found.end()))
            self._at = found.end()
            self._skip_blanks()
            if not self._text.startswith(".", self._at):
                return path
            self._at += 1

    def _read_value(self, path: TomlPath) -> None:
        self._skip_blanks()
        start = self._at
        if self._text[start] == "[":
            self._read_items(path, "]")
        elif self._text[start] == "{":
            self._read_items(path, "}")
        else:
            found = _STRING.match(self._text, start) or _PLAIN.match(self._text, start)
            assert found is not None
            self._at = start + len(found.group().rstrip())
        span = self._toml.values[path] = self._toml.source.span_between(start, self._at)
        if _INTEGER.fullmatch(span.text) and not -LARGEST_INT - 1 <= int(span.text, 0) <= LARGEST_INT:
            raise LoadError.from_problem("number-too-large", "the number is too large", span, _INT_SIZE_HINT)

    def _read_items(self, path: TomlPath, closing: str) -> None:
        """Read the elements of an array, or the pairs of an inline table."""
        self._at += 1
        number = 0
        self._skip_blanks()
        while self._text[self._at] != closing:
            if closing == "]":
                self._read_value((*path, number))
                number += 1
            else:
                self._read_pair(path)
            self._skip_blanks()
            if self._text[self._at] == ",":
                self._at += 1
                self._skip_blanks()
        self._at += 1


def _unquoted_key(key: str) -> str:
    if key[0] == '"':
        # TOML keys and TOML strings have the same escapes.
        return str(tomllib.loads(f"x = {key}")["x"])
    return key[1:-1] if key[0] == "'" else key
