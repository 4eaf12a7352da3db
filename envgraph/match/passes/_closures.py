"""`find p+(a, _)` asks no more than `find p(a, _)`, wherever the other end stands nowhere else."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from envgraph.match.passes._bodies import Bodies
from envgraph.pattern import CallAtom, Closure, ClosureAtom, Conjunction, Goal, mentioned


def closures_as_calls(body: Conjunction, bodies: Bodies) -> Conjunction:
    """A closure of one or more steps with an end that nothing else asks about becomes a call of its step."""
    uses = Counter(variable for goal in body.goals for variable in mentioned(goal))
    fixed = {*body.parameters, *(number for number, _ in body.constants)}

    def simple(goal: Goal) -> Goal:
        if isinstance(goal, ClosureAtom) and goal.closure is Closure.PLUS:
            ends = (goal.source, goal.target)
            if any(uses[end] == 1 and end not in fixed for end in ends):
                return CallAtom(goal.step, ends)
        return goal

    return replace(body, goals=tuple(map(simple, body.goals)))
