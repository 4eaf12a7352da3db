"""The parts of a behaviour, ready to run on one engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from itertools import groupby
from operator import add
from typing import Protocol, TypeVar

from envgraph.behaviour import Action, Effect, Observation, ObserveRange, RuleCall
from envgraph.code import dataclass
from envgraph.errors import EvaluationError, Span
from envgraph.graph import Model
from envgraph.match import Row
from envgraph.metamodel import Value

Scope = Mapping[str, Value | None]
"""What names stand for while a step is done: values, ids of objects, None for an object that is missing."""


class Choices(Protocol):
    """Makes the random choices of a step, in the order in which they come."""

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """One of the alternatives; None with the probability that is missing to 1."""

    def pick(self, count: int) -> int:
        """One of `count` >= 1 alternatives, equally likely."""


Perform = Callable[[Sequence[Value | None], Choices, Model], Sequence[Value | None] | None]
"""Applies a rule or runs a unit with values for its parameters; the values of its outputs, None if nothing was done."""

Possible = Callable[[Sequence[Value | None]], bool]
"""Whether the rule has a match with values for its parameters, or a run of the unit can succeed."""


@dataclass(frozen=True, slots=True)
class PreparedCall:
    """`rule(arguments)`, ready to run.

    Attributes:
        perform: applies the rule, or runs the unit, for the values of the arguments.
        possible: says whether that would do something.
        arguments: the argument expressions of the bound parameters, as functions of the scope.
        objects: which of the arguments are objects.
        outputs: the names that get the outputs.
        call: as it was written.
        done: gets the call when something was done.
    """

    perform: Perform
    possible: Possible
    arguments: tuple[Callable[[Scope], Value | None], ...]
    objects: tuple[bool, ...]
    outputs: tuple[str, ...]
    call: RuleCall
    done: list[RuleCall]

    def run(self, scope: Scope, choices: Choices, model: Model) -> Scope | None:
        """Apply the rule at one of its matches, or run the unit; None if that cannot be done.

        Returns:
            The scope, with the outputs.
        """
        values = self._values(scope, model)
        if values is None:
            return None
        result = self.perform(values, choices, model)
        if result is None:
            return None
        self.done.append(self.call)
        return {**scope, **dict(zip(self.outputs, result, strict=True))} if self.outputs else scope

    def can_run(self, scope: Scope, model: Model) -> bool:
        """Whether `run` would do something."""
        values = self._values(scope, model)
        return values is not None and self.possible(values)

    def _values(self, scope: Scope, model: Model) -> list[Value | None] | None:
        """The values of the arguments; None where one has none, or its object is gone."""
        values = [argument(scope) for argument in self.arguments]
        for value, is_object in zip(values, self.objects, strict=True):
            if value is None or (is_object and not model.graph.alive(value)):  # type: ignore[arg-type]
                return None
        return values


@dataclass(frozen=True, slots=True)
class Alternatives:
    """Branches of a stochastic choice; a call that is None does nothing."""

    probabilities: Callable[[Scope], Sequence[float]]
    calls: tuple[PreparedCall | None, ...]

    def run(self, scope: Scope, choices: Choices, model: Model) -> Scope | None:
        """Draw a branch and run it; None if no rule was applied."""
        position = choices.choose(self.probabilities(scope))
        if position is None:
            return None
        call = self.calls[position]
        return scope if call is None else call.run(scope, choices, model)

    def can_run(self, scope: Scope, model: Model) -> bool:
        """Whether one of the branches would do something; also where it would be an error, for `run` to raise."""
        try:
            branches = zip(self.probabilities(scope), self.calls, strict=True)
            return any(
                chance > 0.0 and (call is None or call.can_run(scope, model)) for chance, call in branches
            )
        except EvaluationError:
            return True


Reward = Callable[[Scope], float]


@dataclass(frozen=True, slots=True)
class PreparedAction:
    """One action: a name of the behaviour with one value for each parameter.

    Attributes:
        values: functions that give the values of its parameters: objects may come and go.
        before: how many effects stand before the action in the file; rewards are summed in that order.
    """

    name: str
    values: tuple[tuple[str, Callable[[], Value | None]], ...]
    branches: Alternatives
    reward: Reward | None
    else_reward: Reward | None
    before: int

    def scope(self, bound: Scope) -> Scope:
        """What names stand for in the present state."""
        return {**bound, **{name: value() for name, value in self.values}} if self.values else bound


def never_acts(action: PreparedAction) -> bool:
    """Whether an action leaves every state as it is, and pays nothing."""
    return not any(action.branches.calls) and action.reward is None and action.else_reward is None


@dataclass(frozen=True, slots=True)
class PreparedClause:
    """`on find ..`.

    Attributes:
        matches: the rows of its named variables on the present state.
        holds: whether one of them is still a match.
        names: the named variables.
        weight: of a match where one of them is drawn; None where each has its turn.
    """

    matches: Callable[[], list[Row]]
    holds: Callable[[Row], bool]
    names: tuple[str, ...]
    reward: Reward | None
    ends: int
    apply: Alternatives | None
    weight: Reward | None

    def scope(self, bound: Scope, row: Row) -> Scope:
        """What names stand for at one of its matches."""
        return {**bound, **dict(zip(self.names, row, strict=True))}


Pending = tuple[Scope, PreparedClause, Row]
"""A match whose `apply` is to run, and what the names outside of it stand for."""


def run_pending(pending: Sequence[Pending], choices: Choices, model: Model) -> None:
    """Run the `apply`s of some matches, clause by clause in turn, each only if its match still is one.

    Raises:
        EvaluationError: a weight is negative, or has no value.
    """
    first = True
    for _, group in groupby(pending, key=lambda one: id(one[1])):
        turns = [(clause, clause.scope(bound, row), row) for bound, clause, row in group]
        if turns[0][0].weight is not None:
            turns = [turn for turn in turns if first or turn[0].holds(turn[2])]
            turns = turns[(place := _drawn(turns, choices)) : place + 1]
        for clause, scope, row in turns:
            if first or clause.holds(row):  # nothing can have changed before the first
                assert clause.apply is not None
                clause.apply.run(scope, choices, model)
            first = False


def _drawn(turns: Sequence[tuple[PreparedClause, Scope, Row]], choices: Choices) -> int:
    """The place of one of some matches, drawn by weight: each by its share in what is left. Behind all for none."""
    weights = [0.0 if clause.weight is None else clause.weight(scope) for clause, scope, _ in turns]
    left = reduce(add, weights, 0.0)  # `sum` rounds otherwise from Python 3.12 on
    for place, weight in enumerate(weights):
        if weight > 0.0 and choices.choose([min(weight / left, 1.0)]) is not None:
            return place
        left -= weight
    return len(turns)


@dataclass(frozen=True, slots=True)
class PreparedEach:
    """`each step ..`."""

    reward: Reward | None
    apply: Alternatives | None


@dataclass(frozen=True, slots=True)
class Component:
    """One component of an observation.

    Attributes:
        size: how many values there are.
        read: the present value, from 0.
        observation: its clause.
        at: the object that a path leads to, or whose attribute it reads, if there is one now; None of `find`.
    """

    size: int
    read: Callable[[], int]
    observation: Observation
    at: Callable[[], int | None] | None = None

    @property
    def clause(self) -> Span | None:
        """Where it is written."""
        return self.observation.span

    @property
    def number(self) -> bool:
        """Whether it is `in` a range."""
        return isinstance(self.observation, ObserveRange)


Clause = TypeVar("Clause", bound=Action | Effect | Observation)

Types = Mapping[str, str]
"""Names that a clause knows, and the classes of their objects."""


def together(
    own: Sequence[Clause], own_types: Types, shared: Sequence[Clause], shared_types: Types
) -> list[tuple[Clause, Types]]:
    """Clauses with the names that they know, in the order of the text; an agent's own first where there is no text."""
    both = [*((clause, own_types) for clause in own), *((clause, shared_types) for clause in shared)]
    starts = [clause.span.start for clause, _ in both if clause.span is not None]
    if len(starts) < len(both):
        return both
    return [both[place] for place in sorted(range(len(both)), key=starts.__getitem__)]
