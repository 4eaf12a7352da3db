"""Compute the tokens of a language from its grammar: keywords, signs, regular expressions, and what may be adjacent.

Nothing here knows about a program that colours text, so lexers for several such programs can be made from this.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

from grammar_files import (
    Choice,
    Literal,
    Part,
    Pattern,
    Reference,
    Repetition,
    Sequence,
    definition_of,
    parts_of,
    reachable_rules,
    read_grammar_file,
)
from grammar_text import part_text

NAME = "NAME"
_DEFINING_RULES = ("definition", "clause")
_KEYWORDS_AS_NAMES = "COUNT | SUM | MIN | MAX | AVG"
"""The alternative of the grammar that reads these keywords as names of variables."""


@dataclass(frozen=True, slots=True)
class LanguageTokens:
    """The tokens of a language.

    A token is known by its text if it is a keyword or a sign, otherwise by the name of its terminal, such as `NAME`.

    Attributes:
        keywords: the words that can be keywords. Each word is a keyword only where the grammar allows the keyword.
        signs: operators and brackets, longest first.
        patterns: the regular expressions of the other terminals, in the order in which they are tried.
        ignored: the terminals between tokens: white space and comments.
        pairs: the pairs of tokens that may follow each other.
        declaring: the keywords that are followed by the name of a new definition, as in `rule move`.
    """

    keywords: frozenset[str]
    signs: tuple[str, ...]
    patterns: dict[str, str]
    ignored: frozenset[str]
    pairs: frozenset[tuple[str, str]]
    declaring: frozenset[str]

    def is_keyword(self, word: str, before: str | None, after: str | None) -> bool:
        """Return True if a word is a keyword between two tokens.

        Args:
            word: the word.
            before: the token before the word; None if unknown, as at the start of a text.
            after: the token after the word; None if unknown. A word after the word is given as it is written.
        """
        if word not in self.keywords or (before is not None and (before, word) not in self.pairs):
            return False
        is_word = after is not None and after not in self.signs and after not in self.patterns
        return after is None or (word, after) in self.pairs or (is_word and (word, NAME) in self.pairs)


@dataclass(slots=True)
class _Edges:
    """The tokens that a part can begin with and end with, and whether the part can be empty."""

    first: set[str] = field(default_factory=set)
    last: set[str] = field(default_factory=set)
    is_empty: bool = False


def is_word(text: str) -> bool:
    """Return True if a literal is a keyword, not a sign."""
    return text[0].isalpha()


def _literal_of(reference: Reference) -> str | None:
    """Return the token of a terminal: its text, or its name if it is a regular expression; None for a rule."""
    if not reference.name.isupper():
        return None
    definition = definition_of(reference)
    return definition.text if isinstance(definition, Literal) else reference.name


class _Adjacency:
    """Computes pairs of adjacent tokens, by repeating over all rules until nothing changes."""

    def __init__(self, rules: list[Reference]) -> None:
        self.pairs: set[tuple[str, str]] = set()
        self._known = {rule: _Edges() for rule in rules}
        size = -1
        while size != (size := self._size()):
            for rule, edges in self._known.items():
                found = self._edges(definition_of(rule))
                edges.first |= found.first
                edges.last |= found.last
                edges.is_empty |= found.is_empty

    def _size(self) -> int:
        return len(self.pairs) + sum(len(one.first) + len(one.last) + one.is_empty for one in self._known.values())

    def _edges(self, part: Part) -> _Edges:
        match part:
            case Literal(text):
                return _Edges({text}, {text})
            case Reference() if (token := _literal_of(part)) is not None:
                return _Edges({token}, {token})
            case Reference():
                return self._known[part]
            case Choice(parts):
                all_edges = [self._edges(one) for one in parts if part_text(one) != _KEYWORDS_AS_NAMES]
                return _Edges(
                    set().union(*(one.first for one in all_edges)),
                    set().union(*(one.last for one in all_edges)),
                    any(one.is_empty for one in all_edges),
                )
            case Sequence(parts):
                found = _Edges(is_empty=True)
                for one in parts:
                    found = self._join(found, self._edges(one))
                return found
            case Repetition(inner, mark):
                edges = self._edges(inner)
                if mark != "?":
                    self._join(edges, edges)
                return _Edges(edges.first, edges.last, edges.is_empty or part.is_optional)
            case Pattern():
                return _Edges()

    def _join(self, left: _Edges, right: _Edges) -> _Edges:
        self.pairs |= {(before, after) for before in left.last for after in right.first}
        return _Edges(
            left.first | right.first if left.is_empty else left.first,
            left.last | right.last if right.is_empty else right.last,
            left.is_empty and right.is_empty,
        )


@cache
def tokens_of(language: str) -> LanguageTokens:
    """Return the tokens of a language, which is also the name of its grammar file."""
    file = read_grammar_file(language)
    ignored = [file.resolve(name) for name in file.ignored]
    rules = [*reachable_rules(language), *ignored]
    adjacency = _Adjacency([rule for rule in rules if not rule.name.isupper()])
    literals = {part.text for rule in rules for part in parts_of(definition_of(rule)) if isinstance(part, Literal)}
    patterns: list[tuple[int, str, str]] = []
    for rule in rules:
        definition = definition_of(rule)
        if isinstance(definition, Pattern):
            priority = read_grammar_file(rule.file).priorities.get(rule.name, 0)
            patterns.append((-priority, rule.name, definition.expression))
    return LanguageTokens(
        keywords=frozenset(filter(is_word, literals)),
        signs=tuple(sorted((one for one in literals if not is_word(one)), key=lambda one: (-len(one), one))),
        patterns={name: expression for _, name, expression in sorted(patterns)},
        ignored=frozenset(one.name for one in ignored),
        pairs=frozenset(adjacency.pairs),
        declaring=frozenset(_declaring_keywords(rules)),
    )


def _declaring_keywords(rules: list[Reference]) -> set[str]:
    """Return the keywords that begin a definition and are followed by its name."""
    found = set()
    defining = [rule for rule in rules if rule.name in _DEFINING_RULES]
    for rule in (part for one in defining for part in parts_of(definition_of(one)) if isinstance(part, Reference)):
        for part in parts_of(definition_of(rule)):
            pairs = pairwise(part.parts) if isinstance(part, Sequence) else ()
            for before, after in pairs:
                if isinstance(before, Literal) and is_word(before.text) and getattr(after, "name", "") == NAME:
                    found.add(before.text)
    return found
