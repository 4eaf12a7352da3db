"""The step of agents that act simultaneously, and the observation of a policy that controls all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, reduce
from itertools import chain, product
from math import prod
from operator import add

from envgraph.behaviour import Behaviour, Effect, KeyIndex
from envgraph.code import dataclass
from envgraph.env._agents import Agents, Seat
from envgraph.env._observing import joint_component_names
from envgraph.env._prepared import Choices, Component, Pending, PreparedClause, PreparedEach, run_pending
from envgraph.env._program import Program, worst
from envgraph.errors import LIMITS, Diagnostic, EvaluationError, ResolutionError
from envgraph.graph import Model


@dataclass(frozen=True, slots=True)
class Clause:
    """A prepared effect for one agent.

    Attributes:
        seat: the number of the agent; 0 for shared effects.
        shared: True if the effect stands outside of `agent` blocks.
    """

    seat: int
    shared: bool
    program: Program
    effect: PreparedEach | PreparedClause


@dataclass(frozen=True, slots=True)
class Move:
    """The reward of one agent's action, and how many of the agent's clauses precede the action in the file."""

    seat: int
    paid: float
    before: int


class Together:
    """A stepper of joint actions; the docstring of `Simulator` defines the step.

    A joint action is a number whose digits are the agents' actions; the first agent's action varies fastest.

    Args:
        behaviour: a behaviour whose agents act together.
        agents: all agents of the family, which must exist in the model.
        model: the state.
        keys: the indices of objects over the family.

    Raises:
        ResolutionError: the model lacks an agent that another member of the family has.

    Attributes:
        rewards: the reward of each agent in the last step; 0.0 for agents that did not exist.
        shape: the sizes of the components that all agents observe: each agent's own ones, then the shared ones.
        observation_names: the names of these components: "left at", "right at", .. "parcel at".
    """

    def __init__(self, behaviour: Behaviour, agents: Agents, model: Model, keys: KeyIndex) -> None:
        check_complete(behaviour, model, keys)
        self._agents, self._model = agents, model
        self._seats: Sequence[Seat] = agents.seats
        self._clauses = _in_order(agents.seats)
        self.rewards = (0.0,) * len(agents.seats)
        parts = [part for seat in agents.seats for part in _parts(seat.program, shared=False)]
        parts += _parts(agents.seats[0].program, shared=True)
        self.observation_names = joint_component_names(
            behaviour, keys, [(seat.name, seat.block) for seat in agents.seats]
        )
        self.shape = tuple(part.size for part in parts)
        self._reads = [(part.read, prod(self.shape[:place])) for place, part in enumerate(parts)]

    @property
    def n_actions(self) -> int:
        """Return the number of joint actions."""
        return int(len(self._agents.action_names) ** len(self._seats))

    @cached_property
    def action_names(self) -> tuple[str, ...]:
        """Return the names of the joint actions: "left: lift, right: wait".

        Raises:
            EvaluationError: the number of joint actions is too large.
        """
        return joint_names([seat.name for seat in self._seats], self._agents.action_names)

    def digits(self, number: int) -> list[int]:
        """Return the number of each agent's action in the joint action with this number."""
        found, base = [], len(self._agents.action_names)
        for _ in self._seats:
            number, digit = divmod(number, base)
            found.append(digit)
        return found

    def number(self, actions: Sequence[int]) -> int:
        """Return the number of the joint action that consists of these actions, one for each agent."""
        base = len(self._agents.action_names)
        return sum(action * base**place for place, action in enumerate(actions))

    def observation(self) -> int:
        """Return the index of the combined observation of all agents in the current state."""
        return sum(read() * weight for read, weight in self._reads)

    def step(self, number: int, choices: Choices) -> tuple[float, int]:
        """Do a joint action except for missing agents; return total reward and end, and set `rewards` by agent."""
        there = [self._agents.present(seat) for seat in self._seats]
        clauses = [clause for clause in self._clauses if clause.shared or there[clause.seat]]
        for seat in self._seats:
            seat.program.done.clear()
        done = [
            self._do(place, action, choices)
            for place, action in enumerate(self.digits(number))
            if there[place]
        ]
        for clause in clauses:
            if isinstance(clause.effect, PreparedEach) and clause.effect.apply is not None:
                clause.effect.apply.run(clause.program.bound, choices, self._model)
        pending: list[Pending] = []
        judged = [(clause, *_judged(clause, pending)) for clause in clauses]
        moves = [move() for move in done]
        gained = [(clause, gains) for clause, gains, _ in judged]
        paid = {move.seat: _total(move, gained, common=True) for move in moves}
        self.rewards = tuple(paid.get(place, 0.0) for place in range(len(self._seats)))
        run_pending(pending, choices, self._model)
        return _of_all(moves, paid, gained), reduce(worst, (ends for *_, ends in judged), 0)

    def _do(self, place: int, number: int, choices: Choices) -> Callable[[], Move]:
        """Do one agent's action; return a callback that evaluates its reward later, after all agents have acted."""
        program, action = self._seats[place].program, self._seats[place].actions[number]
        scope = action.scope(program.bound)
        done = action.branches.run(scope, choices, self._model)
        reward = action.else_reward if done is None else action.reward
        return lambda: Move(place, reward(scope if done is None else done) if reward else 0.0, action.before)


def _judged(clause: Clause, pending: list[Pending]) -> tuple[list[float], int]:
    """Return the rewards and the end of a clause in the current state; append matches to apply to `pending`."""
    effect, bound = clause.effect, clause.program.bound
    if isinstance(effect, PreparedEach):
        return [effect.reward(bound)] if effect.reward else [], 0
    rows = effect.matches()
    if effect.apply is not None:
        pending += [(bound, effect, row) for row in rows]
    gains = [effect.reward(effect.scope(bound, row)) for row in rows] if effect.reward else []
    return gains, effect.ends if rows else 0


def _total(move: Move, gained: Sequence[tuple[Clause, list[float]]], *, common: bool) -> float:
    """Return the reward of one agent, summed in the order of the text, with shared rewards if `common`."""
    parts = [
        gains if common or not clause.shared else []
        for clause, gains in gained
        if clause.shared or clause.seat == move.seat
    ]
    parts.insert(move.before, [move.paid])
    return reduce(add, chain.from_iterable(parts), 0.0)  # `sum` rounds differently from Python 3.12 on


def _of_all(
    moves: Sequence[Move], paid: dict[int, float], gained: Sequence[tuple[Clause, list[float]]]
) -> float:
    """Return the reward of all agents, in which each shared reward is counted once, also if no agent exists."""
    if not moves:
        return reduce(add, chain.from_iterable(gains for _, gains in gained), 0.0)
    return reduce(add, (_total(move, gained, common=False) for move in moves[1:]), paid[moves[0].seat])


def _in_order(seats: Sequence[Seat]) -> tuple[Clause, ...]:
    """Return the prepared effects of all agents, in the order of the text."""
    found = []
    written = [
        [*zip((effect for effect, _ in seat.program.asked), seat.program.shared, strict=True)]
        for seat in seats
    ]
    for number, place in in_order(written):
        program = seats[number].program
        found.append(Clause(number, program.shared[place], program, program.effects[place]))
    return tuple(found)


def in_order(written: Sequence[Sequence[tuple[Effect, bool]]]) -> list[tuple[int, int]]:
    """Order the effects of all agents by the text: a block's effect once for each of its agents, a shared one once.

    Args:
        written: for each agent its effects, each with True if it is shared.

    Returns:
        Pairs of the agent's number and the position of the effect among the agent's effects.
    """
    found = [
        (effect.span.start if effect.span is not None else int(shared), number, place)
        for number, own in enumerate(written)
        for place, (effect, shared) in enumerate(own)
        if not (shared and number)
    ]
    return [(number, place) for _, number, place in sorted(found)]


def joint_names(agents: Sequence[str], actions: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all joint actions; the action of the first agent varies fastest.

    Raises:
        EvaluationError: the number of joint actions is too large.
    """
    count = len(actions) ** len(agents)
    if count > LIMITS["actions"]:
        message = f"{count:,} joint actions of all agents, but at most {LIMITS['actions']:,} are possible"
        raise EvaluationError(
            message, None, "use `envgraph.make_parallel`, which takes one action for each agent"
        )
    each = [[f"{agent}: {action}" for action in actions] for agent in reversed(agents)]
    return tuple(", ".join(reversed(chosen)) for chosen in product(*each))


def _parts(program: Program, shared: bool) -> list[Component]:
    flags = zip(program.components, program.shared_components, strict=True)
    return [part for part, is_shared in flags if is_shared == shared]


def check_complete(behaviour: Behaviour, model: Model, keys: KeyIndex) -> None:
    """Raise ResolutionError if a member lacks an agent of its family; joint actions must mean the same in all."""
    problems = [
        Diagnostic(
            "missing-agent",
            f"agents that act together must exist in every member of a family; this one has no `{agent.cls}` {shown}",
            agent.cls_span or agent.span,
            "remove `together`, so that agents take turns, or remove rules that create or delete agents",
        )
        for agent in behaviour.agents
        for shown in _missing(agent.cls, model, keys)
    ]
    if problems:
        raise ResolutionError(problems)


def _missing(cls: str, model: Model, keys: KeyIndex) -> Iterator[str]:
    for key, node in zip(keys.of_class(cls), keys.objects(model, cls), strict=True):
        if node is None:
            yield ", ".join(map(str, key))
