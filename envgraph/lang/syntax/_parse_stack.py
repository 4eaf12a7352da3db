"""The state of one parse: an LALR(1) stack over lexemes, with the questions that error recovery asks about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from lark import Token, Tree
from lark.parsers.lalr_analysis import Shift

from envgraph.errors import Note, Source, Span
from envgraph.lang.syntax._grammar import Grammar
from envgraph.lang.syntax._lexer import END, PUNCTUATION, Lexeme

ERROR_TREE = "error"
"""The `data` of trees that stand for skipped statements; `parse` removes these trees."""


class ResumePoint(NamedTuple):
    """A stack position where parsing can resume, as if a statement or definition had just been read."""

    kept_states: int
    first_skipped: int
    """Index of the first lexeme that is skipped if parsing resumes here; -1 for none."""
    states: list[int]
    """The parser states after resuming."""


class ParseStack:
    """The state of one parse; `states`, `values` and `first_lexemes` together are the parser stack.

    Attributes:
        lexemes: the lexemes of the whole text.
        states: the parser states; one more than values.
        values: the trees and tokens built so far.
        first_lexemes: for each value, the index of its first lexeme.
        previous_end: the end of the last token read, as an offset.
        brace_depth: the number of open braces at the last error.
        lost_names: the names in skipped text.
        skipped_ranges: the skipped ranges, as offsets in the text.
    """

    def __init__(self, grammar: Grammar, source: Source, lexemes: list[Lexeme]) -> None:
        self.grammar = grammar
        self.source = source
        self.lexemes = lexemes
        self.states = [grammar.start]
        self.values: list[Any] = []
        self.first_lexemes: list[int] = []
        self.previous_end = 0
        self.brace_depth = 0
        self.lost_names: set[str] = set()
        self.skipped_ranges: list[tuple[int, int]] = []

    def terminal_of(self, states: list[int], index: int) -> str | None:
        """Return the terminal as which a parser in these states reads a lexeme; None if the lexeme does not fit."""
        lexeme = self.lexemes[index]
        grammar = self.grammar
        if lexeme.kind == "NAME":
            keyword = None if lexeme.is_escaped else grammar.lexer.keywords.get(lexeme.value)
            if keyword and grammar.accepts(states, keyword):
                return keyword
        elif lexeme.kind == PUNCTUATION:
            sign = grammar.lexer.signs[lexeme.value]
            return sign if grammar.accepts(states, sign) else None
        return lexeme.kind if grammar.accepts(states, lexeme.kind) else None

    def split_sign(self, states: list[int], index: int) -> str | None:
        """Split a sign such as `<-` into two lexemes, and return the first's terminal; if this does not fit, None."""
        lexeme = self.lexemes[index]
        signs = self.grammar.lexer.signs
        if lexeme.kind != PUNCTUATION:
            return None
        for size in range(len(lexeme.value) - 1, 0, -1):
            first, rest = lexeme.value[:size], lexeme.value[size:]
            if first in signs and rest in signs and self.grammar.accepts(states, signs[first]):
                middle = lexeme.start + size
                self.lexemes[index : index + 1] = [
                    Lexeme(PUNCTUATION, first, lexeme.start, middle, brace_depth=lexeme.brace_depth),
                    Lexeme(PUNCTUATION, rest, middle, lexeme.end, brace_depth=lexeme.brace_depth),
                ]
                return signs[first]
        return None

    def read_token(self, terminal: str, lexeme: Lexeme, index: int) -> None:
        """Read a lexeme as an accepted terminal: reduce finished rules to trees, then shift."""
        states, values, begins = self.states, self.values, self.first_lexemes
        table = self.grammar.states
        lexeme.terminal = terminal
        while True:
            action, argument = table[states[-1]][terminal]
            if action is Shift:
                states.append(argument)
                values.append(Token(terminal, lexeme.value, lexeme.start, end_pos=lexeme.end))
                begins.append(index)
                self.previous_end = lexeme.end
                return
            size, rule, make = argument
            if make is None:
                states[-1] = table[states[-2]][rule][1]
                continue
            begin, start, parts = index, lexeme.start, []
            if size:
                begin = begins[-size]
                start = self.lexemes[begin].start
                parts = values[-size:]
                del states[-size:], values[-size:], begins[-size:]
            value = make(parts)
            if isinstance(value, Tree) and (meta := value.meta).empty:
                meta.start_pos = start
                meta.end_pos = max(start, self.previous_end)
                meta.empty = False
            states.append(table[states[-1]][rule][1])
            values.append(value)
            begins.append(begin)
            if terminal == END and states[-1] == self.grammar.end:
                return

    def resume_points(self) -> Iterator[ResumePoint]:
        """Yield the stack positions where parsing can resume, innermost first, but none inside closed blocks."""
        above: set[str] = set()
        for height in range(len(self.states), 0, -1):
            row = self.grammar.states[self.states[height - 1]]
            here = {rule for rule in self.grammar.recovery_rules if rule in row}
            # The state before the first statement of a list lies below; resuming there would skip the whole list.
            fresh, above = here - above, here
            for rule in self.grammar.recovery_rules:
                if rule in fresh:
                    kept = self.states[:height]
                    begin = self.first_lexemes[height - 1] if height <= len(self.first_lexemes) else -1
                    if begin >= 0 and self.lexemes[begin].brace_depth > self.brace_depth:
                        continue
                    yield ResumePoint(height, begin, [*kept, row[rule][1]])

    def can_parse(self, states: list[int], start: int, stop: int) -> bool:
        """Return True if the lexemes from `start` to `stop` (included) can follow; `states` is changed."""
        index = start
        while index <= min(stop, len(self.lexemes) - 1):
            terminal = self.terminal_of(states, index)
            if terminal is None:
                return False
            if terminal == END:
                return True
            self.grammar.advance(states, terminal)
            index += 1
        return True

    def truncate(self, height: int) -> None:
        """Remove all states above the first `height` states, with their values."""
        del self.states[height:], self.values[height - 1 :], self.first_lexemes[height - 1 :]

    def skip_lexemes(self, height: int, begin: int, end: int) -> None:
        """Cut the stack, and record the lexemes from `begin` to `end` (excluded) as skipped, their names as lost."""
        self.truncate(height)
        if begin >= 0:
            if begin < end:
                self.skipped_ranges.append((self.lexemes[begin].start, self.lexemes[end].start))
            self.lost_names.update(one.value for one in self.lexemes[begin:end] if one.kind == "NAME")

    def push_error_tree(self, level: ResumePoint, index: int) -> None:
        """Push an error tree in place of the skipped rule of the level; the stack must be cut to its height."""
        self.states.append(level.states[-1])
        self.values.append(Tree(ERROR_TREE, []))
        self.first_lexemes.append(level.first_skipped if level.first_skipped >= 0 else index)

    def unclosed_brace_note(self, place: int) -> tuple[Note, ...]:
        """Return a note about the innermost `{` that is open before a lexeme; () if none is open."""
        depth = self.lexemes[place].brace_depth
        for lexeme in reversed(self.lexemes[:place]):
            if lexeme.kind == PUNCTUATION and lexeme.value == "{" and lexeme.brace_depth == depth - 1:
                return (Note("this `{` is not closed", self.span(lexeme)),)
        return ()

    def span(self, lexeme: Lexeme) -> Span:
        """Return the span of a lexeme in the source."""
        return self.source.span_between(lexeme.start, lexeme.end)

    def column(self, lexeme: Lexeme) -> int:
        """Return the column of a lexeme, from 1."""
        return self.source.line_and_column(lexeme.start)[1]
