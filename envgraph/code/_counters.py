"""Insert calls into generated functions that count how often each statement in them is reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from envgraph.code._tree import Assign, Body, Call, Do, For, Function, If, Statement

Counter = Callable[[object], Call | None]
"""Returns the call to insert after a statement with the given origin, or None. The call must return True."""


def with_counters(function: Function, counter: Counter) -> Function:
    """Return a copy of the function, and of functions in it, with counting calls.

    A call is inserted after each test that holds, at the start of each loop iteration, and after each assignment.
    `counter` returns the call for the origin of the statement, or None to insert none.
    """
    return replace(function, body=_counted(function.body, counter))


def _counted(body: Body, counter: Counter) -> Body:
    found: list[Statement] = []
    for statement in body:
        call = counter(statement.origin)
        match statement:
            case If(test, then, otherwise):
                then = _counted(then, counter)
                # Use a separate test, so that the nesting does not become deeper.
                then = then if call is None else (If(call, then),)
                found.append(If(test, then, _counted(otherwise, counter), statement.origin))
            case For():
                inside = _counted(statement.body, counter)
                found.append(replace(statement, body=inside if call is None else (Do(call), *inside)))
            case Function():
                found.append(with_counters(statement, counter))
            case Assign() if call is not None:
                found += [statement, Do(call)]
            case _:
                found.append(statement)
    return tuple(found)
