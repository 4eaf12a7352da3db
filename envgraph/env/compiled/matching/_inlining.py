"""Inline functions that are called from one place only, since numba's compile time depends on their number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from envgraph import code

CPYTHON_LOOP_DEPTH: Final = 20
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
    nodes = {function.name: code.walk_parts(function) for function in functions}
    called = {name: _called_names(found) for name, found in nodes.items()}
    numbers = Counter([callee for names in called.values() for callee in names])
    left: dict[str, code.Function] = {}
    for function in functions:
        once = [name for name in called[function.name] if numbers[name] == 1 and name not in entry_points]
        known = {name: left[name] for name in once if name in left}
        left[function.name] = function
        if known:
            body, used = _inline_calls(function.body, known, _local_names(nodes[function.name]), fresh)
            if _loop_depth(body) <= CPYTHON_LOOP_DEPTH:
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


def _called_names(nodes: Sequence[object]) -> list[str]:
    """Return the names of the functions that code calls, once for each call."""
    calls = [node.function for node in nodes if isinstance(node, code.Call)]
    return [function.name for function in calls if isinstance(function, code.Name)]


def local_names(node: object) -> set[str]:
    """Return the names of the local variables in a code tree."""
    return _local_names(code.walk_parts(node))


def _local_names(nodes: Sequence[object]) -> set[str]:
    return {one.name for one in nodes if isinstance(one, code.Local)}


def _inline_calls(
    body: code.Body, known: Mapping[str, code.Function], taken: set[str], fresh: NewLocal
) -> tuple[code.Body, list[str]]:
    """Return a body with calls of `known` functions inlined, and the names of the inlined functions.

    Variables of these functions whose names are `taken` are renamed; the names of all others are added to `taken`.
    """
    found: list[code.Statement] = []
    used: list[str] = []
    for statement in body:
        match statement:
            case code.Return(code.Call(code.Name(name), arguments)) if name in known:
                found += _inlined_statements(known[name], arguments, taken, fresh)
                used.append(name)
            case code.Assign(target, code.Call(code.Name(name), arguments), "=") if name in known and _returns_at_end(
                known[name]
            ):
                *before, last = _inlined_statements(known[name], arguments, taken, fresh)
                assert isinstance(last, code.Return) and last.value is not None
                found += [*before, code.Assign(target, last.value)]
                used.append(name)
            case code.If(test, then, otherwise):
                then, more = _inline_calls(then, known, taken, fresh)
                otherwise, most = _inline_calls(otherwise, known, taken, fresh)
                found.append(code.If(test, then, otherwise))
                used += more + most
            case code.For(target, iterable, inside):
                inside, more = _inline_calls(inside, known, taken, fresh)
                found.append(code.For(target, iterable, inside))
                used += more
            case code.While(test, inside):
                inside, more = _inline_calls(inside, known, taken, fresh)
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
                parameters = [parameter.name for parameter in function.parameters]
                values = dict(zip(parameters, call.arguments, strict=True))
                whole: code.Expression = _rename_locals(code.emit_joined("and", tests, True), values)
                return whole
            case _:
                return None


def _returns_at_end(function: code.Function) -> bool:
    returns = [node for node in code.walk_parts(function.body) if isinstance(node, code.Return)]
    return len(returns) == 1 and isinstance(function.body[-1], code.Return)


def _inlined_statements(
    function: code.Function, arguments: Sequence[code.Expression], taken: set[str], fresh: NewLocal
) -> list[code.Statement]:
    """Return assignments of the arguments, and the statements of a function; see `_inline_calls` for its variables."""
    nodes = code.walk_parts(function)
    assigned = [node.target for node in nodes if isinstance(node, code.Assign | code.For)]
    written = _local_names([part for one in assigned for part in (one.items if isinstance(one, code.Tuple) else [one])])
    pairs = [
        (parameter, argument)
        for parameter, argument in zip(function.parameters, arguments, strict=True)
        if parameter != argument or parameter.name in written
    ]
    own = {*written, *[parameter.name for parameter, _ in pairs]}
    names = {name: fresh(name) for name in sorted(own & taken)}
    taken |= _local_names(nodes)
    body = _rename_locals(function.body, names) if names else function.body
    return [*[code.Assign(_rename_locals(parameter, names), argument) for parameter, argument in pairs], *body]


def _rename_locals(node: Any, names: Mapping[str, code.Expression]) -> Any:
    if isinstance(node, code.Local):
        return names.get(node.name, node)
    if isinstance(node, tuple):
        return tuple([_rename_locals(part, names) for part in node])
    parts = code.compared_fields(node.__class__)
    return replace(node, **{part: _rename_locals(getattr(node, part), names) for part in parts}) if parts else node
