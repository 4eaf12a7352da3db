"""A check for units that can never succeed, because every way through them calls them again."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

from envgraph.errors import Diagnostic, Severity
from envgraph.metamodel import shortest_path
from envgraph.pattern import (
    Alap,
    AtomicStep,
    IfStep,
    Repeat,
    Step,
    StepSequence as Steps,
    TryStep,
    UnitCall,
    UnitChoice,
)
from envgraph.rewrite.check._unit_check import CheckedUnit, inner_steps


def check_endless(units: Sequence[CheckedUnit]) -> Iterator[Diagnostic]:
    """Warn once for each cycle of calls from which no unit can return except by failing. The units must have no errors.

    A unit may succeed if some way through it calls only rules, and units that may succeed. This is repeated until no
    more such units are found; the remaining units never succeed.
    """
    left = {checked.unit.qualified_name: checked for checked in units}
    callers: dict[str, list[str]] = {name: [] for name in left}
    for name, one in left.items():
        for callee, _ in _calls_to(one.unit.body, one, left):
            callers[callee].append(name)
    waiting = list(left)
    for name in waiting:
        if name in left and _may_succeed(left[name].unit.body, left[name], left):
            del left[name]
            waiting += callers[name]
    calls = {name: list(_calls_to(one.unit.body, one, left)) for name, one in left.items()}
    reported: set[str] = set()
    for name in left:
        way = None if name in reported else shortest_path(name, name, lambda one: [c for c, _ in calls[one]])
        if way and reported.isdisjoint(way):
            reported.update(way)
            yield _endless_warning(name, way, calls)


def _may_succeed(step: Step, checked: CheckedUnit, endless_units: Collection[str]) -> bool:
    """Return True if a step may succeed without calling a unit of `endless_units`."""
    match step:
        case UnitCall():
            callee = checked.calls.get(id(step))
            return callee is None or callee.name not in endless_units
        case Steps(steps):
            return all(_may_succeed(inner, checked, endless_units) for inner in steps)
        case UnitChoice(alternatives):
            return any(_may_succeed(inner, checked, endless_units) for inner in alternatives)
        case Alap():
            return True
        case Repeat(lower, _, body):
            return lower == 0 or not isinstance(lower, int) or _may_succeed(body, checked, endless_units)
        case TryStep(body, otherwise) | IfStep(_, body, otherwise):
            return otherwise is None or any(_may_succeed(one, checked, endless_units) for one in (body, otherwise))
        case AtomicStep(body):
            return _may_succeed(body, checked, endless_units)


def _calls_to(step: Step, checked: CheckedUnit, units: Collection[str]) -> Iterator[tuple[str, UnitCall]]:
    """Yield name and call of the units of `units` that a step calls, in the order of the text."""
    if isinstance(step, UnitCall):
        callee = checked.calls.get(id(step))
        if callee is not None and callee.name in units:
            yield callee.name, step
    for inner in inner_steps(step):
        yield from _calls_to(inner, checked, units)


def _endless_warning(name: str, way: Sequence[str], calls: Mapping[str, Sequence[tuple[str, UnitCall]]]) -> Diagnostic:
    call = next(call for callee, call in calls[name] if callee == way[0])
    through = f" through `{way[0]}`" * (len(way) > 1) + " and others" * (len(way) > 2)
    message = f"`{name}` always calls itself{through}, so that it never succeeds"
    hint = "put the call into `try { .. }` or behind an `if`, or write `alap { .. }` instead"
    return Diagnostic("endless-unit", message, call.name_span or call.span, hint, Severity.WARNING)
