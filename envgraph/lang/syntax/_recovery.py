"""Recover from syntax errors: repair the text by one token, or skip a statement, and report one diagnostic.

Most mistakes are a single token: a mistyped keyword is read as the intended keyword, a missing separator is inserted.
The repairs are tried in a fixed order, and each must make sense for the next few tokens. A keyword that starts an outer
definition closes the definitions around it. If no repair helps, the innermost unfinished definition or statement is
skipped. Parsing then resumes behind its `;`, before the `}` around it, or at a word that starts the next statement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, did_you_mean, nearest, too_many_errors
from envgraph.lang.syntax._lexer import END, PUNCTUATION, Lexeme, first_on_line
from envgraph.lang.syntax._stack import Level, ParseStack
from envgraph.lang.syntax._unexpected import VALUE_WORDS, Reports

_LOOKAHEAD = 3
_MOST_CLOSED = 50
_SEPARATORS = (";", ",", ")", "]")


@dataclass(frozen=True, slots=True)
class Repair:
    """A possible correction of the text: a token that is read in place of a lexeme, or inserted before it.

    Attributes:
        place: the index of the lexeme.
        height: the number of parser states that remain on the stack before the token is read.
        terminal, token: the terminal and the token to read.
        inserted: True if the token is inserted before the lexeme, False if it replaces the lexeme.
        until: the repair is accepted only if the text can be parsed up to the lexeme with this index.
        told: the arguments of the report (code, message, lexeme, hint and notes); () for the usual report of an
            unexpected lexeme.
        times: how many times the token is read.
    """

    place: int
    height: int
    terminal: str
    token: Lexeme
    inserted: bool
    until: int
    told: tuple[Any, ...]
    times: int = 1


class Recovery:
    """An error recovery that repairs a parse at syntax errors and collects the diagnostics.

    Args:
        stack: the state of the parser.
        lexical: the diagnostics of misspelt tokens, whose consequences are not reported.
        diagnostics: the list to which syntax errors are added.
    """

    def __init__(self, stack: ParseStack, lexical: list[Diagnostic], diagnostics: list[Diagnostic]) -> None:
        self._reports = Reports(stack, lexical, diagnostics)
        self.diagnostics = diagnostics
        self._stack = stack
        self._grammar = stack.grammar
        self._source = stack.source
        self._lexemes = stack.lexemes
        self._closed: set[int] = set()
        """The indices of keywords before which `}` was inserted once; if that did not help, it is not repeated."""

    def recover(self, index: int) -> int | None:
        """Report the unexpected lexeme, repair or skip text, and return the index to continue at, or None.

        None means that no tree can be built.
        """
        self._stack.depth = self._lexemes[index].braces
        attempts: tuple[Callable[[int], int | None], ...] = (
            partial(self._mend, self._misplaced),
            partial(self._mend, self._mistyped),
            partial(self._mend, self._braces),
            partial(self._mend, self._unescaped),
            self._swallowed,
            partial(self._mend, self._separators),
        )
        for attempt in attempts:
            resumed = attempt(index)
            if resumed is not None:
                return resumed
        if not self._surplus(index):
            self._reports.unexpected(index)
        return self._close_all(index) if self._lexemes[index].kind == END else self._give_up(index)

    def stop(self, index: int) -> None:
        """Report that the rest of the text is not read because of too many errors."""
        self.diagnostics.append(too_many_errors(self._stack.span(self._lexemes[index])))

    def _mend(self, repairs: Callable[[int], Iterator[Repair]], index: int) -> int | None:
        """Apply and report the first repair after which the next lexemes can be parsed.

        Return the index of the lexeme to continue at, or None if no repair helps.
        """
        stack, grammar = self._stack, self._grammar
        for repair in repairs(index):
            start = repair.place + (not repair.inserted)
            states = stack.states[: repair.height]
            if not grammar.accepts(states, repair.terminal):
                continue
            for _ in range(repair.times):
                grammar.shift(states, repair.terminal)
            if not stack.makes_sense(states, start, repair.until):
                continue
            stack.cut(repair.height)
            if repair.inserted:
                stack.previous_end = repair.token.start
            if repair.told:
                self._reports.report(*repair.told)
            else:
                self._reports.unexpected(index)
            for _ in range(repair.times):
                stack.feed(repair.terminal, repair.token, repair.place)
            return start
        return None

    def _insertion(self, sign: str, place: int, height: int, until: int) -> Iterator[Repair]:
        """Yield a repair that inserts a missing sign before a lexeme, if the language has this sign."""
        terminal = self._grammar.core.signs.get(sign)
        if terminal is None:
            return
        end = self._stack.previous_end
        if sign in "{}":
            end = self._lexemes[place - 1].end if place else 0
        notes = self._stack.unclosed(place) if sign == "}" else ()
        token = Lexeme(PUNCTUATION, sign, end, end)
        told = "missing-token", f"missing `{sign}`", token, self._completion(sign, place), notes
        yield Repair(place, height, terminal, token, True, until, told)

    def _misplaced(self, index: int) -> Iterator[Repair]:
        """Yield repairs that insert `}` before a keyword that starts an outer definition but was read as a name."""
        levels = list(self._stack.levels())
        brace = self._grammar.core.signs.get("}")
        if len(levels) < 2 or brace is None:
            return
        # A complete definition before the keyword is kept, an incomplete one is skipped.
        whole = self._grammar.accepts(self._stack.states, brace)
        inner = levels[0]
        height = len(self._stack.states) if whole else inner.height
        for place in range(inner.begin if inner.begin >= 0 else index, index + 1):
            lexeme = self._lexemes[place]
            keyword = self._grammar.core.keywords.get(lexeme.value)
            if keyword is None or lexeme.escaped or place in self._closed:
                continue
            outer = any(self._starts_outer(level, keyword, lexeme) for level in levels[1:])
            times = self._braces_before(keyword, brace, height) if outer else 0
            if times and first_on_line(self._source, lexeme.start):
                self._closed.add(place)
                token, hint = (
                    Lexeme(PUNCTUATION, "}", lexeme.start, lexeme.start),
                    "write the missing `}` before it",
                )
                told = (
                    "unexpected-token",
                    f"unexpected `{lexeme.value}`",
                    lexeme,
                    hint,
                    self._stack.unclosed(place),
                )
                yield Repair(place, height, brace, token, True, place, told, times)

    def _starts_outer(self, outer: Level, keyword: str, lexeme: Lexeme) -> bool:
        if outer.begin < 0 or not self._grammar.accepts(outer.states, keyword):
            return False
        return self._stack.column(lexeme) <= self._stack.column(self._lexemes[outer.begin])

    def _braces_before(self, keyword: str, brace: str, height: int) -> int:
        """Return how many `}` must be inserted before the keyword fits; 0 if no number helps, or none is needed."""
        states = self._stack.states[:height]
        for times in range(_MOST_CLOSED):
            if self._grammar.accepts(states, keyword):
                return times
            if not self._grammar.accepts(states, brace):
                return 0
            self._grammar.shift(states, brace)
        return 0

    def _mistyped(self, index: int) -> Iterator[Repair]:
        """Yield repairs that replace a mistyped word, here or at the statement's start, by a similar keyword."""
        height = len(self._stack.states)
        places = [(index, height)]
        if self._just_before(index):
            places.append((index - 1, height - 1))
        level = next(self._stack.levels(), None)
        if level and 0 <= level.begin < index:
            places.append((level.begin, level.height))
        for place, kept in places:
            lexeme, states = self._lexemes[place], self._stack.states[:kept]
            if lexeme.kind != "NAME" or lexeme.escaped or len(lexeme.value) <= 2:
                continue
            meant = nearest(lexeme.value, self._reports.words(states))
            if meant is not None:
                hint = did_you_mean(lexeme.value, [meant])
                told = "unexpected-token", f"unexpected `{lexeme.value}`", lexeme, hint
                token, until = replace(lexeme, value=meant), self._line_end(index, index + _LOOKAHEAD)
                yield Repair(place, kept, self._grammar.core.keywords[meant], token, False, until, told)

    def _just_before(self, index: int) -> bool:
        """Return True if the last value on the stack is exactly the previous lexeme."""
        return bool(self._stack.begins) and self._stack.begins[-1] == index - 1

    def _line_end(self, index: int, most: int) -> int:
        """Return the index of the last lexeme on this line, at most `most`, as later lines may have other mistakes."""
        last = index
        while last < min(most, len(self._lexemes) - 1):
            if first_on_line(self._source, self._lexemes[last + 1].start):
                break
            last += 1
        return last

    def _unescaped(self, index: int) -> Iterator[Repair]:
        """Yield a repair that reads the keyword just before the unexpected lexeme as a name."""
        if not self._just_before(index) or self._lexemes[index].value == "(":
            return
        lexeme, height = self._lexemes[index - 1], len(self._stack.states) - 1
        if lexeme.kind != "NAME" or self._stack.resolve(self._stack.states[:height], index - 1) in {
            None,
            "NAME",
        }:
            return
        level = next(self._stack.levels(), None)
        if level and level.begin == index - 1 and lexeme.value not in VALUE_WORDS:
            return  # the keyword starts a statement: probably the name behind it is missing
        hint = f"write `^{lexeme.value}` for the name"
        told = "unescaped-keyword", f"`{lexeme.value}` is a keyword here", lexeme, hint
        until = self._line_end(index, index + _LOOKAHEAD)
        yield Repair(index - 1, height, "NAME", lexeme, False, until, told)

    def _swallowed(self, index: int) -> int | None:
        """Report a keyword that starts a statement but was read as a name, and skip the unfinished statement before it.

        Return the index of the keyword to continue at, or None.
        """
        level = next(self._stack.levels(), None)
        if level is None or level.begin < 0:
            return None
        states = self._stack.states[: level.height]
        if self._begins_statement(states, level.begin - 1, index):
            word = self._lexemes[level.begin - 1]
            self._reports.report("unexpected-token", f"unexpected `{word.value}`", word, "expected a name")
            self._stack.cut(level.height)
            return level.begin - 1
        for place in range(level.begin, index):
            lexeme = self._lexemes[place]
            terminal = self._stack.resolve(states, place)
            if terminal is None:
                return None
            keyword = None if lexeme.escaped else self._grammar.core.keywords.get(lexeme.value)
            starts = terminal == "NAME" and keyword and self._grammar.accepts(level.states, keyword)
            if starts and place > level.begin and first_on_line(self._source, lexeme.start):
                self._reports.report(
                    "unexpected-token",
                    f"unexpected `{lexeme.value}`",
                    lexeme,
                    self._reports.expectation(states),
                )
                self._stack.forget(level.height, level.begin, place)
                self._stack.resume(level, index)
                return place
            self._grammar.shift(states, terminal)
        return None

    def _begins_statement(self, states: list[int], place: int, index: int) -> bool:
        """Return True if the keyword that ended the previous statement fits better as the start of this one."""
        lexeme = self._lexemes[place]
        keyword = None if lexeme.escaped else self._grammar.core.keywords.get(lexeme.value)
        if place < 0 or keyword is None or not self._grammar.accepts(states, keyword):
            return False
        return first_on_line(self._source, lexeme.start) and self._stack.makes_sense(
            list(states), place, index
        )

    def _separators(self, index: int) -> Iterator[Repair]:
        """Yield repairs that exchange `,` and `;`, or insert a missing separator or closing bracket."""
        lexeme, height, until = self._lexemes[index], len(self._stack.states), index + _LOOKAHEAD
        meant = {",": ";", ";": ","}.get(lexeme.value, "") if lexeme.kind == PUNCTUATION else ""
        if meant in self._grammar.core.signs:
            told = "unexpected-token", f"unexpected `{lexeme.value}`", lexeme, f"write `{meant}`"
            token = replace(lexeme, value=meant)
            yield Repair(index, height, self._grammar.core.signs[meant], token, False, until, told)
        for sign in _SEPARATORS if lexeme.kind != END else ():
            if sign == ";" and (self._reports.foreign(index) or self._opens_block(lexeme)):
                continue
            for repair in self._insertion(sign, index, height, until):
                on_line = sign == "," and not first_on_line(self._source, lexeme.start)
                yield replace(repair, told=()) if on_line else repair

    def _opens_block(self, lexeme: Lexeme) -> bool:
        """Return True for a `{` that is not first on its line, because the word before it is probably mistyped."""
        return lexeme.value == "{" and not first_on_line(self._source, lexeme.start)

    def _braces(self, index: int) -> Iterator[Repair]:
        """Yield repairs that insert a missing `{` here or one lexeme before, or a missing `}`."""
        lexeme, height = self._lexemes[index], len(self._stack.states)
        if lexeme.kind == END:
            return
        until = index + _LOOKAHEAD
        inside = self._is_inside(index)
        if self._just_before(index) and self._lexemes[index - 1].kind == "NAME":
            yield from self._insertion("{", index - 1, height - 1, until)
            if not inside and self._closes_before(index - 1, height - 1):
                yield from self._insertion("}", index - 1, height - 1, until)
        yield from self._insertion("{", index, height, until)
        if lexeme.value == ";" and not inside:
            yield from self._insertion("}", index, height, until)

    def _closes_before(self, place: int, height: int) -> bool:
        """Return True if a `}` can be inserted before this word, and the word is a keyword then."""
        states, terminal = self._stack.states[:height], self._grammar.core.signs.get("}")
        if terminal is None or not self._grammar.accepts(states, terminal):
            return False
        self._grammar.shift(states, terminal)
        return self._stack.resolve(states, place) not in {None, "NAME"}

    def _is_inside(self, index: int) -> bool:
        """Return True for a `{` whose block ends right before another `}`, which closes the surrounding block."""
        opening = self._lexemes[index]
        if opening.value != "{":
            return False
        for place in range(index + 1, len(self._lexemes) - 1):
            if self._lexemes[place].value == "}" and self._lexemes[place].braces == opening.braces + 1:
                return self._lexemes[place + 1].value == "}"
        return False

    def _completion(self, sign: str, index: int) -> str:
        """Return a hint that says where the missing sign belongs."""
        if sign == ";":
            return "end the statement with `;`"
        lexeme = self._lexemes[index]
        before = (self._source.text[lexeme.start : lexeme.end] or lexeme.value).split("\n")[0][:30]
        return f"write `{sign}` before `{before}`"

    def _close_all(self, index: int) -> int | None:
        """Skip the unfinished statements at the end of the text, and close all open definitions.

        Return the index to continue at, or None if no tree can be built.
        """
        brace = self._grammar.core.signs.get("}")
        for _ in range(100):
            level = next(self._stack.levels(), None)
            if level is None:
                return None
            self._stack.forget(level.height, level.begin, index)
            if self._grammar.accepts(self._stack.states, END):
                return index
            if brace is None or not self._grammar.accepts(self._stack.states, brace):
                self._stack.resume(level, index)
                if self._grammar.accepts(self._stack.states, END):
                    return index
                if brace is None or not self._grammar.accepts(self._stack.states, brace):
                    self._stack.cut(level.height - 1)
                    continue
            end = self._lexemes[index].end
            self._stack.feed(brace, Lexeme(PUNCTUATION, "}", end, end), index)
        return None

    def _give_up(self, index: int) -> int | None:
        """Skip the unfinished statement, and return the index of the lexeme where parsing resumes, or None."""
        levels = list(self._stack.levels())
        for place in range(index, len(self._lexemes)):
            lexeme = self._lexemes[place]
            if lexeme.kind == END:
                break
            for level in levels:
                resumed = self._resumes(level, place, index)
                if resumed is not None:
                    self._stack.forget(level.height, level.begin if level.begin >= 0 else index, place)
                    self._stack.resume(level, index)
                    return resumed
        if levels:
            self._stack.forget(levels[0].height, index, len(self._lexemes) - 1)
            self._stack.resume(levels[0], index)
            return self._end_after_giving_up()
        return None

    def _end_after_giving_up(self) -> int | None:
        last = len(self._lexemes) - 1
        return last if self._grammar.accepts(self._stack.states, END) else self._close_all(last)

    def _resumes(self, level: Level, place: int, index: int) -> int | None:
        """Return the index to resume at if the level's statement ends at or before the lexeme `place`, else None."""
        lexeme = self._lexemes[place]
        begin = level.begin if level.begin >= 0 else index
        depth = self._lexemes[begin].braces
        if place == index == begin and lexeme.value not in {";", "}"}:
            return None
        accepted = self._stack.resolve(level.states, place)
        if lexeme.kind == PUNCTUATION:
            return self._resumes_at_sign(level, place, depth, accepted)
        if lexeme.kind != "NAME" or accepted is None:
            return None
        level_column = self._stack.column(self._lexemes[begin])
        if accepted != "NAME":
            elsewhere = lexeme.bracketed or lexeme.value in VALUE_WORDS
            if lexeme.braces == depth and place > begin and not elsewhere:
                return place
            starts_line = first_on_line(self._source, lexeme.start)
            return place if starts_line and self._stack.column(lexeme) <= level_column else None
        if lexeme.braces == depth and self._stack.column(lexeme) == level_column:
            return place if first_on_line(self._source, lexeme.start) else None
        return None

    def _resumes_at_sign(self, level: Level, place: int, depth: int, accepted: str | None) -> int | None:
        lexeme = self._lexemes[place]
        if lexeme.value == ";" and lexeme.braces == depth:
            return place if accepted else place + 1
        if lexeme.value == "}" and lexeme.braces == depth and accepted:
            return place
        if lexeme.value == "}" and lexeme.braces == depth + 1:
            # This `}` closes a block inside the broken statement, which ends here if another statement can start.
            following = place + 1
            while following + 1 < len(self._lexemes) and self._lexemes[following].value in {
                ";",
                ",",
            }:
                following += 1
            return following if self._stack.resolve(level.states, following) else None
        if lexeme.value == "@" and lexeme.braces == depth and accepted:
            return place if first_on_line(self._source, lexeme.start) else None
        return None

    def _surplus(self, index: int) -> bool:
        """Return True for a `}` without a `{` that is a consequence of an earlier error."""
        lexeme = self._lexemes[index]
        return (
            lexeme.value == "}"
            and lexeme.kind == PUNCTUATION
            and lexeme.braces == 0
            and bool(self.diagnostics)
        )
