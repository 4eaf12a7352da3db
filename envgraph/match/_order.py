"""Orders the goals of a conjunction: cheap filters first, then the loop that promises the least work.

Goals that no wanted value depends on become a question of existence, answered before the loops that do not need it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from typing import Final, Protocol

from envgraph.match._calls import CallGraph
from envgraph.match._estimate import Sizes
from envgraph.match._plan import (
    Absence,
    Condition,
    Conjunction,
    Goal,
    Kind,
    Plan,
    Step,
    Valuation,
    ViewKey,
    ViewPlan,
    arguments,
    inputs,
    variables,
)
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    InstanceAtom,
    Library,
    LinkAtom,
    ObjectType,
    UnequalAtom,
)

ACCESS: Final = 1.0
"""The unit of cost: one look at the store."""
EXPRESSION: Final = 2.0
"""Work of an expression."""
CALL: Final = 4.0
"""Work of calling a function, on top of what it does."""
REACHED: Final = 30.0
"""Objects that a closure reaches."""
RECURSIVE_ROWS: Final = 10.0
"""Matches of a recursive pattern; fixed, for an estimate must not depend on which of a cycle is asked first."""
RECURSIVE_COST: Final = 500.0
"""Work of finding them."""
MOST_BRANCHES: Final = 4
"""Loops that are tried at one place; the cheapest complete plan wins."""
MOST_PLANS: Final = 48
"""Plans of one conjunction that are compared; beyond, the most promising loop is taken."""
MOST_EXPLORED: Final = 24
"""Goals of a conjunction beyond which only the most promising loop is tried."""


class Unplannable(Exception):
    """Nothing can give these variables a value; the pattern has to be asked with values for them."""

    def __init__(self, numbers: frozenset[int]) -> None:
        self.numbers = numbers
        super().__init__(f"variables {sorted(numbers)} cannot be enumerated")


class Views(Protocol):
    """What a search asks about the patterns that its goals call."""

    library: Library
    calls: CallGraph
    sizes: Sizes

    def view(self, key: ViewKey) -> ViewPlan:
        """The plan of a view; raises `Unplannable`."""


@dataclass(frozen=True, slots=True)
class Option:
    """A goal that could come next: work of one execution, and rows for each row before, both estimated."""

    kind: Kind
    goal: Goal
    binds: tuple[int, ...]
    cost: float
    fanout: float
    inner: tuple[Plan, ...] = ()

    @property
    def rank(self) -> float:
        """Independent filters do the least work in ascending order of this (Hellerstein 1993, section 2)."""
        return (self.fanout - 1.0) / self.cost

    @property
    def effort(self) -> float:
        """Orders loops: by rows, and by work where that is out of proportion."""
        return self.fanout + self.cost / 4


@dataclass(slots=True)
class Draft:
    """A plan in the making."""

    remaining: list[Goal]
    bound: set[int]
    steps: list[Step] = field(default_factory=list)
    rows: float = 1.0
    cost: float = 0.0

    def copy(self) -> Draft:
        """A draft that can go another way."""
        return replace(self, remaining=list(self.remaining), bound=set(self.bound), steps=list(self.steps))

    def add(self, option: Option) -> None:
        """Execute an option next."""
        self.cost += self.rows * option.cost
        self.rows *= option.fanout
        self.bound.update(option.binds)
        self.steps.append(Step(option.kind, option.goal, option.binds, option.cost, self.rows, option.inner))

    def drop(self, goals: Sequence[Goal]) -> None:
        """Goals that have been met; told apart by identity, for literals that differ in type compare equal."""
        gone = set(map(id, goals))
        self.remaining = [goal for goal in self.remaining if id(goal) not in gone]


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

    def __init__(
        self,
        views: Views,
        conjunction: Conjunction,
        bound: frozenset[int],
        wanted: frozenset[int],
        explore: bool = True,
    ) -> None:
        self._views = views
        self._sizes = views.sizes
        self._conjunction = conjunction
        self._bound = bound
        self._wanted = wanted
        self._explore = explore
        self._plans_left = 0
        self._inner: dict[int, tuple[Plan, ...]] = {}

    def plan(self, goals: Sequence[Goal]) -> Plan:
        """Order the goals.

        Raises:
            Unplannable: some variables cannot be enumerated.
        """
        self._plans_left = MOST_PLANS if self._explore and len(goals) <= MOST_EXPLORED else 0
        draft = self._complete(Draft(list(goals), set(self._bound)), inf)
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
                return None
            if not self._detach(draft):
                loops = self._loops(draft)
                if not loops:
                    unbound = {v for goal in draft.remaining for v in variables(goal)} - draft.bound
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

    def _enter(self, draft: Draft, loop: Option) -> None:
        """Execute a loop, and drop the goals that it meets."""
        draft.add(loop)
        met: list[Goal] = [loop.goal]
        if isinstance(loop.goal, InstanceAtom):
            above = self._views.library.metamodel.supertypes(loop.goal.cls)
            met += [
                goal
                for goal in draft.remaining
                if isinstance(goal, InstanceAtom)
                and goal.variable == loop.goal.variable
                and (goal == loop.goal or (goal.cls in above and not goal.exact))
            ]
        draft.drop(met)

    # --- filters

    def _filter(self, draft: Draft) -> None:
        """Execute everything that cannot multiply the rows."""
        while True:
            uses = self._uses(draft)
            options = [o for o in (self._option(goal, draft, uses) for goal in draft.remaining) if o]
            if not options:
                return
            for option in sorted(options, key=lambda o: o.rank):
                draft.add(option)
                draft.drop([option.goal])
                if option.binds:
                    break  # what has a value now may make a cheaper filter possible

    def _uses(self, draft: Draft) -> Counter[int]:
        uses = Counter(v for goal in draft.remaining for v in variables(goal))
        uses.update(self._wanted)
        return uses

    def _option(self, goal: Goal, draft: Draft, uses: Counter[int]) -> Option | None:
        """The goal as a filter, if it can be one now."""
        bound = draft.bound
        match goal:
            case InstanceAtom():
                return self._instance(goal, bound, uses)
            case AttributeAtom(_, owner, value):
                if owner not in bound:
                    return None
                if value in bound:
                    return Option(Kind.TEST, goal, (), ACCESS, 0.2)
                return Option(Kind.BIND, goal, (value,), ACCESS, 0.99)
            case LinkAtom():
                return self._link(goal, bound, uses)
            case CallAtom():
                free = _free(goal, bound)
                return None if self._needed(goal, free, uses) else self._test_of_call(goal, bound)
            case ClosureAtom():
                return self._test_of_closure(goal, bound)
            case _:
                return self._derived(goal, bound) if bound.issuperset(inputs(goal)) else None

    def _derived(self, goal: Goal, bound: set[int]) -> Option:
        match goal:
            case UnequalAtom():
                return Option(Kind.TEST, goal, (), ACCESS, 0.9)
            case Condition():
                return Option(Kind.TEST, goal, (), EXPRESSION, 0.5)
            case Valuation(_, _, result):
                return self._value(goal, result, bound, EXPRESSION)
            case AggregateAtom():
                inner = self._plans_inside(goal)
                return self._value(goal, goal.result, bound, CALL + inner[0].cost, inner)
            case Absence():
                inner = self._plans_inside(goal)
                return Option(
                    Kind.ABSENT, goal, (), ACCESS + sum(plan.cost for plan in inner) / 2, 0.5, inner
                )
        raise AssertionError(goal)

    def _value(
        self, goal: Goal, result: int, bound: set[int], cost: float, inner: tuple[Plan, ...] = ()
    ) -> Option:
        if result in bound:
            return Option(Kind.TEST, goal, (), cost, 0.2, inner)
        return Option(Kind.BIND, goal, (result,), cost, 0.99, inner)

    def _plans_inside(self, goal: Absence | AggregateAtom) -> tuple[Plan, ...]:
        """Plans of a negation's alternatives, or of an aggregate's relation; their inputs have values."""
        if id(goal) not in self._inner:
            known = frozenset(number for number, _ in self._conjunction.constants).union(inputs(goal))
            alternatives: Sequence[tuple[Goal, ...]]
            if isinstance(goal, Absence):
                alternatives, wanted = goal.alternatives, frozenset[int]()
            else:
                alternatives, wanted = [(goal.relation,)], frozenset(arguments(goal.relation)) - known
            self._inner[id(goal)] = tuple(
                Search(self._views, self._conjunction, known, wanted).plan(goals) for goals in alternatives
            )
        return self._inner[id(goal)]

    def _instance(self, goal: InstanceAtom, bound: set[int], uses: Counter[int]) -> Option | None:
        if goal.variable in bound or uses[goal.variable] == 1:
            return Option(Kind.TEST, goal, (), ACCESS, 0.3)
        return None

    def _link(self, goal: LinkAtom, bound: set[int], uses: Counter[int]) -> Option | None:
        reference, source, target = goal.reference, goal.source, goal.target
        if source in bound and target in bound:
            return Option(Kind.TEST, goal, (), ACCESS, self._sizes.link(reference))
        if source in bound:
            single, end, size = not reference.many, target, self._sizes.forward(reference)
        elif target in bound:
            single, end, size = self._sizes.single_source(reference), source, self._sizes.backward(reference)
        else:
            return None
        if uses[end] == 1:
            return Option(Kind.TEST, goal, (), ACCESS, min(0.9, size))
        return Option(Kind.BIND, goal, (end,), ACCESS, min(0.99, size)) if single else None

    def _test_of_call(self, goal: CallAtom, bound: set[int]) -> Option | None:
        try:
            _, cost = self._estimate(goal, bound, ())
        except Unplannable:
            return None
        return Option(Kind.TEST, goal, (), cost / 2, 0.5)

    def _test_of_closure(self, goal: ClosureAtom, bound: set[int]) -> Option | None:
        if not (goal.source in bound and goal.target in bound):
            return None
        try:
            return Option(Kind.TEST, goal, (), self._closure_cost(goal, bound) / 2, 0.5)
        except Unplannable:
            return None

    def _closure_cost(self, goal: ClosureAtom, bound: set[int]) -> float:
        """Work of following the steps from a bound end, or from every source."""
        if self._views.calls.recursive(goal.step):
            return REACHED * RECURSIVE_COST
        from_source, from_target = goal.source in bound, goal.target in bound
        keys = [ViewKey(goal.step, (0,), (1,))] if from_source or not from_target else []
        if from_target:
            keys.append(ViewKey(goal.step, (1,), (0,)))
        cost = min(self._views.view(key).cost for key in keys)
        return (1.0 if from_source or from_target else REACHED) * REACHED * (cost + CALL)

    def _needed(self, goal: CallAtom, free: Sequence[int], uses: Counter[int]) -> tuple[int, ...]:
        """The free variables of a call whose values matter; all of them if the pattern is recursive."""
        if self._views.calls.recursive(goal.pattern) and any(uses[v] > 1 for v in free):
            return tuple(free)
        return tuple(v for v in free if uses[v] > 1)

    def _estimate(self, goal: CallAtom, bound: set[int], needed: Sequence[int]) -> tuple[float, float]:
        """Rows and work of a call."""
        if self._views.calls.recursive(goal.pattern):
            return RECURSIVE_ROWS ** len(needed), RECURSIVE_COST
        view = self._views.view(call_key(goal, bound, needed))
        return view.rows, view.cost + CALL

    # --- existence

    def _detach(self, draft: Draft) -> bool:
        """Turn goals that no wanted variable depends on into questions of existence."""
        groups = self._groups(draft)
        if self._wanted:
            groups = [
                group for group in groups if not any(v in self._wanted for g in group for v in variables(g))
            ]
        else:
            groups.pop()  # the last one is what is left to solve
        for group in groups:
            names = {v for goal in group for v in variables(goal)}
            search = Search(
                self._views, self._conjunction, frozenset(draft.bound & names), frozenset(), False
            )
            plan = search.plan(group)
            draft.add(Option(Kind.EXISTS, group[0], (), plan.cost / 2 + ACCESS, min(0.5, plan.rows), (plan,)))
            draft.drop(group)
        return bool(groups)

    def _groups(self, draft: Draft) -> list[list[Goal]]:
        """The remaining goals, apart where no variable without a value links them; the largest group last."""
        leader: dict[int, int] = {}

        def find(variable: int) -> int:
            while leader.setdefault(variable, variable) != variable:
                variable = leader[variable]
            return variable

        for goal in draft.remaining:
            first, *others = (v for v in variables(goal) if v not in draft.bound)
            for other in others:
                leader[find(other)] = find(first)
        groups: dict[int, list[Goal]] = {}
        for goal in draft.remaining:
            variable = next(v for v in variables(goal) if v not in draft.bound)
            groups.setdefault(find(variable), []).append(goal)
        return sorted(groups.values(), key=lambda group: sum(_weight(goal) for goal in group))

    # --- loops

    def _loops(self, draft: Draft) -> list[Option]:
        """What can be looped over now, the least effort first."""
        uses = self._uses(draft)
        options = [*self._relations(draft, uses), *self._extents(draft, uses)]
        return sorted(options, key=lambda option: option.effort)

    def _relations(self, draft: Draft, uses: Counter[int]) -> Iterator[Option]:
        for goal in draft.remaining:
            match goal:
                case LinkAtom(reference, source, target) if source in draft.bound:
                    size = self._sizes.forward(reference)
                    yield Option(Kind.LOOP, goal, (target,), size, size)
                case LinkAtom(reference, source, target) if target in draft.bound:
                    size = self._sizes.backward(reference)
                    yield Option(Kind.LOOP, goal, (source,), size, size)
                case CallAtom():
                    needed = self._needed(goal, _free(goal, draft.bound), uses)
                    try:
                        rows, cost = self._estimate(goal, draft.bound, needed)
                    except Unplannable:
                        continue
                    yield Option(Kind.LOOP, goal, needed, cost, rows)
                case ClosureAtom(_, _, source, target):
                    try:
                        cost = self._closure_cost(goal, draft.bound)
                    except Unplannable:
                        continue
                    free = tuple(dict.fromkeys(v for v in (source, target) if v not in draft.bound))
                    yield Option(Kind.LOOP, goal, free, cost, REACHED ** len(free))
                case _:
                    pass

    def _extents(self, draft: Draft, uses: Counter[int]) -> Iterator[Option]:
        """For every object variable without a value the smallest class that all its values have."""
        classes: dict[int, list[InstanceAtom]] = {}
        for goal in draft.remaining:
            for variable in variables(goal):
                type_ = self._conjunction.types[variable]
                if variable not in draft.bound and isinstance(type_, ObjectType):
                    classes.setdefault(variable, [InstanceAtom(type_.cls, variable)])
            if isinstance(goal, InstanceAtom):
                classes[goal.variable].append(goal)
        for variable, atoms in classes.items():
            atom = min(atoms, key=lambda a: (self._extent(a), not a.exact))
            # An object that nothing else asks for is better found through what asks for it.
            weight = 1.0 if uses[variable] > 1 else 1.5
            yield Option(Kind.LOOP, atom, (variable,), self._extent(atom) * weight, self._extent(atom))

    def _extent(self, atom: InstanceAtom) -> float:
        return self._sizes.exact_extent(atom.cls) if atom.exact else self._sizes.extent(atom.cls)


def _free(goal: CallAtom, bound: set[int]) -> tuple[int, ...]:
    """The variables of a call without a value, each once."""
    return tuple(dict.fromkeys(v for v in goal.arguments if v not in bound))


def call_key(goal: CallAtom, bound: set[int] | frozenset[int], needed: Sequence[int]) -> ViewKey:
    """The view that a call asks for: values come in at the bound positions, out at those of needed variables."""
    given = tuple(position for position, v in enumerate(goal.arguments) if v in bound)
    wanted = tuple(position for position, v in enumerate(goal.arguments) if v in needed)
    return ViewKey(goal.pattern, given, wanted)


def _weight(goal: Goal) -> float:
    """A rough measure of work, to look at small groups first."""
    match goal:
        case ClosureAtom():
            return 100.0
        case CallAtom():
            return 10.0
        case _:
            return 1.0
