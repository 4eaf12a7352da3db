"""Restrict recursive patterns to the rows that a caller needs: the rows with given values at some positions.

Magic sets, for patterns whose recursive calls need values that are known beforehand: J. F. Naughton, R. Ramakrishnan,
Y. Sagiv, J. D. Ullman, "Efficient evaluation of right-, left-, and multi-linear rules", SIGMOD 1989.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from envgraph.pattern import CallAtom, Conjunction, all_variables

Definitions = Mapping[str, Sequence[Conjunction]]
"""The bodies of the patterns of a recursive component, by name."""

RestrictedDefinitions = tuple[Definitions, Definitions]
"""The definitions of the patterns of a recursive component, and those of views that read them."""


def calls(body: Conjunction, names: Collection[str]) -> list[CallAtom]:
    """Return the calls in a body of patterns whose names are in `names`."""
    return [goal for goal in body.goals if isinstance(goal, CallAtom) and goal.pattern in names]


def restrict_unchanged(definitions: Definitions, positions: Sequence[int], place: str) -> RestrictedDefinitions | None:
    """Return definitions of patterns `place/p` with only the rows of `p` whose values at the positions are in a view.

    The view `place/asked` contains the values that the caller allows. Return None unless every recursive call passes on
    its caller's values at the positions unchanged.
    """
    found: dict[str, list[Conjunction]] = {f"{place}/{name}": [] for name in definitions}
    for name, bodies in definitions.items():
        for body in bodies:
            own, asked = calls(body, definitions), _values_at(body.parameters, positions)
            if len(asked) < len(positions) or any(_values_at(call.arguments, positions) != asked for call in own):
                return None
            inside = [CallAtom(f"{place}/{call.pattern}", call.arguments) for call in own]
            outside = [goal for goal in body.goals if goal not in own]
            first = inside or [CallAtom(f"{place}/asked", asked)]
            found[f"{place}/{name}"].append(replace(body, goals=(*first, *outside)))
    return (found, {}) if any(calls(body, found) for bodies in found.values() for body in bodies) else ({}, found)


def restrict_changed(definitions: Definitions, position: int, place: str) -> RestrictedDefinitions | None:
    """Return definitions as `restrict_unchanged` does, but for recursive calls that change the value at the one
    position.

    The view `place/led` pairs each allowed value with itself and with the values that recursive calls reach from it.
    Return None unless there is one pattern, each recursive call changes only the value at the position, and no other
    goal mentions the other parameters. Then a row of any reached call is a row of the first caller.
    """
    (pattern, bodies), *others = definitions.items()
    if others:
        return None
    type_ = bodies[0].types[bodies[0].parameters[position]]
    led = [Conjunction((type_,), (), (0, 0), (CallAtom(f"{place}/asked", (0,)),))]
    rows: list[Conjunction] = []
    for body in bodies:
        own, start, near = calls(body, definitions), len(body.types), body.parameters[position]
        goals = tuple(goal for goal in body.goals if goal not in own)
        heads, found = _with_value_at(body.parameters, position, start), rows
        if own:
            given, far = (
                {*_with_value_at(body.parameters, position)},
                own[0].arguments[position : position + 1],
            )
            used = {near, *far, *(v for goal in goals for v in all_variables(goal)), *dict(body.constants)}
            alike = own == [CallAtom(pattern, _with_value_at(body.parameters, position, *far))]
            if not alike or used & given or len(given) + 1 < len(body.parameters):
                return None
            heads, found = (start, *far), led
        goals = (CallAtom(f"{place}/led", (start, near)), *goals)
        found.append(replace(body, types=(*body.types, type_), parameters=heads, goals=goals))
    return {f"{place}/led": led}, {f"{place}/{pattern}": rows}


def transitive_body(definitions: Definitions) -> tuple[Conjunction, CallAtom, CallAtom] | None:
    """Return the only recursive body and its two calls, if its goals are exactly `p(a, m), p(m, b)`; else None."""
    (_, bodies), *others = definitions.items()
    own = [body for body in bodies if calls(body, definitions)]
    found = [] if others or len(own) != 1 else calls(own[0], definitions)
    for first, last in (found, found[::-1]) if len(found) == 2 == len(own[0].goals) else ():
        match first.arguments, last.arguments:
            case (a, m), (k, b) if m == k and (a, b) == own[0].parameters and len({a, b, m}) == 3:
                return own[0], first, last
    return None


def _values_at(values: tuple[int, ...], positions: Iterable[int]) -> tuple[int, ...]:
    """Return the values at some positions; positions beyond the end are skipped."""
    return tuple(value for p in positions for value in values[p : p + 1])


def _with_value_at(values: tuple[int, ...], position: int, *new: int) -> tuple[int, ...]:
    """Return the tuple of values with the value at a position replaced by new values."""
    return (*values[:position], *new, *values[position + 1 :])
