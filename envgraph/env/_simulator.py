"""The step of an environment, on the live engine."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from copy import deepcopy
from math import prod
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import (
    Behaviour,
    KeyIndex,
    Reading,
    check_behaviour,
    indexed_classes,
    is_gone,
    key_attributes,
    readings,
)
from envgraph.code import dataclass
from envgraph.env._agents import Agents, Seat
from envgraph.env._observing import component_names
from envgraph.env._prepared import (
    Choices,
    Pending,
    PreparedAction,
    PreparedClause,
    PreparedEach,
    Scope,
    run_pending,
)
from envgraph.env._program import Program, worst
from envgraph.env._sampling import MOST_OUTCOMES, Draw, all_choices
from envgraph.env._tabular import allowed_or_all
from envgraph.env._together import Together
from envgraph.env._too_many import TooManyOutcomes
from envgraph.env.scene._scene import DRAW_HINT, Painter
from envgraph.errors import InvalidArgument, ResolutionError, Severity
from envgraph.graph import Model, Savepoint
from envgraph.rewrite import Engine

GOES_ON, SUCCESS, FAILURE = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a step gave.

    Attributes:
        reward: the sum of all rewards.
        terminated: 0, or the episode ended in success (1) or in failure (2), or was truncated (-1).
        observation: index of what the agent sees.
    """

    reward: float
    terminated: int
    observation: int


class Simulator:
    """Runs a behaviour on an engine, with the exact semantics of a step.

    The state of the engine when the simulator is made is the initial one. From the first `reset` to `close` the
    simulator keeps a savepoint open, so that meanwhile nothing else may commit or check out.

    A step: (a) draws a branch of the action, with probabilities as they are in that state, then one of the matches of
    its rule, and applies it; without a match the state stays. (b) `each step` rules in the same way. (c) All `on`
    clauses are matched on this one state. (d) All rewards are evaluated on it and summed in the order of the file;
    failure beats success, and that truncation. (e) The `apply`s of the clauses run in that order, each only if its
    match still is one; (f) the agent observes.

    `reward` of an action counts when its rule was applied or the branch `nothing()` was drawn, `else reward` when there
    was no match, or when the probability that is missing to 1 was drawn.

    With `agent` blocks a step is the turn of one agent: it does what its block and the shared clauses say, the reward
    is that of its turn, and then the next agent observes. Agents take turns block by block, in a block by key; one that
    is gone is passed over.

    Agents that act `together` make one step: (a) each one that is there does its action, in the order of the turns, on
    the state that those before it have left; (b) to (e) happen once, clause by clause in the order of the file, a
    clause of a block for each of its agents that were there. An agent gets what its block and what the shared clauses
    pay; the reward of the step counts what is shared once. Its action is one of each agent in one number, and its
    observation all that the agents see.

    Args:
        engine: with the model, its patterns and rules.
        behaviour: what the environment does.
        keys: indices of objects over a family; those of the engine's model alone if None.

    Raises:
        ResolutionError: the behaviour has errors, or the model has no object for a parameter, or no agent.

    Attributes:
        players: names of the agents, in the order in which they act; () for a behaviour without `agent` blocks.
        agent_names: the same, () also for agents that act together.
        agents: the same themselves; one from outside for a behaviour without `agent` blocks.
        together: makes the step of agents that act together; None where they take turns.
        turn: number of the agent that acts next; 0 where they act together.
        action_names, observation_shape, n_observations: of a step.
        did: whether the action of the last step did something: a rule was applied, or the branch `nothing()` drawn;
            True where agents act together.
    """

    def __init__(self, engine: Engine, behaviour: Behaviour, keys: KeyIndex | None = None) -> None:
        behaviour = engine.library.resolved(behaviour)
        problems = [p for p in check_behaviour(behaviour, engine) if p.severity is Severity.ERROR]
        if problems:
            raise ResolutionError(problems)
        self.engine = engine
        self.behaviour = behaviour
        self.keys = keys or KeyIndex.of(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        self.agents = Agents(behaviour, engine, self.keys)
        self._model = engine.model
        self._start: Savepoint | None = None
        self._drawn: list[tuple[int, float]] = []
        self._fresh = _first_new(engine.model, self.keys)
        self._needed = [one for one in readings(behaviour) if one.always and one.callers]
        self.turn = self._first = self.agents.after(-1)
        self.did = False
        self._painter: Painter | None = None
        self.together: Together | None = None
        if behaviour.together:
            self.together = Together(behaviour, self.agents, self._model, self.keys)
        self.players = tuple(seat.name for seat in self.agents.seats if seat.node is not None)
        self.agent_names = () if behaviour.together else self.players

    @property
    def action_names(self) -> tuple[str, ...]:
        """The names of the actions of a step."""
        return (self.together or self.agents).action_names

    @property
    def observation_shape(self) -> tuple[int, ...]:
        """Sizes of the components of the observation of a step."""
        return (self.together or self.agents).shape

    @property
    def n_observations(self) -> int:
        """How many observations of a step there are."""
        return prod(self.observation_shape)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Different names for the components of the observation of a step."""
        if self.together is not None:
            return self.together.observation_names
        return component_names(self.behaviour, self.keys, len(self.observation_shape))

    # --- live

    def reset(self, rng: np.random.Generator) -> int:
        """Go to a start state, drawn with one number; returns the observation."""
        self.close()
        self._start, uniform = self._model.graph.history.savepoint(), rng.random()
        self._begin(Draw(uniform))
        self._drawn = [(-1, uniform)]  # -1 stands for the reset
        return self.observe()

    def step(self, action: int, rng: np.random.Generator) -> Outcome:
        """Do an action, drawing one number.

        Raises:
            InvalidArgument: no episode has begun, or there is no such action.
            RuleError: a rule matches but cannot be applied.
            EvaluationError: a reward has no value, or an observed object no index.
        """
        reward, terminated = self.move(action, rng)
        return Outcome(reward, terminated, self.observe())

    def move(self, action: int, rng: np.random.Generator) -> tuple[float, int]:
        """`step` without an observation: reward and end."""
        if self._start is None:
            raise InvalidArgument("no episode has begun: call `reset` first")
        uniform = rng.random()
        found = self._step(action, Draw(uniform))
        self._drawn.append((action, uniform))
        return found

    def __reduce__(self) -> tuple[Callable[..., Simulator], tuple[Any, ...]]:
        """Return the data to rebuild a simulator: the initial state, actions and random numbers of the episode."""
        engine, key = self.engine, self.state_key()
        shelf = None if self._start is None else self._model.graph.history.shelve(self._start)
        try:
            engine_copy = deepcopy(engine)
        finally:
            if shelf is not None:
                self._start = self._model.graph.history.resume(shelf)
        if engine.events.active or {*engine.rules, *engine.units} != {*engine_copy.rules, *engine_copy.units}:
            message = "has event rules or Python functions as rules; make a second environment instead"
            raise TypeError(f"environment `{self.behaviour.name}` cannot be copied: its engine {message}")
        return _replayed, (engine_copy, self.behaviour, self.keys, self._drawn[:], key)

    def act(self, action: int, uniform: float) -> Outcome:
        """`step` in the present state of the model, whether or not an episode has begun, with a number from [0, 1)."""
        reward, terminated = self._step(action, Draw(uniform))
        return Outcome(reward, terminated, self.observe())

    def begin(self, uniform: float) -> int:
        """`reset` from the present state of the model, with a number from [0, 1)."""
        self._begin(Draw(uniform))
        return self.observe()

    def close(self) -> None:
        """Go back to the initial state and release the model."""
        if self._start is not None:
            self._model.graph.history.rollback(self._start)
            self._start, self._drawn = None, []
            self.turn = self._first

    def observe(self) -> int:
        """The index of what the agent that acts next sees of the present state; the first component varies fastest."""
        if self.together is not None:
            return self.together.observation()
        return self.agents.observation(self.turn)

    def allowed(self) -> NDArray[np.bool_]:
        """Whether each action would do something in the present state [actions]; where none would, all are True.

        That is: a branch of it is `nothing()`, a rule that has a match, or a unit that can succeed. A joint action of
        agents that act together needs that of all of them, whatever those before may do in the same step.
        """
        if self.together is None:
            return self.allowed_to(self.turn)
        found = np.ones(1, dtype=np.bool_)
        for number in range(len(self.agents.seats)):
            found = (self.allowed_to(number)[:, None] & found).ravel()
        return found

    def allowed_to(self, number: int) -> NDArray[np.bool_]:
        """`allowed` for the actions of one agent; where it is gone, all are True."""
        seat, model = self.agents.seats[number], self._model
        if not self.agents.present(seat):
            return np.ones(len(seat.actions), dtype=np.bool_)
        bound = seat.program.bound
        can = [one.branches.can_run(one.scope(bound), model) for one in seat.actions]
        return allowed_or_all(np.array(can))

    def state_key(self) -> tuple[int, int]:
        """What tells states apart: the model, and whose turn it is; of new objects the order in which they came."""
        return self._model.state_hash(self._fresh), self.turn

    def look(self) -> tuple[int, ...]:
        """The components of the observation that are no number in a range."""
        seats = self.agents.seats if self.together else (self.agents.seats[self.turn],)
        components = (component for seat in seats for component in seat.program.components)
        return tuple(component.read() for component in components if not component.number)

    def in_the_way(self, end: int) -> Callable[[], int]:
        """Counts the matches that have to go before an episode can end in success (1) or failure (2)."""
        return self.agents.seats[0].program.in_the_way(end)

    def painter(self) -> Painter:
        """Draws the states of this simulator.

        Raises:
            InvalidArgument: the behaviour has no `draw`.
        """
        draw = self.behaviour.draw
        if draw is None:
            raise InvalidArgument(f"environment `{self.behaviour.name}` has no `draw`; {DRAW_HINT}")
        if self._painter is None:
            self._painter = Painter(self._model, draw, self.behaviour.parameters)
        return self._painter

    @property
    def seat(self) -> Seat:
        """The agent that acts next; that from outside where a behaviour has no agents."""
        return self.agents.seats[self.turn]

    # --- all outcomes

    def starts(self) -> Generator[float]:
        """The probability of each start, as often as the choices can be made; meanwhile the model is in that state."""
        for probability, _, _, savepoint in self.attempts(None):
            try:
                yield probability
            finally:
                self._model.graph.history.rollback(savepoint)
                self.turn = self._first

    def outcomes(self, action: int) -> Generator[tuple[float, float, int]]:
        """Probability, reward and end of an action in the present state, in the order of the choices.

        While the caller looks at an outcome the model is in the successor state, which it may `observe`; afterwards it
        is as before. Outcomes that are the same are not put together.
        """
        turn = self.turn
        for probability, reward, terminated, savepoint in self.attempts(action):
            try:
                yield probability, reward, terminated
            finally:
                self._model.graph.history.rollback(savepoint)
                self.turn = turn

    def attempts(self, action: int | None) -> Iterator[tuple[float, float, int, Savepoint]]:
        """Yield the outcomes of an action, or the starts for None, each with a savepoint before it.

        The caller undoes each outcome before it asks for the next: it rolls back to the savepoint, or shelves it.

        Raises:
            TooManyOutcomes: there are more than 10,000 of them.
        """
        turn = self.turn
        for number, choices in enumerate(all_choices()):
            if action is not None and number >= MOST_OUTCOMES:
                raise TooManyOutcomes(self.behaviour, self.action_names[action], MOST_OUTCOMES)
            self.turn = turn
            savepoint = self._model.graph.history.savepoint()
            try:
                if action is None:
                    self._begin(choices)
                    reward, terminated = 0.0, GOES_ON
                else:
                    reward, terminated = self._step(action, choices)
            except BaseException:
                self._model.graph.history.rollback(savepoint)
                self.turn = turn
                raise
            yield choices.probability, reward, terminated, savepoint

    # --- the step

    def _action(self, number: int) -> PreparedAction:
        actions = self.agents.seats[self.turn].actions
        if not 0 <= number < len(actions):
            raise InvalidArgument(f"action {number} is not in 0..{len(actions) - 1}")
        return actions[number]

    def _begin(self, choices: Choices) -> None:
        shared = self.agents.seats[0].program
        shared.done.clear()
        for reset in shared.resets:
            if isinstance(reset, PreparedClause):
                run_pending([(shared.bound, reset, row) for row in reset.matches()], choices, self._model)
            elif reset.apply is not None:
                reset.apply.run(shared.bound, choices, self._model)
        _check_needed(shared, self._needed, self._model)
        self.turn = self.agents.after(-1)

    def _step(self, number: int, choices: Choices) -> tuple[float, int]:
        if self.together is not None:
            return self._step_together(self.together, number, choices)
        action = self._action(number)
        program, model = self.agents.seats[self.turn].program, self._model
        program.done.clear()
        scope = action.scope(program.bound)
        done = action.branches.run(scope, choices, model)
        self.did = done is not None
        for effect in program.effects:
            if isinstance(effect, PreparedEach) and effect.apply is not None:
                effect.apply.run(program.bound, choices, model)
        reward, terminated, pending = self._judge(program, action, scope, done)
        run_pending(pending, choices, self._model)
        if terminated == GOES_ON and program.done:
            _check_needed(program, self._needed, self._model)
        self.turn = self.agents.after(self.turn)
        return reward, terminated

    def _step_together(self, together: Together, number: int, choices: Choices) -> tuple[float, int]:
        if not 0 <= number < together.n_actions:
            raise InvalidArgument(f"action {number} is not in 0..{together.n_actions - 1}")
        reward, terminated = together.step(number, choices)
        self.did = True
        for seat in self.agents.seats:
            if terminated == GOES_ON and seat.program.done:
                _check_needed(seat.program, self._needed, self._model)
        return reward, terminated

    def _judge(
        self, program: Program, action: PreparedAction, scope: Scope, done: Scope | None
    ) -> tuple[float, int, list[Pending]]:
        """Reward and end of a step on the present state, and the matches whose `apply` is to run."""
        effects = program.effects
        total, terminated = 0.0, GOES_ON
        pending: list[Pending] = []
        for position in range(len(effects) + 1):
            if position == action.before:
                reward = action.else_reward if done is None else action.reward
                total += reward(scope if done is None else done) if reward else 0.0
            if position == len(effects):
                break
            effect = effects[position]
            if isinstance(effect, PreparedEach):
                total += effect.reward(program.bound) if effect.reward else 0.0
                continue
            for row in effect.matches():
                total += effect.reward(effect.scope(program.bound, row)) if effect.reward else 0.0
                terminated = worst(terminated, effect.ends)
                if effect.apply is not None:
                    pending.append((program.bound, effect, row))
        return total, terminated, pending


def _replayed(
    engine: Engine, behaviour: Behaviour, keys: KeyIndex, drawn: list[tuple[int, float]], key: tuple[int, int]
) -> Simulator:
    """Make a simulator and play an episode; raises TypeError if it ends in another state than that of the key."""
    made = Simulator(engine, behaviour, keys)
    if behaviour.draw is not None:
        made.painter()  # finds the objects of parameters in the initial state
    rng: Any = SimpleNamespace(random=iter([uniform for _, uniform in drawn]).__next__)
    for number, (action, _) in enumerate(drawn):
        made.move(action, rng) if number else made.reset(rng)
    if made.state_key() != key:
        message = "its model was changed from outside; copy it before `reset`"
        raise TypeError(f"`{behaviour.name}` cannot be copied in this episode: {message}")
    return made


def _check_needed(program: Program, needed: Sequence[Reading], model: Model) -> None:
    """Raise an error if an object that each step reads is gone: later nobody knows which rule deleted it."""
    for each in needed:
        if is_gone(model, program.bound[each.name], each.cls):
            raise program.lost(each.name, each.cls, each.what, each.span)


def _first_new(model: Model, keys: KeyIndex) -> int | None:
    """The id of the first object that a rule creates; None if objects are known by such ids in other members."""
    first = model.graph.store.next_id
    unnamed = (cls for cls in keys.keys if not key_attributes(model.metamodel, cls))
    return None if any(key >= (first,) for cls in unnamed for key in keys.of_class(cls)) else first
