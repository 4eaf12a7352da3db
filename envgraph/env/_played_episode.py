"""Play an episode step by step, by keys or buttons, and undo steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate

from envgraph.behaviour import action_keys, clause_name, key_bindings
from envgraph.code import dataclass
from envgraph.env._simulator import CONTINUES, Simulator
from envgraph.env.scene._scene import Scene
from envgraph.errors import InvalidArgument
from envgraph.graph import Savepoint


@dataclass(frozen=True, slots=True)
class PlayedStep:
    """A step of an episode that is played.

    Attributes:
        action: the number of the action.
        name: the name of the action, after that of the agent if there are several: "left: lift".
        reward: the reward of the step.
        end: 0 if the episode goes on; 1 for success, 2 for failure, -1 if it was truncated.
        reason: the clauses of the behaviour that ended the episode, or its limit of steps; "" if it goes on.
        scene: the picture after the step; None if the behaviour has no `draw` clause.
    """

    action: int
    name: str
    reward: float
    end: int
    reason: str
    scene: Scene | None


class PlayedEpisode:
    """An episode that is played on a live engine, one step after the other. Steps can be undone.

    The episode begins when the object is created. With `numpy.random.default_rng(seed).random` it has the steps of the
    Gymnasium environment after `reset(seed=seed)`. A step that is undone and repeated has the same outcome.

    Args:
        simulator: the engine and its behaviour; nothing else may change its model in the meantime.
        limit: steps after which the episode is truncated, or None.
        random: returns uniform random numbers in [0, 1): one for the reset, and one for each step.

    Raises:
        EvaluationError: the behaviour cannot be evaluated in the initial state.

    Attributes:
        simulator: the simulator.
        steps: the steps so far.
        first_scene: the picture before the first step; None if the behaviour has no `draw` clause.
        action_names: the names of the actions of one agent, by their numbers.
        bindings: the number of the action that each key does; see `key_bindings`.
    """

    def __init__(self, simulator: Simulator, limit: int | None, random: Callable[[], float]) -> None:
        self.simulator, self._limit, self._random = simulator, limit, random
        self.steps: list[PlayedStep] = []
        self.action_names = simulator.agents.action_names
        written = action_keys(simulator.behaviour, simulator.keys, simulator.engine.model.metamodel)
        self.bindings = key_bindings(self.action_names, written)
        self._clauses = {
            id(effect): clause
            for agent in simulator.agents.prepared_agents
            for effect, (clause, _) in zip(agent.behaviour.effects, agent.behaviour.effect_clauses, strict=True)
        }
        self._history = simulator.engine.model.graph.history
        self._starts: list[tuple[Savepoint, int]] = []
        if simulator.behaviour.draw is not None:
            simulator.painter()  # finds parameters in the initial state
        self.restart()

    def restart(self) -> None:
        """Begin another episode in a newly sampled start state."""
        self._uniforms = [self._random()]
        self.steps.clear()
        self.close()
        self._starts = [(self._history.savepoint(), self.simulator.turn)]
        self._choices: list[int] = []
        self.simulator.reset_with(self._uniforms[0])
        self._skip_missing_agents()
        self.first_scene = self._draw()

    def close(self) -> None:
        """Restore the initial state of the model."""
        while self._starts:
            self._roll_back()

    @property
    def uniforms(self) -> Sequence[float]:
        """Return the random number of the reset, and that of each step."""
        return self._uniforms[: len(self.steps) + 1]

    @property
    def end(self) -> int:
        """Return how the episode ended, as in `PlayedStep.end`; 0 while it goes on."""
        return self.steps[-1].end if self.steps else CONTINUES

    @property
    def totals(self) -> list[float]:
        """Return the sum of the rewards before the first step, 0, and after each step."""
        return [*accumulate((step.reward for step in self.steps), initial=0.0)]

    @property
    def scenes(self) -> list[Scene]:
        """Return the pictures before the first step and after each step; [] if the behaviour has no `draw` clause."""
        scenes = (self.first_scene, *(step.scene for step in self.steps))
        return [scene for scene in scenes if scene is not None]

    @property
    def agent(self) -> str:
        """Return the name of the agent that chooses an action next; "" for a behaviour without `agent` blocks."""
        return self.simulator.agents.prepared_agents[self._chooser].name

    @property
    def allowed(self) -> list[bool]:
        """Return True for each enabled action. If no action is enabled, all are True; after the end, all are False."""
        if self.end:
            return [False] * len(self.action_names)
        return self.simulator.agent_allowed_actions(self._chooser)

    def choose(self, action: int) -> PlayedStep | None:
        """Choose an action for `agent`. Do a step, unless other agents have to choose for the same step.

        Returns:
            The step; None if other agents have to choose first.

        Raises:
            InvalidArgument: the episode is over, or there is no such action.
            RuleError: as for `Simulator.step`. Nothing has changed then.
            EvaluationError: as for `Simulator.step`. Nothing has changed then.
        """
        self._check_action(action, len(self.action_names))
        stepper = self.simulator.joint_stepper
        if stepper is None:
            return self.step(action)
        self._choices.append(action)
        self._skip_missing_agents()
        if len(self._choices) < len(stepper.acting):
            return None
        return self.step(stepper.joint_action(self._choices))

    def step(self, action: int) -> PlayedStep:
        """Do an action of the environment. If agents act simultaneously, it combines an action of each agent.

        Raises:
            InvalidArgument, RuleError, EvaluationError: as for `choose`.
        """
        simulator, number = self.simulator, len(self.steps) + 1
        stepper = simulator.current_stepper
        self._check_action(action, stepper.n_actions)
        if len(self._uniforms) == number:
            self._uniforms.append(self._random())
        name = self._action_name(action)
        self._choices = []
        self._starts.append((self._history.savepoint(), simulator.turn))
        try:
            outcome = simulator.step_with(action, self._uniforms[number])
            end, scene = outcome.terminated, self._draw()
        except BaseException:
            self._roll_back()
            self._skip_missing_agents()
            raise
        clauses = {id(one): self._clauses[id(one)] for one in stepper.ended_by if one.end == end}
        spans = {one.span.text if one.span else clause_name(one): None for one in clauses.values()}
        reason = "; ".join(" ".join(text.split()) for text in spans)
        if not end and number == self._limit:
            end, reason = -1, f"limit {number} steps"
        done = PlayedStep(action, name, outcome.reward, end, reason, scene)
        self.steps.append(done)
        self._skip_missing_agents()
        return done

    def undo(self) -> bool:
        """Undo the choices of agents for the next step, or else the last step; return False if there are none."""
        if any(self._can_act(place) for place in range(len(self._choices))):
            self._choices = []
        elif self.steps:
            self._choices = []
            self.steps.pop()
            self._roll_back()
        else:
            return False
        self._skip_missing_agents()
        return True

    # --- parts

    @property
    def _chooser(self) -> int:
        """Return the number of the agent that chooses next; the last one if all have chosen."""
        if self.simulator.joint_stepper is None:
            return self.simulator.turn
        return min(len(self._choices), len(self.simulator.agents.prepared_agents) - 1)

    def _can_act(self, number: int) -> bool:
        agents = self.simulator.agents
        return agents.can_act(agents.prepared_agents[number])

    def _skip_missing_agents(self) -> None:
        """Choose action 0, which has no effect, for agents whose object was deleted, if agents act simultaneously.

        If none of them exists, the first one chooses, so that the episode can go on.
        """
        agents = range(len(self.simulator.agents.prepared_agents)) if self.simulator.joint_stepper else ()
        present = [self._can_act(number) for number in agents]
        while len(self._choices) < len(present) and any(present) and not present[len(self._choices)]:
            self._choices.append(0)

    def _check_action(self, action: int, count: int) -> None:
        if self.end:
            raise InvalidArgument("the episode is over", "undo the last step, or restart")
        if not 0 <= action < count:
            raise InvalidArgument(f"action {action} is not in 0..{count - 1}")

    def _action_name(self, action: int) -> str:
        agents = self.simulator.current_stepper.acting
        count, names = len(self.action_names), self.action_names
        each = [(agent.name, names[action // count**place % count]) for place, agent in enumerate(agents)]
        return ", ".join(f"{agent}: {name}" if agent else name for agent, name in each)

    def _draw(self) -> Scene | None:
        return None if self.simulator.behaviour.draw is None else self.simulator.painter().draw()

    def _roll_back(self) -> None:
        savepoint, self.simulator.turn = self._starts.pop()
        self._history.rollback(savepoint)
