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
from envgraph.errors import Diagnostic, Edit, did_you_mean, most_similar
from envgraph.lang.syntax._lexer import END, PUNCTUATION, Lexeme, is_first_on_line
from envgraph.lang.syntax._parse_stack import ParseStack, ResumePoint
from envgraph.lang.syntax._unexpected_tokens import VALUE_WORDS, SyntaxReports

_LOOKAHEAD = 3
_MOST_CLOSED = 50
_SEPARATORS = (";", ",", ")", "]")


@dataclass(frozen=True, slots=True)
class Repair:
    """A possible correction of the text: a token that is read in place of a lexeme, or inserted before it.

    Attributes:
        lexeme_index: the index of the lexeme.
        kept_states: the number of parser states that remain on the stack before the token is read.
        terminal, token: the terminal and the token to read.
        is_insertion: True if the token is inserted before the lexeme, False if it replaces the lexeme.
        check_until: the repair is accepted only if the text can be parsed up to the lexeme with this index.
        report_arguments: the arguments of the report (code, message, lexeme, hint and notes); () for the usual
            report of an unexpected lexeme.
        repetitions: how many times the token is read.
    """

    lexeme_index: int
    kept_states: int
    terminal: str
    token: Lexeme
    is_insertion: bool
    check_until: int
    report_arguments: tuple[Any, ...]
    repetitions: int = 1


_SYNONYMS = {"done": "terminate", "end": "terminate", "finish": "terminate", "window": "around", "view": "around"}
"""By word: the keyword of environments that has this meaning."""


class Recovery:
    """An error recovery that repairs a parse at syntax errors and collects the diagnostics.

    Args:
        stack: the state of the parser.
        lexical: the diagnostics of misspelt tokens, whose consequences are not reported.
        diagnostics: the list to which syntax errors are added.
    """

    def __init__(self, stack: ParseStack, lexical: list[Diagnostic], diagnostics: list[Diagnostic]) -> None:
        self._reports = SyntaxReports(stack, lexical, diagnostics)
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
        self._stack.brace_depth = self._lexemes[index].brace_depth
        attempts: tuple[Callable[[int], int | None], ...] = (
            partial(self._apply_first_repair, self._missing_closing_brace_repairs),
            partial(self._apply_first_repair, self._mistyped_word_repairs),
            partial(self._apply_first_repair, self._brace_repairs),
            partial(self._apply_first_repair, self._unescaped_keyword_repairs),
            self._resume_at_keyword_read_as_name,
            partial(self._apply_first_repair, self._separator_repairs),
        )
        for attempt in attempts:
            resumed = attempt(index)
            if resumed is not None:
                return resumed
        if not self._is_surplus_brace(index):
            self._reports.report_unexpected(index)
        return self._close_open_definitions(index) if self._lexemes[index].kind == END else self._skip_statement(index)

    def _apply_first_repair(self, repairs: Callable[[int], Iterator[Repair]], index: int) -> int | None:
        """Apply and report the first repair after which the next lexemes can be parsed.

        Return the index of the lexeme to continue at, or None if no repair helps.
        """
        stack, grammar = self._stack, self._grammar
        for repair in repairs(index):
            start = repair.lexeme_index + (not repair.is_insertion)
            states = stack.states[: repair.kept_states]
            if not grammar.accepts(states, repair.terminal):
                continue
            for _ in range(repair.repetitions):
                grammar.advance(states, repair.terminal)
            if not stack.can_parse(states, start, repair.check_until):
                continue
            stack.truncate(repair.kept_states)
            if repair.is_insertion:
                stack.previous_end = repair.token.start
            reported = len(self.diagnostics)
            if repair.report_arguments:
                self._reports.report(*repair.report_arguments)
            else:
                self._reports.report_unexpected(index)
            if len(self.diagnostics) > reported:
                self.diagnostics[-1] = replace(self.diagnostics[-1], edits=(self._edit_of(repair),))
            for _ in range(repair.repetitions):
                stack.read_token(repair.terminal, repair.token, repair.lexeme_index)
            return start
        return None

    def _edit_of(self, repair: Repair) -> Edit:
        """Return the change of the text that has the same effect as a repair."""
        lexeme, word = repair.token, repair.token.value * repair.repetitions
        if repair.is_insertion:
            return Edit(self._source.span_between(lexeme.start, lexeme.start), word)
        is_name = repair.terminal == "NAME" and word in self._grammar.lexer.keywords
        return Edit(self._stack.span(self._lexemes[repair.lexeme_index]), f"^{word}" if is_name else word)

    def _insertion_repairs(self, sign: str, place: int, height: int, until: int) -> Iterator[Repair]:
        """Yield a repair that inserts a missing sign before a lexeme, if the language has this sign."""
        terminal = self._grammar.lexer.signs.get(sign)
        if terminal is None:
            return
        end = self._stack.previous_end
        if sign in "{}":
            end = self._lexemes[place - 1].end if place else 0
        notes = self._stack.unclosed_brace_note(place) if sign == "}" else ()
        token = Lexeme(PUNCTUATION, sign, end, end)
        reported = "missing-token", f"missing `{sign}`", token, self._insertion_hint(sign, place), notes
        yield Repair(place, height, terminal, token, True, until, reported)

    def _missing_closing_brace_repairs(self, index: int) -> Iterator[Repair]:
        """Yield repairs that insert `}` before a keyword that starts an outer definition but was read as a name."""
        levels = list(self._stack.resume_points())
        brace = self._grammar.lexer.signs.get("}")
        if len(levels) < 2 or brace is None:
            return
        # A complete definition before the keyword is kept, an incomplete one is skipped.
        whole = self._grammar.accepts(self._stack.states, brace)
        inner = levels[0]
        height = len(self._stack.states) if whole else inner.kept_states
        for place in range(inner.first_skipped if inner.first_skipped >= 0 else index, index + 1):
            lexeme = self._lexemes[place]
            keyword = self._grammar.lexer.keywords.get(lexeme.value)
            if keyword is None or lexeme.is_escaped or place in self._closed:
                continue
            outer = any(self._starts_outer(level, keyword, lexeme) for level in levels[1:])
            times = self._braces_before(keyword, brace, height) if outer else 0
            if times and is_first_on_line(self._source, lexeme.start):
                self._closed.add(place)
                token, hint = (
                    Lexeme(PUNCTUATION, "}", lexeme.start, lexeme.start),
                    "write the missing `}` before it",
                )
                reported = (
                    "unexpected-token",
                    f"unexpected `{lexeme.value}`",
                    lexeme,
                    hint,
                    self._stack.unclosed_brace_note(place),
                )
                yield Repair(place, height, brace, token, True, place, reported, times)

    def _starts_outer(self, outer: ResumePoint, keyword: str, lexeme: Lexeme) -> bool:
        if outer.first_skipped < 0 or not self._grammar.accepts(outer.states, keyword):
            return False
        return self._stack.column(lexeme) <= self._stack.column(self._lexemes[outer.first_skipped])

    def _braces_before(self, keyword: str, brace: str, height: int) -> int:
        """Return how many `}` must be inserted before the keyword fits; 0 if no number helps, or none is needed."""
        states = self._stack.states[:height]
        for times in range(_MOST_CLOSED):
            if self._grammar.accepts(states, keyword):
                return times
            if not self._grammar.accepts(states, brace):
                return 0
            self._grammar.advance(states, brace)
        return 0

    def _mistyped_word_repairs(self, index: int) -> Iterator[Repair]:
        """Yield repairs that replace a mistyped word, here or at the statement's start, by a similar keyword."""
        height = len(self._stack.states)
        places = [(index, height)]
        if self._is_last_value(index):
            places.append((index - 1, height - 1))
        level = next(self._stack.resume_points(), None)
        if level and 0 <= level.first_skipped < index:
            places.append((level.first_skipped, level.kept_states))
        for place, kept in places:
            lexeme, states = self._lexemes[place], self._stack.states[:kept]
            if lexeme.kind != "NAME" or lexeme.is_escaped or len(lexeme.value) <= 2:
                continue
            expected, following = self._reports.expected_keywords(states), self._lexemes[place + 1].value
            synonym = _SYNONYMS.get(lexeme.value)
            meant = synonym if synonym in expected else most_similar(lexeme.value, expected)
            if meant is not None:
                hint = did_you_mean(lexeme.value, [meant])
                if meant == synonym == "terminate":
                    hint = f"write `terminate {following if following in ('success', 'failure') else 'success'}`"
                elif meant == synonym:
                    hint = f"write `observe around {following} 5 x 5`"
                reported = "unexpected-token", f"unexpected `{lexeme.value}`", lexeme, hint
                token, until = replace(lexeme, value=meant), self._line_end(index, index + _LOOKAHEAD)
                yield Repair(place, kept, self._grammar.lexer.keywords[meant], token, False, until, reported)

    def _is_last_value(self, index: int) -> bool:
        """Return True if the last value on the stack is exactly the previous lexeme."""
        return bool(self._stack.first_lexemes) and self._stack.first_lexemes[-1] == index - 1

    def _line_end(self, index: int, most: int) -> int:
        """Return the index of the last lexeme on this line, at most `most`, as later lines may have other mistakes."""
        last = index
        while last < min(most, len(self._lexemes) - 1):
            if is_first_on_line(self._source, self._lexemes[last + 1].start):
                break
            last += 1
        return last

    def _unescaped_keyword_repairs(self, index: int) -> Iterator[Repair]:
        """Yield a repair that reads the keyword just before the unexpected lexeme as a name."""
        if not self._is_last_value(index) or self._lexemes[index].value == "(":
            return
        lexeme, height = self._lexemes[index - 1], len(self._stack.states) - 1
        if lexeme.kind != "NAME" or self._stack.terminal_of(self._stack.states[:height], index - 1) in {
            None,
            "NAME",
        }:
            return
        level = next(self._stack.resume_points(), None)
        if level and level.first_skipped == index - 1 and lexeme.value not in VALUE_WORDS:
            return  # the keyword starts a statement: probably the name behind it is missing
        hint = f"write `^{lexeme.value}` for the name"
        reported = "unescaped-keyword", f"`{lexeme.value}` is a keyword here", lexeme, hint
        until = self._line_end(index, index + _LOOKAHEAD)
        yield Repair(index - 1, height, "NAME", lexeme, False, until, reported)

    def _resume_at_keyword_read_as_name(self, index: int) -> int | None:
        """Report a keyword that starts a statement but was read as a name, and skip the unfinished statement before it.

        Return the index of the keyword to continue at, or None.
        """
        level = next(self._stack.resume_points(), None)
        if level is None or level.first_skipped < 0:
            return None
        states = self._stack.states[: level.kept_states]
        if self._is_statement_start(states, level.first_skipped - 1, index):
            word = self._lexemes[level.first_skipped - 1]
            self._reports.report("unexpected-token", f"unexpected `{word.value}`", word, "expected a name")
            self._stack.truncate(level.kept_states)
            return level.first_skipped - 1
        for place in range(level.first_skipped, index):
            lexeme = self._lexemes[place]
            terminal = self._stack.terminal_of(states, place)
            if terminal is None:
                return None
            keyword = None if lexeme.is_escaped else self._grammar.lexer.keywords.get(lexeme.value)
            starts = terminal == "NAME" and keyword and self._grammar.accepts(level.states, keyword)
            if starts and place > level.first_skipped and is_first_on_line(self._source, lexeme.start):
                self._reports.report(
                    "unexpected-token",
                    f"unexpected `{lexeme.value}`",
                    lexeme,
                    self._reports.expectation_text(states),
                )
                self._stack.skip_lexemes(level.kept_states, level.first_skipped, place)
                self._stack.push_error_tree(level, index)
                return place
            self._grammar.advance(states, terminal)
        return None

    def _is_statement_start(self, states: list[int], place: int, index: int) -> bool:
        """Return True if the keyword that ended the previous statement fits better as the start of this one."""
        lexeme = self._lexemes[place]
        keyword = None if lexeme.is_escaped else self._grammar.lexer.keywords.get(lexeme.value)
        if place < 0 or keyword is None or not self._grammar.accepts(states, keyword):
            return False
        return is_first_on_line(self._source, lexeme.start) and self._stack.can_parse(list(states), place, index)

    def _separator_repairs(self, index: int) -> Iterator[Repair]:
        """Yield repairs that exchange `,` and `;`, or insert a missing separator or closing bracket."""
        lexeme, height, until = self._lexemes[index], len(self._stack.states), index + _LOOKAHEAD
        meant = {",": ";", ";": ","}.get(lexeme.value, "") if lexeme.kind == PUNCTUATION else ""
        if meant in self._grammar.lexer.signs:
            reported = "unexpected-token", f"unexpected `{lexeme.value}`", lexeme, f"write `{meant}`"
            token = replace(lexeme, value=meant)
            yield Repair(index, height, self._grammar.lexer.signs[meant], token, False, until, reported)
        for sign in _SEPARATORS if lexeme.kind != END else ():
            if sign == ";" and (self._reports.misplaced_keyword_level(index) or self._opens_block(lexeme)):
                continue
            for repair in self._insertion_repairs(sign, index, height, until):
                on_line = sign == "," and not is_first_on_line(self._source, lexeme.start)
                yield replace(repair, report_arguments=()) if on_line else repair

    def _opens_block(self, lexeme: Lexeme) -> bool:
        """Return True for a `{` that is not first on its line, because the word before it is probably mistyped."""
        return lexeme.value == "{" and not is_first_on_line(self._source, lexeme.start)

    def _brace_repairs(self, index: int) -> Iterator[Repair]:
        """Yield repairs that insert a missing `{` here or one lexeme before, or a missing `}`."""
        lexeme, height = self._lexemes[index], len(self._stack.states)
        if lexeme.kind == END:
            return
        until = index + _LOOKAHEAD
        inside = self._ends_with_outer_block(index)
        if self._is_last_value(index) and self._lexemes[index - 1].kind == "NAME":
            yield from self._insertion_repairs("{", index - 1, height - 1, until)
            if not inside and self._closes_before(index - 1, height - 1):
                yield from self._insertion_repairs("}", index - 1, height - 1, until)
        yield from self._insertion_repairs("{", index, height, until)
        if lexeme.value == ";" and not inside:
            yield from self._insertion_repairs("}", index, height, until)

    def _closes_before(self, place: int, height: int) -> bool:
        """Return True if a `}` can be inserted before this word, and the word is a keyword then."""
        states, terminal = self._stack.states[:height], self._grammar.lexer.signs.get("}")
        if terminal is None or not self._grammar.accepts(states, terminal):
            return False
        self._grammar.advance(states, terminal)
        return self._stack.terminal_of(states, place) not in {None, "NAME"}

    def _ends_with_outer_block(self, index: int) -> bool:
        """Return True for a `{` whose block ends right before another `}`, which closes the surrounding block.

        If a definition or the end of the file follows inside a `{`, that other `}` closes a block farther out.
        """
        opening = self._lexemes[index]
        if opening.value != "{":
            return False
        for place in range(index + 1, len(self._lexemes) - 1):
            if self._lexemes[place].value == "}" and self._lexemes[place].brace_depth == opening.brace_depth + 1:
                return self._lexemes[place + 1].value == "}" and not self._starts_unclosed_definition(place + 2)
        return False

    def _starts_unclosed_definition(self, place: int) -> bool:
        """Return True if a `{` is open before a lexeme that starts a definition or is the end of the file."""
        *_, outermost = self._stack.resume_points()
        is_definition = self._stack.terminal_of(outermost.states, place) is not None
        return is_definition and self._lexemes[place].brace_depth > 0

    def _insertion_hint(self, sign: str, index: int) -> str:
        """Return a hint that says where the missing sign belongs."""
        if sign == ";":
            return "end the statement with `;`"
        lexeme = self._lexemes[index]
        before = (self._source.text[lexeme.start : lexeme.end] or lexeme.value).split("\n")[0][:30]
        return f"write `{sign}` before `{before}`"

    def _close_open_definitions(self, index: int) -> int | None:
        """Skip the unfinished statements at the end of the text, and close all open definitions.

        Return the index to continue at, or None if no tree can be built.
        """
        brace = self._grammar.lexer.signs.get("}")
        for _ in range(100):
            level = next(self._stack.resume_points(), None)
            if level is None:
                return None
            self._stack.skip_lexemes(level.kept_states, level.first_skipped, index)
            if self._grammar.accepts(self._stack.states, END):
                return index
            if brace is None or not self._grammar.accepts(self._stack.states, brace):
                self._stack.push_error_tree(level, index)
                if self._grammar.accepts(self._stack.states, END):
                    return index
                if brace is None or not self._grammar.accepts(self._stack.states, brace):
                    self._stack.truncate(level.kept_states - 1)
                    continue
            end = self._lexemes[index].end
            self._stack.read_token(brace, Lexeme(PUNCTUATION, "}", end, end), index)
            self._stack.brace_depth -= 1  # so that the closed block is not skipped
            if self._grammar.accepts(self._stack.states, END):
                return index
        return None

    def _skip_statement(self, index: int) -> int | None:
        """Skip the unfinished statement, and return the index of the lexeme where parsing resumes, or None."""
        levels = list(self._stack.resume_points())
        for place in range(index, len(self._lexemes)):
            lexeme = self._lexemes[place]
            if lexeme.kind == END:
                break
            for level in levels:
                resumed = self._resume_index(level, place, index)
                if resumed is not None:
                    self._stack.skip_lexemes(
                        level.kept_states, level.first_skipped if level.first_skipped >= 0 else index, place
                    )
                    self._stack.push_error_tree(level, index)
                    return resumed
        if levels:
            self._stack.skip_lexemes(levels[0].kept_states, index, len(self._lexemes) - 1)
            self._stack.push_error_tree(levels[0], index)
            return self._end_after_skipping()
        return None

    def _end_after_skipping(self) -> int | None:
        last = len(self._lexemes) - 1
        return last if self._grammar.accepts(self._stack.states, END) else self._close_open_definitions(last)

    def _resume_index(self, level: ResumePoint, place: int, index: int) -> int | None:
        """Return the index to resume at if the level's statement ends at or before the lexeme `place`, else None."""
        lexeme = self._lexemes[place]
        begin = level.first_skipped if level.first_skipped >= 0 else index
        depth = self._lexemes[begin].brace_depth
        if place == index == begin and lexeme.value not in {";", "}"}:
            return None
        accepted = self._stack.terminal_of(level.states, place)
        if lexeme.kind == PUNCTUATION:
            return self._resume_index_at_sign(level, place, depth, accepted)
        if lexeme.kind != "NAME" or accepted is None:
            return None
        level_column = self._stack.column(self._lexemes[begin])
        if accepted != "NAME":
            elsewhere = lexeme.is_bracketed or lexeme.value in VALUE_WORDS
            if lexeme.brace_depth == depth and place > begin and not elsewhere:
                return place
            starts_line = is_first_on_line(self._source, lexeme.start)
            return place if starts_line and self._stack.column(lexeme) <= level_column else None
        if lexeme.brace_depth == depth and self._stack.column(lexeme) == level_column:
            return place if is_first_on_line(self._source, lexeme.start) else None
        return None

    def _resume_index_at_sign(self, level: ResumePoint, place: int, depth: int, accepted: str | None) -> int | None:
        lexeme = self._lexemes[place]
        if lexeme.value == ";" and lexeme.brace_depth == depth:
            return place if accepted else place + 1
        if lexeme.value == "}" and lexeme.brace_depth == depth and accepted:
            return place
        if lexeme.value == "}" and lexeme.brace_depth == depth + 1:
            # This `}` closes a block inside the broken statement, which ends here if another statement can start.
            following = place + 1
            while following + 1 < len(self._lexemes) and self._lexemes[following].value in {
                ";",
                ",",
            }:
                following += 1
            return following if self._stack.terminal_of(level.states, following) else None
        if lexeme.value == "@" and lexeme.brace_depth == depth and accepted:
            return place if is_first_on_line(self._source, lexeme.start) else None
        return None

    def _is_surplus_brace(self, index: int) -> bool:
        """Return True for a `}` without a `{` that is a consequence of an earlier error."""
        lexeme = self._lexemes[index]
        return lexeme.value == "}" and lexeme.kind == PUNCTUATION and lexeme.brace_depth == 0 and bool(self.diagnostics)
