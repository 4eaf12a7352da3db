"""A pass that replaces a closure `find p+(a, b)` with the call `find p(a, b)` if no other goal uses one of its ends."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from envgraph.match.passes._rewritten_bodies import RewrittenBodies
from envgraph.pattern import CallAtom, Closure, ClosureAtom, Conjunction, Goal, all_variables


def closures_as_calls(body: Conjunction, bodies: RewrittenBodies) -> Conjunction:
    """Return the body with each closure `p+(a, b)` replaced by the call `p(a, b)` if one end is used nowhere else.

    One or more steps exist from `a` exactly if one step exists. The unused end must be no parameter and no constant.
    """
    uses = Counter(variable for goal in body.goals for variable in all_variables(goal))
    fixed = {*body.parameters, *(number for number, _ in body.constants)}

    def as_call(goal: Goal) -> Goal:
        """Return the call that may replace the goal; the goal itself if it is no `+` closure or both ends are used."""
        if isinstance(goal, ClosureAtom) and goal.closure is Closure.PLUS:
            ends = (goal.source, goal.target)
            if any(uses[end] == 1 and end not in fixed for end in ends):
                return CallAtom(goal.step, ends)
        return goal

    return replace(body, goals=tuple(map(as_call, body.goals)))
