"""Divide a text into parts of about one definition each, and parse the parts.

Parsing takes most of the time of a request, so results are cached by the text of a part: after a keystroke only the
part with the cursor is parsed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise

from lark import Token, Tree
from lark.parsers.lalr_analysis import Shift

from envgraph.code import dataclass
from envgraph.errors import Source
from envgraph.lang.syntax._grammar import Grammar, language_of, load_grammar
from envgraph.lang.syntax._lexer import Lexeme
from envgraph.lang.syntax._parser import parse_tokens, states_before

_DEFINITION_STARTS = {
    "metamodel": r"(?:abstract[ \t]+)?class|enum",
    "model": r"model[ \t]+\w",
    "query": r"(?:private[ \t]+|search[ \t]+|incremental[ \t]+)*pattern|function",
    "rules": r"rule|unit|derive",
    "environment": r"environment",
}
_CUT_SIGNS = {
    language: re.compile(
        r'"""[\s\S]*?(?:"""|\Z)|"(?:\\.|[^"\\\n])*"|' + r"'(?:\\.|[^'\\\n])*'|//[^\n]*|/\*[\s\S]*?(?:\*/|\Z)"
        rf"|[{{}}]|^(?:{words})\b",
        re.MULTILINE,
    )
    for language, words in _DEFINITION_STARTS.items()
}
"""By language: matches the signs that decide where a definition ends, and texts that may contain such signs."""
_AFTER_BRACE = re.compile(r"[ \t]*;?[ \t]*(?://[^\n]*)?\r?\n(?:[ \t]*\r?\n)*(?!(?>\s|//[^\n]*\n|/\*[\s\S]*?\*/)*+or\b)")
"""Matches the rest of the line behind the `}` of a definition, and empty lines after it."""


@dataclass(frozen=True, slots=True, eq=False)
class PartReading:
    """The lexemes and the syntax tree of a part of a text; all offsets count from the start of the part.

    Attributes:
        source: the text of the part, without a name.
        lexemes: the lexemes; the last one is the end of the part.
        tree: the syntax tree; None if the part cannot be parsed at all.
        has_mistakes: True if the part has lexical or syntax errors.
    """

    grammar: Grammar
    source: Source
    lexemes: tuple[Lexeme, ...]
    tree: Tree[Token] | None
    has_mistakes: bool

    def spans_around(self, offset: int) -> Iterator[tuple[int, int]]:
        """Yield start and end of the syntax trees and the token that contain an offset, from the outermost inwards."""
        tree: Tree[Token] | Token | None = self.tree
        while tree is not None:
            yield _bounds(tree)
            inner = tree.children if isinstance(tree, Tree) else ()
            around = (one for one in inner if one is not None and _bounds(one)[0] <= offset <= _bounds(one)[1])
            tree = next(around, None)

    def states_before(self, offset: int) -> list[int] | None:
        """Return the parser states after all lexemes that start before an offset; None if the text there is skipped."""
        return states_before(self.grammar, self.source, self.lexemes, offset)


def _bounds(item: Tree[Token] | Token) -> tuple[int, int]:
    """Return start and end of a tree or token; (-1, -1) for an empty tree."""
    if isinstance(item, Token):
        return item.start_pos or 0, item.end_pos or 0
    return (-1, -1) if item.meta.empty else (item.meta.start_pos, item.meta.end_pos)


@dataclass(frozen=True, slots=True)
class TextPart:
    """A part of a text: whole lines, in most cases one definition with the comments before it.

    Attributes:
        language: the language of the text.
        start: the offset of the part in the whole text.
        text: the text of the part.
    """

    language: str
    start: int
    text: str

    @property
    def end(self) -> int:
        """Return the offset of the end of the part in the whole text."""
        return self.start + len(self.text)

    @property
    def reading(self) -> PartReading:
        """Return the lexemes and the syntax tree of the part, from a cache if this text was read before."""
        return _read_part(self.language, self.text)


@lru_cache(maxsize=2048)
def _read_part(language: str, text: str) -> PartReading:
    grammar, source = load_grammar(language), Source("", text)
    parsed, lexemes = parse_tokens(grammar, source)
    return PartReading(grammar, source, tuple(lexemes), parsed.tree, bool(parsed.diagnostics))


@lru_cache(maxsize=64)
def text_parts(source: Source) -> tuple[TextPart, ...]:
    """Return the parts of a text in one of the five languages, in their order; () for a text in another language."""
    language = language_of(source.name)
    if language is None:
        return ()
    cuts = [0, *_cut_offsets(language, source.text), len(source.text)]
    return tuple(TextPart(language, a, source.text[a:b]) for a, b in pairwise(cuts) if a < b)


def part_at(source: Source, offset: int) -> TextPart | None:
    """Return the part that contains an offset, the end of the text included; None without a known language."""
    for part in text_parts(source):
        if offset < part.end or part.end == len(source.text):
            return part
    language = language_of(source.name)
    return TextPart(language, 0, source.text) if language else None


def _cut_offsets(language: str, text: str) -> Iterator[int]:
    """Yield the offsets behind the last line of each definition.

    A definition that starts at the first column ends the definition before it, even if a `}` is missing there.
    """
    depth = 0
    for found in _CUT_SIGNS[language].finditer(text):
        sign = found.group()
        if sign == "{":
            depth += 1
        elif sign == "}":
            depth = max(0, depth - 1)
            if depth == 0 and (rest := _AFTER_BRACE.match(text, found.end())):
                yield rest.end()
        elif depth and sign[0].isalpha():
            depth = 0
            yield found.start()


def name_roles(grammar: Grammar, states: list[int]) -> tuple[frozenset[str], frozenset[str]] | None:
    """Return the roles of a name that is read in these parser states; None if no name is accepted there.

    The roles are the grammar rules that the name can end, without the prefixes of imported rules, and the signs and
    keywords that can follow the name inside of a rule.
    """
    if not grammar.accepts(states, "NAME"):
        return None
    after = [*states]
    grammar.advance(after, "NAME")
    rules, signs = set(), set()
    for terminal, (action, argument) in grammar.states[after[-1]].items():
        if terminal not in grammar.spelling:
            continue
        if action is Shift:
            signs.add(grammar.spelling[terminal].strip("`"))
        elif grammar.accepts(after, terminal):
            rules.add(argument.rule.rpartition("__")[2] if argument.rule[0] != "_" else argument.rule)
    return frozenset(rules), frozenset(signs)
