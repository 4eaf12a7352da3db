"""Measures of a single model: matches, values of patterns, graph distances, plans and certificates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from math import inf
from typing import TYPE_CHECKING, ClassVar, Final

from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes
from envgraph.code import dataclass
from envgraph.errors import LIMITS
from envgraph.files import report_counting
from envgraph.graph import Model
from envgraph.lang import ComponentSpec
from envgraph.match import Row
from envgraph.metamodel import Metamodel
from envgraph.pattern import Variable
from envgraph.rewrite import Engine
from envgraph.search.problem._object_columns import object_fact_columns

if TYPE_CHECKING:
    from envgraph.env.compiled import ActionPlan, Plans, TableBuilder
    from envgraph.solve import Certificates

DEFAULT_STEP_LIMIT: Final = 200
"""Step limit of an episode if neither the family nor the environment has a limit."""


@dataclass(frozen=True, slots=True)
class MatchCount:
    """A measure: the number of matches of a pattern."""

    pattern: str
    whole: ClassVar = True

    def evaluate(self, engine: Engine) -> float:
        """Return the number of matches in the engine's current model."""
        return float(engine.count(self.pattern))


@dataclass(frozen=True, slots=True)
class PatternValue:
    """A measure: the number that a parameter has in the only match of a pattern.

    Attributes:
        pattern: name of the pattern.
        parameter_place: position of the parameter, from 0.
        whole: True if the parameter is an `int`.
    """

    pattern: str
    parameter_place: int
    whole: bool

    def evaluate(self, engine: Engine) -> float:
        """Return the number in the engine's current model; `inf` if the pattern has no match or several matches.

        Raises:
            OverflowError: the number has more than 308 digits.
        """
        _, pattern, arguments = engine.queries.resolve_query(self.pattern)
        return self.value_in(engine.matcher.rows(pattern, arguments))

    def value_in(self, rows: Sequence[Row]) -> float:
        """Return the number from the matches of the pattern; `inf` if there is no match or several matches."""
        value = rows[0][self.parameter_place] if len(rows) == 1 else inf
        assert isinstance(value, int | float), "`check_family` demands a number"
        return value


@dataclass(frozen=True, slots=True)
class ShortestPath:
    """A measure: the longest of all shortest paths from a start object to a goal object that it reaches, in links.

    Over all pairs of objects this is the diameter of the graph (Wasserman and Faust 1994, section 4.3.4). With one
    start and one goal it is their distance. An object that is both start and goal has distance 0 to itself.

    Attributes:
        along: names of references, or of binary patterns, that are the links.
        start, goal: names of classes, or None for every object.
        avoid: name of the class whose objects no path enters, or None.
    """

    metamodel: Metamodel
    along: tuple[str, ...]
    start: str | None = None
    goal: str | None = None
    avoid: str | None = None
    whole: ClassVar = True

    def evaluate(self, engine: Engine) -> float:
        """Return the length in the engine's current model; `inf` if no start reaches a goal."""
        model = engine.model
        every = [
            node for cls in self.metamodel.class_list if not cls.abstract for node in model.graph.exact_extent(cls.name)
        ]
        blocked = set(model.graph.extent(self.avoid)) if self.avoid else set()
        links: dict[int, list[int]] = {}
        for source, target in self._links(engine):
            if target not in blocked and source not in blocked:
                links.setdefault(source, []).append(target)
        goals = set(model.graph.extent(self.goal) if self.goal else every) - blocked
        starts = [node for node in (model.graph.extent(self.start) if self.start else every) if node not in blocked]
        found = (steps for start in starts for node, steps in link_distances(links, start).items() if node in goals)
        return float(max(found, default=inf))

    def _links(self, engine: Engine) -> Iterable[tuple[int, int]]:
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


def link_distances(links: Mapping[int, Sequence[int]], start: int) -> dict[int, int]:
    """Return the number of links from `start` to each object that can be reached, by breadth-first search."""
    distance, queue = {start: 0}, [start]
    for node in queue:
        for target in links.get(node, ()):
            if target not in distance:
                distance[target] = distance[node] + 1
                queue.append(target)
    return distance


@dataclass(slots=True)
class ShortestPlan:
    """A measure: the fewest steps in which an episode can end in success.

    For large environments it is an upper bound on them. Stochastic outcomes count as possible. The measure is infinite
    if no plan was found. The plans of the last measured state are cached, because constraints ask for the same plans.

    Attributes:
        guide: name of a pattern for beam search, which keeps the states with the fewest matches of it. None: the
            patterns of the behaviour.
        shortest: False if any plan will do, even a longer one: see `Plans` of `envgraph.env.compiled`.
    """

    behaviour: Behaviour
    guide: str | None = None
    shortest: bool = True
    whole: ClassVar = True
    _plans: dict[int, Plans] = field(default_factory=dict, init=False, repr=False, compare=False)
    _last_plans: tuple[int, dict[int, ActionPlan]] = field(default=(0, {}), init=False, repr=False, compare=False)

    def evaluate(self, engine: Engine) -> float:
        """Return the fewest steps to success that were found from the engine's current model; infinity without a plan.

        Raises:
            EvaluationError: the behaviour cannot be compiled, and has too many states to visit all of them.
        """
        from envgraph.env import explore
        from envgraph.env.compiled import NotCompiled
        from envgraph.solve import shortest_plan

        try:
            return self.find_plan(engine).steps
        except NotCompiled:
            with report_counting(f"states of {self.behaviour.name}") as progress:
                table = explore(engine, self.behaviour, progress=progress).tabular
            return shortest_plan(table, native=False)

    def find_plan(self, engine: Engine, outcome: int = 1) -> ActionPlan:
        """Search a plan for the engine's current model that ends with `outcome` (1 success, 2 failure), and cache it.

        Objects are numbered within this model only, not as in other members.

        Raises:
            NotCompiled: the behaviour has a construct that cannot be compiled.
        """
        from envgraph.env.compiled import Plans

        state = engine.model.state_hash()
        if self._last_plans[0] != state:
            self._last_plans = state, {}
        known = self._last_plans[1]
        if outcome not in known:
            plans = self._plans.setdefault(outcome, Plans(self.behaviour, outcome, self.guide, self.shortest))
            with report_counting(f"states of {self.behaviour.name}") as progress:
                known[outcome] = plans.plan(engine, progress)
        return known[outcome]

    def why_no_plan(self, engine: Engine, outcome: int = 1) -> tuple[str, str | None]:
        """Return a text why no plan was found in the current model, and a hint; None as the hint if no plan exists."""
        from envgraph.env.compiled import NotCompiled, guide_calls

        try:
            plan = self.find_plan(engine, outcome)
        except NotCompiled as reason:
            most = f"{LIMITS['searched states']:,} states"
            return "no plan was found", f"remove what limits the search to {most}: {reason}"
        if plan.is_exact:
            return f"no plan was found ({plan})", None
        terms = (term for call in guide_calls(self.behaviour, outcome) for term in call.arguments)
        counted = {term.name for term in terms if isinstance(term, Variable)}
        counted -= {one.name for one in self.behaviour.parameters}
        hint = (
            'write `guide = "name"` in a measure with `kind = "shortest_plan"`, where `name` is a pattern with fewer '
            "and fewer matches towards the end of an episode; or raise `limit`"
        )
        if self.guide is not None:
            hint = hint.replace("write", f"instead of `{self.guide}` write", 1)
        elif not counted:
            hint = f"nothing guides the search, since no `on neg find .. terminate` leaves a number to count: {hint}"
        return f"no plan was found ({plan})", hint


class DistanceToModel:
    """A measure: the number of objects in which a model differs from another model.

    Objects are compared by id. They differ in their class, a value or a link, or if only one model has them. A link
    belongs to the object whose reference is declared first.

    Args:
        origin: the other model in its current state. None if the measure is only declared, and never evaluated.
    """

    whole = True

    def __init__(self, origin: Model | None) -> None:
        self._origin = [] if origin is None else object_fact_columns(origin)
        self.range = (0.0, float(max(1, 0 if origin is None else len(origin))))

    def evaluate(self, engine: Engine) -> float:
        """Return the number of objects in which the engine's current model differs from the other model."""
        (before, *facts), (after, *others) = self._origin, object_fact_columns(engine.model)
        common = min(len(before), len(after))
        changed = {node for node in range(common) if before[node] != after[node]}
        for one, other in zip(facts, others, strict=True):
            if one != other:
                changed.update(node for node in range(common) if one[node] != other[node] and after[node] != -1)
        return float(len(changed) + sum(cls != -1 for cls in (before[common:] or after[common:])))


class CachedCertifier:
    """A calculator of the certificates of a model, which caches those of the last model.

    Args:
        behaviour: the behaviour of the environments.
        limit: the maximum number of steps of an episode.
    """

    def __init__(self, behaviour: Behaviour, limit: int) -> None:
        self._behaviour, self._limit = behaviour, limit
        self._tables: TableBuilder | None = None
        self._last: tuple[int, Certificates] | None = None

    def certificates_of(self, engine: Engine, measure: ComponentSpec) -> Certificates:
        """Return the certificates of the engine's current model, with those of a random policy.

        Objects are numbered within this model only, not as in other members.

        Args:
            engine: the engine, at the model.
            measure: the measure that needs the certificates, for the error message.

        Raises:
            TooManyStates: the environment has too many states to visit all of them.
        """
        from envgraph.env import TooManyStates
        from envgraph.env.compiled import TableBuilder
        from envgraph.solve import certify

        state = engine.model.state_hash()
        if self._last is None or self._last[0] != state:
            keys = KeyIndex.of_model(engine.model, indexed_classes(self._behaviour, engine.model.metamodel))
            with report_counting(f"states of {self._behaviour.name}") as progress:
                self._tables = self._tables or TableBuilder(self._behaviour)
                try:
                    tabular = self._tables.build(engine, keys, progress)
                except TooManyStates as error:
                    message = f"measure `{measure.name}` needs a table of all states: {error.message}"
                    hint = (
                        f"replace `{measure.kind}` by a measure that needs no table, such as `count`, `value` or "
                        "`shortest_plan`, or add `[constraints]` that exclude large members"
                    )
                    raise error.from_message(self._behaviour, message, hint, measure.span()) from error
            self._last = state, certify(tabular, limit=self._limit)
        return self._last[1]


@dataclass(frozen=True, slots=True)
class CertifiedMeasure:
    """A measure that is one of the certificates, within the step limit and exact but for rounding.

    Attributes:
        certifier: computes the certificates.
        spec: the measure in the family file.
        certificate: "random_success" of a uniformly random policy, or "optimal_return", the greatest expected
            undiscounted return.
        range: the bounds of its values, or None.
    """

    certifier: CachedCertifier
    spec: ComponentSpec
    certificate: str
    range: tuple[float, float] | None = None

    def evaluate(self, engine: Engine) -> float:
        """Return the certificate of the engine's current model. Raise `TooManyStates` as `certificates_of` does."""
        return float(getattr(self.certifier.certificates_of(engine, self.spec), self.certificate))
