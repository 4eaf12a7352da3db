"""Measures of one environment that are not about directed paths on a grid."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field
from math import inf
from typing import TYPE_CHECKING, ClassVar, Final

from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes
from envgraph.code import dataclass
from envgraph.files import counting
from envgraph.graph import Model
from envgraph.lang import ComponentSpec
from envgraph.match import Row
from envgraph.metamodel import Metamodel
from envgraph.rewrite import Engine
from envgraph.search.problem._object_facts import object_facts

if TYPE_CHECKING:
    from envgraph.env import TooManyStates
    from envgraph.env.compiled import Plan, Plans, Tables
    from envgraph.solve import Certificates

LIMIT: Final = 200
"""Steps of an episode where neither family nor environment have a limit."""


@dataclass(frozen=True, slots=True)
class MatchCount:
    """The number of matches of a pattern."""

    pattern: str
    whole: ClassVar = True

    def evaluate(self, engine: Engine) -> float:
        """The count in the model at which the engine stands."""
        return float(engine.count(self.pattern))


@dataclass(frozen=True, slots=True)
class PatternValue:
    """The number that a pattern binds a parameter to in its only match.

    Attributes:
        pattern: its name.
        place: of the parameter, from 0.
        whole: whether it is an `int`.
    """

    pattern: str
    place: int
    whole: bool

    def evaluate(self, engine: Engine) -> float:
        """The number in the model at which the engine stands; infinite where there is no match, or several.

        Raises:
            OverflowError: the number has more than 308 digits.
        """
        _, pattern, arguments = engine.queries.question(self.pattern)
        return self.read(engine.matcher.rows(pattern, arguments))

    def read(self, rows: Sequence[Row]) -> float:
        """The number in the matches of the pattern."""
        value = rows[0][self.place] if len(rows) == 1 else inf
        assert isinstance(value, int | float), "`check_family` demands a number"
        return value


@dataclass(frozen=True, slots=True)
class ShortestPath:
    """Number of links on the longest of all shortest paths from a start object to a goal object that it reaches.

    Over all pairs of objects this is the diameter of the graph (Wasserman and Faust 1994, section 4.3.4); with one
    start and one goal it is their distance. An object that is both is at distance 0.

    Attributes:
        along: names of references, or of binary patterns.
        start, goal: classes, or None for every object.
        avoid: class of objects that no path enters, or None.
    """

    metamodel: Metamodel
    along: tuple[str, ...]
    start: str | None = None
    goal: str | None = None
    avoid: str | None = None
    whole: ClassVar = True

    def evaluate(self, engine: Engine) -> float:
        """The length in the model at which the engine stands; infinite where no start reaches a goal."""
        model = engine.model
        every = [
            node
            for cls in self.metamodel.class_list
            if not cls.abstract
            for node in model.graph.exact_extent(cls.name)
        ]
        blocked = set(model.graph.extent(self.avoid)) if self.avoid else set()
        links: dict[int, list[int]] = {}
        for source, target in self._steps(engine):
            if target not in blocked and source not in blocked:
                links.setdefault(source, []).append(target)
        goals = set(model.graph.extent(self.goal) if self.goal else every) - blocked
        starts = [
            node for node in (model.graph.extent(self.start) if self.start else every) if node not in blocked
        ]
        found = (_farthest(links, node, goals) for node in starts)
        return max((float(steps) for steps in found if steps is not None), default=inf)

    def _steps(self, engine: Engine) -> Iterable[tuple[int, int]]:
        for name in self.along:
            references = [one for one in self.metamodel.references if name in {one.name, str(one)}]
            for reference in references:
                for source in engine.model.graph.extent(reference.owner):
                    for target in engine.model.graph.targets(source, reference):
                        yield source, target
            if not references:
                for match in engine.matches(name):
                    first, second = match.row
                    if isinstance(first, int) and isinstance(second, int):
                        yield first, second


def _farthest(links: dict[int, list[int]], start: int, goals: set[int]) -> int | None:
    """Distance of the goal that breadth-first search from a start meets last; None when it meets none."""
    distance = {start: 0}
    queue = [start]
    farthest = None
    for node in queue:
        if node in goals:
            farthest = distance[node]
        for target in links.get(node, ()):
            if target not in distance:
                distance[target] = distance[node] + 1
                queue.append(target)
    return farthest


@dataclass(slots=True)
class ShortestPlan:
    """Fewest steps after which an episode can end in success; of large environments, an upper bound on them.

    A stochastic outcome counts as possible. Infinite where no plan was found. What `Plans` of
    `envgraph.env.compiled` says is kept of the last state of the model: constraints ask about what is then measured.

    Attributes:
        guide: a pattern that a beam keeps the states with the fewest matches of; None: those of the behaviour.
        shortest: False if any plan will do, even a longer one: see `Plans`.
    """

    behaviour: Behaviour
    guide: str | None = None
    shortest: bool = True
    whole: ClassVar = True
    _plans: dict[int, Plans] = field(default_factory=dict, init=False, repr=False, compare=False)
    _last: tuple[int, dict[int, Plan]] = field(default=(0, {}), init=False, repr=False, compare=False)

    def evaluate(self, engine: Engine) -> float:
        """The number of steps from a start state of the model at which the engine stands.

        Raises:
            EvaluationError: the behaviour is not compiled, and has too many states to visit all of them.
        """
        from envgraph.env import explore
        from envgraph.env.compiled import NotCompiled
        from envgraph.solve import shortest_plan

        try:
            return self.plan(engine).steps
        except NotCompiled:
            with counting(f"states of {self.behaviour.name}") as progress:
                table = explore(engine, self.behaviour, progress=progress).tabular
            return shortest_plan(table, native=False)

    def plan(self, engine: Engine, outcome: int = 1) -> Plan:
        """A plan that ends so (1 success, 2 failure); objects are numbered among themselves alone.

        Raises:
            NotCompiled: something in the behaviour only the live engine has.
        """
        from envgraph.env.compiled import Plans

        state = engine.model.state_hash()
        if self._last[0] != state:
            self._last = state, {}
        known = self._last[1]
        if outcome not in known:
            plans = self._plans.setdefault(outcome, Plans(self.behaviour, outcome, self.guide, self.shortest))
            with counting(f"states of {self.behaviour.name}") as progress:
                known[outcome] = plans.plan(engine, progress)
        return known[outcome]

    def why_none(self, engine: Engine, outcome: int = 1) -> tuple[str, str | None]:
        """How far the search went that found no plan in the present model, and a hint if it may have missed one."""
        from envgraph.env import REACH_LIMIT
        from envgraph.env.compiled import NotCompiled

        try:
            plan = self.plan(engine, outcome)
        except NotCompiled:
            live = f"what is not compiled is searched on the live engine, up to {REACH_LIMIT:,} states"
            return "no way there was found", live
        hint = (
            "there may be one: a beam goes on from the states with the fewest matches of a pattern. Name one that "
            'has fewer on the way there as the `guide` of a measure with `kind = "shortest_plan"`, or raise `limit`'
        )
        return f"no way there was found ({plan})", None if plan.exact else hint


class Distance:
    """In how many objects a model differs from another one: in their class, a value or a link, or by being there.

    An object is what has the same id; a link belongs to the object whose reference is declared first.

    Args:
        origin: the other model, as it is now; None for none, where nothing is measured.
    """

    whole = True

    def __init__(self, origin: Model | None) -> None:
        self._origin = [] if origin is None else object_facts(origin)
        self.range = (0.0, float(max(1, 0 if origin is None else len(origin))))

    def evaluate(self, engine: Engine) -> float:
        """The number in the model at which the engine stands."""
        (before, *facts), (after, *others) = self._origin, object_facts(engine.model)
        common = min(len(before), len(after))
        changed = {node for node in range(common) if before[node] != after[node]}
        for one, other in zip(facts, others, strict=True):
            if one != other:
                changed.update(
                    node for node in range(common) if one[node] != other[node] and after[node] != -1
                )
        return float(len(changed) + sum(cls != -1 for cls in (before[common:] or after[common:])))


class Certifier:
    """Knows what is certain of the model at which an engine stands; of the last one without being asked twice.

    Args:
        behaviour: of the environments.
        limit: steps of an episode.
    """

    def __init__(self, behaviour: Behaviour, limit: int) -> None:
        self._behaviour, self._limit = behaviour, limit
        self._tables: Tables | None = None
        self._last: tuple[int, Certificates] | None = None

    def of(self, engine: Engine, asked: ComponentSpec | None = None) -> Certificates:
        """Certificates of the model and of a random walk in it; objects are numbered among themselves alone.

        Args:
            engine: on the model.
            asked: the measure that asks, for the error.

        Raises:
            TooManyStates: there are too many to visit.
        """
        from envgraph.env import TooManyStates
        from envgraph.env.compiled import Tables
        from envgraph.solve import certify

        state = engine.model.state_hash()
        if self._last is None or self._last[0] != state:
            keys = KeyIndex.of(engine.model, indexed_classes(self._behaviour, engine.model.metamodel))
            with counting(f"states of {self._behaviour.name}") as progress:
                self._tables = self._tables or Tables(self._behaviour)
                try:
                    tabular = self._tables.table(engine, keys, progress)
                except TooManyStates as error:
                    raise self._needs_table(error, asked) from error
            self._last = state, certify(tabular, limit=self._limit)
        return self._last[1]

    def _needs_table(self, error: TooManyStates, asked: ComponentSpec | None) -> TooManyStates:
        """The error at the measure, which somebody may do without."""
        if asked is None:
            return error
        message = f"measure `{asked.name}` needs a table of all states: {error.message}"
        hint = (
            f"write a measure that needs none in place of `{asked.kind}`, such as `count`, `value` or "
            "`shortest_plan`, or let `[constraints]` keep members smaller"
        )
        return error.again(self._behaviour, message, hint, asked.span())


@dataclass(frozen=True, slots=True)
class RandomSuccess:
    """How likely an agent that draws all its actions succeeds within the limit: exact but for rounding."""

    certifier: Certifier
    spec: ComponentSpec | None = None
    range: ClassVar = (0.0, 1.0)

    def evaluate(self, engine: Engine) -> float:
        """The probability in the model at which the engine stands; raises as `Certifier.of`."""
        return self.certifier.of(engine, self.spec).random_success


@dataclass(frozen=True, slots=True)
class OptimalReturn:
    """The greatest return that any agent has within the limit, undiscounted: exact but for rounding."""

    certifier: Certifier
    spec: ComponentSpec | None = None

    def evaluate(self, engine: Engine) -> float:
        """The return in the model at which the engine stands; raises as `Certifier.of`."""
        return self.certifier.of(engine, self.spec).optimal_return
