"""The clauses of a behaviour, prepared to run on one engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from itertools import groupby
from operator import add
from typing import Final, Protocol, TypeVar

from envgraph.behaviour import Action, Effect, Observation, RuleCall
from envgraph.code import dataclass
from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model
from envgraph.match import Row
from envgraph.metamodel import Value
from envgraph.rewrite import REFUSALS

NameValues = Mapping[str, Value | None]
"""The values of names during a step: data values, ids of objects, or None for a missing object."""

Owner = tuple[str, Callable[[], Value | None]]
"""The name at which an observation begins, and a function that returns its object, or None if it is missing."""

MAX_REWARD: Final = 1e100
"""Largest absolute value of a clause's reward, and of a weight, so that sums, returns and squares stay finite."""


class ChoiceSource(Protocol):
    """A source of the random choices of a step, which are made in a fixed order."""

    def choose(self, probabilities: Sequence[float]) -> int | None:
        """Return the position of a sampled alternative; with the probability that is missing to 1, return None."""

    def pick(self, count: int) -> int:
        """Return the position of one of `count` >= 1 alternatives, sampled uniformly."""


PerformCall = Callable[[Sequence[Value | None], ChoiceSource, Model], Sequence[Value | None] | None]
"""A function that applies a rule or runs a unit with parameter values; returns the outputs, or None if impossible."""

CanPerform = Callable[[Sequence[Value | None]], bool]
"""A function that returns True if a rule has a match with parameter values, or a unit can succeed."""


@dataclass(frozen=True, slots=True)
class PreparedCall:
    """A call `rule(arguments)`, prepared to run.

    Attributes:
        perform: applies the rule, or runs the unit, for the values of the arguments.
        can_perform: returns True if the rule has a match for the values, or the unit can succeed.
        arguments: for each bound parameter a function that evaluates the argument in a scope.
        is_object: for each argument True if it is an object.
        outputs: the names that get the outputs.
        call: the call in the behaviour.
        calls_done: a list to which the call is appended whenever its rule or unit was applied.
        refusals: a list to which the call is appended whenever its rule was refused; None if a refusal is an error.
    """

    perform: PerformCall
    can_perform: CanPerform
    arguments: tuple[Callable[[NameValues], Value | None], ...]
    is_object: tuple[bool, ...]
    outputs: tuple[str, ...]
    call: RuleCall
    calls_done: list[RuleCall]
    refusals: list[RuleCall] | None

    def run(self, scope: NameValues, choices: ChoiceSource, model: Model) -> NameValues | None:
        """Apply the rule at one of its matches, or run the unit, and append the call to `calls_done`.

        Returns:
            The scope, extended by the outputs; None, without effect, if an argument is missing or nothing applies.
        """
        values = self._values(scope, model)
        if values is None:
            return None
        try:
            result = self.perform(values, choices, model)
        except RuleError as error:
            if self.refusals is None or error.reason not in REFUSALS:
                raise
            self.refusals.append(self.call)
            return None
        if result is None:
            return None
        self.calls_done.append(self.call)
        return {**scope, **dict(zip(self.outputs, result, strict=True))} if self.outputs else scope

    def can_run(self, scope: NameValues, model: Model) -> bool:
        """Return True if all arguments have values, and the rule has a match for them or the unit can succeed."""
        values = self._values(scope, model)
        return values is not None and self.can_perform(values)

    def _values(self, scope: NameValues, model: Model) -> list[Value | None] | None:
        """Return the values of the arguments; None if a value is missing or an object was deleted."""
        values = [argument(scope) for argument in self.arguments]
        for value, is_object in zip(values, self.is_object, strict=True):
            if value is None or (is_object and not model.graph.alive(value)):  # type: ignore[arg-type]
                return None
        return values


@dataclass(frozen=True, slots=True)
class PreparedBranches:
    """The branches of a stochastic choice; None in `calls` is the branch `nothing()`."""

    probabilities: Callable[[NameValues], Sequence[float]]
    calls: tuple[PreparedCall | None, ...]

    def run(self, scope: NameValues, choices: ChoiceSource, model: Model) -> NameValues | None:
        """Sample a branch and run it; return the extended scope, or None if no branch was sampled or its call fails."""
        position = choices.choose(self.probabilities(scope))
        if position is None:
            return None
        call = self.calls[position]
        return scope if call is None else call.run(scope, choices, model)

    def can_run(self, scope: NameValues, model: Model) -> bool:
        """Return True if a branch of positive probability is `nothing()` or can be applied.

        Return True also if its evaluation fails, so that `run` raises the error.
        """
        try:
            branches = zip(self.probabilities(scope), self.calls, strict=True)
            return any(chance > 0.0 and (call is None or call.can_run(scope, model)) for chance, call in branches)
        except EvaluationError:
            return True


Reward = Callable[[NameValues], float]


@dataclass(frozen=True, slots=True)
class PreparedAction:
    """An action of an environment: an `action` clause of the behaviour with one value for each parameter.

    Attributes:
        values: for each parameter its name, and a function that returns its current value, as objects are created and
            deleted.
        reward, else_reward: the reward if a branch was applied, and otherwise; None for no reward.
        effects_before: how many effects precede the action in the file; rewards are summed in this order.
    """

    name: str
    values: tuple[tuple[str, Callable[[], Value | None]], ...]
    branches: PreparedBranches
    reward: Reward | None
    else_reward: Reward | None
    effects_before: int

    def current_scope(self, bound: NameValues) -> NameValues:
        """Return `bound`, extended by the current values of the action's parameters."""
        return {**bound, **{name: value() for name, value in self.values}} if self.values else bound


def never_acts(action: PreparedAction) -> bool:
    """Return True if an action never changes the state and never pays a reward."""
    return not any(action.branches.calls) and action.reward is None and action.else_reward is None


@dataclass(frozen=True, slots=True)
class PreparedOnFind:
    """An `on find ..` clause, prepared to run.

    Attributes:
        matches: returns the rows of its named variables in the current state.
        still_matches: returns True if a row still is a match.
        names: the named variables.
        end: the number of the end that a match causes; 0 if the episode goes on.
        weight: the weight for sampling one match; None if all matches are applied.
    """

    matches: Callable[[], list[Row]]
    still_matches: Callable[[Row], bool]
    names: tuple[str, ...]
    reward: Reward | None
    end: int
    apply: PreparedBranches | None
    weight: Reward | None

    def match_scope(self, bound: NameValues, row: Row) -> NameValues:
        """Return `bound`, extended by the values of the named variables in a row, a match of the clause."""
        return {**bound, **dict(zip(self.names, row, strict=True))}


PendingMatch = tuple[NameValues, PreparedOnFind, Row]
"""A match whose `apply` is to run: the values of names outside the clause, the clause, and the row of the match."""


def run_pending(pending: Sequence[PendingMatch], choices: ChoiceSource, model: Model) -> None:
    """Run the `apply` of pending matches, clause by clause; skip a match that earlier ones have made invalid.

    If a clause has weights, only one of its matches, sampled by weight, is used.

    Raises:
        EvaluationError: a weight is negative, or has no value.
    """
    first = True
    for _, group in groupby(pending, key=lambda one: id(one[1])):
        turns = [(clause, clause.match_scope(bound, row), row) for bound, clause, row in group]
        if turns[0][0].weight is not None:
            turns = [turn for turn in turns if first or turn[0].still_matches(turn[2])]
            turns = turns[(place := _sample_by_weight(turns, choices)) : place + 1]
        for clause, scope, row in turns:
            if first or clause.still_matches(row):  # the first match cannot have changed
                assert clause.apply is not None
                clause.apply.run(scope, choices, model)
            first = False


def _sample_by_weight(turns: Sequence[tuple[PreparedOnFind, NameValues, Row]], choices: ChoiceSource) -> int:
    """Return the position in `turns` of a match sampled by weight; `len(turns)` if none has a positive weight."""
    weights = [0.0 if clause.weight is None else clause.weight(scope) for clause, scope, _ in turns]
    left = reduce(add, weights, 0.0)  # `sum` rounds differently from Python 3.12 on
    for place, weight in enumerate(weights):
        if weight > 0.0 and choices.choose([min(weight / left, 1.0)]) is not None:
            return place
        left -= weight
    return len(turns)


@dataclass(frozen=True, slots=True)
class PreparedEachStep:
    """An `each step ..` clause, prepared to run."""

    reward: Reward | None
    apply: PreparedBranches | None


@dataclass(frozen=True, slots=True)
class PreparedOnRefused:
    """An `on refused ..` clause, prepared to run; `end` is as in `PreparedOnFind`."""

    reward: Reward | None
    end: int


@dataclass(frozen=True, slots=True)
class ObservationComponent:
    """A component of an observation.

    Attributes:
        size: the number of values.
        read: returns the current value, from 0.
        observation: the `observe` clause.
        target_object: returns the object that the path leads to, whose attribute it reads, or of which it observes
            matches, or None if it is missing; for windows and `find` without `for`, `target_object` itself is None.
        is_range: True if the clause observes a number within a range.
        owner: the name at which the path begins, and a function that returns its object, or None if it is missing.
        words: for windows, the values in words.
    """

    size: int
    read: Callable[[], int]
    observation: Observation
    target_object: Callable[[], Value | None] | None = None
    is_range: bool = False
    owner: Owner | None = None
    words: Sequence[str] = ()


Clause = TypeVar("Clause", bound=Action | Effect | Observation)

NameClasses = Mapping[str, str]
"""The class of the object of each name that a clause can use."""


def merge_clauses(
    own: Sequence[Clause], own_types: NameClasses, shared: Sequence[Clause], shared_types: NameClasses
) -> list[tuple[Clause, NameClasses]]:
    """Merge an agent's own and the shared clauses in the order of the text, each with the classes of its names.

    Clauses without a source position keep their order, the agent's own first.
    """
    both = [*((clause, own_types) for clause in own), *((clause, shared_types) for clause in shared)]
    starts = [clause.span.start for clause, _ in both if clause.span is not None]
    if len(starts) < len(both):
        return both
    return [both[place] for place in sorted(range(len(both)), key=starts.__getitem__)]
