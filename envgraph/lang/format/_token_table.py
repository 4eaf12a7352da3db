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
class SourceComment:
    """A comment in the text.

    Attributes:
        line_breaks: the number of line breaks between the comment and the token or comment before it.
        column: the column at which the comment begins.
        blanks_before: the number of characters between the comment and the token or comment before it.
    """

    text: str
    line_breaks: int
    column: int
    blanks_before: int

    @property
    def is_line_comment(self) -> bool:
        """Return True if the comment extends to the end of its line (`//`)."""
        return self.text.startswith("//")


@dataclass(frozen=True, slots=True)
class TokenGap:
    """The comments, line breaks and blanks before a token.

    Attributes:
        comments: the comments, in order.
        line_breaks: the number of line breaks directly before the token, after the last comment or the previous token.
        blanks: the number of blanks before the token, if the gap has neither comments nor line breaks.
    """

    comments: tuple[SourceComment, ...] = ()
    line_breaks: int = 0
    blanks: int = 0

    @property
    def has_line_break(self) -> bool:
        """Return True if the tokens before and after the gap are on different lines."""
        return self.line_breaks > 0 or any(remark.line_breaks for remark in self.comments)


@dataclass(slots=True)
class SyntaxPart:
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

    def child_parts(self, *kinds: str) -> list[SyntaxPart]:
        """Return the child parts; if kinds are given, only the child parts of these kinds."""
        return [item for item in self.items if isinstance(item, SyntaxPart) and (not kinds or item.kind in kinds)]


Item = int | SyntaxPart


@dataclass(slots=True)
class TokenTable:
    """The tokens of a text for the formatter, as parallel lists.

    Attributes:
        texts: the text of each token.
        kinds: the kind of each token: "NAME", "TEXT", "punctuation" and so on.
        gaps: the gap before each token, and finally the gap before the end of the text.
        part_kinds: the kind of the innermost part that contains each token.
        parenthesised_checks: the positions of `check` keywords whose whole expression is in parentheses.
    """

    texts: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    gaps: list[TokenGap] = field(default_factory=list)
    part_kinds: list[str] = field(default_factory=list)
    parenthesised_checks: set[int] = field(default_factory=set)


def read_tokens(text: str, lexemes: list[Lexeme], tree: Tree[Token]) -> tuple[TokenTable, SyntaxPart]:
    """Return the tokens of a text without syntax errors, and the root part of its syntax tree."""
    words = [one for one in lexemes if one.start < one.end]
    found = TokenTable()
    end = 0
    for lexeme in words:
        found.texts.append(text[lexeme.start : lexeme.end])
        found.kinds.append(lexeme.kind)
        found.gaps.append(_read_gap(text, end, lexeme.start))
        end = lexeme.end
    found.gaps.append(_read_gap(text, end, len(text)))
    found.part_kinds = [""] * len(words)
    _move_comments_behind_separators(found)
    starts = [one.start for one in words]
    root = _build_parts(tree, starts, len(words), found)
    return found, root


def comment_texts(tokens: TokenTable) -> Iterator[str]:
    """Yield the comments in the order of the text, with the indentation of their lines removed."""
    for gap in tokens.gaps:
        for remark in gap.comments:
            yield "\n".join(line.strip() for line in remark.text.split("\n"))


def _read_gap(text: str, start: int, end: int) -> TokenGap:
    remarks = []
    position = start
    for match in _COMMENT.finditer(text, start, end):
        between = text[position : match.start()]
        line = text.rfind("\n", 0, match.start()) + 1
        remarks.append(SourceComment(match.group().rstrip(), between.count("\n"), match.start() - line, len(between)))
        position = match.end()
    between = text[position:end]
    breaks = between.count("\n")
    return TokenGap(tuple(remarks), breaks, 0 if remarks or breaks else len(between))


def _move_comments_behind_separators(tokens: TokenTable) -> None:
    """Move comments between an item and its `;` or `,` behind this separator."""
    for index, word in enumerate(tokens.texts):
        gap = tokens.gaps[index]
        if word not in (";", ",") or tokens.kinds[index] != PUNCTUATION or not gap.comments or not index:
            continue
        after = tokens.gaps[index + 1]
        apart = gap.comments[-1].is_line_comment or gap.line_breaks > 0
        breaks = max(after.line_breaks, int(apart))
        tokens.gaps[index] = TokenGap()
        if not after.comments:
            tokens.gaps[index + 1] = TokenGap(gap.comments, breaks, after.blanks)
            continue
        first, *rest = after.comments
        if apart and not first.line_breaks:
            first = SourceComment(first.text, 1, first.column, first.blanks_before)
        tokens.gaps[index + 1] = TokenGap((*gap.comments, first, *rest), after.line_breaks, after.blanks)


def _build_parts(root: Tree[Token], starts: list[int], end: int, found: TokenTable) -> SyntaxPart:
    """Return the root part for a syntax tree; record in `found` which part owns each token, and bracketed checks.

    `starts` are the offsets of the `end` tokens. The function is not recursive, since a long sum is a very deep tree.
    """
    whole = SyntaxPart(str(root.data), [], 0, end - 1)
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
            inner = SyntaxPart(str(child.data), [], first, last - 1)
            items.append(inner)
            waiting.append((child, inner))
            position = last
        items.extend(range(position, end))
        for item in items:
            if isinstance(item, int):
                found.part_kinds[item] = part.kind
        grouped = len(items) == 2 and isinstance(items[1], SyntaxPart) and items[1].kind == "group"
        if part.kind == "check" and grouped:
            found.parenthesised_checks.add(part.first)
    return whole


_SIGN_KINDS: Final = frozenset({"unary", "constant", "positive", "number", "bound", "annotation_number", "index"})
"""Kinds of parts in which `-` or `!` is a sign, written without a blank behind it."""

_ARROW_KINDS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})

_CALL_KINDS: Final = frozenset(
    {
        "annotation", "arguments", "call", "domains", "evaluation", "function", "method", "nothing", "parameters",
        "static_method", "terms", "unwind",
    }
)  # fmt: skip
"""Kinds of parts whose `(` is written directly behind a name."""

_TYPE_KINDS: Final = frozenset({"aliased_literal", "enum_literal", "static_method", "type"})


def needs_blank_after(tokens: TokenTable, index: int) -> bool:
    """Return True if a blank belongs between the token at `index` and the next token."""
    left, right = tokens.texts[index], tokens.texts[index + 1]
    owner, following = tokens.part_kinds[index], tokens.part_kinds[index + 1]
    if tokens.kinds[index] == "STRING" or tokens.kinds[index] == "TEXT":
        return right not in _CLOSING
    if left in _OPENING or right in _CLOSING or left == "::":
        return False
    if owner == "closure" or left == "#":
        return False
    if left in ("-", "!", "+") and owner in _SIGN_KINDS:
        return False
    if owner in _ARROW_KINDS and (following in _ARROW_KINDS or following == "closure"):
        return False
    return _needs_blank_before(tokens, index, left, right, following)


_OPENING: Final = frozenset({"(", "[", "@", ".", ".."})
_CLOSING: Final = frozenset({")", "]", ",", ";", ".", ".."})


def _needs_blank_before(tokens: TokenTable, index: int, left: str, right: str, owner: str) -> bool:
    if right == "::":
        return tokens.part_kinds[index] != owner or owner not in _TYPE_KINDS
    if owner == "closure" or (owner == "nesting" and right == "+"):
        return False
    if right == "(":
        return not (owner in _CALL_KINDS or (owner == "group" and index in tokens.parenthesised_checks))
    if right == "[":
        return owner not in ("multiplicity", "cell")
    if owner == "annotation_named" and (left == "{" or right == "}"):
        return False
    return not (right == ":" and owner == "branch")
