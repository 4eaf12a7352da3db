"""The grammars, each built once in a process, when it is first needed."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from lark.lexer import TerminalDef
from lark.parsers.lalr_analysis import Shift

from envgraph.code import dataclass
from envgraph.lang.syntax._data import data_path
from envgraph.lang.syntax._grammar_tables import States, tables
from envgraph.lang.syntax._lexer import END, LexicalCore

RECOVERY: dict[str, tuple[str, ...]] = {
    "metamodel": ("definition", "member"),
    "model": ("definition", "entry", "assignment", "part", "line"),
    "query": ("definition", "constraint"),
    "rules": ("definition", "part", "statement", "action", "step"),
    "environment": ("definition", "clause"),
}
"""For each language the grammar rules that parsing can resume after: the elements of lists of definitions or
statements. A broken one is left out, so such a rule must stand only where it is repeated (`definition*`)."""

_NAMES = {
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
    """The LALR(1) tables of a language, and how to split its text.

    Attributes:
        states: for each parser state, what to do at each terminal and where to go after each rule.
        spelling: terminal to what a person would type or call it.
    """

    name: str
    core: LexicalCore
    states: States
    start: int
    end: int
    recovery: tuple[str, ...]
    spelling: dict[str, str]

    def accepts(self, stack: list[int], terminal: str) -> bool:
        """Return whether the parser in this state would take the terminal, all reductions before it included."""
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

    def shift(self, stack: list[int], terminal: str) -> None:
        """Moves a stack of states past a terminal that it accepts, building nothing."""
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

    def expected(self, stack: list[int]) -> list[str]:
        """The terminals that may come next."""
        return [
            name for name in self.states[stack[-1]] if name in self.spelling and self.accepts(stack, name)
        ]


def build(name: str, path: Path, recovery: tuple[str, ...] = ()) -> Grammar:
    """Reads a grammar file; a conflict in it is an exception."""
    data = tables(path)
    (start,), (end,) = (data["table"][one].values() for one in ("start_states", "end_states"))
    terminals = [TerminalDef.deserialize(data["memo"][str(one["@"])], {}) for one in data["terminals"]]
    core = LexicalCore(terminals)
    spelling = {terminal: f"`{word}`" for word, terminal in (*core.keywords.items(), *core.signs.items())}
    for terminal in (*(t.name for t in terminals), END):
        if terminal not in data["ignored"]:
            spelling.setdefault(terminal, _NAMES.get(terminal, terminal.lower()))
    return Grammar(name, core, States(data), start, end, recovery, spelling)


@cache
def grammar(language: str) -> Grammar:
    """The grammar of one of the languages, by the name that is also its file extension."""
    return build(language, data_path("grammars", f"{language}.lark"), RECOVERY[language])
