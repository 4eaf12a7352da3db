"""What a search needs to know of a domain: how to vary a model, when it is valid, what it measures."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import field
from math import inf, isfinite, isnan
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Protocol

from envgraph.code import dataclass
from envgraph.errors import EvaluationError, with_article
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
from envgraph.search.problem._diversity import BinnedEntropy, Bounded, Gini, Statistic, Swaps, Variance
from envgraph.search.problem._pool import FamilyMeasure, Over

if TYPE_CHECKING:
    from envgraph.env import Behaviour
    from envgraph.search.problem._objective import Objective


MOST_JUDGED: Final = 20_000
"""Judgements that are cached, half a kilobyte each; the oldest is removed first."""


class Constraint(Protocol):
    """A condition on the engine's present model. An optional `why_not(engine)` returns why a model is rejected."""

    def holds(self, engine: Engine) -> bool:
        """Whether the model satisfies it."""

    def __str__(self) -> str:
        """How the constraint is named to people."""


class IndividualMeasure(Protocol):
    """A number for one model.

    A measure may also have a `range`, two numbers between which its values lie, and be `whole` if they are whole
    numbers: `binned_entropy` divides that range.
    """

    def evaluate(self, engine: Engine) -> float:
        """The measure of the model at which the engine stands; infinite where the model has no value."""


class NoValue(EvaluationError):
    """A model has no value of a measure, and the family file does not say what counts otherwise.

    Attributes:
        measure: its name.
    """

    def __init__(self, measure: str) -> None:
        super().__init__(f"the model has no value of `{measure}`")
        self.measure = measure

    def __reduce__(self) -> tuple[type[NoValue], tuple[str]]:
        """Errors cross from worker processes."""
        return NoValue, (self.measure,)


@dataclass(frozen=True, slots=True)
class Require:
    """At least one match of a pattern."""

    pattern: str

    def holds(self, engine: Engine) -> bool:
        """Whether there is a match."""
        return engine.exists(self.pattern)

    def violation(self, library: Library) -> Body:
        """The body of a query that matches where the constraint does not hold."""
        return Body((Negation(_find(library, self.pattern)),))

    def __str__(self) -> str:
        return f"require {self.pattern}"


@dataclass(frozen=True, slots=True)
class Forbid:
    """No match of a pattern."""

    pattern: str

    def holds(self, engine: Engine) -> bool:
        """Whether there is no match."""
        return not engine.exists(self.pattern)

    def violation(self, library: Library) -> Body:
        """The body of a query that matches where the constraint does not hold."""
        return Body((_find(library, self.pattern),))

    def __str__(self) -> str:
        return f"forbid {self.pattern}"


@dataclass(frozen=True, slots=True)
class CountWithin:
    """The number of matches of a pattern is between two bounds, both included; `high` None is no bound."""

    pattern: str
    low: int
    high: int | None

    def holds(self, engine: Engine) -> bool:
        """Whether the number of matches is within the bounds."""
        count = engine.count(self.pattern)
        return self.low <= count and (self.high is None or count <= self.high)

    def violation(self, library: Library) -> Body:
        """The body of a query that matches where the constraint does not hold."""
        found = Variable("found")
        outside = Binary("<", found, Constant(self.low))
        if self.high is not None:
            outside = Binary("||", outside, Binary(">", found, Constant(self.high)))
        count = Aggregate("count", _find(library, self.pattern))
        return Body((Comparison("==", found, count), Check(outside)))

    def __str__(self) -> str:
        return f"count {self.pattern} in {self.low}..{'*' if self.high is None else self.high}"


def _named(library: Library, name: str) -> Pattern:
    """The pattern that a constraint is about.

    Raises:
        InvalidArgument: there is no such pattern.
    """
    return library.resolve(name) or library.get(name)


def _find(library: Library, name: str) -> PatternCall:
    """Any match of a pattern."""
    pattern = _named(library, name)
    return PatternCall(pattern.qualified_name, (Variable("_"),) * len(pattern.parameters))


@dataclass(frozen=True, slots=True)
class _Queries:
    """Constraints that are queries, as a single one: asking for a match costs more than finding it."""

    pattern: str

    @classmethod
    def of(cls, library: Library, constraints: Sequence[Require | Forbid | CountWithin]) -> _Queries:
        """Register the query, under a name that says what it is, so that it is there only once."""
        name = "violation#" + ", ".join(map(str, constraints))
        if name not in library.names():
            library.add(Pattern(name, (), tuple(constraint.violation(library) for constraint in constraints)))
        return cls(name)

    def holds(self, engine: Engine) -> bool:
        """Whether no constraint is violated; they are looked at in their order."""
        return not engine.matcher.exists(self.pattern, ())


@dataclass(frozen=True, slots=True)
class Problem:
    """A search problem.

    Attributes:
        engine: stands at the initial model when a search begins.
        mutations: names of rules, units and groups.
        constraints: all must hold in a valid model; the cheapest first.
        measures: what is recorded of each individual, by name.
        diversity: how diverse a family is, by one measure of its members; what it maximises without an objective.
        diversity_of: name of that measure.
        otherwise: what counts, by the name of a measure, for models that have no value of it; others are not valid.
        objective: what a family is to be instead of as diverse as can be.
        behaviour: of the environments, where there are some; for objectives that read tables.
        order: name of the measure that orders the members of a family, by default that of the diversity.
        target_last: whether the initial model is the last member, and not ordered like the others.
    """

    engine: Engine
    mutations: tuple[str, ...]
    constraints: Sequence[Constraint]
    measures: Mapping[str, IndividualMeasure]
    diversity: Statistic
    diversity_of: str
    otherwise: Mapping[str, float] = field(default_factory=dict)
    objective: Objective | None = None
    behaviour: Behaviour | None = None
    order: str | None = None
    target_last: bool = True
    _checks: Sequence[Constraint] = field(init=False, repr=False, compare=False)
    _open: list[Sequence[Constraint]] = field(default_factory=list, init=False, repr=False, compare=False)
    _judged: dict[int, dict[str, float] | str] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "_checks", self._joined(()))
        if not isinstance(self.diversity, BinnedEntropy | Gini | Variance | _Checked):
            object.__setattr__(self, "diversity", _Checked(self.diversity))

    def _joined(self, fixed: Container[str]) -> tuple[Constraint, ...]:
        """The constraints, but for those on fixed patterns; those that are queries as a single one."""
        queries, others = list[Require | Forbid | CountWithin](), list[Constraint]()
        for one in self.constraints:
            if not isinstance(one, Require | Forbid | CountWithin):
                others.append(one)
            elif _named(self.engine.library, one.pattern).qualified_name not in fixed:
                queries.append(one)
        return (*([_Queries.of(self.engine.library, queries)] if queries else ()), *others)

    def _mutable(self) -> Sequence[Constraint]:
        """Return the constraints that a mutation of a valid model can violate, found once."""
        if not self._open:
            from envgraph.env.compiled import unaffected

            fixed = () if self.engine.events.active else unaffected(self.engine, self.mutations)
            self._open.append(self._joined(fixed))
        return self._open[0]

    def valid(self) -> bool:
        """Whether the model at which the engine stands satisfies every constraint."""
        return all(check.holds(self.engine) for check in self._checks)

    def judged(self, *, mutated: bool = False) -> dict[str, float] | str:
        """Return the measures of the present model, or why it is rejected. Judge each state once. Raises as `measure`.

        If mutations made the model of a valid one (`mutated`), skip constraints that no mutation can violate.
        """
        state = self.engine.model.state_hash()
        if state not in self._judged:
            if len(self._judged) >= MOST_JUDGED:
                del self._judged[next(iter(self._judged))]
            self._judged[state] = self._judge(self._mutable() if mutated else self._checks)
        return self._judged[state]

    def _judge(self, checks: Sequence[Constraint]) -> dict[str, float] | str:
        if not all(check.holds(self.engine) for check in checks):
            first = next(self.violations())
            why_not = getattr(first, "why_not", None)
            return f"`{first}` is violated" if why_not is None else str(why_not(self.engine))
        try:
            return self.measure()
        except NoValue as error:
            return error.message

    def violations(self) -> Iterator[Constraint]:
        """The constraints that the model violates, in their order, each looked at when it is asked for."""
        return (constraint for constraint in self.constraints if not constraint.holds(self.engine))

    @property
    def family_measures(self) -> tuple[FamilyMeasure, ...]:
        """What families are compared by, what counts most first."""
        return (
            (Over(self.diversity, self.diversity_of),) if self.objective is None else self.objective.measures
        )

    def maximum(self, size: int) -> float:
        """How diverse a family of so many members can be at most; infinite where that is not known."""
        return self.diversity.maximum(size) if isinstance(self.diversity, Bounded) else inf

    def measure(self) -> dict[str, float]:
        """Every measure of the model at which the engine stands; all of them are finite.

        Raises:
            NoValue: the model has no value of one of them, and there is none `otherwise`.
            EvaluationError: a measure is no number.
        """
        values = {}
        for name, measure in self.measures.items():
            value = number(measure.evaluate(self.engine), f"measure `{name}`")
            if not isfinite(value):
                if name not in self.otherwise:
                    raise NoValue(name)
                value = self.otherwise[name]
            values[name] = value
        return values


def number(value: object, what: str) -> float:
    """What a function of the user returned as a number; it may be infinite.

    Raises:
        EvaluationError: it is none.

    >>> number("many", "measure `fires`")
    Traceback (most recent call last):
    envgraph.errors._exceptions.EvaluationError: measure `fires` is no number: it returned a `str`
    ...
    """
    if type(value) is float and not isnan(value):
        return value
    found = with_article(type(value).__name__)
    if isinstance(value, Real):
        try:
            converted = float(value)
        except OverflowError:
            found = "a number with more than 308 digits"
        else:
            if not isnan(converted):
                return converted
            found = "`nan`"
    hint = "return a number, or `math.inf` where there is no value"
    raise EvaluationError(f"{what} is no number: it returned {found}", hint=hint)


def finite(value: object, what: str) -> float:
    """What a measure of the user's returned for a family, as a number.

    Raises:
        EvaluationError: it is none, or infinite.
    """
    found = number(value, what)
    if not isfinite(found):
        raise EvaluationError(f"{what} is infinite", hint="return a finite number for every family")
    return found


class _Checked:
    """A statistic of the user, whose numbers are numbers."""

    def __init__(self, statistic: Statistic) -> None:
        self._statistic = statistic
        self._what = f"diversity `{type(statistic).__name__}`"

    def score(self, values: Sequence[float]) -> float:
        return finite(self._statistic.score(values), self._what)

    def maximum(self, size: int) -> float:
        bounded = self._statistic
        return number(bounded.maximum(size), self._what) if isinstance(bounded, Bounded) else inf

    def __getattr__(self, name: str) -> Any:
        """`swaps`, where the statistic has them."""
        if name != "swaps":
            raise AttributeError(name)
        make = self._statistic.swaps  # type: ignore[attr-defined]  # raises what Python raises
        return lambda values, members: _CheckedSwaps(make(values, members), self._what)


class _CheckedSwaps:
    def __init__(self, swaps: Swaps, what: str) -> None:
        self._swaps, self._what = swaps, what
        self.swap = swaps.swap

    def delta(self, leaving: int, entering: int) -> float:
        return finite(self._swaps.delta(leaving, entering), self._what)
