"""Search problems: mutations, constraints on models, and measures of models, with checks of their values."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import field
from math import inf, isfinite, isnan
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Protocol

from envgraph.code import dataclass
from envgraph.errors import EvaluationError, quote_with_article
from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Comparison,
    Constant,
    Library,
    Negation,
    Pattern,
    PatternCall,
    Variable,
)
from envgraph.rewrite import Engine
from envgraph.search.problem._candidate_pool import FamilyMeasure, StatisticMeasure
from envgraph.search.problem._statistics import (
    BinnedEntropy,
    BoundedMeasure,
    Gini,
    Statistic,
    Swaps,
    Variance,
)

if TYPE_CHECKING:
    from envgraph.env import Behaviour
    from envgraph.search.problem._objective import Objective


MOST_CACHED_RESULTS: Final = 20_000
"""Number of models whose measures are cached, half a kilobyte each; the oldest entry is removed first."""


class Constraint(Protocol):
    """A condition on the engine's current model. An optional `why_not(engine)` returns why a model is rejected."""

    def holds(self, engine: Engine) -> bool:
        """Return True if the engine's current model satisfies the constraint."""

    def __str__(self) -> str:
        """Return the text by which messages refer to the constraint."""


class IndividualMeasure(Protocol):
    """A measure: a function from a model to a number.

    A measure may also have an attribute `range`, the pair of bounds of its values, and an attribute `whole`, which is
    True if all values are integers. `binned_entropy` divides that range.
    """

    def evaluate(self, engine: Engine) -> float:
        """Return the measure of the engine's current model; `inf` if the model has no value."""


class MissingValueError(EvaluationError):
    """A model has no value of a measure, and the family file gives no substitute (`otherwise`).

    Attributes:
        measure: name of the measure.
    """

    def __init__(self, measure: str) -> None:
        super().__init__(f"the model has no value of `{measure}`")
        self.measure = measure

    def __reduce__(self) -> tuple[type[MissingValueError], tuple[str]]:
        """Return the constructor and its argument, so that worker processes can pickle the error."""
        return MissingValueError, (self.measure,)


@dataclass(frozen=True, slots=True)
class Require:
    """The constraint that a pattern has at least one match."""

    pattern: str

    def holds(self, engine: Engine) -> bool:
        """Return True if the pattern has a match."""
        return engine.exists(self.pattern)

    def violation_body(self, library: Library) -> Body:
        """Return the body of a query that matches if the constraint is violated."""
        return Body((Negation(_any_match_call(library, self.pattern)),))

    def __str__(self) -> str:
        return f"require {self.pattern}"


@dataclass(frozen=True, slots=True)
class Forbid:
    """The constraint that a pattern has no match."""

    pattern: str

    def holds(self, engine: Engine) -> bool:
        """Return True if the pattern has no match."""
        return not engine.exists(self.pattern)

    def violation_body(self, library: Library) -> Body:
        """Return the body of a query that matches if the constraint is violated."""
        return Body((_any_match_call(library, self.pattern),))

    def __str__(self) -> str:
        return f"forbid {self.pattern}"


@dataclass(frozen=True, slots=True)
class MatchCountWithin:
    """The constraint that a pattern has from `low` to `high` matches. If `high` is None, there is no upper bound."""

    pattern: str
    low: int
    high: int | None

    def holds(self, engine: Engine) -> bool:
        """Return True if the number of matches is within the bounds."""
        count = engine.count(self.pattern)
        return self.low <= count and (self.high is None or count <= self.high)

    def violation_body(self, library: Library) -> Body:
        """Return the body of a query that matches if the constraint is violated."""
        found = Variable("found")
        outside = Binary("<", found, Constant(self.low))
        if self.high is not None:
            outside = Binary("||", outside, Binary(">", found, Constant(self.high)))
        count = Aggregate("count", _any_match_call(library, self.pattern))
        return Body((Comparison("==", found, count), Check(outside)))

    def __str__(self) -> str:
        return f"count {self.pattern} in {self.low}..{'*' if self.high is None else self.high}"


def _find_pattern(library: Library, name: str) -> Pattern:
    """Return the pattern with this name.

    Raises:
        InvalidArgument: no pattern has this name.
    """
    return library.resolve(name) or library.get(name)


def _any_match_call(library: Library, name: str) -> PatternCall:
    """Return a call of a pattern with `_` for every parameter, which holds if the pattern has a match."""
    pattern = _find_pattern(library, name)
    return PatternCall(pattern.qualified_name, (Variable("_"),) * len(pattern.parameters))


@dataclass(frozen=True, slots=True)
class NoViolation:
    """The constraint that a query for violations has no match; `text` describes the constraint in messages."""

    query: str
    text: str

    def holds(self, engine: Engine) -> bool:
        """Return True if there is no violation."""
        return not engine.matcher.exists(self.query, ())

    def __str__(self) -> str:
        return self.text


def _combined_query(library: Library, constraints: Sequence[Require | Forbid | MatchCountWithin]) -> NoViolation:
    """Combine constraints, in their order, into one query of the library, which is faster than several queries."""
    text = ", ".join(map(str, constraints))
    name = f"violation#{text}"
    if name not in library.names():
        library.add(Pattern(name, (), tuple(constraint.violation_body(library) for constraint in constraints)))
    return NoViolation(name, text)


@dataclass(frozen=True, slots=True)
class Problem:
    """A search problem: an engine, mutations, constraints, measures and an objective.

    Attributes:
        engine: the engine, which is at the initial model when a search begins.
        mutations: names of rules, units and groups.
        constraints: the constraints on every model, the cheapest first.
        measures: the measures that are recorded of each individual, by name.
        diversity: a statistic of one measure of the members. It is maximised if there is no objective.
        diversity_measure_name: name of that measure.
        otherwise: substitutes for missing values, by name of the measure. A model is invalid if a measure without a
            substitute has no value.
        objective: the objective of a family, in place of diversity; or None.
        behaviour: the behaviour of the environments, for objectives that read transition tables; or None.
        order_measure_name: name of the measure that orders the members of a family. None: the measure of the diversity.
        target_last: True if the initial model is the last member of a family, instead of being ordered like the others.
    """

    engine: Engine
    mutations: tuple[str, ...]
    constraints: Sequence[Constraint]
    measures: Mapping[str, IndividualMeasure]
    diversity: Statistic
    diversity_measure_name: str
    otherwise: Mapping[str, float] = field(default_factory=dict)
    objective: Objective | None = None
    behaviour: Behaviour | None = None
    order_measure_name: str | None = None
    target_last: bool = True
    _checks: Sequence[Constraint] = field(init=False, repr=False, compare=False)
    _violable_cache: list[Sequence[Constraint]] = field(default_factory=list, init=False, repr=False, compare=False)
    _results_by_state: dict[int, dict[str, float] | str] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "_checks", self._combine_constraints(()))
        if not isinstance(self.diversity, BinnedEntropy | Gini | Variance | _CheckedStatistic):
            object.__setattr__(self, "diversity", _CheckedStatistic(self.diversity))

    def _combine_constraints(self, fixed_patterns: Container[str]) -> tuple[Constraint, ...]:
        """Return the constraints that are not on `fixed_patterns` patterns. Constraints that are queries become one
        query.
        """
        queries, others = list[Require | Forbid | MatchCountWithin](), list[Constraint]()
        for one in self.constraints:
            if not isinstance(one, Require | Forbid | MatchCountWithin):
                others.append(one)
            elif _find_pattern(self.engine.library, one.pattern).qualified_name not in fixed_patterns:
                queries.append(one)
        return *([_combined_query(self.engine.library, queries)] if queries else ()), *others

    def _violable_constraints(self) -> Sequence[Constraint]:
        """Return the constraints that a mutation of a valid model can violate. The first call caches them."""
        if not self._violable_cache:
            from envgraph.env.compiled import unaffected_patterns

            fixed = () if self.engine.events.has_event_rules else unaffected_patterns(self.engine, self.mutations)
            self._violable_cache.append(self._combine_constraints(fixed))
        return self._violable_cache[0]

    def is_valid(self) -> bool:
        """Return True if the engine's current model satisfies every constraint."""
        return all(check.holds(self.engine) for check in self._checks)

    def measures_or_rejection(self, *, is_mutated: bool = False) -> dict[str, float] | str:
        """Return the measures of the current model, or the reason why it is rejected. Results are cached by state hash.

        If `is_mutated`, the model must come from mutations of a valid model; constraints that no mutation can violate
        are skipped. Raises as `measure`.
        """
        state = self.engine.model.state_hash()
        if state not in self._results_by_state:
            if len(self._results_by_state) >= MOST_CACHED_RESULTS:
                del self._results_by_state[next(iter(self._results_by_state))]
            self._results_by_state[state] = self._compute_measures_or_rejection(
                self._violable_constraints() if is_mutated else self._checks
            )
        return self._results_by_state[state]

    def take_results(self) -> dict[int, dict[str, float] | str]:
        """Return the cached results by state hash, and empty the cache."""
        found = dict(self._results_by_state)
        self._results_by_state.clear()
        return found

    def add_results(self, results: Mapping[int, dict[str, float] | str]) -> None:
        """Add results that another problem of the same domain has cached; see `take_results`."""
        self._results_by_state.update(results)

    def _compute_measures_or_rejection(self, checks: Sequence[Constraint]) -> dict[str, float] | str:
        if not all(check.holds(self.engine) for check in checks):
            first = next(self.violated_constraints())
            why_not = getattr(first, "why_not", None)
            return f"`{first}` is violated" if why_not is None else str(why_not(self.engine))
        try:
            return self.compute_measures()
        except MissingValueError as error:
            return error.message

    def violated_constraints(self) -> Iterator[Constraint]:
        """Yield the constraints that the current model violates, in their order. Check each constraint lazily."""
        return (constraint for constraint in self.constraints if not constraint.holds(self.engine))

    @property
    def family_measures(self) -> tuple[FamilyMeasure, ...]:
        """Return the measures by which families are compared, in order of precedence."""
        return (
            (StatisticMeasure(self.diversity, self.diversity_measure_name),)
            if self.objective is None
            else self.objective.measures
        )

    def largest_diversity(self, size: int) -> float:
        """Return the largest diversity of a family of `size` members; infinity if it is unknown."""
        return self.diversity.maximum(size) if isinstance(self.diversity, BoundedMeasure) else inf

    def compute_measures(self) -> dict[str, float]:
        """Return the value of every measure for the engine's current model. All values are finite.

        Raises:
            NoValue: the model has no value of a measure that has no substitute in `otherwise`.
            EvaluationError: a measure did not return a number.
        """
        values = {}
        for name, measure in self.measures.items():
            value = checked_number(measure.evaluate(self.engine), f"measure `{name}`")
            if not isfinite(value):
                if name not in self.otherwise:
                    raise MissingValueError(name)
                value = self.otherwise[name]
            values[name] = value
        return values


def checked_number(value: object, description: str) -> float:
    """Convert the result of a user's function to a float, which may be infinite.

    Raises:
        EvaluationError: the result is not a number. `description` names the function in the message.

    >>> checked_number("many", "measure `fires`")
    Traceback (most recent call last):
    envgraph.errors._exceptions.EvaluationError: measure `fires` must return a number, but returned a `str`
    ...
    """
    if type(value) is float and not isnan(value):
        return value
    found = quote_with_article(type(value).__name__)
    if isinstance(value, Real):
        try:
            converted = float(value)
        except OverflowError:
            found = "an integer with more than 308 digits"
        else:
            if not isnan(converted):
                return converted
            found = "`nan`"
    hint = "return a number, or `math.inf` if there is no value"
    raise EvaluationError(f"{description} must return a number, but returned {found}", hint=hint)


def checked_finite_number(value: object, description: str) -> float:
    """Convert a score that a user's measure returned for a family to a finite float.

    Raises:
        EvaluationError: the score is not a number, or is infinite. `description` names the measure in the message.
    """
    found = checked_number(value, description)
    if not isfinite(found):
        raise EvaluationError(f"{description} is infinite", hint="return a finite number for every family")
    return found


class _CheckedStatistic:
    """A user's statistic with a check that its results are numbers."""

    def __init__(self, statistic: Statistic) -> None:
        self._statistic = statistic
        self._what = f"diversity `{type(statistic).__name__}`"

    def score(self, values: Sequence[float]) -> float:
        return checked_finite_number(self._statistic.score(values), self._what)

    def maximum(self, size: int) -> float:
        bounded = self._statistic
        return checked_number(bounded.maximum(size), self._what) if isinstance(bounded, BoundedMeasure) else inf

    def __getattr__(self, name: str) -> Any:
        """Return the checked `swaps` of the statistic. Raise `AttributeError` for other names or without `swaps`."""
        if name != "swaps":
            raise AttributeError(name)
        make = self._statistic.swaps  # type: ignore[attr-defined]  # raises what Python raises
        return lambda values, members: _CheckedSwaps(make(values, members), self._what)


class _CheckedSwaps:
    """Score changes of a user's statistic with a check that they are finite numbers."""

    def __init__(self, swaps: Swaps, what: str) -> None:
        self._swaps, self._what = swaps, what
        self.swap = swaps.swap

    def delta(self, leaving: int, entering: int) -> float:
        return checked_finite_number(self._swaps.delta(leaving, entering), self._what)
