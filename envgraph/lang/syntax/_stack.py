"""The state of one parse: an LALR(1) stack over lexemes, and what can be asked of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from lark import Token, Tree
from lark.parsers.lalr_analysis import Shift

from envgraph.errors import Note, Source, Span
from envgraph.lang.syntax._grammar import Grammar
from envgraph.lang.syntax._lexer import END, PUNCTUATION, Lexeme

ERROR = "error"
"""`data` of the tree that stands for what was given up; `parse` removes them."""


class Level(NamedTuple):
    """A place on the stack where parsing can resume: how much to keep, and what is taken as read there."""

    height: int
    rule: str
    begin: int
    """Index of the first lexeme that resuming here gives up; -1 for none."""
    states: list[int]
    """The stack of states after resuming."""


class ParseStack:
    """One parse. `states`, `values` and `begins` are one stack.

    Attributes:
        lexemes: of the whole text.
        states: of the parser, one more than there are values.
        values: trees and tokens.
        begins: for each value the index of its first lexeme.
        previous_end: where the last token that was taken ends.
        depth: how many braces are open at the last error.
        lost: names that stand in what was given up.
        gaps: where that stood, as offsets of the text.
    """

    def __init__(self, grammar: Grammar, source: Source, lexemes: list[Lexeme]) -> None:
        self.grammar = grammar
        self.source = source
        self.lexemes = lexemes
        self.states = [grammar.start]
        self.values: list[Any] = []
        self.begins: list[int] = []
        self.previous_end = 0
        self.depth = 0
        self.lost: set[str] = set()
        self.gaps: list[tuple[int, int]] = []

    def resolve(self, states: list[int], index: int) -> str | None:
        """The terminal that a lexeme is in this state, or None when it cannot be anything."""
        lexeme = self.lexemes[index]
        grammar = self.grammar
        if lexeme.kind == "NAME":
            keyword = None if lexeme.escaped else grammar.core.keywords.get(lexeme.value)
            if keyword and grammar.accepts(states, keyword):
                return keyword
        elif lexeme.kind == PUNCTUATION:
            sign = grammar.core.signs[lexeme.value]
            return sign if grammar.accepts(states, sign) else None
        return lexeme.kind if grammar.accepts(states, lexeme.kind) else None

    def split(self, states: list[int], index: int) -> str | None:
        """Takes `<-` for `<` and `-` where only that makes sense."""
        lexeme = self.lexemes[index]
        signs = self.grammar.core.signs
        if lexeme.kind != PUNCTUATION:
            return None
        for size in range(len(lexeme.value) - 1, 0, -1):
            first, rest = lexeme.value[:size], lexeme.value[size:]
            if first in signs and rest in signs and self.grammar.accepts(states, signs[first]):
                middle = lexeme.start + size
                self.lexemes[index : index + 1] = [
                    Lexeme(PUNCTUATION, first, lexeme.start, middle, braces=lexeme.braces),
                    Lexeme(PUNCTUATION, rest, middle, lexeme.end, braces=lexeme.braces),
                ]
                return signs[first]
        return None

    def feed(self, terminal: str, lexeme: Lexeme, index: int) -> None:
        """Reduces and shifts; the terminal is acceptable."""
        states, values, begins = self.states, self.values, self.begins
        table = self.grammar.states
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

    def levels(self) -> Iterator[Level]:
        """Yield where parsing can resume, innermost first; not inside what has been closed before the error."""
        above: set[str] = set()
        for height in range(len(self.states), 0, -1):
            row = self.grammar.states[self.states[height - 1]]
            here = {rule for rule in self.grammar.recovery if rule in row}
            # Below a list of statements lies the state before the first one: that would give up them all.
            fresh, above = here - above, here
            for rule in self.grammar.recovery:
                if rule in fresh:
                    kept = self.states[:height]
                    begin = self.begins[height - 1] if height <= len(self.begins) else -1
                    if begin >= 0 and self.lexemes[begin].braces > self.depth:
                        continue
                    yield Level(height, rule, begin, [*kept, row[rule][1]])

    def makes_sense(self, states: list[int], start: int, stop: int) -> bool:
        """Return whether the lexemes from `start` to `stop` (included) can follow."""
        index = start
        while index <= min(stop, len(self.lexemes) - 1):
            terminal = self.resolve(states, index)
            if terminal is None:
                return False
            if terminal == END:
                return True
            self.grammar.shift(states, terminal)
            index += 1
        return True

    def cut(self, height: int) -> None:
        """Keeps so many states."""
        del self.states[height:], self.values[height - 1 :], self.begins[height - 1 :]

    def forget(self, height: int, begin: int, end: int) -> None:
        """Cuts the stack, and remembers the names between two lexemes as lost."""
        self.cut(height)
        if begin >= 0:
            if begin < end:
                self.gaps.append((self.lexemes[begin].start, self.lexemes[end].start))
            self.lost.update(one.value for one in self.lexemes[begin:end] if one.kind == "NAME")

    def resume(self, level: Level, index: int) -> None:
        """Takes the rule of the level as read; the stack is cut to its height."""
        self.states.append(level.states[-1])
        self.values.append(Tree(ERROR, []))
        self.begins.append(level.begin if level.begin >= 0 else index)

    def unclosed(self, place: int) -> tuple[Note, ...]:
        """A note on the innermost `{` that is open before a lexeme, if there is one."""
        depth = self.lexemes[place].braces
        for lexeme in reversed(self.lexemes[:place]):
            if lexeme.kind == PUNCTUATION and lexeme.value == "{" and lexeme.braces == depth - 1:
                return (Note("this `{` is not closed", self.span(lexeme)),)
        return ()

    def span(self, lexeme: Lexeme) -> Span:
        """The characters of a lexeme."""
        return self.source.span(lexeme.start, lexeme.end)

    def column(self, lexeme: Lexeme) -> int:
        """The column of a lexeme, from 1."""
        return self.source.position(lexeme.start)[1]
