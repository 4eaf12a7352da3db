"""Format texts of the five languages in one style."""

from __future__ import annotations

from dataclasses import replace

from envgraph.errors import InvalidArgument, LoadError, Source
from envgraph.lang.format._constructs import CONSTRUCTS
from envgraph.lang.format._document import HARD, Piece, joined, lines_of, printed
from envgraph.lang.format._layout import Layout
from envgraph.lang.format._tokens import Part, Tokens, comments_of, read_tokens
from envgraph.lang.syntax._grammar import RECOVERY, grammar
from envgraph.lang.syntax._lexer import Lexeme
from envgraph.lang.syntax._parsing import parse_tokens


def format_text(language: str, text: str, name: str = "<text>") -> str:
    """Return a text in the standard style of its language.

    Only blanks, line breaks and the indentation of comments and grid rows change. A comment between a statement and its
    `;` is moved behind the `;`. Formatting a formatted text changes nothing. The kind of line break of the first line
    is used for all lines.

    Args:
        language: "metamodel", "model", "query", "rules" or "environment".
        text: a text without syntax errors. Names in it need not be defined.
        name: the name of the file, for diagnostics.

    Raises:
        LoadError: the text has syntax errors; contains all of them.
        InvalidArgument: the language is unknown.

    >>> print(format_text("query", "pattern far(a:Tile,b:Tile){neg find near( a,b ) ;a!=b;}"), end="")
    pattern far(a : Tile, b : Tile) { neg find near(a, b); a != b; }
    """
    if language not in RECOVERY:
        raise InvalidArgument(f"unknown language `{language}`; the languages are {', '.join(RECOVERY)}")
    plain = text.replace("\r\n", "\n")
    source = Source(name, plain)
    parsed, lexemes = parse_tokens(grammar(language), source)
    if parsed.tree is None or parsed.diagnostics:
        raise LoadError(parsed.diagnostics)
    tokens, root = read_tokens(plain, lexemes, parsed.tree)
    lines = [line.rstrip(" ") for line in _lines(tokens, root.parts())]
    while lines and not lines[0]:
        del lines[0]
    result = "\n".join(lines).rstrip("\n") + "\n" if any(lines) else ""
    _assert_same(language, tokens, lexemes, result)
    first = text.find("\n")
    return result.replace("\n", "\r\n") if first > 0 and text[first - 1] == "\r" else result


def language_of(name: str) -> str | None:
    """Return the language of a file with this name; None if the suffix belongs to none of the five languages.

    >>> language_of("rules/railway.vql"), language_of("family.toml")
    ('query', None)
    """
    _, dot, ending = name.rpartition(".")
    if not dot:
        return None
    return "query" if ending == "vql" else ending if ending in RECOVERY else None


def _lines(tokens: Tokens, definitions: list[Part]) -> list[str]:
    """Return the lines of all definitions and of the comments behind them.

    An empty line is inserted after each definition of several lines, and before it if the previous definition is of
    another kind.
    """
    layout = Layout(tokens, CONSTRUCTS)
    if tokens.gaps[0].remarks:
        first, *rest = tokens.gaps[0].remarks
        tokens.gaps[0] = replace(tokens.gaps[0], remarks=(replace(first, breaks=1), *rest))
    pieces: list[Piece] = []
    after_long, after_kind = False, ""
    for definition in definitions:
        before = printed(layout.vertical(definition.first, bool(after_kind)))
        own = printed(layout.part(definition))
        long = "\n" in own or "\n\n" in own
        apart = after_long or (long and after_kind not in ("", definition.kind))
        if apart and "\n\n" not in before and "\n" in before:
            before[before.index("\n")] = "\n\n"
        pieces += before
        pieces += own
        after_long, after_kind = long, definition.kind
    return lines_of([*pieces, *printed(joined((*layout.remarks(tokens.gaps[-1], bool(definitions)), HARD)))])


def _assert_same(language: str, tokens: Tokens, lexemes: list[Lexeme], result: str) -> None:
    """Assert that the formatted text has the same tokens and comments as the original text."""
    source = Source("<formatted>", result)
    parsed, again = parse_tokens(grammar(language), source)
    assert parsed.tree is not None and not parsed.diagnostics, "the formatted text cannot be read"
    assert list(map(_word, lexemes)) == list(map(_word, again)), "the formatted text has other tokens"
    other, _ = read_tokens(result, again, parsed.tree)
    assert list(comments_of(tokens)) == list(comments_of(other)), "the formatted text has other comments"


def _word(lexeme: Lexeme) -> tuple[str, str, bool]:
    value = lexeme.value
    if lexeme.kind == "TEXT":
        value = "\n".join(line.strip() for line in value.split("\n"))
    return lexeme.kind, value, lexeme.escaped
