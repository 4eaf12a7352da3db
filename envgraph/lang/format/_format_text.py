"""Format texts of the five languages in one style."""

from __future__ import annotations

from dataclasses import replace

from envgraph.errors import InvalidArgument, LoadError, Source
from envgraph.lang.format._construct_layouts import DOCUMENT_FUNCTIONS
from envgraph.lang.format._document_builder import DocumentBuilder
from envgraph.lang.format._layout_document import (
    FORCED_LINE,
    Piece,
    aligned_lines,
    join_documents,
    print_pieces,
)
from envgraph.lang.format._token_table import SyntaxPart, TokenTable, comment_texts, read_tokens
from envgraph.lang.syntax._grammar import RECOVERY_RULES, load_grammar
from envgraph.lang.syntax._lexer import Lexeme
from envgraph.lang.syntax._parser import parse_tokens


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
    if language not in RECOVERY_RULES:
        raise InvalidArgument(f"unknown language `{language}`; the languages are {', '.join(RECOVERY_RULES)}")
    unix_text = text.replace("\r\n", "\n")
    source = Source(name, unix_text)
    parsed, lexemes = parse_tokens(load_grammar(language), source)
    if parsed.tree is None or parsed.diagnostics:
        raise LoadError(parsed.diagnostics)
    tokens, root = read_tokens(unix_text, lexemes, parsed.tree)
    lines = [line.rstrip(" ") for line in _formatted_lines(tokens, root.child_parts())]
    while lines and not lines[0]:
        del lines[0]
    result = "\n".join(lines).rstrip("\n") + "\n" if any(lines) else ""
    _assert_same_tokens(language, tokens, lexemes, result)
    first = text.find("\n")
    return result.replace("\n", "\r\n") if first > 0 and text[first - 1] == "\r" else result


def _formatted_lines(tokens: TokenTable, definitions: list[SyntaxPart]) -> list[str]:
    """Return the lines of all definitions and of the comments behind them.

    An empty line is inserted after each definition of several lines, and before it if the previous definition is of
    another kind.
    """
    layout = DocumentBuilder(tokens, DOCUMENT_FUNCTIONS)
    if tokens.gaps[0].comments:
        first, *rest = tokens.gaps[0].comments
        tokens.gaps[0] = replace(tokens.gaps[0], comments=(replace(first, line_breaks=1), *rest))
    pieces: list[Piece] = []
    after_long, after_kind = False, ""
    for definition in definitions:
        before = print_pieces(layout.statement_gap_document(definition.first, bool(after_kind)))
        own = print_pieces(layout.part_document(definition))
        long = "\n" in own or "\n\n" in own
        apart = after_long or (long and after_kind not in ("", definition.kind))
        if apart and "\n\n" not in before and "\n" in before:
            before[before.index("\n")] = "\n\n"
        pieces += before
        pieces += own
        after_long, after_kind = long, definition.kind
    return aligned_lines(
        [
            *pieces,
            *print_pieces(join_documents((*layout.comment_documents(tokens.gaps[-1], bool(definitions)), FORCED_LINE))),
        ]
    )


def _assert_same_tokens(language: str, tokens: TokenTable, lexemes: list[Lexeme], result: str) -> None:
    """Assert that the formatted text has the same tokens and comments as the original text."""
    source = Source("<formatted>", result)
    parsed, again = parse_tokens(load_grammar(language), source)
    assert parsed.tree is not None and not parsed.diagnostics, "the formatted text cannot be read"
    assert list(map(_token_key, lexemes)) == list(map(_token_key, again)), "the formatted text has other tokens"
    other, _ = read_tokens(result, again, parsed.tree)
    assert list(comment_texts(tokens)) == list(comment_texts(other)), "the formatted text has other comments"


def _token_key(lexeme: Lexeme) -> tuple[str, str, bool]:
    value = lexeme.value
    if lexeme.kind == "TEXT":
        value = "\n".join(line.strip() for line in value.split("\n"))
    return lexeme.kind, value, lexeme.is_escaped
