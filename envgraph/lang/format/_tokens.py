"""Prepare the tokens of a text for the formatter: the gaps between them, and the syntax tree part of each token."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import field
from typing import Final

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.lang.syntax._lexer import PUNCTUATION, Lexeme

_COMMENT: Final = re.compile(r"//[^\n]*|/\*[\s\S]*?\*/")


@dataclass(frozen=True, slots=True)
class Remark:
    """A comment in the text.

    Attributes:
        breaks: the number of line breaks between the comment and the token or comment before it.
        column: the column at which the comment begins.
        spaces: the number of characters between the comment and the token or comment before it.
    """

    text: str
    breaks: int
    column: int
    spaces: int

    @property
    def to_end(self) -> bool:
        """Return True if the comment extends to the end of its line (`//`)."""
        return self.text.startswith("//")


@dataclass(frozen=True, slots=True)
class Gap:
    """The comments, line breaks and blanks before a token.

    Attributes:
        remarks: the comments, in order.
        breaks: the number of line breaks directly before the token, after the last comment or the previous token.
        spaces: the number of blanks before the token, if the gap has neither comments nor line breaks.
    """

    remarks: tuple[Remark, ...] = ()
    breaks: int = 0
    spaces: int = 0

    @property
    def ends_line(self) -> bool:
        """Return True if the tokens before and after the gap are on different lines."""
        return self.breaks > 0 or any(remark.breaks for remark in self.remarks)


@dataclass(slots=True)
class Part:
    """A node of the syntax tree, made by one grammar rule.

    Attributes:
        kind: the name of the grammar rule, or of its alternative.
        items: the positions of its own tokens, and its child parts, in the order of the text.
        first, last: the positions of its first and last token.
    """

    kind: str
    items: list[Item]
    first: int
    last: int

    def parts(self, *kinds: str) -> list[Part]:
        """Return the child parts; if kinds are given, only the child parts of these kinds."""
        return [item for item in self.items if isinstance(item, Part) and (not kinds or item.kind in kinds)]


Item = int | Part


@dataclass(slots=True)
class Tokens:
    """The tokens of a text for the formatter, as parallel lists.

    Attributes:
        words: the text of each token.
        kinds: the kind of each token: "NAME", "TEXT", "punctuation" and so on.
        gaps: the gap before each token, and finally the gap before the end of the text.
        owners: the kind of the innermost part that contains each token.
        whole: the positions of `check` keywords whose whole expression is in parentheses.
    """

    words: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    owners: list[str] = field(default_factory=list)
    whole: set[int] = field(default_factory=set)


def read_tokens(text: str, lexemes: list[Lexeme], tree: Tree[Token]) -> tuple[Tokens, Part]:
    """Return the tokens of a text without syntax errors, and the root part of its syntax tree."""
    words = [one for one in lexemes if one.start < one.end]
    found = Tokens()
    end = 0
    for lexeme in words:
        found.words.append(text[lexeme.start : lexeme.end])
        found.kinds.append(lexeme.kind)
        found.gaps.append(_gap(text, end, lexeme.start))
        end = lexeme.end
    found.gaps.append(_gap(text, end, len(text)))
    found.owners = [""] * len(words)
    _separators_first(found)
    starts = [one.start for one in words]
    root = _part(tree, starts, len(words), found)
    return found, root


def comments_of(tokens: Tokens) -> Iterator[str]:
    """Yield the comments in the order of the text, with the indentation of their lines removed."""
    for gap in tokens.gaps:
        for remark in gap.remarks:
            yield "\n".join(line.strip() for line in remark.text.split("\n"))


def _gap(text: str, start: int, end: int) -> Gap:
    remarks = []
    position = start
    for match in _COMMENT.finditer(text, start, end):
        between = text[position : match.start()]
        line = text.rfind("\n", 0, match.start()) + 1
        remarks.append(
            Remark(match.group().rstrip(), between.count("\n"), match.start() - line, len(between))
        )
        position = match.end()
    between = text[position:end]
    breaks = between.count("\n")
    return Gap(tuple(remarks), breaks, 0 if remarks or breaks else len(between))


def _separators_first(tokens: Tokens) -> None:
    """Move comments between an item and its `;` or `,` behind this separator."""
    for index, word in enumerate(tokens.words):
        gap = tokens.gaps[index]
        if word not in (";", ",") or tokens.kinds[index] != PUNCTUATION or not gap.remarks or not index:
            continue
        after = tokens.gaps[index + 1]
        apart = gap.remarks[-1].to_end or gap.breaks > 0
        breaks = max(after.breaks, int(apart))
        tokens.gaps[index] = Gap()
        if not after.remarks:
            tokens.gaps[index + 1] = Gap(gap.remarks, breaks, after.spaces)
            continue
        first, *rest = after.remarks
        if apart and not first.breaks:
            first = Remark(first.text, 1, first.column, first.spaces)
        tokens.gaps[index + 1] = Gap((*gap.remarks, first, *rest), after.breaks, after.spaces)


def _part(root: Tree[Token], starts: list[int], end: int, found: Tokens) -> Part:
    """Return the root part for a syntax tree; record in `found` which part owns each token, and bracketed checks.

    `starts` are the offsets of the `end` tokens. The function is not recursive, since a long sum is a very deep tree.
    """
    whole = Part(str(root.data), [], 0, end - 1)
    waiting = [(root, whole)]
    for tree, part in waiting:  # the list grows during the loop
        items, position, end = part.items, part.first, part.last + 1
        for child in tree.children:
            if not isinstance(child, Tree):
                continue
            first = bisect_left(starts, child.meta.start_pos, position, end)
            last = bisect_left(starts, child.meta.end_pos, first, end)
            if first == last:
                continue
            items.extend(range(position, first))
            inner = Part(str(child.data), [], first, last - 1)
            items.append(inner)
            waiting.append((child, inner))
            position = last
        items.extend(range(position, end))
        for item in items:
            if isinstance(item, int):
                found.owners[item] = part.kind
        grouped = len(items) == 2 and isinstance(items[1], Part) and items[1].kind == "group"
        if part.kind == "check" and grouped:
            found.whole.add(part.first)
    return whole


_SIGNED: Final = frozenset({"unary", "constant", "positive", "number", "bound", "annotation_number", "index"})
"""Kinds of parts in which `-` or `!` is a sign, written without a blank behind it."""

_ARROWS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})

_CALLS: Final = frozenset(
    {
        "annotation", "arguments", "call", "domains", "evaluation", "function", "method", "parameters",
        "static_method", "terms", "unwind",
    }
)  # fmt: skip
"""Kinds of parts whose `(` is written directly behind a name."""

_TYPES: Final = frozenset({"aliased_literal", "enum_literal", "static_method", "type"})


def spaced(tokens: Tokens, index: int) -> bool:
    """Return True if a blank belongs between the token at `index` and the next token."""
    left, right = tokens.words[index], tokens.words[index + 1]
    owner, following = tokens.owners[index], tokens.owners[index + 1]
    if tokens.kinds[index] == "STRING" or tokens.kinds[index] == "TEXT":
        return right not in _CLOSING
    if left in _OPENING or right in _CLOSING or left == "::":
        return False
    if owner == "closure" or left == "#":
        return False
    if left in ("-", "!", "+") and owner in _SIGNED:
        return False
    if owner in _ARROWS and (following in _ARROWS or following == "closure"):
        return False
    return _spaced_before(tokens, index, left, right, following)


_OPENING: Final = frozenset({"(", "[", "@", ".", ".."})
_CLOSING: Final = frozenset({")", "]", ",", ";", ".", ".."})


def _spaced_before(tokens: Tokens, index: int, left: str, right: str, owner: str) -> bool:
    if right == "::":
        return tokens.owners[index] != owner or owner not in _TYPES
    if owner == "closure" or (owner == "nesting" and right == "+"):
        return False
    if right == "(":
        return not (owner in _CALLS or (owner == "group" and index in tokens.whole))
    if right == "[":
        return owner not in ("multiplicity", "cell")
    if owner == "annotation_named" and (left == "{" or right == "}"):
        return False
    return not (right == ":" and owner == "branch")
