"""What is said of an unexpected token, and what may have been meant."""

from __future__ import annotations

from dataclasses import replace

from envgraph.errors import Diagnostic, Note, did_you_mean
from envgraph.lang.syntax._hints import expectation as expectation_of
from envgraph.lang.syntax._hints import habit
from envgraph.lang.syntax._lexer import END, PUNCTUATION, Lexeme, first_on_line, overlapping
from envgraph.lang.syntax._stack import Level, ParseStack

_ENDLESS = {"unterminated-text", "unterminated-comment", "too-many-errors"}


class Reports:
    """Collects the diagnostics of a parse.

    Args:
        stack: of the parse.
        lexical: the misspelt tokens; what follows from them is not reported.
        diagnostics: to which what is wrong is added.
    """

    def __init__(self, stack: ParseStack, lexical: list[Diagnostic], diagnostics: list[Diagnostic]) -> None:
        self.diagnostics = diagnostics
        self._stack = stack
        self._grammar = stack.grammar
        self._source = stack.source
        self._lexemes = stack.lexemes
        self._lexical = lexical

    def unexpected(self, index: int) -> None:
        """Reports a lexeme that cannot stand where it does."""
        lexeme = self._lexemes[index]
        if lexeme.kind == END:
            opening = self._stack.open_brace(index)
            notes = (Note("this `{` is not closed", self._stack.span(opening)),) if opening else ()
            self.report("unexpected-end", "unexpected end of the file", lexeme, self.expectation(), notes)
            return
        foreign = self.foreign(index)
        if foreign is not None:
            keyword = self._lexemes[foreign.begin]
            states = self._stack.states[: foreign.height]
            hint = habit(self._grammar, states, self._lexemes, foreign.begin) or self.expectation(states)
            self.report("unexpected-token", f"unexpected `{keyword.value}`", keyword, hint)
            return
        shown = self._source.text[lexeme.start : lexeme.end].split("\n")[0]
        shown = shown if len(shown) <= 30 else shown[:27] + "..."
        if lexeme.value == "}" and lexeme.kind == PUNCTUATION and lexeme.braces == 0:
            hint = "no `{` is open here: take it out, or look for one that is closed too soon"
            self.report("unexpected-token", "unexpected `}`", lexeme, hint)
            return
        meant = habit(self._grammar, self._stack.states, self._lexemes, index)
        expected = [self._grammar.spelling[one] for one in self._grammar.expected(self._stack.states)]
        if len(expected) == 1 and expected[0][0] == "`" and first_on_line(self._source, lexeme.start):
            spelt, end = expected[0].strip("`"), self._stack.previous_end
            before = self._source.text[self._lexemes[index - 1].start : end]
            missing = Lexeme(PUNCTUATION, spelt, end, end)
            self.report("missing-token", f"missing `{spelt}`", missing, meant or f"write `{before} {spelt}`")
            return
        meant = meant or self._escape_hint(index) or self._meant(index) or self.expectation()
        self.report("unexpected-token", f"unexpected `{shown}`", lexeme, meant)

    def foreign(self, index: int) -> Level | None:
        """The statement under way, if a keyword of other places starts it, with a word after it."""
        level = next(self._stack.levels(), None)
        if level is None or level.begin < 0 or level.begin not in {index - 1, index - 2}:
            return None
        word, following = self._lexemes[level.begin : level.begin + 2]
        keyword = word.kind == "NAME" and not word.escaped and word.value in self._grammar.core.keywords
        if not keyword or following.kind != "NAME":
            return None
        states = self._stack.states[: level.height]
        return level if self._stack.resolve(states, level.begin) == "NAME" else None

    def _meant(self, index: int) -> str | None:
        """The keyword that a word resembles, where no name is expected."""
        lexeme = self._lexemes[index]
        states = self._stack.states
        if lexeme.kind != "NAME" or self._grammar.accepts(states, "NAME") or len(lexeme.value) <= 2:
            return None
        return did_you_mean(lexeme.value, self.words(states))

    def _escape_hint(self, index: int) -> str | None:
        """For a keyword where a name is expected."""
        lexeme = self._lexemes[index]
        keyword = lexeme.kind == "NAME" and not lexeme.escaped and lexeme.value in self._grammar.core.keywords
        if keyword and "NAME" in self._grammar.expected(self._stack.states):
            return f"write `^{lexeme.value}` for the name"
        return None

    def expectation(self, states: list[int] | None = None) -> str:
        """Return what may come next, in plain words."""
        return expectation_of(self._grammar, self._stack.states if states is None else states)

    def words(self, states: list[int]) -> list[str]:
        """The keywords that may come next; `and` is only read to be refused."""
        words = self._grammar.core.keywords.items()
        return [word for word, terminal in words if word != "and" and self._grammar.accepts(states, terminal)]

    def _replaced(self, missing: Lexeme) -> bool:
        """Whether a character that means nothing stands where a sign is missing: then that is what to write for it."""
        for place, one in enumerate(self._lexical):
            if one.code != "stray-character" or one.span is None or one.span.start < missing.start:
                continue
            if not self._source.text[missing.start : one.span.start].strip():
                self._lexical[place] = replace(one, hint=f"write `{missing.value}`")
                return True
        return False

    def report(
        self, code: str, message: str, lexeme: Lexeme, hint: str | None, notes: tuple[Note, ...] = ()
    ) -> None:
        """Reports a mistake, unless a misspelt token explains it."""
        span = self._stack.span(lexeme)
        # A misspelt token has been reported already; that it does not fit is its consequence.
        before = self._source.span(self._stack.previous_end, lexeme.end)
        if code == "missing-token" and self._replaced(lexeme):
            return
        swallowed = lexeme.kind == END and any(one.code in _ENDLESS for one in self._lexical)
        if not swallowed and not overlapping(self._lexical, before):
            subject = (lexeme.value,)
            self.diagnostics.append(Diagnostic(code, message, span, hint, notes=notes, subject=subject))
