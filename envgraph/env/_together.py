"""The step of agents that act together, and what one observer sees who plays all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from math import prod

from envgraph.behaviour import Behaviour
from envgraph.code import dataclass
from envgraph.env._agents import Agents, Seat
from envgraph.env._keys import KeyIndex
from envgraph.env._prepared import Choices, Component, PreparedAction, PreparedClause, PreparedEach, Scope
from envgraph.env._program import Program
from envgraph.errors import Diagnostic, EvaluationError, ResolutionError
from envgraph.graph import Model
from envgraph.match import Row

MOST_JOINT_ACTIONS = 100_000
"""As many as an agent may have."""

Pending = list[tuple[Program, PreparedClause, Row]]


@dataclass(frozen=True, slots=True)
class Clause:
    """An effect of one agent; a shared one is that of the first.

    Attributes:
        seat: number of the agent.
        place: of the effect among those of the agent.
    """

    seat: int
    place: int
    program: Program
    shared: bool

    @property
    def effect(self) -> PreparedEach | PreparedClause:
        """The effect, ready to run."""
        return self.program.effects[self.place]


class Together:
    """Makes a step of one action of each agent; what a step is, says the docstring of `Simulator`.

    A joint action is a number whose digits are the actions of the agents, that of the first varies fastest.

    Args:
        behaviour: whose agents act together.
        agents: all that the family has are in the model.
        model: the state.
        keys: the indices of objects over the family.

    Raises:
        ResolutionError: the model lacks an agent that another member of the family has.

    Attributes:
        rewards: of the last step, by agent; 0.0 of those that were not there.
        shape: sizes of the components of what an observer of all sees: those of each agent's own, then the shared ones.
    """

    def __init__(self, behaviour: Behaviour, agents: Agents, model: Model, keys: KeyIndex) -> None:
        _check_complete(behaviour, model, keys)
        self._agents, self._model = agents, model
        self._seats: Sequence[Seat] = agents.seats
        self._clauses = _in_order(agents.seats)
        self.rewards = (0.0,) * len(agents.seats)
        parts = [part for seat in agents.seats for part in _parts(seat.program, shared=False)] + _parts(
            agents.seats[0].program, shared=True
        )
        self.shape = tuple(part.size for part in parts)
        self._reads = [(part.read, prod(self.shape[:place])) for place, part in enumerate(parts)]

    @property
    def n_actions(self) -> int:
        """How many joint actions there are."""
        return int(len(self._agents.action_names) ** len(self._seats))

    @cached_property
    def action_names(self) -> tuple[str, ...]:
        """Of the joint actions: "left: lift, right: wait".

        Raises:
            EvaluationError: there are too many.
        """
        if self.n_actions > MOST_JOINT_ACTIONS:
            message = f"{self.n_actions:,} actions of all agents together, at most {MOST_JOINT_ACTIONS:,} are possible"
            raise EvaluationError(message, None, "`envgraph.make_parallel` has an action for each agent")
        names = self._agents.action_names
        return tuple(
            ", ".join(
                f"{seat.name}: {names[digit]}"
                for seat, digit in zip(self._seats, self.digits(number), strict=True)
            )
            for number in range(self.n_actions)
        )

    def digits(self, number: int) -> list[int]:
        """The actions of the agents that a joint action has."""
        found, base = [], len(self._agents.action_names)
        for _ in self._seats:
            number, digit = divmod(number, base)
            found.append(digit)
        return found

    def number(self, actions: Sequence[int]) -> int:
        """The joint action of some actions, one for each agent."""
        base = len(self._agents.action_names)
        return sum(action * base**place for place, action in enumerate(actions))

    def observation(self) -> int:
        """What an observer of all agents sees, as an index."""
        return sum(read() * weight for read, weight in self._reads)

    def step(self, number: int, choices: Choices) -> tuple[float, int]:
        """Make a step of a joint action: the reward of all agents together, and the end; `rewards` has each one's."""
        actions = [seat.actions[digit] for seat, digit in zip(self._seats, self.digits(number), strict=True)]
        there = [self._agents.present(seat) for seat in self._seats]
        clauses = [clause for clause in self._clauses if clause.shared or there[clause.seat]]
        for seat in self._seats:
            seat.program.done.clear()
        moves = [
            self._move(seat.program, action, choices) if present else None
            for seat, action, present in zip(self._seats, actions, there, strict=True)
        ]
        for clause in clauses:
            effect = clause.effect
            if isinstance(effect, PreparedEach) and effect.apply is not None:
                effect.apply.run(clause.program.bound, choices, self._model)
        gains: dict[tuple[int, int], list[float]] = {}
        terminated, pending = 0, list[tuple[Program, PreparedClause, Row]]()
        for clause in clauses:
            gained, ends = _judge(clause, pending)
            gains[clause.seat, clause.place] = gained
            terminated = max(terminated, ends)
        total = self._pay(actions, moves, gains)
        for position, (program, found, row) in enumerate(pending):
            assert found.apply is not None
            if position == 0 or found.holds(row):  # nothing can have changed before the first
                found.apply.run(found.scope(program.bound, row), choices, self._model)
        return total, terminated

    def _move(self, program: Program, action: PreparedAction, choices: Choices) -> tuple[Scope, Scope | None]:
        """Do the action of one agent: the names that it knew before, and what it did, if anything."""
        scope = action.scope(program.bound)
        return scope, action.branches.run(scope, choices, self._model)

    def _pay(
        self,
        actions: Sequence[PreparedAction],
        moves: Sequence[tuple[Scope, Scope | None] | None],
        gains: dict[tuple[int, int], list[float]],
    ) -> float:
        """Sum the rewards of each agent in the order of the text, and those of all: what is shared counts once."""
        shared = [place for place, shared in enumerate(self._seats[0].program.shared) if shared]
        rewards, total, counted = [], 0.0, False
        for number, (seat, action, move) in enumerate(zip(self._seats, actions, moves, strict=True)):
            if move is None:
                rewards.append(0.0)
                continue
            scope, done = move
            reward = action.else_reward if done is None else action.reward
            of_action = [reward(scope if done is None else done)] if reward else []
            everything, own, common = list[float](), list[float](), iter(shared)
            for place, is_shared in enumerate([*seat.program.shared, False]):
                if place == action.before:
                    everything += of_action
                    own += of_action
                if place < len(seat.program.shared):
                    gained = gains[(0, next(common)) if is_shared else (number, place)]
                    everything += gained
                    own += [] if is_shared else gained
            rewards.append(sum(everything, 0.0))
            total += sum(own, 0.0) if counted else rewards[-1]
            counted = True
        self.rewards = tuple(rewards)
        if not counted:
            return sum((gain for place in shared for gain in gains[0, place]), 0.0)
        return total


def _judge(clause: Clause, pending: Pending) -> tuple[list[float], int]:
    """The rewards of a clause on the present state, and the end; matches whose `apply` is to run go to `pending`."""
    effect, program = clause.effect, clause.program
    if isinstance(effect, PreparedEach):
        return [effect.reward(program.bound)] if effect.reward else [], 0
    rows = effect.matches()
    if effect.apply is not None:
        pending += [(program, effect, row) for row in rows]
    gained = [effect.reward(effect.scope(program.bound, row)) for row in rows] if effect.reward else []
    return gained, effect.ends if rows else 0


def _in_order(seats: Sequence[Seat]) -> tuple[Clause, ...]:
    """The effects in the order of the text, one of a block for each of its agents in turn, a shared one once."""
    found = []
    for number, seat in enumerate(seats):
        for place, (written, _) in enumerate(seat.program.asked):
            shared = seat.program.shared[place]
            if not (shared and number):
                start = written.span.start if written.span is not None else int(shared)
                found.append((start, number, place, Clause(number, place, seat.program, shared)))
    return tuple(clause for *_, clause in sorted(found, key=lambda one: one[:3]))


def _parts(program: Program, shared: bool) -> list[Component]:
    flags = zip(program.components, program.shared_components, strict=True)
    return [part for part, is_shared in flags if is_shared == shared]


def _check_complete(behaviour: Behaviour, model: Model, keys: KeyIndex) -> None:
    """See that a member has all the agents of its family: else its joint actions would not be those of the others."""
    problems = [
        Diagnostic(
            "missing-agent",
            f"agents that act together are the same in all members of a family: this one has no `{agent.cls}` {shown}",
            agent.cls_span or agent.span,
            "let them take turns, or keep rules from adding and removing agents",
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
