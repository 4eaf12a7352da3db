"""The tokens of a text as the formatter has them: what is between them, and which part of the text each belongs to."""

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
    """A comment.

    Attributes:
        breaks: how many lines end between it and what comes before.
        column: where it begins on its line.
        spaces: how many blanks stand before it.
    """

    text: str
    breaks: int
    column: int
    spaces: int

    @property
    def to_end(self) -> bool:
        """Whether it goes on to the end of its line."""
        return self.text.startswith("//")


@dataclass(frozen=True, slots=True)
class Gap:
    """What stands before a token.

    Attributes:
        breaks: how many lines end between the last comment (or the token before, if there is none) and the token.
        spaces: how many blanks stand before it, if nothing else does.
    """

    remarks: tuple[Remark, ...] = ()
    breaks: int = 0
    spaces: int = 0

    @property
    def ends_line(self) -> bool:
        """Whether the two tokens are on different lines."""
        return self.breaks > 0 or any(remark.breaks for remark in self.remarks)


@dataclass(slots=True)
class Part:
    """A rule of the grammar with what it was made of.

    Attributes:
        kind: name of the rule, or of its alternative.
        items: positions of tokens, and parts, in the order of the text.
        first, last: positions of its first and its last token.
    """

    kind: str
    items: list[Item]
    first: int
    last: int

    def parts(self, *kinds: str) -> list[Part]:
        """Its parts, those of some kinds if any are given."""
        return [item for item in self.items if isinstance(item, Part) and (not kinds or item.kind in kinds)]


Item = int | Part


@dataclass(slots=True)
class Tokens:
    """All tokens of a text.

    Attributes:
        words: each as it is written.
        kinds: "NAME", "TEXT", "punctuation" ..., of each.
        gaps: what stands before each, and at last before the end of the text.
        owners: kind of the innermost part that each belongs to.
        whole: the `check`s that have all of their expression in brackets.
    """

    words: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    owners: list[str] = field(default_factory=list)
    whole: set[int] = field(default_factory=set)


def read_tokens(text: str, lexemes: list[Lexeme], tree: Tree[Token]) -> tuple[Tokens, Part]:
    """The tokens of a text without errors, and its tree over them."""
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
    """The comments in the order of the text, without how their lines are indented."""
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
    """Moves comments between an item and its `;` or `,` behind that."""
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
    """The part for the tree of all tokens; without recursion, since a long sum is as many trees inside each other."""
    whole = Part(str(root.data), [], 0, end - 1)
    waiting = [(root, whole)]
    for tree, part in waiting:  # which grows
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
"""Where `-` or `!` belongs to what comes after it."""

_ARROWS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})

_CALLS: Final = frozenset(
    {
        "annotation", "arguments", "call", "domains", "evaluation", "function", "method", "parameters",
        "static_method", "terms", "unwind",
    }
)  # fmt: skip
"""What has its `(` directly behind a name."""

_TYPES: Final = frozenset({"aliased_literal", "enum_literal", "static_method", "type"})


def spaced(tokens: Tokens, index: int) -> bool:
    """Return whether a blank stands between a token and the next one."""
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
