"""Text to trees: an LALR(1) loop that reports every mistake once and goes on.

At an unexpected token it first looks for the mistake behind it: a mistyped keyword is read as the keyword meant, a
forgotten separator is put in, a keyword that starts an outer definition closes the ones before it. What cannot be
mended that way is left out: the innermost definition or statement that is under way is given up, and parsing resumes
behind its `;`, before the `}` of its surroundings, or at a word that starts the next one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from lark import Token, Tree
from lark.parsers.lalr_analysis import Shift

from envgraph.errors import Diagnostic, Note, Source, Span, did_you_mean
from envgraph.lang._grammar import Grammar, grammar
from envgraph.lang._hints import VALUE_WORDS, expectation
from envgraph.lang._lexer import END, PUNCTUATION, DocComment, Lexeme, first_on_line, overlapping
from envgraph.metamodel import Annotation, Value

Branch = Tree[Token] | Token | None

ERROR = "error"
"""`data` of the tree that stands for what was given up; `parse` removes them."""

_MOST_ERRORS = 100
_DEEPEST = 150
_LOOKAHEAD = 3
_ENDLESS = {"unterminated-text", "unterminated-comment"}
_SEPARATORS = (";", ",", ")", "]")


@dataclass(slots=True)
class Parsed:
    """What a text says, as far as it can be read.

    Attributes:
        tree: the tree of the start rule, without what was given up; None when nothing could be saved.
        diagnostics: all lexical and syntax errors, in the order of the text.
        lost: the names that stand in what was given up; that one of them is unknown says nothing.
    """

    source: Source
    tree: Tree[Token] | None
    diagnostics: list[Diagnostic]
    docs: list[DocComment] = field(default_factory=list)
    lost: frozenset[str] = frozenset()

    def span(self, item: Tree[Token] | Token) -> Span:
        """The characters that a tree or token was made of, brackets and keywords included."""
        return span_of(self.source, item)

    def doc(self, tree: Tree[Token]) -> str | None:
        """The doc comment before a definition, or between its annotations and the rest of it."""
        ends = {
            child.meta.end_pos
            for child in tree.children
            if isinstance(child, Tree) and child.data == "annotation"
        }
        for doc in self.docs:
            if doc.after == tree.meta.start_pos or doc.before in ends:
                return doc.text
        return None


def parse(language: str, source: Source) -> Parsed:
    """The tree of a text in one of the five languages, and all its errors."""
    return parse_with(grammar(language), source)


def parse_with(grammar: Grammar, source: Source) -> Parsed:
    """As `parse`, with a grammar at hand."""
    scan = grammar.core.scan(source)
    if any(problem.code == "nested-too-deeply" for problem in scan.diagnostics):
        return Parsed(source, None, scan.diagnostics)
    run = _Run(grammar, source, scan.lexemes, scan.diagnostics)
    tree = run.run()
    diagnostics = sorted(
        [*scan.diagnostics, *run.diagnostics], key=lambda one: one.span.start if one.span else 0
    )
    if tree is not None:
        deep = _tidy(tree)
        if deep is not None:
            message = "this is nested too deeply to be read"
            diagnostics.append(Diagnostic("nested-too-deeply", message, span_of(source, deep)))
            tree = None
    return Parsed(source, tree, diagnostics, scan.docs, frozenset(run.lost))


def span_of(source: Source, item: Tree[Token] | Token) -> Span:
    """The characters that a tree or token was made of."""
    if isinstance(item, Token):
        return source.span(item.start_pos or 0, item.end_pos or 0)
    return source.span(item.meta.start_pos, item.meta.end_pos)


def trees(items: Iterable[Branch], *names: str) -> list[Tree[Token]]:
    """Those of the items that are trees, of one of the names if any are given."""
    return [item for item in items if isinstance(item, Tree) and (not names or item.data in names)]


def tokens(items: Iterable[Branch], *types: str) -> list[Token]:
    """Those of the items that are tokens, of one of the types if any are given."""
    return [item for item in items if isinstance(item, Token) and (not types or item.type in types)]


def annotation_of(source: Source, tree: Tree[Token]) -> Annotation:
    """The data of an `annotation` tree; a list of values for one key repeats the key."""
    name, *arguments = [child for child in tree.children if child is not None]
    positional: list[Value] = []
    named: list[tuple[str, Value]] = []
    for argument in trees(arguments):
        if argument.data == "annotation_named":
            key = str(argument.children[0])
            named.extend((key, _annotation_value(value)) for value in trees(argument.children))
        else:
            positional.extend(_annotation_value(value) for value in trees(argument.children))
    return Annotation(str(name), tuple(positional), tuple(named), span_of(source, tree))


def _annotation_value(tree: Tree[Token]) -> Value:
    match tree.data:
        case "annotation_true":
            return True
        case "annotation_false":
            return False
        case "annotation_number":
            *sign, number = tokens(tree.children)
            value = float(number) if number.type == "FLOAT" else int(number)
            return -value if sign else value
    return str(tree.children[0])


def qualified_name_of(tree: Tree[Token]) -> str:
    """`a.b.c` of a `qualified_name` tree."""
    return ".".join(str(part) for part in tree.children)


# --- the parser loop ---


class _Level(NamedTuple):
    """A place on the stack where parsing can resume: how much to keep, and what is taken as read there."""

    height: int
    rule: str
    begin: int
    """Index of the first lexeme that resuming here gives up."""
    states: list[int]
    """The stack of states after resuming."""


class _Run:
    """One parse. `_states`, `_values` and `_begins` are one stack; `_begins` holds indexes of first lexemes."""

    def __init__(
        self, grammar: Grammar, source: Source, lexemes: list[Lexeme], lexical: list[Diagnostic]
    ) -> None:
        self._grammar = grammar
        self._source = source
        self._lexemes = lexemes
        self._lexical = lexical
        self._states = [grammar.start]
        self._values: list[Any] = []
        self._begins: list[int] = []
        self._previous_end = 0
        self._recoveries = 0
        self._depth = 0
        """How many braces are open at the last error."""
        self.diagnostics: list[Diagnostic] = []
        self.lost: set[str] = set()
        self._closed: set[int] = set()
        """Keywords that braces have been closed before: once is enough, if it does not help."""

    def run(self) -> Tree[Token] | None:
        index = 0
        while True:
            lexeme = self._lexemes[index]
            terminal = self._resolve(self._states, index) or self._split(self._states, index)
            if terminal is None:
                # Counted, and not the diagnostics: what follows from a misspelt token is not reported.
                self._recoveries += 1
                if self._recoveries > _MOST_ERRORS:
                    return None
                resumed = self._recover(index)
                if resumed is None:
                    return None
                index = resumed
                continue
            self._feed(terminal, self._lexemes[index], index)
            if lexeme.kind == END:
                tree = self._values[-1]
                assert isinstance(tree, Tree)
                return tree
            index += 1

    # --- one token ---

    def _resolve(self, states: list[int], index: int) -> str | None:
        """The terminal that a lexeme is in this state, or None when it cannot be anything."""
        lexeme = self._lexemes[index]
        grammar = self._grammar
        if lexeme.kind == "NAME":
            keyword = None if lexeme.escaped else grammar.core.keywords.get(lexeme.value)
            if keyword and grammar.accepts(states, keyword):
                return keyword
        elif lexeme.kind == PUNCTUATION:
            sign = grammar.core.signs[lexeme.value]
            return sign if grammar.accepts(states, sign) else None
        return lexeme.kind if grammar.accepts(states, lexeme.kind) else None

    def _split(self, states: list[int], index: int) -> str | None:
        """Takes `<-` for `<` and `-` where only that makes sense."""
        lexeme = self._lexemes[index]
        signs = self._grammar.core.signs
        if lexeme.kind != PUNCTUATION:
            return None
        for size in range(len(lexeme.value) - 1, 0, -1):
            first, rest = lexeme.value[:size], lexeme.value[size:]
            if first in signs and rest in signs and self._grammar.accepts(states, signs[first]):
                middle = lexeme.start + size
                self._lexemes[index : index + 1] = [
                    Lexeme(PUNCTUATION, first, lexeme.start, middle, braces=lexeme.braces),
                    Lexeme(PUNCTUATION, rest, middle, lexeme.end, braces=lexeme.braces),
                ]
                return signs[first]
        return None

    def _feed(self, terminal: str, lexeme: Lexeme, index: int) -> None:
        """Reduces and shifts; the terminal is acceptable."""
        states, values, begins = self._states, self._values, self._begins
        table, callbacks = self._grammar.states, self._grammar.callbacks
        while True:
            action, argument = table[states[-1]][terminal]
            if action is Shift:
                states.append(argument)
                values.append(Token(terminal, lexeme.value, lexeme.start, end_pos=lexeme.end))
                begins.append(index)
                self._previous_end = lexeme.end
                return
            size = len(argument.expansion)
            begin, start, parts = index, lexeme.start, []
            if size:
                begin = begins[-size]
                start = self._lexemes[begin].start
                parts = values[-size:]
                del states[-size:], values[-size:], begins[-size:]
            value = callbacks[argument](parts)
            if isinstance(value, Tree) and value.meta.empty:
                value.meta.start_pos = start
                value.meta.end_pos = max(start, self._previous_end)
                value.meta.empty = False
            states.append(table[states[-1]][argument.origin.name][1])
            values.append(value)
            begins.append(begin)
            if terminal == END and states[-1] == self._grammar.end:
                return

    # --- errors ---

    def _recover(self, index: int) -> int | None:
        """Reports the unexpected lexeme, mends or gives up a part, and says where to go on."""
        self._depth = self._lexemes[index].braces
        attempts = (
            self._misplaced,
            self._missing_brace,
            self._mistyped,
            self._unescaped,
            self._swallowed,
            self._missing,
        )
        for attempt in attempts:
            resumed = attempt(index)
            if resumed is not None:
                return resumed
        if not self._surplus(index):
            self._report_unexpected(index)
        return self._close_all(index) if self._lexemes[index].kind == END else self._give_up(index)

    def _levels(self) -> Iterator[_Level]:
        """Where parsing can resume, innermost first; not inside what has been closed before the error."""
        above: set[str] = set()
        for height in range(len(self._states), 0, -1):
            row = self._grammar.states[self._states[height - 1]]
            here = {rule for rule in self._grammar.recovery if rule in row}
            # Below a list of statements lies the state before the first one: that would give up them all.
            fresh, above = here - above, here
            for rule in self._grammar.recovery:
                if rule in fresh:
                    kept = self._states[:height]
                    begin = self._begins[height - 1] if height <= len(self._begins) else -1
                    if begin >= 0 and self._lexemes[begin].braces > self._depth:
                        continue
                    yield _Level(height, rule, begin, [*kept, row[rule][1]])

    def _misplaced(self, index: int) -> int | None:
        """A keyword that starts an outer definition, taken for a name so far: a `}` is missing before it."""
        levels = list(self._levels())
        if len(levels) < 2:
            return None
        inner = levels[0]
        first = inner.begin if inner.begin >= 0 else index
        for place in range(first, index + 1):
            lexeme = self._lexemes[place]
            keyword = self._grammar.core.keywords.get(lexeme.value)
            if (
                place in self._closed
                or keyword is None
                or lexeme.escaped
                or not first_on_line(self._source, lexeme.start)
            ):
                continue
            for outer in levels[1:]:
                if not self._starts_outer(outer, keyword, lexeme):
                    continue
                if not self._closed_before(inner, outer, place, keyword):
                    continue
                self._closed.add(place)
                return place
        return None

    def _starts_outer(self, outer: _Level, keyword: str, lexeme: Lexeme) -> bool:
        if outer.begin < 0 or not self._grammar.accepts(outer.states, keyword):
            return False
        return self._column(lexeme) <= self._column(self._lexemes[outer.begin])

    def _closed_before(self, inner: _Level, outer: _Level, place: int, keyword: str) -> bool:
        """Closes what is open until the keyword can follow; reports where the open brace is."""
        brace = self._grammar.core.signs.get("}")
        states = self._states[: inner.height]
        closing = 0
        while brace and not self._grammar.accepts(states, keyword) and closing < 50:
            if not self._grammar.accepts(states, brace):
                return False
            self._grammar.shift(states, brace)
            closing += 1
        if closing == 0 or brace is None:
            return False
        lexeme = self._lexemes[place]
        self._forget(inner.height, place, place)
        opening = self._open_brace(place)
        for _ in range(closing):
            self._feed(brace, Lexeme(PUNCTUATION, "}", lexeme.start, lexeme.start), place)
        notes = (Note("this `{` is not closed", self._span(opening)),) if opening else ()
        self._report(
            "unexpected-token", f"unexpected `{lexeme.value}`", lexeme, "a `}` is missing before it", notes
        )
        return True

    def _mistyped(self, index: int) -> int | None:
        """A word that is nearly the keyword that makes sense here, or at the start of the statement under way."""
        if self._substitute(index, len(self._states), index):
            return index + 1
        just_before = bool(self._begins) and self._begins[-1] == index - 1
        if just_before and self._substitute(index - 1, len(self._states) - 1, index):
            return index
        for level in self._levels():
            if 0 <= level.begin < index and self._substitute(level.begin, level.height, index):
                return level.begin + 1
            return None
        return None

    def _substitute(self, place: int, height: int, index: int) -> bool:
        """Reads the word at `place` as the keyword it resembles, if the text then makes sense past `index`."""
        lexeme = self._lexemes[place]
        if lexeme.kind != "NAME" or lexeme.escaped:
            return False
        states = self._states[:height]
        keywords = self._grammar.core.keywords
        words = [word for word, terminal in keywords.items() if self._grammar.accepts(states, terminal)]
        hint = did_you_mean(lexeme.value, words) if len(lexeme.value) > 2 else None
        if hint is None:
            return False
        terminal = keywords[hint.split("`")[1]]
        self._grammar.shift(states, terminal)
        if not self._makes_sense(states, place + 1, index + _LOOKAHEAD):
            return False
        self._report("unexpected-token", f"unexpected `{lexeme.value}`", lexeme, hint)
        self._cut(height)
        self._feed(terminal, lexeme, place)
        return True

    def _unescaped(self, index: int) -> int | None:
        """A name that is a keyword where it stands, just before the unexpected lexeme."""
        if not self._begins or self._begins[-1] != index - 1:
            return None
        lexeme, height = self._lexemes[index - 1], len(self._states) - 1
        states = self._states[:height]
        is_keyword = lexeme.kind == "NAME" and self._resolve(states, index - 1) not in {None, "NAME"}
        if not is_keyword or self._lexemes[index].value == "(" or not self._grammar.accepts(states, "NAME"):
            return None
        level = next(self._levels(), None)
        if level and level.begin == index - 1 and lexeme.value not in VALUE_WORDS:
            return None  # the word of a statement: more likely its name is missing
        self._grammar.shift(states, "NAME")
        if not self._makes_sense(states, index, index + _LOOKAHEAD):
            return None
        hint = f"write `^{lexeme.value}` for the name"
        self._report("unescaped-keyword", f"`{lexeme.value}` is a keyword here", lexeme, hint)
        self._cut(height)
        self._feed("NAME", lexeme, index - 1)
        return index

    def _swallowed(self, index: int) -> int | None:
        """A keyword that starts the next statement, taken for a name by an unfinished one before it."""
        level = next(self._levels(), None)
        if level is None or level.begin < 0:
            return None
        states = self._states[: level.height]
        if self._begins_statement(states, level.begin - 1, index):
            word = self._lexemes[level.begin - 1]
            self._report("unexpected-token", f"unexpected `{word.value}`", word, "expected a name")
            self._cut(level.height)
            return level.begin - 1
        for place in range(level.begin, index):
            lexeme = self._lexemes[place]
            terminal = self._resolve(states, place)
            if terminal is None:
                return None
            keyword = None if lexeme.escaped else self._grammar.core.keywords.get(lexeme.value)
            starts = terminal == "NAME" and keyword and self._grammar.accepts(level.states, keyword)
            if starts and place > level.begin and first_on_line(self._source, lexeme.start):
                self._report(
                    "unexpected-token", f"unexpected `{lexeme.value}`", lexeme, self._expectation(states)
                )
                self._forget(level.height, level.begin, place)
                self._resume(level, index)
                return place
            self._grammar.shift(states, terminal)
        return None

    def _begins_statement(self, states: list[int], place: int, index: int) -> bool:
        """Whether a keyword that ended the statement before should rather have started this one."""
        lexeme = self._lexemes[place]
        keyword = None if lexeme.escaped else self._grammar.core.keywords.get(lexeme.value)
        if place < 0 or keyword is None or not self._grammar.accepts(states, keyword):
            return False
        return first_on_line(self._source, lexeme.start) and self._makes_sense(list(states), place, index)

    def _missing(self, index: int) -> int | None:
        """A separator or closing bracket that was left out."""
        lexeme = self._lexemes[index]
        for sign in _SEPARATORS:
            terminal = self._grammar.core.signs.get(sign)
            if terminal is None or not self._grammar.accepts(self._states, terminal):
                continue
            states = list(self._states)
            self._grammar.shift(states, terminal)
            if sign == ";" and self._foreign(index):
                continue
            if lexeme.kind == END or not self._makes_sense(states, index, index + _LOOKAHEAD):
                continue
            if sign != "," or first_on_line(self._source, lexeme.start):
                before = Lexeme(PUNCTUATION, sign, self._previous_end, self._previous_end)
                self._report("missing-token", f"missing `{sign}`", before, self._completion(sign, index))
            else:
                self._report_unexpected(index)
            self._feed(terminal, Lexeme(PUNCTUATION, sign, self._previous_end, self._previous_end), index)
            return index
        return None

    def _missing_brace(self, index: int) -> int | None:
        """A `{` before this or the previous lexeme, or a `}` before a `;` or a keyword that was taken for a name."""
        if self._lexemes[index].kind == END:
            return None
        places = [(index - 1, "{"), (index - 1, "}"), (index, "{")]
        if self._lexemes[index].value == ";":
            places.append((index, "}"))
        for place, sign in places:
            terminal = self._grammar.core.signs.get(sign)
            height = len(self._states)
            if place < index:
                if not self._begins or self._begins[-1] != place or self._lexemes[place].kind != "NAME":
                    continue
                height -= 1
            states = self._states[:height]
            if terminal is None or not self._grammar.accepts(states, terminal):
                continue
            self._grammar.shift(states, terminal)
            if sign == "}" and place < index and self._resolve(states, place) in {None, "NAME"}:
                continue
            if self._makes_sense(states, place, index + _LOOKAHEAD):
                self._insert_brace(terminal, sign, place, height)
                return place
        return None

    def _insert_brace(self, terminal: str, sign: str, place: int, height: int) -> None:
        self._cut(height)
        self._previous_end = self._lexemes[place - 1].end if place else 0
        before = Lexeme(PUNCTUATION, sign, self._previous_end, self._previous_end)
        opening = self._open_brace(place) if sign == "}" else None
        notes = (Note("this `{` is not closed", self._span(opening)),) if opening else ()
        self._report("missing-token", f"missing `{sign}`", before, self._completion(sign, place), notes)
        self._feed(terminal, before, place)

    def _completion(self, sign: str, index: int) -> str:
        """Where a separator belongs that was left out."""
        if sign == ";":
            return "a statement ends with `;`"
        lexeme = self._lexemes[index]
        before = self._source.text[lexeme.start : lexeme.end].split("\n")[0][:30]
        return f"write `{sign}` before `{before}`"

    def _makes_sense(self, states: list[int], start: int, stop: int) -> bool:
        """Whether the lexemes from `start` to `stop` (included) can follow."""
        index = start
        while index <= min(stop, len(self._lexemes) - 1):
            terminal = self._resolve(states, index)
            if terminal is None:
                return False
            if terminal == END:
                return True
            self._grammar.shift(states, terminal)
            index += 1
        return True

    def _close_all(self, index: int) -> int | None:
        """At the end of the text: gives up what is under way and closes every open definition."""
        brace = self._grammar.core.signs.get("}")
        for _ in range(100):
            level = next(self._levels(), None)
            if level is None:
                return None
            self._forget(level.height, level.begin, index)
            if self._grammar.accepts(self._states, END):
                return index
            if brace is None or not self._grammar.accepts(self._states, brace):
                self._resume(level, index)
                if self._grammar.accepts(self._states, END):
                    return index
                if brace is None or not self._grammar.accepts(self._states, brace):
                    self._cut(level.height - 1)
                    continue
            end = self._lexemes[index].end
            self._feed(brace, Lexeme(PUNCTUATION, "}", end, end), index)
        return None

    def _give_up(self, index: int) -> int | None:
        """Drops the statement under way and looks for the next one."""
        levels = list(self._levels())
        for place in range(index, len(self._lexemes)):
            lexeme = self._lexemes[place]
            if lexeme.kind == END:
                break
            for level in levels:
                resumed = self._resumes(level, place, index)
                if resumed is not None:
                    self._forget(level.height, level.begin if level.begin >= 0 else index, place)
                    self._resume(level, index)
                    return resumed
        if levels:
            self._forget(levels[0].height, index, len(self._lexemes) - 1)
            self._resume(levels[0], index)
            return self._end_after_giving_up()
        return None

    def _end_after_giving_up(self) -> int | None:
        last = len(self._lexemes) - 1
        return last if self._grammar.accepts(self._states, END) else self._close_all(last)

    def _resumes(self, level: _Level, place: int, index: int) -> int | None:
        """Where to go on if the statement of this level ends before or at the lexeme at `place`, else None."""
        lexeme = self._lexemes[place]
        begin = level.begin if level.begin >= 0 else index
        depth = self._lexemes[begin].braces
        if place == index == begin and lexeme.value not in {";", "}"}:
            return None
        accepted = self._resolve(level.states, place)
        if lexeme.kind == PUNCTUATION:
            return self._resumes_at_sign(level, place, depth, accepted)
        if lexeme.kind != "NAME" or accepted is None:
            return None
        level_column = self._column(self._lexemes[begin])
        if accepted != "NAME":
            elsewhere = lexeme.bracketed or lexeme.value in VALUE_WORDS
            if lexeme.braces == depth and place > begin and not elsewhere:
                return place
            starts_line = first_on_line(self._source, lexeme.start)
            return place if starts_line and self._column(lexeme) <= level_column else None
        if lexeme.braces == depth and self._column(lexeme) == level_column:
            return place if first_on_line(self._source, lexeme.start) else None
        return None

    def _resumes_at_sign(self, level: _Level, place: int, depth: int, accepted: str | None) -> int | None:
        lexeme = self._lexemes[place]
        if lexeme.value == ";" and lexeme.braces == depth:
            return place if accepted else place + 1
        if lexeme.value == "}" and lexeme.braces == depth and accepted:
            return place
        if lexeme.value == "}" and lexeme.braces == depth + 1:
            # The `}` of a block inside the broken statement: the statement ends here if another can start.
            following = place + 1
            while following + 1 < len(self._lexemes) and self._lexemes[following].value in {";", ","}:
                following += 1
            return following if self._resolve(level.states, following) else None
        if lexeme.value == "@" and lexeme.braces == depth and accepted:
            return place if first_on_line(self._source, lexeme.start) else None
        return None

    # --- the stack ---

    def _cut(self, height: int) -> None:
        del self._states[height:], self._values[height - 1 :], self._begins[height - 1 :]

    def _forget(self, height: int, begin: int, end: int) -> None:
        """Cuts the stack, and remembers the names between two lexemes as lost."""
        self._cut(height)
        if begin >= 0:
            self.lost.update(one.value for one in self._lexemes[begin:end] if one.kind == "NAME")

    def _resume(self, level: _Level, index: int) -> None:
        """Takes the rule of the level as read; the stack is cut to its height."""
        self._states.append(level.states[-1])
        self._values.append(Tree(ERROR, []))
        self._begins.append(level.begin if level.begin >= 0 else index)

    def _open_brace(self, place: int) -> Lexeme | None:
        """The innermost `{` that is open before a lexeme."""
        depth = self._lexemes[place].braces
        for index in range(place - 1, -1, -1):
            lexeme = self._lexemes[index]
            if lexeme.kind == PUNCTUATION and lexeme.value == "{" and lexeme.braces == depth - 1:
                return lexeme
        return None

    # --- messages ---

    def _surplus(self, index: int) -> bool:
        """Whether this is a `}` without a `{`, and an error before it explains that."""
        lexeme = self._lexemes[index]
        return (
            lexeme.value == "}"
            and lexeme.kind == PUNCTUATION
            and lexeme.braces == 0
            and bool(self.diagnostics)
        )

    def _report_unexpected(self, index: int) -> None:
        lexeme = self._lexemes[index]
        if lexeme.kind == END:
            opening = self._open_brace(index)
            notes = (Note("this `{` is not closed", self._span(opening)),) if opening else ()
            self._report("unexpected-end", "unexpected end of the file", lexeme, self._expectation(), notes)
            return
        foreign = self._foreign(index)
        if foreign is not None:
            keyword = self._lexemes[foreign.begin]
            hint = self._expectation(self._states[: foreign.height])
            self._report("unexpected-token", f"unexpected `{keyword.value}`", keyword, hint)
            return
        shown = self._source.text[lexeme.start : lexeme.end].split("\n")[0]
        shown = shown if len(shown) <= 30 else shown[:27] + "..."
        hint = self._escape_hint(index) or self._expectation()
        self._report("unexpected-token", f"unexpected `{shown}`", lexeme, hint)

    def _foreign(self, index: int) -> _Level | None:
        """The statement under way, if a keyword of other places starts it and the unexpected word follows."""
        level = next(self._levels(), None)
        if level is None or not 0 <= level.begin == index - 1 or self._lexemes[index].kind != "NAME":
            return None
        lexeme = self._lexemes[level.begin]
        keyword = lexeme.kind == "NAME" and not lexeme.escaped and lexeme.value in self._grammar.core.keywords
        return (
            level if keyword and self._resolve(self._states[: level.height], level.begin) == "NAME" else None
        )

    def _escape_hint(self, index: int) -> str | None:
        """For a keyword where a name is expected."""
        lexeme = self._lexemes[index]
        keyword = lexeme.kind == "NAME" and not lexeme.escaped and lexeme.value in self._grammar.core.keywords
        if keyword and "NAME" in self._grammar.expected(self._states):
            return f"write `^{lexeme.value}` for the name"
        return None

    def _expectation(self, states: list[int] | None = None) -> str:
        """What may come next, in plain words."""
        return expectation(self._grammar, self._states if states is None else states)

    def _report(
        self, code: str, message: str, lexeme: Lexeme, hint: str | None, notes: tuple[Note, ...] = ()
    ) -> None:
        span = self._span(lexeme)
        # A misspelt token has been reported already; that it does not fit is its consequence.
        before = self._source.span(self._previous_end, lexeme.end)
        swallowed = lexeme.kind == END and any(one.code in _ENDLESS for one in self._lexical)
        if not swallowed and not overlapping(self._lexical, before):
            self.diagnostics.append(Diagnostic(code, message, span, hint, notes=notes))

    def _span(self, lexeme: Lexeme) -> Span:
        return self._source.span(lexeme.start, lexeme.end)

    def _column(self, lexeme: Lexeme) -> int:
        return self._source.position(lexeme.start)[1]


def _tidy(root: Tree[Token]) -> Tree[Token] | None:
    """Removes the trees of what was given up; returns a tree that lies too deep for recursion, or None.

    The rules of an imported grammar are known by their own names: `name` for Lark's `common__name`.
    """
    level = [root]
    for _ in range(_DEEPEST):
        below: list[Tree[Token]] = []
        for tree in level:
            if "__" in tree.data:
                tree.data = tree.data.rpartition("__")[2]
            children = [child for child in tree.children if isinstance(child, Tree)]
            if any(child.data == ERROR for child in children):
                tree.children = [c for c in tree.children if not (isinstance(c, Tree) and c.data == ERROR)]
            below += [child for child in children if child.data != ERROR]
        level = below
        if not level:
            return None
    return level[0]
