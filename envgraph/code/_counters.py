"""Watching how often functions come to certain places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from envgraph.code._tree import Assign, Body, Call, Do, For, Function, If, Statement

Counter = Callable[[object], Call | None]
"""What is called where something with an origin has been done; None if nothing is. It returns True."""


def with_counters(function: Function, counter: Counter) -> Function:
    """The function with a call behind each test that holds, in each round of a loop, and behind each assignment."""
    return replace(function, body=_counted(function.body, counter))


def _counted(body: Body, counter: Counter) -> Body:
    found: list[Statement] = []
    for statement in body:
        call = counter(statement.origin)
        match statement:
            case If(test, then, otherwise):
                then = _counted(then, counter)
                # A test of its own, so that nothing comes to stand deeper.
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
