"""The control structures of units as functions of functions; `_units` says what they mean."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph.rewrite._run import Action, Environment, Run, draw_weighted
from envgraph.rewrite._runner import draw


def sequence(actions: Sequence[Action]) -> Action:
    """`a; b;`"""
    if len(actions) == 1:
        return actions[0]

    def run_steps(run: Run, environment: Environment) -> bool | None:
        changed = False
        for action in actions:
            outcome = action(run, environment)
            if outcome is None:
                return None
            changed |= outcome
        return changed

    return run_steps


def every(actions: Sequence[Action]) -> Action:
    """Run all steps, whatever they do; fails if all fail."""

    def run_all(run: Run, environment: Environment) -> bool | None:
        outcomes = [action(run, environment) for action in actions]
        return True if any(outcomes) else None

    return run_all


def choice(actions: Sequence[Action], preferences: Sequence[tuple[int, float]]) -> Action:
    """`a | b`; a preference is a priority and a weight."""

    def run_one(run: Run, environment: Environment) -> bool | None:
        left = list(range(len(actions)))
        while left:
            highest = max(preferences[number][0] for number in left)
            best = [number for number in left if preferences[number][0] == highest]
            chosen = best[draw_weighted(run.rng, [preferences[number][1] for number in best])]
            outcome = actions[chosen](run, dict(environment))
            if outcome is not None:
                return outcome
            left.remove(chosen)
        return None

    return run_one


def alap(action: Action) -> Action:
    """`alap { .. }`"""

    def run_rounds(run: Run, environment: Environment) -> bool | None:
        changed = False
        while True:
            run.count()
            outcome = action(run, dict(environment))
            if not outcome:
                run.refusal = None
                return changed
            changed = True

    return run_rounds


def repeat(lower: int, upper: int, action: Action) -> Action:
    """`repeat lower..upper { .. }`"""

    def run_rounds(run: Run, environment: Environment) -> bool | None:
        changed = False
        for done in range(lower + draw(run.rng, upper - lower + 1)):
            run.count()
            outcome = action(run, dict(environment))
            if outcome is None:
                return None if done < lower else changed
            changed |= outcome
        return changed

    return run_rounds


def attempt(action: Action, otherwise: Action | None) -> Action:
    """`try { .. } else { .. }`"""

    def run_body(run: Run, environment: Environment) -> bool | None:
        outcome = action(run, dict(environment))
        if outcome is not None:
            return outcome
        run.refusal = None
        return False if otherwise is None else otherwise(run, dict(environment))

    return run_body


def branch(test: Callable[[Environment], bool], then: Action, otherwise: Action | None) -> Action:
    """`if .. { .. } else { .. }`"""

    def run_branch(run: Run, environment: Environment) -> bool | None:
        if test(environment):
            return then(run, dict(environment))
        return False if otherwise is None else otherwise(run, dict(environment))

    return run_branch
