"""Lines, indentation and names of generated source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from envgraph.match.generate._symbols import (
    Backward,
    Bounded,
    Builtin,
    Classes,
    ClassTable,
    Closed,
    Forward,
    Held,
    Literal,
    Members,
    Recursive,
    Source,
    Symbol,
    Tallied,
    Valued,
    Values,
    View,
)
from envgraph.metamodel import Value
from envgraph.pattern import Expression, StaticType, compile_expression

MOST_LOOPS: Final = 12
"""Loops of one function, of the 20 that CPython allows."""
MOST_LEVELS: Final = 40
"""Levels of indentation of one function, of the 100 that CPython allows."""
MOST_COLUMNS: Final = 100
"""Longer conditions are broken into lines."""
INDENT: Final = "    "
DEPTH: Final = 2
"""Levels of indentation of the body of an inner function."""


class Module:
    """The names of one generated source, and the functions in it."""

    def __init__(self) -> None:
        self._names: dict[Symbol, str] = {}
        self._symbols: list[tuple[str, Symbol]] = []
        self._counts: dict[str, int] = {}
        self._functions: list[str] = []

    def name(self, symbol: Symbol) -> str:
        """The name of a symbol."""
        if symbol not in self._names:
            self._names[symbol] = name = self._invent(symbol)
            self._symbols.append((name, symbol))
        return self._names[symbol]

    def __contains__(self, symbol: Symbol) -> bool:
        return symbol in self._names

    def _invent(self, symbol: Symbol) -> str:
        match symbol:
            case Classes():
                return "C"
            case Members(index):
                return f"E{index}"
            case Values(index):
                return f"A{index}"
            case Forward(index):
                return f"F{index}"
            case Backward(index):
                return f"B{index}"
            case Builtin(name):
                return name
            case ClassTable():
                return self.fresh("T")
            case Literal():
                return self.fresh("k")
            case View() | Recursive():
                return self.fresh("f")
            case Closed():
                return self.fresh("r")
            case Valued():
                return self.fresh("i")
            case Tallied():
                return self.fresh("n")
            case Bounded():
                return self.fresh("m")
            case Held(what):
                return self.fresh(f"{what}_")

    def fresh(self, prefix: str) -> str:
        """A name with a number that nothing else has."""
        number = self._counts.get(prefix, 0)
        self._counts[prefix] = number + 1
        return f"{prefix}{number}"

    def literal(self, value: Value) -> str:
        """The name of a constant."""
        return self.name(Literal(value))

    def expression(
        self, expression: Expression, names: Mapping[str, str], types: Mapping[str, StaticType]
    ) -> str:
        """The source of an expression; one that may have no value is put into a function that returns None then."""
        first = self._counts.get("k", 0)
        compiled = compile_expression(expression, names, types, constant=lambda i: f"k{first + i}")
        for value in compiled.constants:
            self.name(Literal(value))
        if not compiled.fallible:
            return compiled.source
        name = self.fresh("x")
        inputs = sorted({source for source in names.values() if not source.startswith("k")})
        body = Block()
        body.write(
            ["try:", f"{INDENT}return {compiled.source}", "except EvaluationError:", f"{INDENT}return None"]
        )
        self.function(name, inputs, body)
        return f"{name}({', '.join(inputs)})"

    def function(self, name: str, parameters: Sequence[str], block: Block) -> None:
        """Add an inner function."""
        self._functions.append("\n".join([f"{INDENT}def {name}({', '.join(parameters)}):", *block.lines]))

    def source(self, name: str) -> Source:
        """The whole source; `build` returns the inner function of this name."""
        parameters = ", ".join(name for name, _ in self._symbols)
        parts = [f"def build({parameters}):", *self._functions, f"{INDENT}return {name}", ""]
        return Source("\n".join(parts), tuple(self._symbols))


class Block:
    """The body of an inner function. Conditions are collected until something stands under them."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.depth = DEPTH
        self.loops = 0
        self.conditions: list[str] = []

    def line(self, text: str) -> None:
        """A line at the present depth, under the conditions so far."""
        self.flush()
        self.lines.append(INDENT * self.depth + text)

    def write(self, lines: Iterable[str]) -> None:
        """Several lines at the present depth."""
        for line in lines:
            self.line(line)

    def raw(self, lines: Iterable[str]) -> None:
        """First or last lines of the function, under no conditions."""
        self.lines.extend(INDENT * DEPTH + line for line in lines)

    def test(self, condition: str) -> None:
        """What follows holds only if a condition does."""
        self.conditions.append(condition)

    def loop(self, target: str, iterable: str) -> None:
        """What follows is done for each element."""
        self.line(f"for {target} in {iterable}:")
        self.depth += 1
        self.loops += 1

    def flush(self) -> None:
        """Put what follows under the conditions so far."""
        if not self.conditions:
            return
        pad = INDENT * self.depth
        if sum(map(len, self.conditions)) + 5 * len(self.conditions) < MOST_COLUMNS - len(pad):
            self.lines.append(f"{pad}if {' and '.join(self.conditions)}:")
        else:
            inside = f"\n{pad}{INDENT}and ".join(self.conditions)
            self.lines.append(f"{pad}if (\n{pad}{INDENT}{inside}\n{pad}):")
        self.conditions = []
        self.depth += 1

    @property
    def full(self) -> bool:
        """Whether anything more should go into a function of its own."""
        return self.loops >= MOST_LOOPS or self.depth >= MOST_LEVELS
