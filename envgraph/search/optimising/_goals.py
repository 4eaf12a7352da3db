"""What a model is worth: its distance from satisfying the constraints, and then what it costs by each objective."""

from __future__ import annotations

from math import inf
from typing import Literal, NamedTuple

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import numeric_parameters
from envgraph.metamodel import Scalar
from envgraph.rewrite import Engine
from envgraph.search.problem._measures import MatchCount, PatternValue
from envgraph.search.problem._problem import IndividualMeasure, number

Sense = Literal["maximise", "minimise"]


@dataclass(frozen=True, slots=True)
class Goal:
    """A measure that is to be as large or as small as can be.

    Attributes:
        name: how it is called in results.
        otherwise: what counts where a model has no value; None: such a model is worse than any that has one.
    """

    name: str
    measure: IndividualMeasure
    sense: Sense = "maximise"
    otherwise: float | None = None

    @classmethod
    def of(cls, engine: Engine, pattern: str, sense: Sense) -> Goal:
        """The number that a pattern computes; of a pattern without a parameter for one, how many matches it has.

        Raises:
            InvalidArgument: there is no such pattern, or it has several parameters that are numbers.
        """
        name = engine.catalog.asked(pattern)[0].definition
        numbers = numeric_parameters(engine.library, name) or {}
        if len(numbers) > 1:
            known = " and ".join(f"`{one}`" for one in numbers)
            raise InvalidArgument(f"`{pattern}` has several parameters that are numbers: {known}")
        for place, type_ in numbers.values():
            return cls(pattern, PatternValue(name, place, whole=type_ is Scalar.INT), sense)
        return cls(pattern, MatchCount(name), sense)

    def cost(self, measured: object) -> float:
        """What was measured as a cost: less is better, infinity is no value."""
        value = number(measured, f"objective `{self.name}`")
        if value in (inf, -inf):
            value = inf if self.otherwise is None else self.otherwise
            if value == inf:
                return inf
        return -value if self.sense == "maximise" else value

    def value(self, cost: float) -> float:
        """The measure of which this is the cost."""
        return -cost if self.sense == "maximise" and cost != inf else cost


class Standing(NamedTuple):
    """What a model is worth. Fewer violations come first, whatever the costs (Deb 2000, "constraint-domination").

    Attributes:
        violation: 0 where all constraints hold; else how far they are from it, see `excess`.
        costs: one for each goal.
    """

    violation: float
    costs: tuple[float, ...]

    def dominates(self, other: Standing) -> bool:
        """Whether it is better in something, and in nothing worse."""
        if self.violation != other.violation:
            return self.violation < other.violation
        return self.costs != other.costs and all(
            mine <= yours for mine, yours in zip(self.costs, other.costs, strict=True)
        )
