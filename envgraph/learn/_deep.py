"""Agents of an experiment that are networks: PPO and DQN of Stable-Baselines3, trained on the tables of a family."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.env import EnvgraphVectorEnv
from envgraph.errors import InvalidArgument
from envgraph.learn._table_agents import ProgramFamily, TableAgent, TableFamily
from envgraph.solve.learning import Stage, StageMembers, StageResult, TrainingSettings

ROLLOUT: Final = 256
"""Maximum number of steps between two updates of PPO; with the 2,048 of SB3 a short stage has only one update."""

OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "sb3:ppo": {"n_steps": ROLLOUT},
    "sb3:dqn": {"learning_rate": 1e-3, "buffer_size": 100_000, "tau": 0.01, "target_update_interval": 1},
}
"""Options that differ from the defaults of Stable-Baselines3, for budgets of some thousand steps."""


class DeepAgent(TableAgent):
    """An agent that learns with a network of Stable-Baselines3.

    Stable-Baselines3 samples from the global generators of NumPy and PyTorch. Each new agent seeds them, so a process
    may train only one agent at a time. PyTorch uses one thread: with more, sums in another order give other results.
    """

    def __init__(self, family: TableFamily | ProgramFamily, settings: TrainingSettings, rng: Generator) -> None:
        if isinstance(family, ProgramFamily):
            raise InvalidArgument(
                f"`{settings.student}` needs tables, but the environments have too many states for tables"
            )
        super().__init__(family, settings, "python")
        import stable_baselines3
        import torch

        torch.set_num_threads(1)
        self._epsilon, self._on_policy = settings.epsilon.start, settings.student == "sb3:ppo"
        algorithm = stable_baselines3.PPO if self._on_policy else stable_baselines3.DQN
        environment, seed = self._stage_environment((0,)), int(rng.integers(2**31))
        options = {"gamma": settings.discount, "seed": seed, "device": "cpu", **OPTIONS[settings.student]}
        self._model: Any = algorithm("MlpPolicy", environment, **options)

    def train_stage(self, rng: Generator, members: StageMembers, stage: Stage) -> StageResult:
        """Train for exactly the steps of a stage: PPO in rollouts of about equal length, DQN in one call."""
        model, keeps, self._epsilon = self._model, self._on_policy and stage.learn, stage.epsilon
        _, _, per_step, per_episode, minimum = stage.factors
        log: list[tuple[float, bool, bool]] = []

        def record_step(found: dict[str, Any], _: dict[str, Any]) -> bool:
            """Record a step and decay epsilon. Return False to stop at the end of the stage; PPO stops by itself."""
            ended = bool(found["dones"][0])
            log.append((found["rewards"][0], ended, ended and found["infos"][0]["is_success"]))
            self._epsilon = max(self._epsilon * per_step * (per_episode if ended else 1.0), minimum)
            return keeps or len(log) < stage.steps

        model.set_env(self._stage_environment(members))
        model.env.seed(int(rng.integers(2**31)))
        model.exploration_rate, model.exploration_schedule = stage.epsilon, lambda _: self._epsilon  # DQN
        model.gradient_steps = int(stage.learn)  # DQN
        for part in np.array_split(range(stage.steps), -(-stage.steps // ROLLOUT) if keeps else 1):
            if self._on_policy:
                model.n_steps = model.rollout_buffer.buffer_size = len(part)
            model.learn(len(part), record_step, log_interval=None, reset_num_timesteps=False)
        totals = np.cumsum(log, axis=0, dtype=np.float64)[np.array(stage.curve_points) - 1].tolist()
        return StageResult(self._epsilon, [(reward, int(ends), int(wins)) for reward, ends, wins in totals])

    def _stage_environment(self, members: StageMembers) -> Any:
        from envgraph.sb3 import SB3VectorEnv

        options: dict[str, Any] = {"max_episode_steps": self._settings.limit, "autoreset_mode": "SameStep"}
        return SB3VectorEnv(EnvgraphVectorEnv([self._family.stages[members]], 1, observation="flat", **options))

    def _action_values(self) -> NDArray[np.float64]:
        """Return 1 for the action that the network prefers, 0 for other actions [observations, actions]."""
        members, view = self._family.members, self._model.env.envs.view
        observed = [self._family.stages[(place,)].observation for place in range(len(members))]
        seen, first = np.unique(np.concatenate(observed), return_index=True)
        actions, _ = self._model.predict(np.stack([view.from_index(int(one)) for one in seen]), deterministic=True)
        values = np.zeros((members[0].n_observations, members[0].n_actions))
        values[np.concatenate([one.observation for one in members])[first], actions] = 1.0
        return values
