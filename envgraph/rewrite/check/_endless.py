"""A check for units that can never succeed, because every way through them calls them again."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

from envgraph.errors import Diagnostic, Severity
from envgraph.metamodel import shortest_way
from envgraph.pattern import Alap, Atomic, Call, Choice, If, Repeat, Sequence as Steps, Step, Try
from envgraph.rewrite.check._unit_check import CheckedUnit, inner_steps


def endless(units: Sequence[CheckedUnit]) -> Iterator[Diagnostic]:
    """Warn once for each cycle of calls from which no unit can return except by failing. The units must have no errors.

    A unit may succeed if some way through it calls only rules, and units that may succeed. This is repeated until no
    more such units are found; the remaining units never succeed.
    """
    left = {checked.unit.qualified_name: checked for checked in units}
    callers: dict[str, list[str]] = {name: [] for name in left}
    for name, one in left.items():
        for callee, _ in _calls(one.unit.body, one, left):
            callers[callee].append(name)
    waiting = list(left)
    for name in waiting:
        if name in left and _succeeds(left[name].unit.body, left[name], left):
            del left[name]
            waiting += callers[name]
    calls = {name: list(_calls(one.unit.body, one, left)) for name, one in left.items()}
    told: set[str] = set()
    for name in left:
        way = None if name in told else shortest_way(name, name, lambda one: [c for c, _ in calls[one]])
        if way and told.isdisjoint(way):
            told.update(way)
            yield _warning(name, way, calls)


def _succeeds(step: Step, checked: CheckedUnit, left: Collection[str]) -> bool:
    """Return True if a step may succeed without calling a unit of `left`."""
    match step:
        case Call():
            callee = checked.calls.get(id(step))
            return callee is None or callee.name not in left
        case Steps(steps):
            return all(_succeeds(inner, checked, left) for inner in steps)
        case Choice(alternatives):
            return any(_succeeds(inner, checked, left) for inner in alternatives)
        case Alap():
            return True
        case Repeat(lower, _, body):
            return lower == 0 or not isinstance(lower, int) or _succeeds(body, checked, left)
        case Try(body, otherwise) | If(_, body, otherwise):
            return otherwise is None or any(_succeeds(one, checked, left) for one in (body, otherwise))
        case Atomic(body):
            return _succeeds(body, checked, left)


def _calls(step: Step, checked: CheckedUnit, left: Collection[str]) -> Iterator[tuple[str, Call]]:
    """Yield name and call of the units of `left` that a step calls, in the order of the text."""
    if isinstance(step, Call):
        callee = checked.calls.get(id(step))
        if callee is not None and callee.name in left:
            yield callee.name, step
    for inner in inner_steps(step):
        yield from _calls(inner, checked, left)


def _warning(name: str, way: Sequence[str], calls: Mapping[str, Sequence[tuple[str, Call]]]) -> Diagnostic:
    call = next(call for callee, call in calls[name] if callee == way[0])
    through = f" through `{way[0]}`" * (len(way) > 1) + " and others" * (len(way) > 2)
    message = f"`{name}` always calls itself{through}, so that it never succeeds"
    hint = "put the call into `try { .. }` or behind an `if`, or write `alap { .. }` instead"
    return Diagnostic("endless-unit", message, call.name_span or call.span, hint, Severity.WARNING)
