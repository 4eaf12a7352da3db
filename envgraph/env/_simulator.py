"""Simulate an environment on a live engine; defines the semantics of a step."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from copy import deepcopy
from math import prod
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from envgraph.behaviour import (
    Behaviour,
    KeyIndex,
    ObjectRead,
    check_behaviour,
    indexed_classes,
    is_lost,
    object_reads,
)
from envgraph.code import dataclass
from envgraph.env._agent_order import AgentOrder, PreparedAgent
from envgraph.env._joint_steps import AgentStepper, JointStepper
from envgraph.env._observation_components import component_names
from envgraph.env._prepared_behaviour import PreparedBehaviour
from envgraph.env._prepared_clauses import ChoiceSource, PreparedEachStep, PreparedOnFind, run_pending
from envgraph.env._random_choices import UniformDraw, all_choice_sequences
from envgraph.env._size_errors import TooManyStates
from envgraph.env.scene._scene import DRAW_HINT, Painter
from envgraph.errors import LIMITS, InvalidArgument, ResolutionError, Severity
from envgraph.graph import Model, Savepoint
from envgraph.rewrite import Engine, Randomness

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CONTINUES, SUCCESS, FAILURE = 0, 1, 2


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """The result of a step.

    Attributes:
        reward: the sum of all rewards.
        terminated: 0 if the episode goes on; 1 for success, 2 for failure, -1 if it was truncated.
        observation: the index of the observation of the agent that acts next.
    """

    reward: float
    terminated: int
    observation: int


class Simulator:
    """A simulator that runs a behaviour on an engine, with the exact semantics of a step.

    The engine's state when the simulator is created is the initial state. From the first `reset` to `close` the
    simulator keeps a savepoint open, so that no other code may commit or check out.

    A step: (a) Sample a branch of the action, with the probabilities of the current state, then one match of its rule,
    and apply the rule; without a match the state does not change. (b) Run the `each step` rules in the same way. (c)
    Match all `on` clauses on the resulting state. (d) Evaluate all rewards on this state and sum them in the order of
    the file; failure takes precedence over success, and success over truncation. (e) Run the `apply`s of the clauses
    in that order, each only if its match still is one. (f) If a rule was refused, add the rewards and ends of the `on
    refused` clauses that are about it; without such a clause a refusal is an error. (g) The agent observes.

    `reward` of an action is paid if its rule was applied or the branch `nothing()` was sampled. `else reward` is paid
    if the rule had no match or was refused, or if no branch was sampled because their probabilities sum to less than 1.

    With `agent` blocks a step is the turn of one agent. The step runs the agent's block and the shared clauses, and its
    reward is that of the turn; then the next agent observes. Agents take turns block by block, within a block by key;
    agents whose object does not exist are skipped.

    Agents that act `joint_stepper` do one step: (a) Each agent that exists does its action, in the order of turns, on
    the state that earlier agents have left. (b) to (f) happen once, clause by clause in the order of the file; a clause
    of a block runs for each of its agents that existed. An agent gets the rewards of its block and of shared clauses;
    the reward of the step counts shared rewards once. A joint action combines one action of each agent in one number,
    and its observation contains all that the agents observe.

    Args:
        engine: the engine with the model, its patterns and rules.
        behaviour: the behaviour of the environment.
        keys: indices of objects over a family; None: those of the engine's model.

    Raises:
        ResolutionError: the behaviour has errors, or the model has no object for a parameter, or no agent.

    Attributes:
        all_agent_names: the names of the agents in the order of turns; () for a behaviour without `agent` blocks.
        agent_names: like `all_agent_names`, but () if agents act together.
        agents: the agents; a single one without object for a behaviour without `agent` blocks.
        joint_stepper: does the step of agents that act together; None if agents take turns.
        turn: the number of the agent that acts next; 0 if agents act together.
        action_names, observation_shape, n_observations: the actions and observations of a step.
        has_acted: True if the action of the last step applied a rule, was refused, or sampled the branch `nothing()`;
            always True if agents act together.
    """

    def __init__(self, engine: Engine, behaviour: Behaviour, keys: KeyIndex | None = None) -> None:
        behaviour = engine.library.with_functions_resolved(behaviour)
        problems = [p for p in check_behaviour(behaviour, engine) if p.severity is Severity.ERROR]
        if problems:
            raise ResolutionError(problems)
        self.engine = engine
        self.behaviour = behaviour
        self.keys = keys or KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
        self.agents = AgentOrder(behaviour, engine, self.keys)
        self._model = engine.model
        self._episode_savepoint: Savepoint | None = None
        self._episode_record: list[tuple[int, float]] = []
        self._first_created = engine.model.graph.store.next_id
        self._always_read = [one for one in object_reads(behaviour) if one.is_always_evaluated and one.callers]
        self.turn = self._first_turn = self.agents.next_turn(-1)
        self.has_acted = False
        self._painter: Painter | None = None
        agents = self.agents.prepared_agents
        self.joint_stepper: JointStepper | None = None
        if behaviour.together:
            self.joint_stepper = JointStepper(behaviour, self.agents, self._model, self.keys)
        self._steppers: list[AgentStepper] = (
            [self.joint_stepper]
            if self.joint_stepper
            else [AgentStepper(self.agents, [agent], self._model) for agent in agents]
        )
        self.all_agent_names = tuple(agent.name for agent in agents if agent.node is not None)
        self.agent_names = () if behaviour.together else self.all_agent_names

    @property
    def action_names(self) -> tuple[str, ...]:
        """Return the names of the actions of a step."""
        return (self.joint_stepper or self.agents).action_names

    @property
    def observation_shape(self) -> tuple[int, ...]:
        """Return the sizes of the components of an observation."""
        return (self.joint_stepper or self.agents).shape

    @property
    def n_observations(self) -> int:
        """Return the number of possible observations."""
        return prod(self.observation_shape)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Return distinct names for the components of an observation."""
        if self.joint_stepper is not None:
            return self.joint_stepper.observation_names
        return component_names(self.behaviour, self.keys, len(self.observation_shape))

    # --- live

    def reset(self, rng: Randomness) -> int:
        """Put the model into a start state, sampled with one random number; return the index of the observation."""
        self.close()
        self._episode_savepoint, uniform = self._model.graph.history.savepoint(), rng.random()
        self._apply_reset(UniformDraw(uniform))
        self._episode_record = [(-1, uniform)]  # -1 stands for the reset
        return self.observe()

    def step(self, action: int, rng: Randomness) -> StepOutcome:
        """Do an action, whose random choices are all decided by one random number.

        Raises:
            InvalidArgument: no episode has begun, or the action does not exist.
            RuleError: a rule matches but is refused, and no `on refused` clause is about it.
            EvaluationError: a reward has no value, or an observed object no index.
        """
        reward, terminated = self.step_without_observation(action, rng)
        return StepOutcome(reward, terminated, self.observe())

    def step_without_observation(self, action: int, rng: Randomness) -> tuple[float, int]:
        """Do a step without an observation; return the reward and the end (0, 1, 2 or -1)."""
        if self._episode_savepoint is None:
            raise InvalidArgument("no episode has begun: call `reset` first")
        uniform = rng.random()
        found = self._step(action, UniformDraw(uniform))
        self._episode_record.append((action, uniform))
        return found

    def __reduce__(self) -> tuple[Callable[..., Simulator], tuple[Any, ...]]:
        """Return the data to rebuild a simulator: initial state, actions and random numbers of the episode."""
        engine, key = self.engine, self.state_key()
        shelf = None if self._episode_savepoint is None else self._model.graph.history.undo_to(self._episode_savepoint)
        try:
            engine_copy = deepcopy(engine)
        finally:
            if shelf is not None:
                self._episode_savepoint = self._model.graph.history.redo(shelf)
        if engine.events.has_event_rules or {*engine.rules, *engine.units} != {
            *engine_copy.rules,
            *engine_copy.units,
        }:
            message = "has event rules or Python functions as rules; make a second environment instead"
            raise TypeError(f"environment `{self.behaviour.name}` cannot be copied: its engine {message}")
        return _replay, (engine_copy, self.behaviour, self.keys, self._episode_record[:], key)

    def step_with(self, action: int, uniform: float) -> StepOutcome:
        """Do a step in the model's current state, with or without an episode, decided by `uniform` in [0, 1)."""
        reward, terminated = self._step(action, UniformDraw(uniform))
        return StepOutcome(reward, terminated, self.observe())

    def reset_with(self, uniform: float) -> int:
        """Reset from the model's current state, decided by `uniform` in [0, 1); return the observation's index."""
        self._apply_reset(UniformDraw(uniform))
        return self.observe()

    def close(self) -> None:
        """End the episode: restore the initial state, and close the savepoint. Do nothing if no episode has begun."""
        if self._episode_savepoint is not None:
            self._model.graph.history.rollback(self._episode_savepoint)
            self._episode_savepoint, self._episode_record = None, []
            self.turn = self._first_turn

    def observe(self) -> int:
        """Return the index of the next agent's observation of the current state; the first component varies fastest."""
        if self.joint_stepper is not None:
            return self.joint_stepper.observation_index()
        return self.agents.observation_index(self.turn)

    def action_mask(self) -> NDArray[np.bool_]:
        """Return for each action if it would do something in the current state [actions]; all True if none would.

        See `allowed_actions`, which returns a list and does not need NumPy.
        """
        import numpy as np

        return np.array(self.allowed_actions(), np.bool_)

    def agent_action_mask(self, number: int) -> NDArray[np.bool_]:
        """Return the action mask of one agent [actions]; see `agent_allowed_actions`."""
        import numpy as np

        return np.array(self.agent_allowed_actions(number), np.bool_)

    def allowed_actions(self) -> list[bool]:
        """Return True for each action that is enabled in the current state; all True if no action is enabled.

        An action does something if a branch of it is `nothing()`, a rule that has a match, or a unit that can succeed.
        For a joint action this must be true of each agent's action, tested on the state before the step.
        """
        if self.joint_stepper is None:
            return self.agent_allowed_actions(self.turn)
        found = [True]
        for number in range(len(self.agents.prepared_agents)):
            allowed = self.agent_allowed_actions(number)
            found = [own and others for own in allowed for others in found]
        return found

    def agent_allowed_actions(self, number: int) -> list[bool]:
        """Return True for each enabled action of one agent; all True if no action is enabled.

        Of agents that act together, one whose object does not exist could do anything. One whose turn it is can do what
        needs no such object.
        """
        seat, model = self.agents.prepared_agents[number], self._model
        if self.agents.together and not self.agents.can_act(seat):
            return [True] * len(seat.actions)
        bound = seat.behaviour.bound_values
        found = [one.branches.can_run(one.current_scope(bound), model) for one in seat.actions]
        return found if any(found) else [True] * len(found)

    def state_key(self) -> tuple[int, int]:
        """Return a key that identifies the state: the model's hash and whose turn it is.

        New objects are identified by the order of their creation.
        """
        return self._model.state_hash(self._first_created), self.turn

    def non_range_components(self) -> tuple[int, ...]:
        """Return the component values, except numbers in ranges, of the next agent or of all simultaneous agents."""
        agents = self.current_stepper.acting
        components = (component for agent in agents for component in agent.behaviour.components)
        return tuple(component.read() for component in components if not component.is_range)

    def obstacle_counter(self, end: int) -> Callable[[], int]:
        """Return a function that counts the matches which must vanish before success (1) or failure (2) is possible."""
        return self.agents.prepared_agents[0].behaviour.obstacle_counter(end)

    def painter(self) -> Painter:
        """Return the painter that draws the current state; the first call creates it and binds parameters.

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
    def current_agent(self) -> PreparedAgent:
        """Return the agent that acts next; the single agent without object if the behaviour has no agents."""
        return self.agents.prepared_agents[self.turn]

    @property
    def current_stepper(self) -> AgentStepper:
        """Return the stepper of the agents that act next."""
        return self._steppers[self.turn]

    # --- all outcomes

    def reset_outcomes(self) -> Generator[float]:
        """Put the model into each start state, yield the probability, and roll back; equal states may be repeated."""
        for probability, _, _, savepoint in self.outcomes_with_savepoints(None):
            try:
                yield probability
            finally:
                self._model.graph.history.rollback(savepoint)
                self.turn = self._first_turn

    def outcomes(self, action: int) -> Generator[tuple[float, float, int]]:
        """Yield the probability, reward and end of each outcome of an action, in the order of the choices.

        The model is in the successor state while the caller handles an outcome, and is restored afterwards. Equal
        outcomes are not merged.
        """
        turn = self.turn
        for probability, reward, terminated, savepoint in self.outcomes_with_savepoints(action):
            try:
                yield probability, reward, terminated
            finally:
                self._model.graph.history.rollback(savepoint)
                self.turn = turn

    def outcomes_with_savepoints(self, action: int | None) -> Iterator[tuple[float, float, int, Savepoint]]:
        """Do each outcome of an action (None: a reset); yield probability, reward, end, and the savepoint before it.

        The caller must undo each outcome before the next: roll back to the savepoint, or shelve it.

        Raises:
            TooManyStates: the action has more than 10,000 outcomes.
        """
        turn = self.turn
        for number, choices in enumerate(all_choice_sequences()):
            if action is not None and number >= LIMITS["outcomes"]:
                name = self.action_names[action]
                raise TooManyStates.from_message(
                    self.behaviour,
                    f"action `{name}` has more than {LIMITS['outcomes']} outcomes in one state",
                    'use `engine="compiled"` or "live", which need no table; '
                    "in a unit, write `all r;` to avoid a choice",
                )
            self.turn = turn
            savepoint = self._model.graph.history.savepoint()
            try:
                if action is None:
                    self._apply_reset(choices)
                    reward, terminated = 0.0, CONTINUES
                else:
                    reward, terminated = self._step(action, choices)
            except BaseException:
                self._model.graph.history.rollback(savepoint)
                self.turn = turn
                raise
            yield choices.probability, reward, terminated, savepoint

    # --- the step

    def _apply_reset(self, choices: ChoiceSource) -> None:
        shared = self.agents.prepared_agents[0].behaviour
        shared.calls_done.clear()
        for reset in shared.resets:
            if isinstance(reset, PreparedOnFind):
                run_pending([(shared.bound_values, reset, row) for row in reset.matches()], choices, self._model)
            elif isinstance(reset, PreparedEachStep) and reset.apply is not None:
                reset.apply.run(shared.bound_values, choices, self._model)
        _check_always_read(shared, self._always_read, self._model)
        self.turn = self.agents.next_turn(-1)

    def _step(self, number: int, choices: ChoiceSource) -> tuple[float, int]:
        stepper = self.current_stepper
        reward, terminated = stepper.step(number, choices)
        for agent in stepper.acting if self._always_read and terminated == CONTINUES else ():
            if agent.behaviour.calls_done:
                _check_always_read(agent.behaviour, self._always_read, self._model)
        self.has_acted = stepper.has_acted
        self.turn = self.agents.next_turn(self.turn)
        return reward, terminated


def _replay(
    engine: Engine, behaviour: Behaviour, keys: KeyIndex, drawn: list[tuple[int, float]], key: tuple[int, int]
) -> Simulator:
    """Create a simulator and replay an episode; raise TypeError if the final state differs from `key`."""
    made = Simulator(engine, behaviour, keys)
    if behaviour.draw is not None:
        made.painter()  # finds the objects of parameters in the initial state
    rng: Any = SimpleNamespace(random=iter([uniform for _, uniform in drawn]).__next__)
    for number, (action, _) in enumerate(drawn):
        made.step_without_observation(action, rng) if number else made.reset(rng)
    if made.state_key() != key:
        message = "its model was changed from outside; copy it before `reset`"
        raise TypeError(f"`{behaviour.name}` cannot be copied in this episode: {message}")
    return made


def _check_always_read(program: PreparedBehaviour, needed: Sequence[ObjectRead], model: Model) -> None:
    """Raise an error if an object from which every step reads was deleted; the error names the rule that deleted it."""
    for each in needed:
        if is_lost(model, program.bound_values[each.name], each.cls):
            raise program.deleted_object_error(each.name, each.cls, each.what, each.span)
