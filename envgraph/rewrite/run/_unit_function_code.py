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
FAILURE, REFUSAL = code.AttributeAccess(RUN, "failure"), code.AttributeAccess(RUN, "refusal")
FAILED: Final = code.If(code.emit_is_none(OUTCOME), (code.Return(code.NONE),))


@dataclass(slots=True)
class VariableScope:
    """The expressions for the variables of a unit. Variables in `maybe_unset` may have no value yet."""

    names: dict[str, code.Local | code.Subscript] = field(default_factory=dict)
    maybe_unset: set[str] = field(default_factory=set)

    def nested_scope(self) -> VariableScope:
        """Return a copy for a nested block."""
        return VariableScope(dict(self.names), set(self.maybe_unset))

    def is_set(self, name: str) -> bool:
        """Return True if a variable certainly has a value."""
        return name in self.names and name not in self.maybe_unset

    @property
    def local_variables(self) -> list[code.Local]:
        """Return the local variables, which the functions of inner blocks take as arguments."""
        return [local for local in self.names.values() if isinstance(local, code.Local)]


@dataclass(slots=True)
class OpenFunction:
    """A function whose code is being generated; its local `c` stores whether anything was changed.

    `bodies` are the statement lists of open compound statements, outermost first; `branches` counts nested `if`
    branches.
    """

    bodies: list[list[code.Statement]] = field(default_factory=lambda: [[]])
    branches: int = 0

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


class UnitFunctions:
    """The generated functions of one unit: finished ones, and a stack of unfinished ones, the innermost last.

    Args:
        namespace: values for the names in the functions; constants are added to a copy.
    """

    def __init__(self, namespace: Named[str, Any]) -> None:
        self._namespace: dict[str, Any] = dict(namespace)
        self._finished: list[code.Function] = []
        self._open: list[OpenFunction] = []
        self._numbers = 0

    @contextmanager
    def open_function(self) -> Iterator[OpenFunction]:
        """Yield a new function that is the innermost unfinished one inside the block."""
        function = OpenFunction()
        self._open.append(function)
        yield function
        self._open.pop()

    def finish_function(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> code.Name:
        """Store a finished function and return its name."""
        self._finished.append(code.Function(name, parameters, body))
        return code.Name(name)

    def compile_all_and_return(self, name: str) -> Callable[..., Any]:
        """Compile all functions and return the one with this name."""
        code.define_functions(tuple(self._finished), "<unit of envgraph>", self._namespace)
        compiled: Callable[..., Any] = self._namespace[name]
        return compiled

    @property
    def source(self) -> str:
        """Return the source of all finished functions."""
        return code.print_source(tuple(self._finished)).text

    @property
    def current(self) -> OpenFunction:
        """Return the innermost unfinished function."""
        return self._open[-1]

    def unused_name(self, letter: str) -> str:
        """Return an unused name that begins with the given letter."""
        self._numbers += 1
        return f"{letter}{self._numbers}"

    def new_local(self, letter: str) -> code.Local:
        """Return a new local variable whose name begins with the given letter."""
        return code.Local(self.unused_name(letter))

    def add_constant(self, value: object) -> code.Name:
        """Add an object to the namespace and return its name."""
        name = self.unused_name("k")
        self._namespace[name] = value
        return code.Name(name)

    def emit_failure(self, text: str, span: Span | None) -> code.Body:
        """Return statements that record the failed step and return None from the generated function."""
        return code.Assign(FAILURE, self.add_constant((text, span))), code.Return(code.NONE)

    def emit_failure_if(self, test: code.Expression, text: str, span: Span | None) -> None:
        """Emit code that makes the step fail if a test is true."""
        self.current.add(code.If(test, self.emit_failure(text, span)))

    def emit_changed(self, changed: code.Expression) -> None:
        """Emit code that records whether a step has changed something."""
        self.current.add(code.Assign(CHANGED, changed, "=" if changed == code.TRUE else "|="))

    def new_local_for(self, scope: VariableScope, name: str) -> code.Local:
        """Give a variable of the unit a new local variable, and return it. The variable counts as set from now on."""
        scope.maybe_unset.discard(name)
        local = scope.names[name] = self.new_local("v")
        return local

    def emit_step_count(self, call_site: code.Name) -> code.Body:
        """Return statements that count one step and raise an error beyond the step limit."""
        left = code.AttributeAccess(RUN, "steps")
        over = code.Operation("<", (left, code.Constant(0)))
        return code.Assign(left, code.Constant(1), "-="), code.If(
            over, (code.emit_call_statement("spent", RUN, call_site),)
        )
