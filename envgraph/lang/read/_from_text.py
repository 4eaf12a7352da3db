"""Parse definitions from strings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, Source
from envgraph.lang.read._file_reading import TypeNames
from envgraph.lang.read._query_header import DefinitionsFile
from envgraph.lang.read._query_reader import read_query
from envgraph.lang.read._rules_reader import read_rules
from envgraph.lang.syntax._grammar import load_grammar
from envgraph.lang.syntax._lexer import NO_SURROUNDING_TEXT, Lexeme, SurroundingText
from envgraph.lang.syntax._parser import ParseResult, parse_tokens
from envgraph.pattern import Derivation, FunctionDeclaration, Pattern, Rule, Unit

Definition = Pattern | Rule | Unit | Derivation | FunctionDeclaration


def from_text(text: str, language: str = "rules", name: str = "<text>") -> tuple[Definition, ...]:
    r"""Return the definitions in a text, for `Engine.add`; the inverse of `to_text`.

    Imports are not followed. Names are resolved by the engine to which the definitions are added.

    Args:
        text: the contents of a `.rules` or `.query` file.
        language: "rules" or "query".
        name: the name of the text in error messages.

    Raises:
        LoadError: the text has syntax errors; lists all problems that are found before names are resolved.
        InvalidArgument: `language` is neither "rules" nor "query".

    >>> from envgraph.lang import to_text
    >>> text = "rule burn {\n    lhs { tile : RoadTile; }\n    modify { retype tile : BurningTile; }\n}\n"
    >>> to_text(*from_text(text)) == text
    True
    """
    if language not in ("query", "rules"):
        raise InvalidArgument(f'`language` is {language!r}, but must be "rules" or "query"')
    file = read_framed(language, Source(name, text))[0]
    raise_errors(file.diagnostics)
    return file.definitions


def read_framed(
    language: str, source: Source, frame: SurroundingText = NO_SURROUNDING_TEXT
) -> tuple[DefinitionsFile[Any], list[Lexeme]]:
    """Return the definitions and lexemes of a text between the two texts of `frame`; imports are not followed."""
    parsed, lexemes = parse_tokens(load_grammar(language), source, frame)
    read: Callable[[ParseResult, TypeNames], DefinitionsFile[Any]] = read_query if language == "query" else read_rules
    return read(parsed, TypeNames()), lexemes


def raise_errors(problems: Sequence[Diagnostic]) -> None:
    """Raise LoadError with the diagnostics that are errors; do nothing if all are warnings."""
    errors = [one for one in problems if one.severity is Severity.ERROR]
    if errors:
        raise LoadError(errors)
