"""Build layout documents of expressions, brackets and blocks, with the comments between their tokens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from envgraph.lang.format._document import (
    BLANK,
    COMMENT,
    HARD,
    LINE,
    NOTHING,
    SOFT,
    SPACE,
    Comment,
    Document,
    Line,
    Mark,
    Text,
    grouped,
    indented,
    joined,
)
from envgraph.lang.format._tokens import Gap, Item, Part, Remark, Tokens, spaced
from envgraph.lang.syntax._parsing import level_of

CHAINS: Final = frozenset({"binary", "conditional"})
_ATTACHED: Final = frozenset({";", ","})


class Layout:
    """A builder of layout documents for the parts of one text.

    Args:
        tokens: the tokens of the text.
        constructs: by kind of part: the function that lays out the part. Parts of other kinds are laid out in one row.
    """

    def __init__(self, tokens: Tokens, constructs: Mapping[str, Callable[[Layout, Part], Document]]) -> None:
        self.tokens = tokens
        self._constructs = constructs

    # --- tokens and what is between them

    def word(self, index: int) -> Document:
        """Return the layout document of a token, as it is written."""
        return Text(self.tokens.words[index])

    def between(self, index: int, wanted: Document | None = None) -> Document:
        """Return the document before a token inside a statement: its comments, then a blank, nothing or `wanted`.

        Args:
            index: the position of the token.
            wanted: the document to put there, such as a possible line break; None means the usual blank or nothing.
        """
        if not index:
            return NOTHING
        gap = self.tokens.gaps[index]
        plain = wanted is None
        if wanted is None:
            wanted = SPACE if spaced(self.tokens, index - 1) else NOTHING
        if not gap.remarks:
            return wanted
        hard = indented(HARD) if plain else HARD
        found: list[Document] = []
        for remark in gap.remarks:
            found += [hard] if remark.breaks else [self._before_trailing(remark)]
            found.append(_remark(remark))
        last = gap.remarks[-1]
        if last.to_end or (last.breaks and gap.breaks):
            found.append(hard)
        elif self.tokens.words[index] not in (")", "]", *_ATTACHED):
            found.append(LINE if isinstance(wanted, Line) else SPACE)
        else:
            found.append(wanted)
        return joined(found)

    def _before_trailing(self, remark: Remark) -> Document:
        if not remark.to_end:
            return SPACE
        return joined((Mark(COMMENT, remark.spaces, 2, always=True), Text("  ")))

    # --- parts

    def part(self, part: Part) -> Document:
        """Return the layout document of a part, without the gap before it."""
        return self._constructs.get(part.kind, Layout.plain)(self, part)

    def item(self, item: Item) -> Document:
        """Return the layout document of a token or a part."""
        return self.part(item) if isinstance(item, Part) else self.word(item)

    def plain(self, part: Part) -> Document:
        """Return the layout document of a part with all of its items in one row."""
        return self.row(part.items)

    def row(self, items: Sequence[Item], *, lines: frozenset[str] = frozenset(), mark: str = "") -> Document:
        """Return the layout document of items one after the other; brackets among them are laid out as brackets.

        Args:
            items: tokens and parts.
            lines: a line may end before parts of these kinds.
            mark: the kind of the alignment marks at these places; "" for no marks.
        """
        found: list[Document] = []
        index = 0
        while index < len(items):
            item = items[index]
            first = first_of(item)
            if index:
                wanted = isinstance(item, Part) and item.kind in lines
                if wanted and mark:
                    found.append(Mark(mark, self.tokens.gaps[first].spaces))
                found.append(indented(self.between(first, LINE)) if wanted else self.between(first))
            if isinstance(item, int) and self.tokens.words[item] in _BRACKETS:
                end = self._closing(items, index)
                found.append(self._bracket(items[index : end + 1]))
                index = end + 1
                continue
            found.append(self.item(item))
            index += 1
        return joined(found)

    def _closing(self, items: Sequence[Item], start: int) -> int:
        """Return the index of the closing bracket for the opening bracket at `start`."""
        opening, depth = self.tokens.words[first_of(items[start])], 0
        for place in range(start, len(items)):
            item = items[place]
            if isinstance(item, int):
                depth += (self.tokens.words[item] == opening) - (
                    self.tokens.words[item] == _BRACKETS[opening]
                )
                if not depth:
                    return place
        raise AssertionError("a bracket is not closed")

    # --- brackets

    def _bracket(self, items: Sequence[Item]) -> Document:
        """Return the layout document of `( .. )`, `[ .. ]` or `{ .. }` with its contents."""
        opening = self.tokens.words[first_of(items[0])]
        if opening == "{" and self.tokens.owners[first_of(items[0])] != "annotation_named":
            return grouped(self.block(items))
        inner = [inside for item in items[1:-1] for inside in _spliced(item)]
        start, end = first_of(items[0]), first_of(items[-1])
        if not inner:
            return joined((self.word(start), self.between(end, NOTHING), self.word(end)))
        broken = opening == "[" and self.ends_line(start + 1) and self.tokens.owners[start] == "list"
        found: list[Document] = []
        for place, item in enumerate(inner):
            after_comma = place > 0 and self.is_word(inner[place - 1], ",")
            wanted = SOFT if not place else LINE if after_comma else None
            found += [self.between(first_of(item), wanted), self._inside(item)]
        return grouped(
            self.word(start),
            indented(joined(found, broken=broken)),
            self.between(end, SOFT),
            self.word(end),
        )

    def _inside(self, item: Item) -> Document:
        """Return the document of an item in brackets; a chain of operators gets no indentation of its own there."""
        if isinstance(item, Part) and item.kind in CHAINS:
            return grouped(self.links(item))
        return self.item(item)

    def ends_line(self, index: int) -> bool:
        return self.tokens.gaps[index].ends_line

    def is_word(self, item: Item, word: str) -> bool:
        """Return True if the item is the token `word`."""
        return isinstance(item, int) and self.tokens.words[item] == word

    def block(self, items: Sequence[Item], mark: str = "") -> Document:
        """Return the layout document of `{ .. }` with its statements, to be put in a group.

        `mark` is the kind of the alignment marks between the statements; "" for no marks.
        """
        start, end = first_of(items[0]), first_of(items[-1])
        statements = self._statements(items[1:-1])
        if not statements and not self.tokens.gaps[end].remarks:
            return joined((self.word(start), SPACE, self.word(end)))
        inner: list[Document] = []
        for place, one in enumerate(statements):
            first = first_of(one[0])
            inner += [Mark(mark, self.tokens.gaps[first].spaces)] if mark and place else []
            inner += [self.vertical(first, bool(place)), self.statement(one)]
        last = self.tokens.gaps[end]
        inner += self.remarks(last, bool(statements))
        broken = self.ends_line(start + 1) or any(remark.to_end for remark in last.remarks)
        return joined((self.word(start), indented(*inner), LINE, self.word(end)), broken=broken)

    def _statements(self, items: Sequence[Item]) -> list[list[Item]]:
        """Split the items of a block into statements, each with the `;` or `,` behind it."""
        found: list[list[Item]] = []
        for item in items:
            if isinstance(item, int) and self.tokens.words[item] in _ATTACHED and found:
                found[-1].append(item)
            else:
                found.append([item])
        return found

    def statement(self, items: Sequence[Item]) -> Document:
        parts = [self.item(items[0])]
        for item in items[1:]:
            parts += [self.between(first_of(item), NOTHING), self.item(item)]
        return joined(parts)

    def vertical(self, index: int, inner: bool) -> Document:
        """Return the layout document before a statement of a block: comments, and a line break or an empty line.

        `inner` is False for the first statement, before which there is no empty line.
        """
        gap = self.tokens.gaps[index]
        found = self.remarks(gap, inner)
        last = gap.remarks[-1] if gap.remarks else None
        if last and last.breaks and not gap.breaks:
            found.append(SPACE)
        elif gap.breaks > 1 and (inner or last):
            found.append(BLANK)
        else:
            found.append(HARD if last and last.to_end else LINE)
        return joined(found)

    def remarks(self, gap: Gap, inner: bool) -> list[Document]:
        """Return the comments before a statement, as documents; `inner` is False for the first statement of a block."""
        found: list[Document] = []
        for remark in gap.remarks:
            if not remark.breaks:
                found.append(self._before_trailing(remark))
            else:
                found.append(BLANK if remark.breaks > 1 and (inner or found) else HARD)
            found.append(_remark(remark))
        return found

    # --- chains

    def chain(self, part: Part) -> Document:
        """Return the layout document of a chain of operators outside of brackets; its further lines are indented."""
        return grouped(indented(self.links(part)))

    def links(self, part: Part) -> Document:
        return self._conditional(part) if part.kind == "conditional" else self._operators(part)

    def _operators(self, part: Part) -> Document:
        """Return the layout document of operators of one precedence, `a && b && c`; lines may break before each."""
        level = self._level(part)
        links: list[tuple[int, Item]] = []
        first: Item = part
        while isinstance(first, Part) and first.kind == "binary" and self._level(first) == level:
            left, operator, right = first.items
            assert isinstance(operator, int)
            links.append((operator, right))
            first = left
        found = [self.item(first)]
        for operator, right in reversed(links):
            found += [self.between(operator, LINE), self.word(operator)]
            found += [self.between(operator + 1, SPACE), self.item(right)]
        return joined(found)

    def _level(self, part: Part) -> int | None:
        operator = part.items[1]
        assert isinstance(operator, int)
        return level_of(self.tokens.words[operator])

    def _conditional(self, part: Part) -> Document:
        """Return the layout document of `a ? b : c ? d : e`, which may be broken before each `?` and `:`."""
        found: list[Document] = []
        item: Item = part
        while isinstance(item, Part) and item.kind == "conditional":
            test, asks, then, colon, otherwise = item.items
            assert isinstance(asks, int) and isinstance(colon, int)
            answer = [self.between(asks, LINE), self.word(asks), self.between(asks + 1), self.item(then)]
            found.append(grouped(self.item(test), indented(*answer)))
            found += [self.between(colon, LINE), self.word(colon), self.between(colon + 1)]
            item = otherwise
        return joined((*found, self.item(item)))


_BRACKETS: Final[Mapping[str, str]] = {"(": ")", "[": "]", "{": "}"}


def first_of(item: Item) -> int:
    """Return the position of the first token of an item."""
    return item.first if isinstance(item, Part) else item


def _spliced(item: Item) -> list[Item]:
    """Return the items of an expression list, or the single item itself."""
    return item.items if isinstance(item, Part) and item.kind == "expression_list" else [item]


def _remark(remark: Remark) -> Document:
    # A comment behind a token may still move, when lines are aligned in columns.
    shifted = "\n" in remark.text and remark.breaks > 0
    return Comment(remark.text, remark.column) if shifted else Text(remark.text)
