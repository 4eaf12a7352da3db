"""The generated functions of a unit while they are written: their statements, and the names in these."""

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
    """What stands for each variable of the unit; those in `maybe` may have no value yet."""

    names: dict[str, code.Local | code.Index] = field(default_factory=dict)
    maybe: set[str] = field(default_factory=set)

    def inner(self) -> Scope:
        """The scope of a block, which begins with the same variables."""
        return Scope(dict(self.names), set(self.maybe))

    def known(self, name: str) -> bool:
        """Return whether a variable has a value for sure."""
        return name in self.names and name not in self.maybe

    @property
    def locals(self) -> list[code.Local]:
        """All of them as further arguments."""
        return [local for local in self.names.values() if isinstance(local, code.Local)]


@dataclass(slots=True)
class OpenFunction:
    """A function that is being written; `tracks`: the local `c` holds whether anything was changed."""

    bodies: list[list[code.Statement]] = field(default_factory=lambda: [[]])
    branches: int = 0
    tracks: bool = False

    def add(self, *statements: code.Statement) -> None:
        self.bodies[-1] += statements

    def inside(self, write: Callable[[], None]) -> code.Body:
        """Return what is written inside a compound statement."""
        self.bodies.append([])
        write()
        return tuple(self.bodies.pop())

    @property
    def body(self) -> code.Body:
        """All of it."""
        (body,) = self.bodies
        return tuple(body)

    @property
    def outcome(self) -> code.Expression:
        """What it returns if it succeeds."""
        return CHANGED if self.tracks else code.TRUE


class UnitFunctions:
    """The functions of one unit: those under way, each inside the one before, and those that are done.

    Args:
        namespace: what they need; gets the constants, too.
    """

    def __init__(self, namespace: Named[str, Any]) -> None:
        self._namespace: dict[str, Any] = dict(namespace)
        self._done: list[code.Function] = []
        self._open: list[OpenFunction] = []
        self._numbers = 0

    @contextmanager
    def begun(self) -> Iterator[OpenFunction]:
        """A function that is written in the block."""
        function = OpenFunction()
        self._open.append(function)
        yield function
        self._open.pop()

    def end(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> code.Name:
        """A function is complete."""
        self._done.append(code.Function(name, parameters, body))
        return code.Name(name)

    def compiled(self, name: str) -> Callable[..., Any]:
        """One of the functions, which are all there now."""
        code.define(tuple(self._done), "<unit of envgraph>", self._namespace)
        compiled: Callable[..., Any] = self._namespace[name]
        return compiled

    @property
    def source(self) -> str:
        """What was written."""
        return code.printed(tuple(self._done)).text

    @property
    def now(self) -> OpenFunction:
        """The innermost function under way."""
        return self._open[-1]

    def new(self, letter: str) -> str:
        """A name that nothing has yet."""
        self._numbers += 1
        return f"{letter}{self._numbers}"

    def local(self, letter: str) -> code.Local:
        """A new local variable."""
        return code.Local(self.new(letter))

    def constant(self, value: object) -> code.Name:
        """A name for an object, which the functions find in the namespace."""
        name = self.new("k")
        self._namespace[name] = value
        return code.Name(name)

    def fails(self, text: str, span: Span | None) -> code.Body:
        """The function ends here, and the step has failed."""
        return code.Assign(FAILURE, self.constant((text, span))), code.Return(code.NONE)

    def fails_if(self, test: code.Expression, text: str, span: Span | None) -> None:
        """The function ends here if a test says so."""
        self.now.add(code.If(test, self.fails(text, span)))

    def changed(self, changed: code.Expression) -> None:
        """Note that a step has changed something, where that is not sure anyway."""
        if self.now.tracks:
            self.now.add(code.Assign(CHANGED, changed, "=" if changed == code.TRUE else "|="))

    def give(self, scope: Scope, name: str) -> code.Local:
        """A new local variable for a variable that has its value from now on."""
        scope.maybe.discard(name)
        local = scope.names[name] = self.local("v")
        return local

    def takes_step(self, site: code.Name) -> code.Body:
        """A step of those that a run may take."""
        left = code.Member(RUN, "steps")
        over = code.Operation("<", (left, code.Constant(0)))
        return code.Assign(left, code.Constant(1), "-="), code.If(
            over, (code.Do(code.call("spent", RUN, site)),)
        )
