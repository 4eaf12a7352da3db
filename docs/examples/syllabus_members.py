"""A schedule of envgraph as a curriculum of Syllabus, whose tasks are the members of a family.

pip install envgraph syllabus-rl matplotlib
envgraph generate burning_forest/paper.toml --name fires
python syllabus_members.py fires E1 E2 E3
"""

from __future__ import annotations

import sys
from typing import Any

import gymnasium
import numpy as np
from syllabus.core import Curriculum, GymnasiumSyncWrapper, TaskWrapper, make_multiprocessing_curriculum
from syllabus.task_space import DiscreteTaskSpace

import envgraph
from envgraph.env.schedules import Outcomes, Schedule, named_schedule


class Members(TaskWrapper):
    """The members of a family as tasks."""

    def __init__(self, env: gymnasium.Env, names: list[str]) -> None:
        super().__init__(env)
        self.task_space = DiscreteTaskSpace(len(names), names)

    def change_task(self, new_task: str) -> None:
        self.env.reset(options={"variant": new_task})  # for all following episodes
        super().change_task(new_task)

    def _task_completion(self, observation: Any, reward: Any, terminated: bool, truncated: bool, info: Any) -> float:
        return float(info["success"])


class ScheduledTasks(Curriculum):
    """A schedule as a curriculum."""

    def __init__(self, schedule: Schedule, task_space: DiscreteTaskSpace, rng: np.random.Generator) -> None:
        super().__init__(task_space)
        self.schedule, self.rng = schedule, rng

    def sample(self, k: int = 1) -> list[int]:
        return self.schedule.ask(k, self.rng).members.tolist()

    def update_on_episode(
        self, episode_return: float, length: int, task: int, progress: float, env_id: int | None = None
    ) -> None:
        super().update_on_episode(episode_return, length, task, progress, env_id)
        result = progress, episode_return, length
        self.schedule.tell(Outcomes(np.array([task]), *(np.array([one]) for one in result)))


def main() -> None:
    family, *names = sys.argv[1:]
    env = Members(envgraph.make(family, names[0]), names)
    schedule = named_schedule("learning_progress", len(names))
    curriculum = make_multiprocessing_curriculum(ScheduledTasks(schedule, env.task_space, np.random.default_rng(0)))
    env = GymnasiumSyncWrapper(env, env.task_space, curriculum.components)
    played = set()
    for _ in range(12):
        played.add(env.reset()[1]["variant"])
        while not any(env.step(env.action_space.sample())[2:4]):
            pass
    curriculum.stop()
    print("played", *sorted(played))


if __name__ == "__main__":
    main()
