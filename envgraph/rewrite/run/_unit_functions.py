"""The functions of a unit during code generation: their statements and their names."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping as Named
from contextlib import contextmanager
from dataclasses import field
from typing import Any, Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.errors import Span

RUN, CHANGED, OUTCOME, RESULT, ROW = map(code.Local, ("run", "c", "o", "s", "row"))
FAILURE, REFUSAL = code.Member(RUN, "failure"), code.Member(RUN, "refusal")
FAILED: Final = code.If(code.is_none(OUTCOME), (code.Return(code.NONE),))


@dataclass(slots=True)
class Scope:
    """The expressions for the variables of a unit. Variables in `maybe` may have no value yet."""

    names: dict[str, code.Local | code.Index] = field(default_factory=dict)
    maybe: set[str] = field(default_factory=set)

    def inner(self) -> Scope:
        """Return a copy for a nested block."""
        return Scope(dict(self.names), set(self.maybe))

    def known(self, name: str) -> bool:
        """Return True if a variable certainly has a value."""
        return name in self.names and name not in self.maybe

    @property
    def locals(self) -> list[code.Local]:
        """Return the local variables, which the functions of inner blocks take as arguments."""
        return [local for local in self.names.values() if isinstance(local, code.Local)]


@dataclass(slots=True)
class OpenFunction:
    """A function whose code is being generated; `tracks` means that the local `c` stores whether anything was changed.

    `bodies` are the statement lists of open compound statements, outermost first; `branches` counts nested `if`
    branches.
    """

    bodies: list[list[code.Statement]] = field(default_factory=lambda: [[]])
    branches: int = 0
    tracks: bool = False

    def add(self, *statements: code.Statement) -> None:
        self.bodies[-1] += statements

    def inside(self, write: Callable[[], None]) -> code.Body:
        """Return the statements that `write` emits, as the body of a compound statement."""
        self.bodies.append([])
        write()
        return tuple(self.bodies.pop())

    @property
    def body(self) -> code.Body:
        """Return all statements of the function."""
        (body,) = self.bodies
        return tuple(body)

    @property
    def outcome(self) -> code.Expression:
        """Return the expression that the function returns if it succeeds."""
        return CHANGED if self.tracks else code.TRUE


class UnitFunctions:
    """The generated functions of one unit: finished ones, and a stack of unfinished ones, the innermost last.

    Args:
        namespace: values for the names in the functions; constants are added to a copy.
    """

    def __init__(self, namespace: Named[str, Any]) -> None:
        self._namespace: dict[str, Any] = dict(namespace)
        self._done: list[code.Function] = []
        self._open: list[OpenFunction] = []
        self._numbers = 0

    @contextmanager
    def begun(self) -> Iterator[OpenFunction]:
        """Yield a new function that is the innermost unfinished one inside the block."""
        function = OpenFunction()
        self._open.append(function)
        yield function
        self._open.pop()

    def end(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> code.Name:
        """Store a finished function and return its name."""
        self._done.append(code.Function(name, parameters, body))
        return code.Name(name)

    def compiled(self, name: str) -> Callable[..., Any]:
        """Compile all functions and return the one with this name."""
        code.define(tuple(self._done), "<unit of envgraph>", self._namespace)
        compiled: Callable[..., Any] = self._namespace[name]
        return compiled

    @property
    def source(self) -> str:
        """Return the source of all finished functions."""
        return code.printed(tuple(self._done)).text

    @property
    def now(self) -> OpenFunction:
        """Return the innermost unfinished function."""
        return self._open[-1]

    def new(self, letter: str) -> str:
        """Return an unused name that begins with the given letter."""
        self._numbers += 1
        return f"{letter}{self._numbers}"

    def local(self, letter: str) -> code.Local:
        """Return a new local variable whose name begins with the given letter."""
        return code.Local(self.new(letter))

    def constant(self, value: object) -> code.Name:
        """Add an object to the namespace and return its name."""
        name = self.new("k")
        self._namespace[name] = value
        return code.Name(name)

    def fails(self, text: str, span: Span | None) -> code.Body:
        """Return statements that record the failed step and return None from the generated function."""
        return code.Assign(FAILURE, self.constant((text, span))), code.Return(code.NONE)

    def fails_if(self, test: code.Expression, text: str, span: Span | None) -> None:
        """Emit code that makes the step fail if a test is true."""
        self.now.add(code.If(test, self.fails(text, span)))

    def changed(self, changed: code.Expression) -> None:
        """Emit code that records that a step has changed something, if the function tracks changes."""
        if self.now.tracks:
            self.now.add(code.Assign(CHANGED, changed, "=" if changed == code.TRUE else "|="))

    def give(self, scope: Scope, name: str) -> code.Local:
        """Give a variable of the unit a new local variable, and return it. The variable counts as set from now on."""
        scope.maybe.discard(name)
        local = scope.names[name] = self.local("v")
        return local

    def takes_step(self, site: code.Name) -> code.Body:
        """Return statements that count one step and raise an error beyond the step limit."""
        left = code.Member(RUN, "steps")
        over = code.Operation("<", (left, code.Constant(0)))
        return code.Assign(left, code.Constant(1), "-="), code.If(
            over, (code.Do(code.call("spent", RUN, site)),)
        )
