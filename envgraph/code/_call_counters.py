"""Insert calls into generated functions that count how often each statement in them is reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from envgraph.code._syntax_tree import Assign, Body, Call, ExpressionStatement, For, Function, If, Statement

CounterCallFor = Callable[[object], Call | None]
"""Returns the call to insert after a statement with the given origin, or None. The call must return True."""


def with_counters(function: Function, counter: CounterCallFor) -> Function:
    """Return a copy of the function, and of functions in it, with counting calls.

    A call is inserted after each test that holds, at the start of each loop iteration, and after each assignment.
    `counter` returns the call for the origin of the statement, or None to insert none.
    """
    return replace(function, body=_body_with_counters(function.body, counter))


def _body_with_counters(body: Body, counter: CounterCallFor) -> Body:
    found: list[Statement] = []
    for statement in body:
        call = counter(statement.origin)
        match statement:
            case If(test, then, otherwise):
                then = _body_with_counters(then, counter)
                # Use a separate test, so that the nesting does not become deeper.
                then = then if call is None else (If(call, then),)
                found.append(If(test, then, _body_with_counters(otherwise, counter), statement.origin))
            case For():
                inside = _body_with_counters(statement.body, counter)
                found.append(replace(statement, body=inside if call is None else (ExpressionStatement(call), *inside)))
            case Function():
                found.append(with_counters(statement, counter))
            case Assign() if call is not None:
                found += [statement, ExpressionStatement(call)]
            case _:
                found.append(statement)
    return tuple(found)
