"""Build the LALR(1) parsing tables of the grammars, on first use, and cache them.

Lark itself caches tables as pickles. This module caches the same data as JSON, since building the tables takes longer
than all other work. A cache file is valid for one text of the grammars and one version of Lark. Table rows become
objects only when the parser reaches them, because a small text uses few states and rules.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from sys import intern
from typing import Any, NamedTuple

import lark
from lark import Lark, Tree
from lark.grammar import Rule
from lark.lexer import Lexer, LexerState, TerminalDef, Token
from lark.parse_tree_builder import ExpandSingleChild, ParseTreeBuilder
from lark.parsers.lalr_analysis import Reduce, Shift
from lark.utils import SerializeMemoizer

from envgraph.code import dataclass
from envgraph.files import cache_directory, read_cached, write_cached
from envgraph.lang.syntax._bundled_data import data_path
from envgraph.lang.syntax._lexer import END, TextLexer

RECOVERY_RULES: dict[str, tuple[str, ...]] = {
    "metamodel": ("definition", "member"),
    "model": ("definition", "entry", "assignment", "part", "line"),
    "query": ("definition", "constraint"),
    "rules": ("definition", "part", "statement", "action", "step"),
    "environment": ("definition", "clause"),
}
"""By language: the grammar rules after which parsing can resume, which are elements of lists of definitions or
statements. A broken element is skipped, so the grammar may use these rules only in repetitions (`definition*`)."""

_TERMINAL_NAMES = {
    END: "the end of the file",
    "NAME": "a name",
    "INT": "a whole number",
    "FLOAT": "a number",
    "LONG": "a whole number",
    "STRING": "a string",
    "TEXT": 'a text between `"""`',
}


@dataclass(frozen=True, slots=True)
class Grammar:
    """The LALR(1) tables of a language, and the lexer that splits its text.

    Attributes:
        name: the name of the language.
        lexer: the lexer.
        states: for each parser state: the action for each terminal, and the next state after each rule.
        start, end: the first state, and the state after the whole text.
        recovery_rules: the grammar rules that parsing can resume after.
        spelling: for each terminal: its text or description in messages.
    """

    name: str
    lexer: TextLexer
    states: ParsingTable
    start: int
    end: int
    recovery_rules: tuple[str, ...]
    spelling: dict[str, str]

    def accepts(self, stack: list[int], terminal: str) -> bool:
        """Return True if the parser with this stack of states accepts the terminal; the stack is not changed."""
        size = len(stack)
        added: list[int] = []
        while True:
            top = added[-1] if added else stack[size - 1]
            found = self.states[top].get(terminal)
            if found is None:
                return False
            action, argument = found
            if action is Shift:
                return True
            length = argument.size
            if length > len(added):
                size -= length - len(added)
                added.clear()
            elif length:
                del added[-length:]
            below = added[-1] if added else stack[size - 1]
            added.append(self.states[below][argument.rule][1])
            if terminal == END and added[-1] == self.end:
                return True

    def advance(self, stack: list[int], terminal: str) -> None:
        """Advance a stack of states past a terminal that it accepts, without building a tree."""
        while True:
            action, argument = self.states[stack[-1]][terminal]
            if action is Shift:
                stack.append(argument)
                return
            if argument.size:
                del stack[-argument.size :]
            stack.append(self.states[stack[-1]][argument.rule][1])
            if terminal == END and stack[-1] == self.end:
                return

    def expected_terminals(self, stack: list[int]) -> list[str]:
        """Return the terminals that the parser with this stack of states accepts next; the stack is not changed."""
        return [name for name in self.states[stack[-1]] if name in self.spelling and self.accepts(stack, name)]


def build_grammar(name: str, path: Path, recovery: tuple[str, ...] = ()) -> Grammar:
    """Return the grammar in a file, under the given name; raise Lark's exception if the grammar has conflicts."""
    data = load_tables(path)
    (start,), (end,) = (data["table"][one].values() for one in ("start_states", "end_states"))
    terminals = [TerminalDef.deserialize(data["memo"][str(one["@"])], {}) for one in data["terminals"]]
    core = TextLexer(terminals)
    spelling = {terminal: f"`{word}`" for word, terminal in (*core.keywords.items(), *core.signs.items())}
    for terminal in (*(t.name for t in terminals), END):
        if terminal not in data["ignored"]:
            spelling.setdefault(terminal, _TERMINAL_NAMES.get(terminal, terminal.lower()))
    return Grammar(name, core, ParsingTable(data), start, end, recovery, spelling)


@cache
def load_grammar(language: str) -> Grammar:
    """Return the grammar of one of the five languages, named by its file suffix."""
    return build_grammar(language, data_path("grammars", f"{language}.lark"), RECOVERY_RULES[language])


def reserved_words(language: str) -> frozenset[str]:
    """Return the words that a language uses itself; as a name, some of them must be written `^word`."""
    return frozenset(load_grammar(language).lexer.keywords)


def language_of(name: str) -> str | None:
    """Return the language of a file with this name; None if the suffix belongs to none of the five languages.

    >>> language_of("rules/railway.vql"), language_of("family.toml")
    ('query', None)
    """
    _, dot, ending = name.rpartition(".")
    if not dot:
        return None
    return "query" if ending == "vql" else ending if ending in RECOVERY_RULES else None


class Reduction(NamedTuple):
    """A parser action that replaces the parts of a grammar rule by one result.

    Attributes:
        size: the number of parts.
        rule: the name of the rule.
        build_result: builds the result from the parts; None if the result is the only part, as in a chain of
            precedences.
    """

    size: int
    rule: str
    build_result: Callable[[list[Any]], Any] | None


TableRow = dict[str, tuple[Any, Any]]
"""By terminal: the action, a shift to a state or a `Reduction`. By rule: the next state after the rule."""


class ParsingTable(dict[int, TableRow]):
    """The parsing table: a dict from parser states to rows, in which a row is decoded when it is first used."""

    def __init__(self, data: dict[str, Any]) -> None:
        super().__init__()
        self._names = {int(number): intern(name) for number, name in data["table"]["tokens"].items()}
        self._rows: dict[str, dict[str, Any]] = data["table"]["states"]
        self._parts: dict[str, Any] = data["memo"]
        self._reduction = cache(self._reduction_of)

    def __missing__(self, state: int) -> TableRow:
        row: TableRow = {}
        for number, (reduces, argument) in self._rows[str(state)].items():
            found = self._reduction(argument["@"]) if reduces else argument
            row[self._names[int(number)]] = (Reduce if reduces else Shift, found)
        self[state] = row
        return row

    def _reduction_of(self, number: int) -> Reduction:
        rule: Any = Rule.deserialize(self._parts[str(number)], {})
        builder: Any = ParseTreeBuilder
        (make,) = builder([rule], Tree, maybe_placeholders=True).create_callback().values()
        size = len(rule.expansion)
        same = size == 1 and isinstance(make, ExpandSingleChild)
        return Reduction(size, intern(str(rule.origin.name)), None if same else make)


class _NoLexer(Lexer):
    """A lexer that does nothing, for building tables: Lark requires a lexer although it does not use it then."""

    def __init__(self, conf: Any) -> None:
        pass

    def lex(self, lexer_state: LexerState, parser_state: Any) -> Iterator[Token]:
        return iter(())


def load_tables(path: Path) -> Any:
    """Return the tables of a grammar file in Lark's serialised form, from the cache if possible.

    Lark's exception is raised if the grammar has conflicts.
    """
    directory, key = cache_directory(), _cache_key(path)
    kept = directory / f"grammar-{path.stem}" if directory else None
    if kept is not None and (known := read_cached(kept, key)) is not None:
        return json.loads(known)
    text = json.dumps(_build_tables(path))
    if kept is not None:
        write_cached(kept, key, text.encode())
    return json.loads(text)


def _cache_key(path: Path) -> str:
    """Return the cache key: Lark's version, the grammar's name, and all grammar texts (they import each other)."""
    texts = [one.read_text(encoding="utf-8") for one in sorted(path.parent.glob("*.lark"))]
    return "\0".join([lark.__version__, path.name, *texts])


def _build_tables(path: Path) -> dict[str, Any]:
    """Build the tables with Lark, and return them in serialised form."""
    with path.open(encoding="utf-8") as text:
        made = Lark(text, parser="lalr", lexer=_NoLexer, strict=True)
    memo = SerializeMemoizer([Rule, TerminalDef])
    table: Any = made.parser.parser._parse_table
    data = {
        "table": table.serialize(memo),
        "terminals": [terminal.serialize(memo) for terminal in made.terminals],
        "ignored": sorted(made.ignore_tokens),
    }
    return {**data, "memo": memo.serialize()}
