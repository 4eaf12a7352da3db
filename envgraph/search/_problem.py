"""What a search needs to know of a domain: how to vary a model, when it is valid, what it measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

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

    def __str__(self) -> str:
        return f"require {self.pattern}"


@dataclass(frozen=True, slots=True)
class Forbid:
    """No match of a pattern."""

    pattern: str

    def holds(self, engine: Engine) -> bool:
        """Whether there is no match."""
        return not engine.exists(self.pattern)

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
        return self.low <= engine.count(self.pattern) and (
            self.high is None or engine.count(self.pattern) <= self.high
        )

    def __str__(self) -> str:
        return f"count {self.pattern} in {self.low}..{'*' if self.high is None else self.high}"


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

    def valid(self) -> bool:
        """Whether the model at which the engine stands satisfies every constraint."""
        return all(constraint.holds(self.engine) for constraint in self.constraints)

    def violations(self) -> list[Constraint]:
        """The constraints that the model violates."""
        return [constraint for constraint in self.constraints if not constraint.holds(self.engine)]

    def measure(self) -> dict[str, float]:
        """Every measure of the model at which the engine stands."""
        return {name: float(measure.evaluate(self.engine)) for name, measure in self.measures.items()}
