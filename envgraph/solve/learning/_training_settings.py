"""Settings of the training of an agent; the defaults are the published settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields
from importlib.util import find_spec
from math import isfinite
from typing import Any, Final, Literal, get_args

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, check_known, did_you_mean

Agent = Literal["q_learning", "sarsa", "expected_sarsa", "double_q_learning"]
AGENTS: Final[tuple[Agent, ...]] = get_args(Agent)
Student = Literal["tabular", "sb3:ppo", "sb3:dqn"]
STUDENTS: Final[tuple[Student, ...]] = get_args(Student)

Ties = Literal["lowest", "random"]
Per = Literal["episode", "step"]
Reset = Literal["stage", "never"]


@dataclass(frozen=True, slots=True)
class Epsilon:
    """The exploration rate epsilon: it starts at `start` and is multiplied by `decay` down to `minimum`.

    Attributes:
        start: probability of a random action at the beginning.
        decay: factor after each finished episode or each step, see `per`.
        minimum: epsilon never falls below it.
        per: "episode" (an episode that a stage's end interrupts does not count) or "step".
        reset: back to `start` at each "stage" of a curriculum, or "never".
    """

    start: float = 1.0
    decay: float = 0.995
    minimum: float = 0.05
    per: Per = "episode"
    reset: Reset = "stage"

    def __post_init__(self) -> None:
        _check_range("epsilon.start", self.start, 0.0, 1.0)
        _check_range("epsilon.decay", self.decay, 0.0, 1.0)
        _check_range("epsilon.minimum", self.minimum, 0.0, self.start)
        _check_choice("epsilon.per", self.per, get_args(Per))
        _check_choice("epsilon.reset", self.reset, get_args(Reset))


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """The settings of tabular temporal-difference learning and of its evaluation.

    Attributes:
        agent: the target of a step's value: reward + discount * a value of the next state. "q_learning" (Watkins 1989):
            of its best action; "sarsa" (Rummery and Niranjan 1994): of the action taken there; "expected_sarsa" (van
            Seijen et al. 2009): the mean over the agent's action probabilities there. If an episode or a stage is cut,
            so that there is no next action, SARSA takes the mean as well. "double_q_learning" (van Hasselt 2010): each
            action has two values. One, chosen at random, selects the best action; its target is the other value of that
            action. The agent acts by their sum.
        learning_rate: weight of a new target in the Q-value, in (0, 1].
        discount: weight of the next state's value, in [0, 1].
        epsilon: exploration.
        steps_per_environment: length of a stage, in steps; the running episode is cut at its end.
        evaluation_episodes: number of episodes that an evaluation samples if it is not exact.
        seeds: number of training runs; the seeds are 0, 1, ...
        initial_value: every Q-value at the beginning; above the returns of a short episode it is optimistic.
        n_step: number of rewards that are summed before the next value counts, for SARSA and expected SARSA: n-step
            learning (Sutton and Barto 2018, sections 7.1 and 7.2). At the end of an episode or a stage, pending updates
            use the rewards that are available.
        ties: the action that an agent takes among several best ones, "lowest" or "random". Evaluation always takes the
            lowest.
        limit: steps after which an episode is truncated (the Q-value of the last step still bootstraps).
        checkpoint: steps between two points of a learning curve.
        student: the learner in `run_experiment`: "tabular" for an `agent`; or "sb3:ppo" or "sb3:dqn", networks of
            Stable-Baselines3, which use only the discount, the lengths, the limit and, for DQN, epsilon.

    Raises:
        InvalidArgument: a value is outside its range.

    >>> TrainingSettings(steps_per_environment=10_000).epsilon.decay
    0.995
    """

    agent: Agent = "q_learning"
    learning_rate: float = 0.1
    discount: float = 0.99
    epsilon: Epsilon = field(default_factory=Epsilon)
    steps_per_environment: int = 50_000
    evaluation_episodes: int = 3_000
    seeds: int = 30
    initial_value: float = 0.0
    n_step: int = 1
    ties: Ties = "lowest"
    limit: int = 200
    checkpoint: int = 1_000
    student: Student = "tabular"

    def __post_init__(self) -> None:
        _check_choice("agent", self.agent, AGENTS)
        _check_choice("student", self.student, STUDENTS)
        if self.student != "tabular" and not find_spec("stable_baselines3"):
            raise InvalidArgument(f"`{self.student}` needs Stable-Baselines3: pip install 'envgraph[sb3]'")
        _check_range("learning_rate", self.learning_rate, 0.0, 1.0)
        if self.learning_rate == 0:
            raise InvalidArgument("`learning_rate` must be positive")
        _check_range("discount", self.discount, 0.0, 1.0)
        _check_choice("ties", self.ties, get_args(Ties))
        for name in ("n_step", "steps_per_environment", "evaluation_episodes", "seeds", "limit", "checkpoint"):
            _check_positive(name, getattr(self, name))
        if self.n_step > 1 and "sarsa" not in self.agent:  # Sutton and Barto 2018, section 7.3
            message = f"`n_step` above 1 is for `sarsa` and `expected_sarsa`, not `{self.agent}`"
            raise InvalidArgument(message, "set `n_step = 1`, or choose `sarsa` or `expected_sarsa`")
        if not isfinite(self.initial_value):
            raise InvalidArgument(f"`initial_value` is {self.initial_value}, but must be finite")

    @classmethod
    def from_spec(cls, spec: object, **overrides: Any) -> TrainingSettings:
        """Return the settings of the section `[training]` of a family file.

        Args:
            spec: a mapping, or an object with attributes, of the names above; missing values and None keep the default.
                `epsilon` is a mapping or object as well.
            overrides: values with priority over the spec, such as the `limit` of an environment; None is ignored.

        Raises:
            InvalidArgument: a value is outside its range, or a mapping has an unknown key.

        >>> TrainingSettings.from_spec({"seeds": 5, "epsilon": {"minimum": 0.1}}, limit=50).epsilon.minimum
        0.1
        """
        values = _given_fields(spec, cls) | _given_fields(overrides, cls)
        epsilon = values.get("epsilon")
        if epsilon is not None and not isinstance(epsilon, Epsilon):
            values["epsilon"] = Epsilon(**_given_fields(epsilon, Epsilon))
        return cls(**values)


def _given_fields(spec: object, cls: type[Any]) -> dict[str, Any]:
    """Return the values, except None, that a mapping or object has for fields of a dataclass; refuse unknown keys."""
    names = tuple(one.name for one in fields(cls))
    if isinstance(spec, Mapping):
        for key in spec:
            check_known(key, names, f"unknown training setting `{key}`")
    found = {name: spec.get(name) if isinstance(spec, Mapping) else getattr(spec, name, None) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InvalidArgument(f"`{name}` is {value!r}, it must be a number from {low} to {high}")


def _check_positive(name: str, value: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InvalidArgument(f"`{name}` is {value!r}, it must be a whole number of at least 1")


def _check_choice(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        hint = did_you_mean(str(value), known)
        names = " or ".join(repr(one) for one in known)
        raise InvalidArgument(f"`{name}` is {value!r}, it must be {names}", hint)
