"""Texts at hand to data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from envgraph.errors import Diagnostic, InvalidArgument, LoadError, Severity, Source
from envgraph.lang.read._query import read_query
from envgraph.lang.read._query_header import DefinitionsFile
from envgraph.lang.read._reading import TypeNames
from envgraph.lang.read._rules import read_rules
from envgraph.lang.syntax._grammar import grammar
from envgraph.lang.syntax._lexer import NO_FRAME, Frame, Lexeme
from envgraph.lang.syntax._parsing import Parsed, parse_tokens
from envgraph.pattern import Derivation, FunctionDeclaration, Pattern, Rule, Unit

Definition = Pattern | Rule | Unit | Derivation | FunctionDeclaration


def from_text(text: str, language: str = "rules", name: str = "<text>") -> tuple[Definition, ...]:
    """The definitions that a text has, for `Engine.add`; the way back from `to_text`.

    Imports are not followed: what the definitions mention is looked for in the engine that they are added to.

    Args:
        text: of a `.rules` or a `.query` file.
        language: "rules" or "query".
        name: what the text is called in messages.

    Raises:
        LoadError: all that is wrong with the text before any name is looked up.
        InvalidArgument: another language.

    >>> from envgraph.lang import to_text
    >>> text = "rule burn {\\n    lhs { tile : RoadTile; }\\n    modify { retype tile : BurningTile; }\\n}\\n"
    >>> to_text(*from_text(text)) == text
    True
    """
    if language not in ("query", "rules"):
        raise InvalidArgument(f'definitions are in "rules" or "query", not in {language!r}')
    file = read_framed(language, Source(name, text))[0]
    raise_errors(file.diagnostics)
    return file.definitions


def read_framed(
    language: str, source: Source, frame: Frame = NO_FRAME
) -> tuple[DefinitionsFile[Any], list[Lexeme]]:
    """What a text and the frame around it define, and their lexemes; imports are not followed."""
    parsed, lexemes = parse_tokens(grammar(language), source, frame)
    read: Callable[[Parsed, TypeNames], DefinitionsFile[Any]] = (
        read_query if language == "query" else read_rules
    )
    return read(parsed, TypeNames()), lexemes


def raise_errors(problems: Sequence[Diagnostic]) -> None:
    """Raise LoadError with those that are errors, if there are any."""
    errors = [one for one in problems if one.severity is Severity.ERROR]
    if errors:
        raise LoadError(errors)
