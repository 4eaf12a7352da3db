"""How each construct of the languages is laid out: the tree of a text to a document.

- A block `{ .. }` is on one line if the author put it there and it fits; else each of its statements has a line.
- Brackets `( .. )` stay on the line while they fit; then each of their items has a line.
- A chain of operators, arrows or alternatives that does not fit is broken before each of them.
- Comments stay where they are between the tokens, empty lines between statements are kept, two of them become one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
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
from envgraph.lang.format._spacing import spaced
from envgraph.lang.format._tokens import Gap, Item, Part, Remark, Tokens

_LEVELS: Final[Mapping[str, int]] = {
    "||": 1, "or": 1, "&&": 2, "and": 2, "==": 3, "===": 3, "!=": 3, "!==": 3, "=": 3,
    "<": 4, "<=": 4, ">": 4, ">=": 4, "+": 5, "-": 5, "*": 6, "/": 6, "%": 6,
}  # fmt: skip
"""How tightly operators bind."""

_CHAINS: Final = frozenset({"binary", "conditional"})
_ARROWS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})
_EFFECTS: Final = frozenset({"reward", "other", "apply", "terminate", "each_object", "tokens"})
_ATTACHED: Final = frozenset({";", ","})


class Layout:
    """Makes documents of the parts of one text.

    Args:
        tokens: of the text.
    """

    def __init__(self, tokens: Tokens) -> None:
        self.tokens = tokens

    # --- tokens and what is between them

    def word(self, index: int) -> Document:
        """A token as it is written."""
        return Text(self.tokens.words[index])

    def between(self, index: int, wanted: Document | None = None) -> Document:
        """What stands before a token inside of a statement: a blank or nothing, unless a place for a line is wanted.

        With comments there, they come first.
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
        """The document of a part, without what stands before it."""
        return _LAYOUTS.get(part.kind, Layout.plain)(self, part)

    def item(self, item: Item) -> Document:
        """A token or a part."""
        return self.part(item) if isinstance(item, Part) else self.word(item)

    def plain(self, part: Part) -> Document:
        """One after the other; brackets in it are laid out as brackets."""
        return self.row(part.items)

    def row(self, items: Sequence[Item], *, lines: frozenset[str] = frozenset(), mark: str = "") -> Document:
        """One after the other.

        Args:
            items: tokens and parts.
            lines: before parts of these kinds the line may end.
            mark: kind of the marks there.
        """
        found: list[Document] = []
        index = 0
        while index < len(items):
            item = items[index]
            first = _first(item)
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
        """The place of the bracket that closes the one at `start`."""
        opening, depth = self.tokens.words[_first(items[start])], 0
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
        """`( .. )`, `[ .. ]` or `{ .. }` with everything in it."""
        opening = self.tokens.words[_first(items[0])]
        if opening == "{" and self.tokens.owners[_first(items[0])] != "annotation_named":
            return grouped(self.block(items))
        inner = [inside for item in items[1:-1] for inside in _spliced(item)]
        start, end = _first(items[0]), _first(items[-1])
        if not inner:
            return joined((self.word(start), self.between(end, NOTHING), self.word(end)))
        broken = opening == "[" and self._ends_line(start + 1) and self.tokens.owners[start] == "list"
        found: list[Document] = []
        for place, item in enumerate(inner):
            after_comma = place > 0 and self._is(inner[place - 1], ",")
            wanted = SOFT if not place else LINE if after_comma else None
            found += [self.between(_first(item), wanted), self._inside(item)]
        return grouped(
            self.word(start),
            indented(joined(found, broken=broken)),
            self.between(end, SOFT),
            self.word(end),
        )

    def _inside(self, item: Item) -> Document:
        """An item of brackets: a chain needs no indentation of its own there."""
        if isinstance(item, Part) and item.kind in _CHAINS:
            return grouped(self._links(item))
        return self.item(item)

    def _ends_line(self, index: int) -> bool:
        return self.tokens.gaps[index].ends_line

    def _is(self, item: Item, word: str) -> bool:
        """Whether this is a certain token."""
        return isinstance(item, int) and self.tokens.words[item] == word

    def block(self, items: Sequence[Item], mark: str = "") -> Document:
        """`{ .. }` with its statements, for a group; `mark` is the kind of the marks between them."""
        start, end = _first(items[0]), _first(items[-1])
        statements = self._statements(items[1:-1])
        if not statements and not self.tokens.gaps[end].remarks:
            return joined((self.word(start), SPACE, self.word(end)))
        inner: list[Document] = []
        for place, one in enumerate(statements):
            first = _first(one[0])
            inner += [Mark(mark, self.tokens.gaps[first].spaces)] if mark and place else []
            inner += [self.vertical(first, bool(place)), self.statement(one)]
        last = self.tokens.gaps[end]
        inner += self.remarks(last, bool(statements))
        broken = self._ends_line(start + 1) or any(remark.to_end for remark in last.remarks)
        return joined((self.word(start), indented(*inner), LINE, self.word(end)), broken=broken)

    def _statements(self, items: Sequence[Item]) -> list[list[Item]]:
        """Items with the `;` or `,` behind them."""
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
            parts += [self.between(_first(item), NOTHING), self.item(item)]
        return joined(parts)

    def vertical(self, index: int, inner: bool) -> Document:
        """What stands before a statement of a block; `inner`: it is not the first."""
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
        """The comments between statements; `inner`: they are not the first in their block."""
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
        """Operators and their operands outside of brackets."""
        return grouped(indented(self._links(part)))

    def _links(self, part: Part) -> Document:
        return self._conditional(part) if part.kind == "conditional" else self._operators(part)

    def _operators(self, part: Part) -> Document:
        """`a && b && c`: operators of one level, to be broken before each of them."""
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

    def _level(self, part: Part) -> int:
        operator = part.items[1]
        assert isinstance(operator, int)
        return _LEVELS[self.tokens.words[operator]]

    def _conditional(self, part: Part) -> Document:
        """`a ? b : c ? d : e`: broken before each `:`."""
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

    def assignment(self, part: Part) -> Document:
        """`name = value`; a long expression has lines of its own."""
        value = next((one for one in part.parts(*_CHAINS)), None)
        if value is None:
            return self.plain(part)
        place = part.items.index(value)
        return grouped(
            self.row(part.items[:place]),
            indented(self.between(value.first, LINE), self._links(value)),
            *(document for item in part.items[place + 1 :] for document in (NOTHING, self.item(item))),
        )

    def graph(self, part: Part) -> Document:
        """`a -ref-> b <-ref- c`, broken before the arrows; not because of the values of the last object."""
        *items, last = part.items
        assert isinstance(last, Part)
        start = next((place for place, item in enumerate(last.items) if self._is(item, "{")), len(last.items))
        head = Part(last.kind, last.items[:start], last.first, last.last)
        chain = grouped(self.row([*items, head], lines=_ARROWS))
        if start == len(last.items):
            return chain
        values = last.items[start:]
        return joined((chain, self.between(_first(values[0])), grouped(self.block(values))))

    def alternatives(self, part: Part) -> Document:
        """`a | b`, broken before each `|`; blocks among them as in `try { } else { }`."""
        if any(isinstance(item, Part) and item.kind == "block" for item in part.items):
            return self.nested(part)
        found: list[Document] = []
        for place, item in enumerate(part.items):
            first = _first(item)
            if place:
                found.append(self.between(first, LINE if self._is(item, "|") else None))
            found.append(self.item(item))
        return grouped(self.item(part.items[0]), indented(*found[1:]))

    def listed(self, part: Part) -> Document:
        """Items with commas and no brackets; as many on a line as fit."""
        found = [self.item(part.items[0])]
        for before, item in pairwise(part.items):
            if self._is(before, ","):
                found.append(grouped(indented(self.between(_first(item), LINE)), self.item(item)))
            else:
                found += [self.between(_first(item)), self.item(item)]
        return joined(found)

    def legend(self, part: Part) -> Document:
        """`legend a = A, b = B`: the lines of the author, aligned behind the word."""
        first, *rest = part.items
        assert isinstance(first, int)
        found: list[Document] = [self.item(rest[0])]
        for before, item in pairwise(rest):
            start = _first(item)
            if not self._is(before, ",") or self._is(item, ";"):
                found += [self.between(start, NOTHING), self.item(item)]
            elif self._ends_line(start):
                found += [self.between(start, HARD), self.item(item)]
            else:
                found.append(grouped(self.between(start, LINE), self.item(item)))
        word = self.tokens.words[first]
        return joined(
            (self.word(first), self.between(first + 1), indented(*found, columns=len(word) + 1)),
        )

    # --- definitions

    def definition(self, part: Part) -> Document:
        """Annotations, then the rest."""
        notes = [item for item in part.items if isinstance(item, Part) and item.kind == "annotation"]
        rest = part.items[len(notes) :]
        if not notes:
            return self._body(part, rest)
        found: list[Document] = []
        for place, note in enumerate(notes):
            found += [self._after_note(note.first)] if place else []
            found.append(self.part(note))
        return joined((*found, self._after_note(_first(rest[0]), last=True), self._body(part, rest)))

    def _after_note(self, index: int, last: bool = False) -> Document:
        gap = self.tokens.gaps[index]
        if gap.remarks:
            return self.between(index, HARD if gap.ends_line else SPACE)
        if gap.ends_line:
            return HARD
        return joined((Mark("annotation", gap.spaces, always=True), SPACE)) if last else SPACE

    def _body(self, part: Part, items: Sequence[Item]) -> Document:
        if part.kind == "pattern":
            return self._bodies(items)
        return self._rule(items) if part.kind == "rule" else self.row(items)

    def _bodies(self, items: Sequence[Item]) -> Document:
        """A pattern: all of its bodies on one line, or none."""
        found: list[Document] = []
        for place, item in enumerate(items):
            found += [self.between(_first(item))] if place else []
            if isinstance(item, Part) and item.kind == "body":
                found.append(self._open_block(item))
            else:
                found.append(self.item(item))
        return grouped(*found)

    def _open_block(self, part: Part) -> Document:
        """A body of a pattern, for the group around it."""
        start = self._place(part.items, "{")
        head = [self.row(part.items[:start]), self.between(_first(part.items[start]))] if start else []
        return joined((*head, self.block(part.items[start:])))

    def _place(self, items: Sequence[Item], word: str) -> int:
        """Where a token is first among some items."""
        return next(place for place, item in enumerate(items) if self._is(item, word))

    def _rule(self, items: Sequence[Item]) -> Document:
        """A rule; short ones that stand below each other may be set in columns."""
        start = self._place(items, "{")
        opening = _first(items[start])
        mark = Mark("rule", self.tokens.gaps[opening].spaces)
        block = grouped(mark, self.between(opening), self.block(items[start:], "rule"))
        return joined((self.row(items[:start]), block))

    def nested(self, part: Part) -> Document:
        """`try`, `if` and the like: all of their blocks on one line, or none."""
        return grouped(self._blocks(part))

    def _blocks(self, part: Part) -> Document:
        found: list[Document] = []
        for place, item in enumerate(part.items):
            found += [self.between(_first(item))] if place else []
            if isinstance(item, Part) and item.kind == "block":
                found.append(self.block(item.items))
            elif isinstance(item, Part) and item.kind == "if":
                found.append(self._blocks(item))
            else:
                found.append(self.item(item))
        return joined(found)

    def clause(self, part: Part) -> Document:
        """An action, `on` or the like: what follows from it has lines of its own if it does not fit."""
        mark = "on" if part.kind == "on" else ""
        if part.kind != "action":
            return grouped(self.row(part.items, lines=_EFFECTS, mark=mark))
        place = self._place(part.items, "=")
        equals = _first(part.items[place])
        return grouped(
            self.row(part.items[:place]),
            Mark("action", self.tokens.gaps[equals].spaces),
            self.between(equals),
            self.row(part.items[place:], lines=_EFFECTS),
        )

    def rows(self, part: Part) -> Document:
        """The letters of a grid, one row a line."""
        place = next(i for i in part.items if isinstance(i, int) and i > part.first)
        if self.tokens.kinds[place] != "TEXT":
            return self.plain(part)
        lines = self.tokens.words[place][3:-3].split("\n")
        if len(lines) < 2 or lines[0].strip() or lines[-1].strip():
            return self.plain(part)
        letters = lines[1:-1]
        shared = min((len(row) - len(row.lstrip()) for row in letters if row.strip()), default=0)
        found: list[Document] = []
        for row in letters:
            found += [HARD, Text(row[shared:].rstrip())]
        text = joined((Text('"""'), indented(*found, HARD, Text('"""'))))
        rest = part.items[part.items.index(place) + 1 :]
        return joined(
            (self.row(part.items[: -len(rest) - 1]), self.between(place), text, *map(self.item, rest))
        )

    def line(self, part: Part) -> Document:
        """A line of a table; the values may be set in columns."""
        found: list[Document] = []
        for place, item in enumerate(part.items):
            first = _first(item)
            if place and (self._is(part.items[place - 1], ",") or self._is(part.items[place - 1], ":")):
                found.append(Mark("table", self.tokens.gaps[first].spaces, always=True))
            found += [self.between(first)] if place else []
            found.append(self.item(item))
        return joined(found)


_BRACKETS: Final[Mapping[str, str]] = {"(": ")", "[": "]", "{": "}"}


def _first(item: Item) -> int:
    return item.first if isinstance(item, Part) else item


def _spliced(item: Item) -> list[Item]:
    """The items of a list of expressions, which the grammar makes a part of."""
    return item.items if isinstance(item, Part) and item.kind == "expression_list" else [item]


def _remark(remark: Remark) -> Document:
    # Behind something else its place may still change, when lines are set in columns.
    shifted = "\n" in remark.text and remark.breaks > 0
    return Comment(remark.text, remark.column) if shifted else Text(remark.text)


_LAYOUTS: Final[Mapping[str, Callable[[Layout, Part], Document]]] = {
    **dict.fromkeys(
        ("header", "enum", "class", "attribute", "reference", "pattern", "rule", "unit", "derivation", "environment"),
        Layout.definition,
    ),
    **dict.fromkeys(_CHAINS, Layout.chain),
    **dict.fromkeys(("set", "assignment"), Layout.assignment),
    **dict.fromkeys(("alap", "repeat", "try", "if", "atomic"), Layout.nested),
    **dict.fromkeys(("choice", "branches"), Layout.alternatives),
    **dict.fromkeys(("extends", "tokens"), Layout.listed),
    **dict.fromkeys(
        ("action", "each", "on", "reset", "observation", "draw_grid", "draw_graph"), Layout.clause
    ),
    "graph": Layout.graph,
    "legend": Layout.legend,
    "rows": Layout.rows,
    "line": Layout.line,
}  # fmt: skip
"""Parts that are not laid out plainly."""
