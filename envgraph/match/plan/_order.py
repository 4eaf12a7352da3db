"""Orders the goals of a conjunction: cheap filters first, then the loop that promises the least work.

Goals that no wanted value depends on become a question of existence, answered before the loops that do not need it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from math import inf, prod
from typing import Final

from envgraph.code import dataclass
from envgraph.match.plan._options import ACCESS, Option, Options, Unplannable, Views
from envgraph.match.plan._plan import Kind, Plan, Step
from envgraph.pattern import CallAtom, ClosureAtom, Conjunction, Goal, InstanceAtom, variables

MOST_BRANCHES: Final = 4
"""Loops that are tried at one place; the cheapest complete plan wins."""
MOST_PLANS: Final = 48
"""Plans of one conjunction that are compared; beyond, the most promising loop is taken."""
MOST_EXPLORED: Final = 24
"""Goals of a conjunction beyond which only the most promising loop is tried."""
WIDEST: Final = 2
"""Variables in which partial matches have to differ before a loop: with more, hardly ever two are alike."""
_ENOUGH: Final = 1e100
"""Estimates stop here: a product of hundreds of fanouts would leave the floats."""


@dataclass(slots=True)
class Draft:
    """A plan in the making.

    Attributes:
        remaining: goals that are not met yet, by identity: literals that differ in type compare equal.
        uses: how often each variable stands in a remaining goal, and once more if it is wanted.
        options: the remaining goals as filters, as far as they have been looked at since something changed for them.
        loops: the same as loops.
    """

    remaining: dict[int, Goal]
    uses: Counter[int]
    bound: set[int]
    options: dict[int, Option | None] = field(default_factory=dict)
    loops: dict[int, list[Option]] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    rows: float = 1.0
    cost: float = 0.0

    def copy(self) -> Draft:
        """A draft that can go another way."""
        return replace(
            self,
            remaining=dict(self.remaining),
            uses=self.uses.copy(),
            bound=set(self.bound),
            options=dict(self.options),
            loops=dict(self.loops),
            steps=list(self.steps),
        )

    def add(self, option: Option, together: bool = False) -> None:
        """Execute an option next; `together` if its rows do not depend on those before."""
        cost, rows = self.rows * option.cost, self.rows * option.fanout
        if together and option.together is not None:
            cost, rows = min(cost, option.together[0]), min(rows, option.together[1])
        self.cost = min(self.cost + cost, _ENOUGH)
        self.rows = min(rows, _ENOUGH)
        self.bound.update(option.binds)
        self.steps.append(Step(option.kind, option.goal, option.binds, option.cost, self.rows, option.inner))


class Search:
    """The search for a plan of one conjunction.

    Args:
        views: plans what calls need.
        conjunction: the body.
        bound: variables that have a value.
        wanted: other variables whose values are told apart. Without any, the question is whether there is a
            solution at all.
        explore: whether several first loops are tried.
    """

    options: type[Options] = Options
    most_plans = MOST_PLANS
    most_explored = MOST_EXPLORED
    counts_abandoned = False
    """Whether a plan that was given up counts among those that may be compared."""

    def __init__(
        self,
        views: Views,
        conjunction: Conjunction,
        bound: frozenset[int],
        wanted: frozenset[int],
        explore: bool = True,
    ) -> None:
        self._views = views
        self._conjunction = conjunction
        self._bound = bound
        self._wanted = wanted
        self._explore = explore
        self._plans_left = 0
        self._options = self.options(views, conjunction, self._plan_inside)
        self._variables: dict[int, tuple[int, ...]] = {}
        self._mentions: dict[int, list[int]] = {}

    def plan(self, goals: Sequence[Goal]) -> Plan:
        """Order the goals.

        Raises:
            Unplannable: some variables cannot be enumerated.
        """
        self._plans_left = self.most_plans if self._explore and len(goals) <= self.most_explored else 0
        for goal in goals:
            self._variables[id(goal)] = variables(goal)
            for variable in self._variables[id(goal)]:
                self._mentions.setdefault(variable, []).append(id(goal))
        uses = Counter(v for goal in goals for v in self._variables[id(goal)])
        uses.update(self._wanted)
        draft = self._complete(Draft({id(goal): goal for goal in goals}, uses, set(self._bound)), inf)
        assert draft is not None, "no plan costs more than infinity"
        missing = self._wanted - draft.bound
        if missing:
            raise Unplannable(missing)
        return Plan(tuple(draft.steps), draft.rows, draft.cost)

    def _complete(self, draft: Draft, limit: float) -> Draft | None:
        """The cheapest way found to meet the remaining goals; None if none costs less than the limit."""
        self._filter(draft)
        while draft.remaining:
            if draft.cost >= limit:
                self._plans_left -= self.counts_abandoned
                return None
            if not self._detach(draft):
                loops = self._options.loops(draft.remaining.values(), draft.bound, draft.uses, draft.loops)
                if not loops:
                    unbound = {v for key in draft.remaining for v in self._variables[key]} - draft.bound
                    raise Unplannable(frozenset(unbound))
                if self._plans_left > 0 and len(loops) > 1:
                    return self._best(draft, loops[:MOST_BRANCHES], limit)
                self._enter(draft, loops[0])
            self._filter(draft)
        self._plans_left -= 1
        return draft if draft.cost < limit else None

    def _best(self, draft: Draft, loops: Sequence[Option], limit: float) -> Draft | None:
        """The cheapest of the ways to go on; the earliest of equals."""
        found: Draft | None = None
        failure: Unplannable | None = None
        for loop in loops:
            attempt = draft.copy()
            self._enter(attempt, loop)
            try:
                better = self._complete(attempt, limit)
            except Unplannable as reason:
                failure = failure or reason
                continue
            if better is not None:
                found, limit = better, better.cost
        if found is None and limit == inf and failure is not None:
            raise failure
        return found

    def _plan_inside(self, goals: Sequence[Goal], bound: frozenset[int], wanted: frozenset[int]) -> Plan:
        return type(self)(self._views, self._conjunction, bound, wanted).plan(goals)

    def _enter(self, draft: Draft, loop: Option) -> None:
        """Execute a loop, and drop the goals that it meets."""
        draft.rows = min(draft.rows, self._different(draft))
        draft.add(loop, together=loop.together is not None and self._alone(draft, loop))
        met: list[Goal] = [loop.goal]
        if isinstance(loop.goal, InstanceAtom):
            above = self._views.library.metamodel.supertypes(loop.goal.cls)
            met += [
                goal
                for goal in draft.remaining.values()
                if isinstance(goal, InstanceAtom)
                and goal.variable == loop.goal.variable
                and (goal == loop.goal or (goal.cls in above and not goal.exact))
            ]
        self._drop(draft, met, loop.binds)

    def _alone(self, draft: Draft, loop: Option) -> bool:
        """Return whether nothing that steps have found so far is used after a loop."""
        own = self._variables[id(loop.goal)]
        return all(draft.uses[v] == (v in own) for step in draft.steps for v in step.binds)

    def _different(self, draft: Draft) -> float:
        """Upper bound of the partial matches that differ in what is still used: others do not enter a loop."""
        steps = draft.steps
        loops = (n for n, step in enumerate(steps) if step.kind is Kind.LOOP)
        first = next((n for n in loops if not all(draft.uses[v] for v in steps[n].binds)), len(steps))
        key = [v for step in steps[first:] for v in step.binds if draft.uses[v]]
        if not 0 < len(key) <= WIDEST:
            return inf
        return prod(map(self._options.values, key), start=steps[first - 1].rows if first else 1.0)

    # --- filters

    def _filter(self, draft: Draft) -> None:
        """Execute everything that cannot multiply the rows."""
        while True:
            for key, goal in draft.remaining.items():
                if key not in draft.options:
                    draft.options[key] = self._options.filter(goal, draft.bound, draft.uses)
            ready = [option for option in draft.options.values() if option is not None]
            if not ready:
                return
            option = min(ready, key=lambda o: o.rank)
            draft.add(option)
            self._drop(draft, [option.goal], option.binds)

    def _drop(self, draft: Draft, goals: Iterable[Goal], binds: Sequence[int] = ()) -> None:
        """Goals are met, and variables have got values: what was said about goals with these variables is void."""
        touched = set(binds)
        for goal in goals:
            if draft.remaining.pop(id(goal), None) is not None:
                draft.options.pop(id(goal), None)
                draft.loops.pop(id(goal), None)
                for variable in self._variables[id(goal)]:
                    draft.uses[variable] -= 1
                    touched.add(variable)
        for variable in touched:
            for key in self._mentions.get(variable, ()):
                draft.options.pop(key, None)
                draft.loops.pop(key, None)

    # --- existence

    def _detach(self, draft: Draft) -> bool:
        """Turn goals that no wanted variable depends on into questions of existence."""
        groups = self._groups(draft)
        if self._wanted:
            missing = self._wanted - draft.bound
            groups = [group for group in groups if missing.isdisjoint(self._names(group))]
        else:
            groups.pop()  # the last one is what is left to solve
        for group in groups:
            known = frozenset(self._names(group) & draft.bound)
            plan = type(self)(self._views, self._conjunction, known, frozenset(), explore=False).plan(group)
            draft.add(Option(Kind.EXISTS, group[0], (), plan.cost / 2 + ACCESS, min(0.5, plan.rows), (plan,)))
            self._drop(draft, group)
        return bool(groups)

    def _names(self, goals: Iterable[Goal]) -> set[int]:
        return {v for goal in goals for v in self._variables[id(goal)]}

    def _groups(self, draft: Draft) -> list[list[Goal]]:
        """The remaining goals, apart where no variable without a value links them; the largest group last."""
        leader: dict[int, int] = {}

        def find(variable: int) -> int:
            while leader.setdefault(variable, variable) != variable:
                variable = leader[variable]
            return variable

        free = {key: [v for v in self._variables[key] if v not in draft.bound] for key in draft.remaining}
        for first, *others in free.values():
            for other in others:
                leader[find(other)] = find(first)
        groups: dict[int, list[Goal]] = {}
        for key, goal in draft.remaining.items():
            groups.setdefault(find(free[key][0]), []).append(goal)
        return sorted(groups.values(), key=lambda group: sum(map(_weight, group)))


def _weight(goal: Goal) -> float:
    """A rough measure of work, to look at small groups first."""
    match goal:
        case ClosureAtom():
            return 100.0
        case CallAtom():
            return 10.0
        case _:
            return 1.0
