"""Build layout documents of expressions, brackets and blocks, with the comments between their tokens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from envgraph.lang.format._layout_document import (
    COMMENT_MARK_KIND,
    EMPTY_TEXT,
    FORCED_EMPTY_LINE,
    FORCED_LINE,
    LINE_OR_BLANK,
    LINE_OR_NOTHING,
    SPACE,
    AlignmentMark,
    CommentDocument,
    Document,
    LineBreak,
    TextDocument,
    group_documents,
    indent_documents,
    join_documents,
)
from envgraph.lang.format._token_table import (
    Item,
    SourceComment,
    SyntaxPart,
    TokenGap,
    TokenTable,
    needs_blank_after,
)
from envgraph.lang.syntax._parser import precedence_of

CHAIN_KINDS: Final = frozenset({"binary", "conditional"})
_ATTACHED_SIGNS: Final = frozenset({";", ","})


class DocumentBuilder:
    """A builder of layout documents for the parts of one text.

    Args:
        tokens: the tokens of the text.
        constructs: by kind of part: the function that lays out the part. Parts of other kinds are laid out in one row.
    """

    def __init__(
        self, tokens: TokenTable, constructs: Mapping[str, Callable[[DocumentBuilder, SyntaxPart], Document]]
    ) -> None:
        self.tokens = tokens
        self._constructs = constructs

    # --- tokens and what is between them

    def token_document(self, index: int) -> Document:
        """Return the layout document of a token, as it is written."""
        return TextDocument(self.tokens.texts[index])

    def gap_document(self, index: int, wanted: Document | None = None) -> Document:
        """Return the document before a token inside a statement: its comments, then a blank, nothing or `wanted`.

        Args:
            index: the position of the token.
            wanted: the document to put there, such as a possible line break; None means the usual blank or nothing.
        """
        if not index:
            return EMPTY_TEXT
        gap = self.tokens.gaps[index]
        is_default = wanted is None
        if wanted is None:
            wanted = SPACE if needs_blank_after(self.tokens, index - 1) else EMPTY_TEXT
        if not gap.comments:
            return wanted
        hard = indent_documents(FORCED_LINE) if is_default else FORCED_LINE
        found: list[Document] = []
        for remark in gap.comments:
            found += [hard] if remark.line_breaks else [self._before_trailing_comment(remark)]
            found.append(_comment_document(remark))
        last = gap.comments[-1]
        if last.is_line_comment or (last.line_breaks and gap.line_breaks):
            found.append(hard)
        elif self.tokens.texts[index] not in (")", "]", *_ATTACHED_SIGNS):
            found.append(LINE_OR_BLANK if isinstance(wanted, LineBreak) else SPACE)
        else:
            found.append(wanted)
        return join_documents(found)

    def _before_trailing_comment(self, remark: SourceComment) -> Document:
        if not remark.is_line_comment:
            return SPACE
        return join_documents(
            (
                AlignmentMark(COMMENT_MARK_KIND, remark.blanks_before, 2, counts_in_broken_groups=True),
                TextDocument("  "),
            )
        )

    # --- parts

    def part_document(self, part: SyntaxPart) -> Document:
        """Return the layout document of a part, without the gap before it."""
        return self._constructs.get(part.kind, DocumentBuilder.default_document)(self, part)

    def item_document(self, item: Item) -> Document:
        """Return the layout document of a token or a part."""
        return self.part_document(item) if isinstance(item, SyntaxPart) else self.token_document(item)

    def default_document(self, part: SyntaxPart) -> Document:
        """Return the layout document of a part with all of its items in one row."""
        return self.row_document(part.items)

    def row_document(self, items: Sequence[Item], *, lines: frozenset[str] = frozenset(), mark: str = "") -> Document:
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
            first = first_token(item)
            if index:
                wanted = isinstance(item, SyntaxPart) and item.kind in lines
                if wanted and mark:
                    found.append(AlignmentMark(mark, self.tokens.gaps[first].blanks))
                found.append(
                    indent_documents(self.gap_document(first, LINE_OR_BLANK)) if wanted else self.gap_document(first)
                )
            if isinstance(item, int) and self.tokens.texts[item] in _BRACKETS:
                end = self._closing_index(items, index)
                found.append(self._bracket_document(items[index : end + 1]))
                index = end + 1
                continue
            found.append(self.item_document(item))
            index += 1
        return join_documents(found)

    def _closing_index(self, items: Sequence[Item], start: int) -> int:
        """Return the index of the closing bracket for the opening bracket at `start`."""
        opening, depth = self.tokens.texts[first_token(items[start])], 0
        for place in range(start, len(items)):
            item = items[place]
            if isinstance(item, int):
                depth += (self.tokens.texts[item] == opening) - (self.tokens.texts[item] == _BRACKETS[opening])
                if not depth:
                    return place
        raise AssertionError("a bracket is not closed")

    # --- brackets

    def _bracket_document(self, items: Sequence[Item]) -> Document:
        """Return the layout document of `( .. )`, `[ .. ]` or `{ .. }` with its contents."""
        opening = self.tokens.texts[first_token(items[0])]
        if opening == "{" and self.tokens.part_kinds[first_token(items[0])] != "annotation_named":
            return group_documents(self.block_document(items))
        inner = [inside for item in items[1:-1] for inside in _expression_items(item)]
        start, end = first_token(items[0]), first_token(items[-1])
        if not inner:
            return join_documents(
                (self.token_document(start), self.gap_document(end, EMPTY_TEXT), self.token_document(end))
            )
        broken = opening == "[" and self.is_on_new_line(start + 1) and self.tokens.part_kinds[start] == "list"
        found: list[Document] = []
        for place, item in enumerate(inner):
            after_comma = place > 0 and self.is_token(inner[place - 1], ",")
            wanted = LINE_OR_NOTHING if not place else LINE_OR_BLANK if after_comma else None
            found += [self.gap_document(first_token(item), wanted), self._bracketed_item_document(item)]
        return group_documents(
            self.token_document(start),
            indent_documents(join_documents(found, force_break=broken)),
            self.gap_document(end, LINE_OR_NOTHING),
            self.token_document(end),
        )

    def _bracketed_item_document(self, item: Item) -> Document:
        """Return the document of an item in brackets; a chain of operators gets no indentation of its own there."""
        if isinstance(item, SyntaxPart) and item.kind in CHAIN_KINDS:
            return group_documents(self.chain_links_document(item))
        return self.item_document(item)

    def is_on_new_line(self, index: int) -> bool:
        return self.tokens.gaps[index].has_line_break

    def is_token(self, item: Item, word: str) -> bool:
        """Return True if the item is the token `word`."""
        return isinstance(item, int) and self.tokens.texts[item] == word

    def block_document(self, items: Sequence[Item], mark: str = "") -> Document:
        """Return the layout document of `{ .. }` with its statements, to be put in a group.

        `mark` is the kind of the alignment marks between the statements; "" for no marks.
        """
        start, end = first_token(items[0]), first_token(items[-1])
        statements = self._split_statements(items[1:-1])
        if not statements and not self.tokens.gaps[end].comments:
            return join_documents((self.token_document(start), SPACE, self.token_document(end)))
        inner: list[Document] = []
        for place, one in enumerate(statements):
            first = first_token(one[0])
            inner += [AlignmentMark(mark, self.tokens.gaps[first].blanks)] if mark and place else []
            inner += [self.statement_gap_document(first, bool(place)), self.statement_document(one)]
        last = self.tokens.gaps[end]
        inner += self.comment_documents(last, bool(statements))
        broken = self.is_on_new_line(start + 1) or any(remark.is_line_comment for remark in last.comments)
        return join_documents(
            (self.token_document(start), indent_documents(*inner), LINE_OR_BLANK, self.token_document(end)),
            force_break=broken,
        )

    def _split_statements(self, items: Sequence[Item]) -> list[list[Item]]:
        """Split the items of a block into statements, each with the `;` or `,` behind it."""
        found: list[list[Item]] = []
        for item in items:
            if isinstance(item, int) and self.tokens.texts[item] in _ATTACHED_SIGNS and found:
                found[-1].append(item)
            else:
                found.append([item])
        return found

    def statement_document(self, items: Sequence[Item]) -> Document:
        parts = [self.item_document(items[0])]
        for item in items[1:]:
            parts += [self.gap_document(first_token(item), EMPTY_TEXT), self.item_document(item)]
        return join_documents(parts)

    def statement_gap_document(self, index: int, has_previous: bool) -> Document:
        """Return the layout document before a statement of a block: comments, and a line break or an empty line.

        `has_previous` is False for the first statement, before which there is no empty line.
        """
        gap = self.tokens.gaps[index]
        found = self.comment_documents(gap, has_previous)
        last = gap.comments[-1] if gap.comments else None
        if last and last.line_breaks and not gap.line_breaks:
            found.append(SPACE)
        elif gap.line_breaks > 1 and (has_previous or last):
            found.append(FORCED_EMPTY_LINE)
        else:
            found.append(FORCED_LINE if last and last.is_line_comment else LINE_OR_BLANK)
        return join_documents(found)

    def comment_documents(self, gap: TokenGap, has_previous: bool) -> list[Document]:
        """Return the comments before a statement, as documents; `has_previous` is False for the first statement of a
        block.
        """
        found: list[Document] = []
        for remark in gap.comments:
            if not remark.line_breaks:
                found.append(self._before_trailing_comment(remark))
            else:
                found.append(FORCED_EMPTY_LINE if remark.line_breaks > 1 and (has_previous or found) else FORCED_LINE)
            found.append(_comment_document(remark))
        return found

    # --- chains

    def chain_document(self, part: SyntaxPart) -> Document:
        """Return the layout document of a chain of operators outside of brackets; its further lines are indented."""
        return group_documents(indent_documents(self.chain_links_document(part)))

    def chain_links_document(self, part: SyntaxPart) -> Document:
        return self._conditional_document(part) if part.kind == "conditional" else self._operators_document(part)

    def _operators_document(self, part: SyntaxPart) -> Document:
        """Return the layout document of operators of one precedence, `a && b && c`; lines may break before each."""
        level = self._precedence(part)
        links: list[tuple[int, Item]] = []
        first: Item = part
        while isinstance(first, SyntaxPart) and first.kind == "binary" and self._precedence(first) == level:
            left, operator, right = first.items
            assert isinstance(operator, int)
            links.append((operator, right))
            first = left
        found = [self.item_document(first)]
        for operator, right in reversed(links):
            found += [self.gap_document(operator, LINE_OR_BLANK), self.token_document(operator)]
            found += [self.gap_document(operator + 1, SPACE), self.item_document(right)]
        return join_documents(found)

    def _precedence(self, part: SyntaxPart) -> int | None:
        operator = part.items[1]
        assert isinstance(operator, int)
        return precedence_of(self.tokens.texts[operator])

    def _conditional_document(self, part: SyntaxPart) -> Document:
        """Return the layout document of `a ? b : c ? d : e`, which may be broken before each `?` and `:`."""
        found: list[Document] = []
        item: Item = part
        while isinstance(item, SyntaxPart) and item.kind == "conditional":
            test, asks, then, colon, otherwise = item.items
            assert isinstance(asks, int) and isinstance(colon, int)
            answer = [
                self.gap_document(asks, LINE_OR_BLANK),
                self.token_document(asks),
                self.gap_document(asks + 1),
                self.item_document(then),
            ]
            found.append(group_documents(self.item_document(test), indent_documents(*answer)))
            found += [
                self.gap_document(colon, LINE_OR_BLANK),
                self.token_document(colon),
                self.gap_document(colon + 1),
            ]
            item = otherwise
        return join_documents((*found, self.item_document(item)))


_BRACKETS: Final[Mapping[str, str]] = {"(": ")", "[": "]", "{": "}"}


def first_token(item: Item) -> int:
    """Return the position of the first token of an item."""
    return item.first if isinstance(item, SyntaxPart) else item


def _expression_items(item: Item) -> list[Item]:
    """Return the items of an expression list, or the single item itself."""
    return item.items if isinstance(item, SyntaxPart) and item.kind == "expression_list" else [item]


def _comment_document(remark: SourceComment) -> Document:
    # A comment behind a token may still move, when lines are aligned in columns.
    shifted = "\n" in remark.text and remark.line_breaks > 0
    return CommentDocument(remark.text, remark.column) if shifted else TextDocument(remark.text)
