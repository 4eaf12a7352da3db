"""Inline functions that are called from one place only, since numba's compile time depends on their number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from envgraph import code

MAX_LOOP_DEPTH: Final = 20
"""Maximal nesting of loops in one function of CPython."""

NewLocal = Callable[[str], code.Local]


def inline_functions(
    functions: Sequence[code.Function], entry_points: Sequence[str], fresh: NewLocal
) -> tuple[code.Function, ...]:
    """Return the functions after inlining those that are called once.

    A returned call is always inlined. An assigned call is inlined if the function returns only at its end.

    Args:
        functions: callees before their callers.
        entry_points: names of functions that are called from outside.
        fresh: returns a variable that no function uses.
    """
    calls = Counter(name for function in functions for name in _called_names(function.body))
    once = {name for name, number in calls.items() if number == 1 and name not in entry_points}
    left: dict[str, code.Function] = {}
    for function in functions:
        body, used = _inline_calls(function.body, {name: left[name] for name in once if name in left}, fresh)
        if _loop_depth(body) > MAX_LOOP_DEPTH:
            body, used = function.body, []
        left[function.name] = code.Function(function.name, function.parameters, body)
        for name in used:
            del left[name]
    return tuple(left.values())


def _loop_depth(body: code.Body) -> int:
    """Return the number of loops around the innermost statement of a body."""
    depths = [0]
    for one in body:
        match one:
            case code.For(_, _, inside) | code.While(_, inside):
                depths.append(1 + _loop_depth(inside))
            case code.If(_, then, otherwise):
                depths += [_loop_depth(then), _loop_depth(otherwise)]
    return max(depths)


def _called_names(body: code.Body) -> Iterator[str]:
    """Yield the names of the functions that a body calls, once for each call."""
    for node in code.walk_parts(body):
        if isinstance(node, code.Call) and isinstance(node.function, code.Name):
            yield node.function.name


def local_names(node: object) -> set[str]:
    """Return the names of the local variables in a code tree."""
    return {one.name for one in code.walk_parts(node) if isinstance(one, code.Local)}


def _inline_calls(body: code.Body, known: Mapping[str, code.Function], fresh: NewLocal) -> tuple[code.Body, list[str]]:
    """Return a body with calls of `known` functions inlined, and the names of the inlined functions."""
    found: list[code.Statement] = []
    used: list[str] = []
    for statement in body:
        match statement:
            case code.Return(code.Call(code.Name(name), arguments)) if name in known:
                found += _inlined_statements(known[name], arguments, fresh)
                used.append(name)
            case code.Assign(target, code.Call(code.Name(name), arguments), "=") if name in known and _returns_at_end(
                known[name]
            ):
                *before, last = _inlined_statements(known[name], arguments, fresh)
                assert isinstance(last, code.Return) and last.value is not None
                found += [*before, code.Assign(target, last.value)]
                used.append(name)
            case code.If(test, then, otherwise):
                then, more = _inline_calls(then, known, fresh)
                otherwise, most = _inline_calls(otherwise, known, fresh)
                found.append(code.If(test, then, otherwise))
                used += more + most
            case code.For(target, iterable, inside):
                inside, more = _inline_calls(inside, known, fresh)
                found.append(code.For(target, iterable, inside))
                used += more
            case code.While(test, inside):
                inside, more = _inline_calls(inside, known, fresh)
                found.append(code.While(test, inside))
                used += more
            case _:
                found.append(statement)
    return tuple(found), used


def inlined_test(function: code.Function, call: code.Call) -> code.Expression | None:
    """Return the test whose result a call of a function returns; None if the function does more than a test."""
    tests: list[code.Expression] = []
    body = function.body
    while True:
        match body:
            case (code.If(test, inner, ()), *_):
                tests.append(test)
                body = inner
            case (code.Return(code.TRUE), *_):
                values = dict(zip(function.parameters, call.arguments, strict=True))
                whole: code.Expression = _rename_locals(code.emit_joined("and", tests, True), values)
                return whole
            case _:
                return None


def _returns_at_end(function: code.Function) -> bool:
    returns = sum(isinstance(node, code.Return) for node in code.walk_parts(function.body))
    return returns == 1 and isinstance(function.body[-1], code.Return)


def _inlined_statements(
    function: code.Function, arguments: Sequence[code.Expression], fresh: NewLocal
) -> Iterator[code.Statement]:
    """Yield the statements of a function with renamed variables, after assignments of the arguments."""
    names: dict[code.Local, code.Local] = {}
    for parameter, argument in zip(function.parameters, arguments, strict=True):
        assert isinstance(parameter, code.Local)
        if parameter != argument:
            names[parameter] = fresh(parameter.name)
            yield code.Assign(names[parameter], argument)
    for local in dict.fromkeys(_assigned_locals(function.body)):
        names[local] = fresh(local.name)
    yield from _rename_locals(function.body, names)


def _assigned_locals(body: code.Body) -> Iterator[code.Local]:
    """Yield the local variables that a body assigns."""
    for node in code.walk_parts(body):
        if isinstance(node, code.Assign | code.For):
            targets = node.target.items if isinstance(node.target, code.Tuple) else (node.target,)
            yield from (target for target in targets if isinstance(target, code.Local))


def _rename_locals(node: Any, names: Mapping[Any, code.Expression]) -> Any:
    if isinstance(node, code.Local):
        return names.get(node, node)
    if isinstance(node, tuple):
        return tuple(_rename_locals(part, names) for part in node)
    parts = {part: _rename_locals(getattr(node, part), names) for part in code.compared_fields(node.__class__)}
    return replace(node, **parts) if parts else node
