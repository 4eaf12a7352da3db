"""Objectives of an optimisation, and the evaluation of a model: its constraint violation and its costs."""

from __future__ import annotations

from math import inf
from typing import Literal, NamedTuple

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import numeric_parameters
from envgraph.metamodel import Scalar
from envgraph.rewrite import Engine
from envgraph.search.problem._individual_measures import MatchCount, PatternValue
from envgraph.search.problem._problem import IndividualMeasure, checked_number

Sense = Literal["maximise", "minimise"]


@dataclass(frozen=True, slots=True)
class Goal:
    """An objective: a measure to maximise or to minimise.

    Attributes:
        name: name in results.
        otherwise: substitute if a model has no value of the measure. None: such a model is worse than all others.
    """

    name: str
    measure: IndividualMeasure
    sense: Sense = "maximise"
    otherwise: float | None = None

    @classmethod
    def from_pattern(cls, engine: Engine, pattern: str, sense: Sense) -> Goal:
        """Return the goal for a pattern: its numeric parameter, or its number of matches if no parameter is numeric.

        Raises:
            InvalidArgument: the pattern does not exist, or has several numeric parameters.
        """
        name = engine.catalog.query_target(pattern)[0].definition
        numbers = numeric_parameters(engine.library, name) or {}
        if len(numbers) > 1:
            known = " and ".join(f"`{one}`" for one in numbers)
            raise InvalidArgument(
                f"`{pattern}` has several parameters that are numbers, {known}, but must have at most one"
            )
        for place, type_ in numbers.values():
            return cls(pattern, PatternValue(name, place, whole=type_ is Scalar.INT), sense)
        return cls(pattern, MatchCount(name), sense)

    def value_to_cost(self, measured: object) -> float:
        """Convert a value of the measure to a cost. A lower cost is better.

        An infinite value is replaced by `otherwise`; `inf` is returned if there is no value and no substitute.
        """
        value = checked_number(measured, f"objective `{self.name}`")
        if value in (inf, -inf):
            value = inf if self.otherwise is None else self.otherwise
            if value == inf:
                return inf
        return -value if self.sense == "maximise" else value

    def cost_to_value(self, cost: float) -> float:
        """Convert a cost back to the value of the measure; `inf`, a missing value, stays `inf`."""
        return -cost if self.sense == "maximise" and cost != inf else cost


class ConstrainedCosts(NamedTuple):
    """The evaluation of a model. A lower violation is better, whatever the costs (Deb 2000, "constraint-domination").

    Attributes:
        violation: 0 if all constraints hold, else the sum of the constraints' violations.
        costs: one cost for each goal.
    """

    violation: float
    costs: tuple[float, ...]

    def dominates(self, other: ConstrainedCosts) -> bool:
        """Return True if this evaluation dominates the other: not worse in anything and better in something."""
        if self.violation != other.violation:
            return self.violation < other.violation
        return self.costs != other.costs and all(
            mine <= yours for mine, yours in zip(self.costs, other.costs, strict=True)
        )
