"""Pygments lexers for the languages, made from their grammars."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

from grammar_files import LANGUAGES
from language_tokens import NAME, LanguageTokens, tokens_of
from pygments.lexer import Lexer
from pygments.token import Comment, Error, Keyword, Name, Number, Operator, Punctuation, String, Whitespace

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_KINDS = {
    "WHITESPACE": Whitespace,
    "LINE_COMMENT": Comment.Single,
    "BLOCK_COMMENT": Comment.Multiline,
    "STRING": String,
    "TEXT": String,
    "INT": Number.Integer,
    "LONG": Number.Integer,
    "FLOAT": Number.Float,
}
_CONSTANTS = {"true", "false", "none", "TRUE", "FALSE"}
_ERROR = "error"


class GrammarLexer(Lexer):
    """Splits a text into the tokens of a grammar, and decides by their neighbours which words are keywords."""

    tokens: ClassVar[LanguageTokens]

    def get_tokens_unprocessed(self, text: str) -> Iterator[tuple[int, Any, str]]:
        """Yield the position, the kind and the text of each token."""
        pieces = list(self._split(text))
        words = [index for index, (kind, _) in enumerate(pieces) if kind not in self.tokens.ignored]
        following = {index: pieces[after] for index, after in pairwise(words)}
        position, before = 0, None
        for index, (kind, piece) in enumerate(pieces):
            if kind in self.tokens.ignored or kind == _ERROR:
                yield position, _KINDS.get(kind, Error), piece
            else:
                token = kind
                if kind == NAME and self.tokens.is_keyword(piece, before, self._token(following.get(index))):
                    token = piece
                yield position, self._colour(token, piece, before), piece
                before = token
            position += len(piece)

    def _split(self, text: str) -> Iterator[tuple[str, str]]:
        """Yield the kind of each token and its text; the kind of a sign is the sign."""
        patterns = [f"(?P<{name}>{expression})" for name, expression in self.tokens.patterns.items()]
        signs = "|".join(map(re.escape, self.tokens.signs))
        for found in re.finditer("|".join([*patterns, f"(?P<sign>{signs})", f"(?P<{_ERROR}>[\\s\\S])"]), text):
            kind = found.lastgroup or _ERROR
            yield found.group() if kind == "sign" else kind, found.group()

    def _token(self, piece: tuple[str, str] | None) -> str | None:
        if piece is None or piece[0] == _ERROR:
            return None
        return piece[1] if piece[0] == NAME and not piece[1].startswith("^") else piece[0]

    def _colour(self, token: str, piece: str, before: str | None) -> Any:
        if token in _KINDS:
            return _KINDS[token]
        if token != NAME:
            if piece in _CONSTANTS:
                return Keyword.Constant
            if piece == "@":
                return Name.Decorator
            return Keyword if piece[0].isalpha() else Punctuation if piece in "()[]{},;" else Operator
        if before == "@":
            return Name.Decorator
        if before in self.tokens.declaring:
            return Name.Function
        return Name.Class if piece.lstrip("^")[:1].isupper() else Name


LEXERS: dict[str, type[GrammarLexer]] = {
    language: type(
        f"{language.title()}Lexer",
        (GrammarLexer,),
        {"name": language, "aliases": [language], "tokens": tokens_of(language)},
    )
    for language in LANGUAGES
}


_WRONG = re.compile(r"^( *)```(\w+) wrong$", re.MULTILINE)


def _mark_mistakes(app: Sphinx, document: str, source: list[str]) -> None:
    """Give blocks that are marked as wrong a class; the style sheet adds a caption."""
    source[0] = _WRONG.sub(r"\1```{code-block} \2\n\1:class: wrong\n", source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the lexers with Sphinx."""
    app.connect("source-read", _mark_mistakes)
    for language, lexer in LEXERS.items():
        app.add_lexer(language, lexer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
