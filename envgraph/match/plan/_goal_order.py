"""Order the goals of a conjunction: filters first, then the loop with the lowest estimated work.

Goals on which no wanted value depends become existence tests, executed before the loops that do not use them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from math import inf, prod

from envgraph.code import dataclass
from envgraph.match._match_costs import PLAN
from envgraph.match.plan._search_plan import PlanStep, SearchPlan, StepKind
from envgraph.match.plan._step_candidates import PatternPlans, StepCandidate, StepCandidates, Unplannable
from envgraph.pattern import CallAtom, ClosureAtom, Conjunction, Goal, InstanceAtom, visible_variables


@dataclass(slots=True)
class PlanDraft:
    """A partial plan under construction.

    Attributes:
        remaining: the goals without a step, by identity, since literals of different types compare equal.
        uses: how often each variable occurs in a remaining goal, plus one if the variable is wanted.
        bound: the variables with values after the steps.
        options: cached filter candidates by goal; an entry is removed when one of the goal's variables changes.
        loops: cached loop candidates by goal, removed in the same cases.
    """

    remaining: dict[int, Goal]
    uses: Counter[int]
    bound: set[int]
    options: dict[int, StepCandidate | None] = field(default_factory=dict)
    loops: dict[int, list[StepCandidate]] = field(default_factory=dict)
    steps: list[PlanStep] = field(default_factory=list)
    rows: float = 1.0
    cost: float = 0.0

    def copy(self) -> PlanDraft:
        """Return a copy that can be changed without changing this draft."""
        return replace(
            self,
            remaining=dict(self.remaining),
            uses=self.uses.copy(),
            bound=set(self.bound),
            options=dict(self.options),
            loops=dict(self.loops),
            steps=list(self.steps),
        )

    def append_step(self, option: StepCandidate, is_independent: bool = False) -> None:
        """Append a candidate as a step. `is_independent` is True if its rows do not depend on variables of earlier
        steps.
        """
        cost, rows = self.rows * option.cost, self.rows * option.fanout
        if is_independent and option.total_estimate is not None:
            cost, rows = min(cost, option.total_estimate[0]), min(rows, option.total_estimate[1])
        self.cost = min(self.cost + cost, PLAN.most)
        self.rows = min(rows, PLAN.most)
        self.bound.update(option.binds)
        self.steps.append(PlanStep(option.kind, option.goal, option.binds, option.cost, self.rows, option.inner))


class GoalOrderSearch:
    """The search for a plan of one conjunction.

    Args:
        views: plans of called patterns.
        conjunction: the body.
        bound: the variables with values.
        wanted: the variables whose values distinguish results. If empty, the plan only decides if a solution exists.
        explore: if True, plans with different loops are compared; else the best ranked loop is always taken.
    """

    options: type[StepCandidates] = StepCandidates
    most_plans = PLAN.most_plans
    most_explored = PLAN.most_explored
    counts_abandoned = False
    """True if abandoned plans also count towards `most_plans`."""

    def __init__(
        self,
        views: PatternPlans,
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

    def plan(self, goals: Sequence[Goal]) -> SearchPlan:
        """Return the best plan found for the goals.

        Raises:
            Unplannable: some variables cannot be enumerated.
        """
        self._plans_left = self.most_plans if self._explore and len(goals) <= self.most_explored else 0
        for goal in goals:
            self._variables[id(goal)] = visible_variables(goal)
            for variable in self._variables[id(goal)]:
                self._mentions.setdefault(variable, []).append(id(goal))
        uses = Counter(v for goal in goals for v in self._variables[id(goal)])
        uses.update(self._wanted)
        draft = self._complete(PlanDraft({id(goal): goal for goal in goals}, uses, set(self._bound)), inf)
        assert draft is not None, "no plan costs more than infinity"
        missing = self._wanted - draft.bound
        if missing:
            raise Unplannable(missing)
        return SearchPlan(tuple(draft.steps), draft.rows, draft.cost)

    def _complete(self, draft: PlanDraft, limit: float) -> PlanDraft | None:
        """Return the cheapest completion found of a draft, which is modified; None if each costs `limit` or more."""
        self._filter(draft)
        while draft.remaining:
            if draft.cost >= limit:
                self._plans_left -= self.counts_abandoned
                return None
            if not self._append_existence_tests(draft):
                loops = self._options.loop_candidates(draft.remaining.values(), draft.bound, draft.uses, draft.loops)
                if not loops:
                    unbound = {v for key in draft.remaining for v in self._variables[key]} - draft.bound
                    raise Unplannable(frozenset(unbound))
                if self._plans_left > 0 and len(loops) > 1:
                    return self._best(draft, loops[: PLAN.most_branches], limit)
                self._append_loop(draft, loops[0])
            self._filter(draft)
        self._plans_left -= 1
        return draft if draft.cost < limit else None

    def _best(self, draft: PlanDraft, loops: Sequence[StepCandidate], limit: float) -> PlanDraft | None:
        """Return the cheapest completion that starts with one of the loops; None if each costs `limit` or more."""
        found: PlanDraft | None = None
        failure: Unplannable | None = None
        for loop in loops:
            attempt = draft.copy()
            self._append_loop(attempt, loop)
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

    def _plan_inside(self, goals: Sequence[Goal], bound: frozenset[int], wanted: frozenset[int]) -> SearchPlan:
        """Return the plan of goals inside a negation or aggregate."""
        return type(self)(self._views, self._conjunction, bound, wanted).plan(goals)

    def _append_loop(self, draft: PlanDraft, loop: StepCandidate) -> None:
        """Append a loop; remove its goal and, for a loop over a class, the class tests that the loop satisfies."""
        draft.rows = min(draft.rows, self._distinct_rows_bound(draft))
        draft.append_step(loop, is_independent=loop.total_estimate is not None and self._is_independent(draft, loop))
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
        self._remove_goals(draft, met, loop.binds)

    def _is_independent(self, draft: PlanDraft, loop: StepCandidate) -> bool:
        """Return True if no remaining goal except the loop's own uses a variable that earlier steps have bound."""
        own = self._variables[id(loop.goal)]
        return all(draft.uses[v] == (v in own) for step in draft.steps for v in step.binds)

    def _distinct_rows_bound(self, draft: PlanDraft) -> float:
        """Return an upper bound on the partial matches that differ in variables still used; infinity if unknown."""
        steps = draft.steps
        loops = (n for n, step in enumerate(steps) if step.kind is StepKind.LOOP)
        first = next((n for n in loops if not all(draft.uses[v] for v in steps[n].binds)), len(steps))
        key = [v for step in steps[first:] for v in step.binds if draft.uses[v]]
        if not 0 < len(key) <= PLAN.widest:
            return inf
        return prod(map(self._options.value_count, key), start=steps[first - 1].rows if first else 1.0)

    # --- filters

    def _filter(self, draft: PlanDraft) -> None:
        """Append all possible filters, best rank first. A filter gives at most one row for each row before."""
        while True:
            for key, goal in draft.remaining.items():
                if key not in draft.options:
                    draft.options[key] = self._options.filter_candidate(goal, draft.bound, draft.uses)
            ready = [option for option in draft.options.values() if option is not None]
            if not ready:
                return
            option = min(ready, key=lambda o: o.rank)
            draft.append_step(option)
            self._remove_goals(draft, [option.goal], option.binds)

    def _remove_goals(self, draft: PlanDraft, goals: Iterable[Goal], binds: Sequence[int] = ()) -> None:
        """Remove satisfied goals, and cached candidates of goals that use their variables or those in `binds`."""
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

    def _append_existence_tests(self, draft: PlanDraft) -> bool:
        """Append existence tests for goals on which no wanted variable depends. Return False if there are none.

        If the plan wants no variables, the group of connected goals with the most work remains.
        """
        groups = self._groups(draft)
        if self._wanted:
            missing = self._wanted - draft.bound
            groups = [group for group in groups if missing.isdisjoint(self._variables_of(group))]
        else:
            groups.pop()  # the largest group remains to be solved
        for group in groups:
            known = frozenset(self._variables_of(group) & draft.bound)
            plan = type(self)(self._views, self._conjunction, known, frozenset(), explore=False).plan(group)
            draft.append_step(
                StepCandidate(StepKind.EXISTS, group[0], (), plan.cost / 2 + PLAN.access, min(0.5, plan.rows), (plan,))
            )
            self._remove_goals(draft, group)
        return bool(groups)

    def _variables_of(self, goals: Iterable[Goal]) -> set[int]:
        """Return the set of all variables that occur in the goals."""
        return {v for goal in goals for v in self._variables[id(goal)]}

    def _groups(self, draft: PlanDraft) -> list[list[Goal]]:
        """Return the remaining goals, grouped by shared variables without values, in ascending order of work."""
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
        return sorted(groups.values(), key=lambda group: sum(map(_estimated_work, group)))


def _estimated_work(goal: Goal) -> float:
    """Return a rough estimate of the work of a goal, for sorting groups of goals."""
    match goal:
        case ClosureAtom():
            return 100.0
        case CallAtom():
            return 10.0
        case _:
            return 1.0
