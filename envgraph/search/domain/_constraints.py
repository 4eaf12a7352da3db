"""The constraints that a domain puts on every model, from its family file, its metamodel and its environment."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from math import isfinite
from typing import TYPE_CHECKING

from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes, unbound_names
from envgraph.code import dataclass
from envgraph.errors import LIMITS, has_errors
from envgraph.files import report_counting
from envgraph.graph import Model
from envgraph.pattern import conformance_patterns, key_patterns
from envgraph.rewrite import Engine
from envgraph.search.problem._individual_measures import ShortestPlan
from envgraph.search.problem._problem import (
    Constraint,
    Forbid,
    IndividualMeasure,
    MatchCountWithin,
    NoViolation,
    Require,
)

if TYPE_CHECKING:
    from envgraph.search.domain._domain import Domain


@dataclass(frozen=True, slots=True)
class OutcomeReachable:
    """The constraint that a plan exists with which an episode ends with an outcome, "success" or "failure".

    Attributes:
        plan: the search for a plan. It is the measure `shortest_plan` if the family has one, so that results are
            shared.
    """

    outcome: str
    plan: ShortestPlan

    @property
    def outcome_number(self) -> int:
        """Return the number of the outcome: 1 for success, 2 for failure."""
        return {"success": 1, "failure": 2}[self.outcome]

    def holds(self, engine: Engine) -> bool:
        """Return True if a plan to the outcome is found, by a compiled search if possible, else by visiting states."""
        from envgraph.env import can_end
        from envgraph.env.compiled import NotCompiled

        try:
            return isfinite(self.plan.find_plan(engine, self.outcome_number).steps)
        except NotCompiled:
            behaviour = self.plan.behaviour
            with report_counting(f"states of {behaviour.name}") as progress:
                return can_end(engine, behaviour, self.outcome_number, progress=progress)

    def why_not(self, engine: Engine) -> str:
        """Return the reason for rejecting a model: no plan to the outcome exists, or the search was stopped."""
        from envgraph.env.compiled import NotCompiled

        with suppress(NotCompiled):
            if not self.plan.find_plan(engine, self.outcome_number).is_exact:
                return f"no plan to {self.outcome} was found within {LIMITS['planned states']:,} states"
        return f"`{self}` is violated"

    def __str__(self) -> str:
        return f"reachable {self.outcome}"


@dataclass(frozen=True, slots=True)
class ParametersBound:
    """The constraint that every parameter of the behaviour has an object and that at least one agent can act."""

    behaviour: Behaviour

    def holds(self, engine: Engine) -> bool:
        """Return True if every parameter has an object, and at least one agent can act."""
        return not has_errors(unbound_names(self.behaviour, engine.model))

    def __str__(self) -> str:
        return "each parameter of the environment has its object"


@dataclass(frozen=True, slots=True)
class SameAgents:
    """The constraint that the model has the agents of the initial model, by key, which joint actions need."""

    initial: Model
    classes: tuple[str, ...]

    def holds(self, engine: Engine) -> bool:
        """Return True if the model has exactly the agents of the initial model."""
        return KeyIndex.of_model(engine.model, self.classes) == KeyIndex.of_model(self.initial, self.classes)

    def __str__(self) -> str:
        return "agents that act together are those of the initial model"


def constraints_of(domain: Domain, engine: Engine, measures: Iterable[IndividualMeasure]) -> tuple[Constraint, ...]:
    """Return the constraints of a domain: conformance, then those of the family file, then those that visit states.

    Patterns that these constraints query are added to the engine if it does not have them.
    """
    spec = domain.spec.constraints
    conformance = conformance_patterns(domain.metamodel)
    behaviour = domain.behaviour
    counted = indexed_classes(behaviour, domain.metamodel) if behaviour else ()
    keys = key_patterns(domain.metamodel, counted)
    known = set(engine.patterns)
    engine.add(*(pattern for pattern in (*conformance, *keys) if pattern.qualified_name not in known))
    constraints: list[Constraint] = [Forbid(pattern.qualified_name) for pattern in conformance]
    constraints += [Require(str(name)) for name in spec.require]
    constraints += [Forbid(str(name)) for name in spec.forbid]
    constraints += [Forbid(name) for name in _violation_patterns(domain) if name not in set(map(str, spec.forbid))]
    constraints += [MatchCountWithin(str(name), *bounds) for name, bounds in spec.count]
    constraints += [NoViolation(pattern.qualified_name, "each object has a key of its own") for pattern in keys]
    if behaviour is not None:
        constraints.append(ParametersBound(behaviour))
        if behaviour.together:
            constraints.append(SameAgents(domain.initial(), tuple(agent.cls for agent in behaviour.agents)))
        any_plan = ShortestPlan(behaviour, shortest=False)
        plans = [*(one for one in measures if isinstance(one, ShortestPlan)), any_plan]
        constraints += [OutcomeReachable(str(outcome), plans[0]) for outcome in spec.reachable]
    return tuple(constraints)


def _violation_patterns(domain: Domain) -> list[str]:
    """Return the names of the patterns with a VIATRA `@Constraint` of severity error. Each match is a violation."""
    return [
        pattern.qualified_name
        for pattern in domain.workspace.patterns
        for annotation in pattern.annotations
        if annotation.name == "Constraint" and dict(annotation.named).get("severity") == "error"
    ]
