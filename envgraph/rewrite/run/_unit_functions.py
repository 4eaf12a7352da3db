"""The generated functions of a unit while they are written: their statements, and the names in these."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from collections.abc import Mapping as Named
from contextlib import contextmanager
from dataclasses import field
from typing import Any, Final

from envgraph.code import (
    NONE,
    TRUE,
    Assign,
    Body,
    Constant,
    Do,
    Expression,
    Function,
    If,
    Index,
    Local,
    Member,
    Name,
    Operation,
    Return,
    Statement,
    call,
    dataclass,
    define,
    is_none,
    printed,
)
from envgraph.errors import Span

RUN, CHANGED, OUTCOME, RESULT, ROW = map(Local, ("run", "c", "o", "s", "row"))
FAILURE, REFUSAL = Member(RUN, "failure"), Member(RUN, "refusal")
FAILED: Final = If(is_none(OUTCOME), (Return(NONE),))


@dataclass(slots=True)
class Scope:
    """What stands for each variable of the unit; those in `maybe` may have no value yet."""

    names: dict[str, Local | Index] = field(default_factory=dict)
    maybe: set[str] = field(default_factory=set)

    def inner(self) -> Scope:
        """The scope of a block, which begins with the same variables."""
        return Scope(dict(self.names), set(self.maybe))

    def known(self, name: str) -> bool:
        """Whether a variable has a value for sure."""
        return name in self.names and name not in self.maybe

    @property
    def locals(self) -> list[Local]:
        """All of them as further arguments."""
        return [local for local in self.names.values() if isinstance(local, Local)]


@dataclass(slots=True)
class OpenFunction:
    """A function that is being written; `tracks`: the local `c` holds whether anything was changed."""

    bodies: list[list[Statement]] = field(default_factory=lambda: [[]])
    branches: int = 0
    tracks: bool = False

    def add(self, *statements: Statement) -> None:
        self.bodies[-1] += statements

    def inside(self, write: Callable[[], None]) -> Body:
        """What is written inside a compound statement."""
        self.bodies.append([])
        write()
        return tuple(self.bodies.pop())

    @property
    def body(self) -> Body:
        """All of it."""
        (body,) = self.bodies
        return tuple(body)

    @property
    def outcome(self) -> Expression:
        """What it returns if it succeeds."""
        return CHANGED if self.tracks else TRUE


class UnitFunctions:
    """The functions of one unit: those under way, each inside the one before, and those that are done.

    Args:
        namespace: what they need; gets the constants, too.
    """

    def __init__(self, namespace: Named[str, Any]) -> None:
        self._namespace: dict[str, Any] = dict(namespace)
        self._done: list[Function] = []
        self._open: list[OpenFunction] = []
        self._numbers = 0

    @contextmanager
    def begun(self) -> Iterator[OpenFunction]:
        """A function that is written in the block."""
        function = OpenFunction()
        self._open.append(function)
        yield function
        self._open.pop()

    def end(self, name: str, parameters: tuple[Local, ...], body: Body) -> Name:
        """A function is complete."""
        self._done.append(Function(name, parameters, body))
        return Name(name)

    def compiled(self, name: str) -> Callable[..., Any]:
        """One of the functions, which are all there now."""
        define(tuple(self._done), "<unit of envgraph>", self._namespace)
        compiled: Callable[..., Any] = self._namespace[name]
        return compiled

    @property
    def source(self) -> str:
        """What was written."""
        return printed(tuple(self._done)).text

    @property
    def now(self) -> OpenFunction:
        """The innermost function under way."""
        return self._open[-1]

    def new(self, letter: str) -> str:
        """A name that nothing has yet."""
        self._numbers += 1
        return f"{letter}{self._numbers}"

    def local(self, letter: str) -> Local:
        """A new local variable."""
        return Local(self.new(letter))

    def constant(self, value: object) -> Name:
        """A name for an object, which the functions find in the namespace."""
        name = self.new("k")
        self._namespace[name] = value
        return Name(name)

    def fails(self, text: str, span: Span | None) -> Body:
        """The function ends here, and the step has failed."""
        return Assign(FAILURE, self.constant((text, span))), Return(NONE)

    def fails_if(self, test: Expression, text: str, span: Span | None) -> None:
        """The function ends here if a test says so."""
        self.now.add(If(test, self.fails(text, span)))

    def changed(self, changed: Expression) -> None:
        """Note that a step has changed something, where that is not sure anyway."""
        if self.now.tracks:
            self.now.add(Assign(CHANGED, changed, "=" if changed == TRUE else "|="))

    def give(self, scope: Scope, name: str) -> Local:
        """A new local variable for a variable that has its value from now on."""
        scope.maybe.discard(name)
        local = scope.names[name] = self.local("v")
        return local

    def takes_step(self, site: Name) -> Body:
        """A step of those that a run may take."""
        left = Member(RUN, "steps")
        over = Operation("<", (left, Constant(0)))
        return Assign(left, Constant(1), "-="), If(over, (Do(call("spent", RUN, site)),))
