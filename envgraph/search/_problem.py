"""What a search needs to know of a domain: how to vary a model, when it is valid, what it measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

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
from envgraph.search._diversity import FamilyMeasure


class Constraint(Protocol):
    """A condition on the model at which the engine stands."""

    def holds(self, engine: Engine) -> bool:
        """Whether the model satisfies it."""

    def __str__(self) -> str:
        """How the constraint is named to people."""


class IndividualMeasure(Protocol):
    """A number for one model."""

    def evaluate(self, engine: Engine) -> float:
        """The measure of the model at which the engine stands."""


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


def _find(library: Library, name: str) -> PatternCall:
    """Any match of a pattern.

    Raises:
        InvalidArgument: there is no such pattern.
    """
    pattern = library.resolve(name) or library.get(name)
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
        diversity: what a family maximises.
        diversity_of: name of the measure that it reads.
    """

    engine: Engine
    mutations: tuple[str, ...]
    constraints: Sequence[Constraint]
    measures: Mapping[str, IndividualMeasure]
    diversity: FamilyMeasure
    diversity_of: str
    _checks: Sequence[Constraint] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        queries = [one for one in self.constraints if isinstance(one, Require | Forbid | CountWithin)]
        others = [one for one in self.constraints if not isinstance(one, Require | Forbid | CountWithin)]
        joined = [_Queries.of(self.engine.library, queries)] if queries else []
        object.__setattr__(self, "_checks", (*joined, *others))

    def valid(self) -> bool:
        """Whether the model at which the engine stands satisfies every constraint."""
        return all(check.holds(self.engine) for check in self._checks)

    def violations(self) -> list[Constraint]:
        """The constraints that the model violates."""
        return [constraint for constraint in self.constraints if not constraint.holds(self.engine)]

    def measure(self) -> dict[str, float]:
        """Every measure of the model at which the engine stands."""
        return {name: float(measure.evaluate(self.engine)) for name, measure in self.measures.items()}
