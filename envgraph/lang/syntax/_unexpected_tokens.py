"""Report unexpected tokens, with hints about what was probably meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from envgraph.errors import SHOWN, Diagnostic, Edit, Note, ReplacementHint, did_you_mean
from envgraph.lang.syntax._grammar import Grammar
from envgraph.lang.syntax._lexer import END, PUNCTUATION, Lexeme, has_overlap, is_first_on_line
from envgraph.lang.syntax._parse_stack import ParseStack, ResumePoint

VALUE_WORDS = frozenset(["true", "false", "TRUE", "FALSE", "none", "eval", "count", "sum", "min", "max", "avg"])
"""Keywords that can start a value. They can start statements too, so they do not show where a statement begins."""

_VALUES = frozenset(
    ["a name", "a string", "a whole number", "a number", "`_`", "`#`", "`+`", "`-`", "`!`", "`(`", "`::`"]
    + [f"`{word}`" for word in (*VALUE_WORDS, "if")]
)
_OPERATORS = frozenset(
    f"`{sign}`"
    for group in (
        ".?+-*/%<>=",
        ("<=", ">=", "==", "===", "!=", "!==", "&&", "||", "and", "or", "as", "instanceof"),
    )
    for sign in group
)
_COMPARISONS = ("==", "===", "!=", "!==", "=", "<", "<=", ">", ">=")
_STEP_KEYWORDS = ("first", "top", "all", "alap", "repeat", "try", "atomic", "if")
"""Keywords that start a step of a unit; a rule may have such a name too."""
_DEFINITION_KEYWORDS = {"query": ("pattern",), "rules": ("rule", "unit", "derive")}
"""By file suffix: the keywords that start its definitions."""


def _negation_hint(grammar: Grammar, states: list[int], lexemes: Sequence[Lexeme], index: int) -> str | None:
    """Return a hint for a wrong negation at a lexeme (`not`, or a misplaced `neg`); None if this is no negation."""
    around = range(index - 4, index + 1)
    *before, word = (lexemes[place].value if place >= 0 else "" for place in around)
    keywords, signs = grammar.lexer.keywords, grammar.lexer.signs
    rules = "rule" in keywords
    if word == "{" and before[3] in ("neg", "not"):
        block = "write the block `not { .. }` after the `lhs { .. }`" if rules else "define a pattern with the block"
        return block if before[3] == "not" and rules else f"`neg` takes one condition: {block}"
    if word == "neg" and rules and grammar.accepts(states, keywords["not"]):
        return "write `not { .. }`"
    arrow, following = ("-", "<-", ":"), lexemes[min(index + 2, len(lexemes) - 1)].value
    accepted = word == "not" and grammar.accepts(states, keywords["neg"])
    if rules and ((accepted and following in arrow) or (before[2] == "neg" and word in arrow)):
        return "write negated arrows in a block `not { .. }` after the `lhs { .. }`"
    if accepted:
        return "write `neg`"
    if before[0] == "neg" and before[1] == "check":
        return "negate the expression inside: `check(!(..))`"
    if before[1] == "not" and before[2] == "(":
        return "write `neg`, without brackets"
    if before[2] == "find" and before[3] == "neg":
        return f"write `neg find {word}(..)`"
    if before[3] == "not" and "not" not in keywords:
        return "write `!`" if grammar.accepts(states, signs["&&"]) else "write `neg` instead of `not`"
    return None


def expectation_text(grammar: Grammar, states: list[int]) -> str:
    """Return a text that lists the terminals accepted next, such as `expected a name or `;``.

    All starts of a value are summarised as "a value", and all operators as "an operator".
    """
    expected = grammar.expected_terminals(states)
    spelt: Sequence[str] = list(dict.fromkeys(grammar.spelling[terminal] for terminal in expected))
    if {"NAME", "STRING", "INT"} <= set(expected):
        spelt = ["a value", *(one for one in spelt if one not in _VALUES)]
    if sum(one in _OPERATORS for one in spelt) > 4:
        spelt = ["an operator", *(one for one in spelt if one not in _OPERATORS)]
    # Order: kinds of tokens, signs, keywords.
    spelt = sorted(spelt, key=lambda one: (one.startswith("`") and one[1].isalpha(), one.startswith("`"), one))
    if len(spelt) > SHOWN.expected:
        spelt = [*spelt[: SHOWN.expected - 1], "another statement"]
    return "expected " + (" or ".join([", ".join(spelt[:-1]), spelt[-1]]) if len(spelt) > 1 else spelt[0])


def habit_hint(grammar: Grammar, states: list[int], lexemes: Sequence[Lexeme], index: int) -> str | None:
    """Return a hint for syntax that people use by habit from other languages; None if no such habit is recognised."""
    around = (index - 2, index - 1, index, index + 1)
    *before, word, after = (lexemes[place].value if 0 <= place < len(lexemes) else "" for place in around)
    keywords, signs = grammar.lexer.keywords, grammar.lexer.signs
    if before[1] == "-" and after == "->":
        return f"write the object before the arrow: `x -{word}-> ..`"
    if word == "-" and before[0] == "(" and index > 2 and lexemes[index - 3].value == "suppress":
        return 'write the code of a warning in quotes: `@suppress("..")`'
    if before[0] == "metamodel" and before[1] in keywords and "metamodel" in keywords:
        return f"the metamodel has no name: write `metamodel name` before `{before[1]}`"
    if before[0] == "," and lexemes[index - 4].value == "=" and lexemes[index - 3].kind == "NAME":
        expected = expectation_text(grammar, states)
        if expected == "expected `=`":
            return f"{expected}; write several objects in brackets: `[{lexemes[index - 3].value}, {before[1]}]`"
    if "observe" in keywords:
        if word in ("success", "failure") and grammar.accepts(states, keywords["terminate"]):
            return f"write `terminate {word}`"
        if word == "reward" and grammar.accepts(states, keywords["each"]):
            number = after + (lexemes[index + 2].value if after == "-" else "")
            is_late = any(one.value == "else" for one in lexemes[max(0, index - 6) : index])
            first = "write the `reward` of an action before its `else reward`; for a reward in every step " * is_late
            return f"{first}write `each step reward {number}`"
        if (word, after) == (",", "with") or before == [",", "with"]:
            return "leave out the `,` before `with`"
        if word in ("near", "when", "where", "within") and grammar.accepts(states, keywords["if"]):
            return "to show an observation only in some states, write `if find p(..)` with a pattern for these states"
        if word == "find" and before[0] in ("observe", "reward"):
            aggregates = "write `find p(..)`, or `count`, `sum`, `min`, `max` or `avg` before it"
            return aggregates if before[0] == "observe" else "let a match bind it: `on find p(.., n) reward n`"
        if before[1] == "terminate" and word.startswith("truncat"):
            return "write `truncate`, without `terminate`"
        if grammar.expected_terminals(states) == [keywords["up"]]:
            return f"give the highest value of the count: write `up to {after if word[:2] == 'up' else 3}`"
        if (is_up := word == "up" and grammar.accepts(states, keywords["in"])) or (
            grammar.expected_terminals(states) == [keywords["in"]]
        ):
            return f"give the range of the number: write `in 0..{lexemes[index + 2].value if is_up else 9}`"
        if word == "%" and grammar.accepts(states, signs[":"]):
            return f"a probability is a number from 0 to 1: write `{float(before[1]) / 100:g}`"
        if (word in ("+", "-", "*", "/") and grammar.accepts(states, signs[":"])) or (before[1], word) == (
            ")",
            ":",
        ):
            return "write a computed probability in brackets: `(1 - x.loss): rule(x)`"
    if before[1] == "=" and word in (">", "<"):
        return f"write `{word}=`"
    if "neg" not in keywords:
        return None
    if "unit" in keywords and after == ":" and grammar.accepts(states, signs["{"]) and word[0].isdigit():
        return f"give the weight to the rule: write `@weight({word})` before the `rule`"
    if "unit" in keywords and (hint := _rule_habit_hint(grammar, states, lexemes, index)):
        return hint
    if "unit" in keywords and before[1] in _STEP_KEYWORDS and word in (";", "|", "("):
        return f"{expectation_text(grammar, states)}; to call a rule of that name write `^{before[1]}`"
    home = "query" if "rule" in keywords else "rules"
    starts = [keywords[one] for one in ("pattern", "rule") if one in keywords]
    if word in _DEFINITION_KEYWORDS[home] and after and any(grammar.accepts(states, one) for one in starts):
        return f"write a `{word}` in a `.{home}` file, which other files can import"
    negation = _negation_hint(grammar, states, lexemes, index)
    if negation is not None:
        return negation
    if word in ("|", "||") and before[1] == "}" and "or" in keywords:
        return "write `or` between two bodies"
    if home == "rules" and before == ["<", "-"]:
        return "arrows are for rules: write `Class.reference(source, target)`"
    if home == "rules" and word in ("-", "<", ":") and lexemes[index - 1].kind == "NAME":
        if word == ":":
            return f"write `Class({before[1]})`, with its class: `{before[1]} : {after}` is for rules"
        if after in ("-", "->") or lexemes[min(index + 2, len(lexemes) - 1)].value in ("->", "-", "+"):
            return "arrows are for rules: write `Class.reference(source, target)`"
    if word == "!" and grammar.accepts(states, keywords["neg"]):
        return "write `neg`"
    if word == "(" and before[1] in ("neg", "count", "sum", "min", "max", "avg"):
        return f"remove the brackets: `{before[1]} find p(..)`, `{before[1]} Type(..)`"
    if word == "|" and "&&" in signs and grammar.accepts(states, signs["||"]):
        return "write `||`"
    if word in _COMPARISONS and before[0] == "." and grammar.accepts(states, signs["("]):
        return "write a condition on a feature in `check(..)`"
    if word == "{" and before[1] in ("(", "return", "&&", "||"):
        return "write one expression: blocks of statements are not allowed here"
    if word == "{" and (before[1] == "else" or (before[1] == ")" and grammar.accepts(states, "INT"))):
        return "remove the braces: `if (test) a else b`"
    if before[1] + word in _XTEND_REPLACEMENTS:
        return f"write {_XTEND_REPLACEMENTS[before[1] + word]}"
    if before[1] == "new":
        return "remove `new`: an expression cannot create objects"
    if word in ("+", "-", "*", "/", "%") and after != ">" and grammar.accepts(states, signs[")"]):
        return "write a computed value in `eval(..)`"
    if word == "." and grammar.accepts(states, signs["::"]):
        if before[1][:1].isupper():
            return f"write `{before[1]}::{after}` for a literal of an enum"
        return "read a feature in `check(..)`, in `eval(..)`, or by a path"
    if word == "." and home == "query" and before[0] in ("{", ";") and grammar.accepts(states, signs["->"]):
        return f"write `set {before[1]}.{after} = ..`"
    return None


def _rule_habit_hint(grammar: Grammar, states: list[int], lexemes: Sequence[Lexeme], index: int) -> str | None:
    """Return a hint for other habits in rules and units: loops, parts without a block, values without a class."""
    *before, word, after = (lexemes[place].value for place in range(index - 2, min(index + 2, len(lexemes))))
    keywords, signs = grammar.lexer.keywords, grammar.lexer.signs
    if before[0] == "delete" and word == ".":
        return f"write `set {before[1]}.{after} = none;`"
    if grammar.accepts(states, keywords["lhs"]) and lexemes[index].kind == "NAME" and after != "{":
        return "write what must be matched in `lhs { .. }`, and the changes in `modify { .. }`"
    if word == "{" and lexemes[min(index + 2, len(lexemes) - 1)].value == "=":
        if grammar.accepts(states, signs["("]):
            return f"a left-hand side cannot set values: write `check {before[1]}.{after} == ..;`"
        return f"write the class of the object: `{before[1]} : Class {{ .. }}`"
    for one in reversed(lexemes[max(0, index - 12) : index]):
        if one.value in (";", "{", "}"):
            break
        if one.value == "while":
            return "write `alap { .. }`, which repeats its block as long as a rule in the block applies"
    return None


_XTEND_REPLACEMENTS = {
    "<>": "`!=`",
    "**": "`pow(a, b)`",
    "?:": "`test ? a : b`",
    "?.": "`x.feature`, without `?`",
}
"""By operator of Xtend that these languages lack: the text to write instead."""

_UNCLOSED_CODES = {"unterminated-text", "unterminated-comment", "too-many-errors"}


class SyntaxReports:
    """A collector of the syntax errors of a parse.

    Args:
        stack: the state of the parser.
        lexical: the diagnostics of misspelt tokens, whose consequences are not reported.
        diagnostics: the list to which syntax errors are added.
    """

    def __init__(self, stack: ParseStack, lexical: list[Diagnostic], diagnostics: list[Diagnostic]) -> None:
        self.diagnostics = diagnostics
        self._stack = stack
        self._grammar = stack.grammar
        self._source = stack.source
        self._lexemes = stack.lexemes
        self._lexical = lexical

    def report_unexpected(self, index: int) -> None:
        """Report a lexeme that is not allowed at its position, or the misplaced keyword or missing sign before it."""
        lexeme = self._lexemes[index]
        if lexeme.kind == END:
            notes = self._stack.unclosed_brace_note(index)
            self.report("unexpected-end", "unexpected end of the file", lexeme, self.expectation_text(), notes)
            return
        foreign = self.misplaced_keyword_level(index)
        if foreign is not None:
            keyword = self._lexemes[foreign.first_skipped]
            states = self._stack.states[: foreign.kept_states]
            hint = habit_hint(self._grammar, states, self._lexemes, foreign.first_skipped) or self.expectation_text(
                states
            )
            self.report("unexpected-token", f"unexpected `{keyword.value}`", keyword, hint)
            return
        shown = (self._source.text[lexeme.start : lexeme.end] or lexeme.value).split("\n")[0]
        shown = shown if len(shown) <= 30 else shown[:27] + "..."
        if lexeme.value == "}" and lexeme.kind == PUNCTUATION and lexeme.brace_depth == 0:
            hint = "remove it, or look for a `{` that is closed too early: no `{` is open here"
            self.report("unexpected-token", "unexpected `}`", lexeme, hint)
            return
        meant = habit_hint(self._grammar, self._stack.states, self._lexemes, index)
        expected = [self._grammar.spelling[one] for one in self._grammar.expected_terminals(self._stack.states)]
        if len(expected) == 1 and expected[0][0] == "`" and is_first_on_line(self._source, lexeme.start):
            spelt, end = expected[0].strip("`"), self._stack.previous_end
            before = self._source.text[self._lexemes[index - 1].start : end]
            missing = Lexeme(PUNCTUATION, spelt, end, end)
            self.report("missing-token", f"missing `{spelt}`", missing, meant or f"write `{before} {spelt}`")
            return
        meant = meant or self._escape_hint(index) or self._similar_keyword_hint(index) or self.expectation_text()
        self.report("unexpected-token", f"unexpected `{shown}`", lexeme, meant)

    def misplaced_keyword_level(self, index: int) -> ResumePoint | None:
        """Return the start of the current statement if it consists of a misplaced keyword and a word; else None."""
        level = next(self._stack.resume_points(), None)
        if level is None or level.first_skipped < 0 or level.first_skipped not in {index - 1, index - 2}:
            return None
        word, following = self._lexemes[level.first_skipped : level.first_skipped + 2]
        keyword = word.kind == "NAME" and not word.is_escaped and word.value in self._grammar.lexer.keywords
        if not keyword or following.kind != "NAME":
            return None
        states = self._stack.states[: level.kept_states]
        return level if self._stack.terminal_of(states, level.first_skipped) == "NAME" else None

    def _similar_keyword_hint(self, index: int) -> str | None:
        """Return a hint with a keyword similar to the word; None if a name is allowed here or none is similar."""
        lexeme = self._lexemes[index]
        states = self._stack.states
        if lexeme.kind != "NAME" or self._grammar.accepts(states, "NAME") or len(lexeme.value) <= 2:
            return None
        return did_you_mean(lexeme.value, self.expected_keywords(states))

    def _escape_hint(self, index: int) -> str | None:
        """Return a hint to write `^` before a keyword that is used as a name; None if this is not the mistake."""
        lexeme = self._lexemes[index]
        keyword = lexeme.kind == "NAME" and not lexeme.is_escaped and lexeme.value in self._grammar.lexer.keywords
        if keyword and "NAME" in self._grammar.expected_terminals(self._stack.states):
            return ReplacementHint(f"write `^{lexeme.value}` for the name", lexeme.value, f"^{lexeme.value}")
        return None

    def expectation_text(self, states: list[int] | None = None) -> str:
        """Return a text that lists the terminals accepted next, by default after the current states."""
        return expectation_text(self._grammar, self._stack.states if states is None else states)

    def expected_keywords(self, states: list[int]) -> list[str]:
        """Return the keywords that are accepted next, without `and`, which the grammar accepts only to report it."""
        words = self._grammar.lexer.keywords.items()
        return [word for word, terminal in words if word != "and" and self._grammar.accepts(states, terminal)]

    def _hint_at_stray_character(self, missing: Lexeme) -> bool:
        """Return True if an invalid character is in the place of the missing sign; if so, its hint becomes the sign."""
        for place, one in enumerate(self._lexical):
            if one.code != "stray-character" or one.span is None or one.span.start < missing.start:
                continue
            if not self._source.text[missing.start : one.span.start].strip():
                hint = ReplacementHint(f"write `{missing.value}`", one.span.text, missing.value)
                self._lexical[place] = replace(one, hint=hint)
                return True
        return False

    def report(
        self,
        code: str,
        message: str,
        lexeme: Lexeme,
        hint: str | None,
        notes: tuple[Note, ...] = (),
        edits: tuple[Edit, ...] = (),
    ) -> None:
        """Add a diagnostic about a lexeme, unless a misspelt token here or an unclosed text explains the mistake."""
        span = self._stack.span(lexeme)
        # If a misspelt token has been reported here, this mistake is its consequence.
        before = self._source.span_between(self._stack.previous_end, lexeme.end)
        if code == "missing-token" and self._hint_at_stray_character(lexeme):
            return
        swallowed = lexeme.kind == END and any(one.code in _UNCLOSED_CODES for one in self._lexical)
        if not swallowed and not has_overlap(self._lexical, before):
            subject = (lexeme.value,)
            self.diagnostics.append(Diagnostic(code, message, span, hint, notes=notes, subject=subject, edits=edits))
