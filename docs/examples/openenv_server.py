"""Serve a family to language models: an OpenEnv server whose tasks are the members.

    pip install envgraph openenv
    envgraph generate burning_forest/paper.toml --name fires && envgraph verify fires
    envgraph export fires --format family -o fires.json
    python openenv_server.py fires.json 8000

`reset` takes the `index` of a member, from 0 for the easiest, or its name as `task`; without both it takes the target.
The difficulty of a task is a certificate, the number of steps of the shortest plan.
"""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

from openenv.core.env_server import Action, Environment, Observation, State, create_fastapi_app

import envgraph
from envgraph.search import open_family

SPLIT = "train"


class NamedAction(Action):
    """An action by its name, as a text lists it after `actions:`."""

    name: str


class Text(Observation):
    """A state in words, or what is wrong with an action; `success` is True at the end of an episode that succeeded."""

    text: str
    success: bool = False


class FamilyEnvironment(Environment[NamedAction, Text, State]):
    """The members of a family; a client changes between them by `reset`."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self, family: str) -> None:
        super().__init__()
        self.members = open_family(family).members
        self.env = envgraph.make(family, observation="text")
        self.names: tuple[str, ...] = self.env.unwrapped.action_names
        self._state, self.text, self.playing = State(), "", False

    def list_splits(self) -> list[str]:
        return [SPLIT]

    def list_tasks(self, split: str) -> list[dict[str, Any]]:
        return [self.get_task(split, index) for index in range(len(self.members))]

    def num_tasks(self, split: str) -> int:
        return len(self.members)

    def get_task(self, split: str, index: int) -> dict[str, Any]:
        member = self.members[index]
        certificates = dict(member.certificates)
        return {
            "id": member.name,
            "index": index,
            "difficulty": certificates.get("shortest_plan"),
            "certificates": certificates,
        }

    def reset(self, seed: int | None = None, episode_id: str | None = None, **task: Any) -> Text:
        index = task.get("index")
        name = task.get("task", self.members[-1 if index is None else index].name)
        self.text, _ = self.env.reset(seed=seed, options={"variant": name})
        self.playing = True
        self._state = State(episode_id=episode_id, step_count=0, task=name)
        return Text(text=self.text)

    def step(self, action: NamedAction, timeout_s: float | None = None, **_: Any) -> Text:
        if not self.playing:
            return Text(text="the episode is over: reset the environment", done=True)
        if action.name not in self.names:
            return Text(text=f"there is no action `{action.name}`\n{self.text}", reward=0.0)
        self.text, reward, terminated, truncated, info = self.env.step(self.names.index(action.name))
        self._state.step_count += 1
        self.playing = not (terminated or truncated)
        return Text(text=self.text, reward=float(reward), done=not self.playing, success=info["success"])

    @property
    def state(self) -> State:
        return self._state


def make_app(family: str) -> Any:
    """Return the web application that serves a family file or run."""
    return create_fastapi_app(
        partial(FamilyEnvironment, family), NamedAction, Text, max_concurrent_envs=64, env_name="envgraph"
    )


if __name__ == "__main__":
    import uvicorn

    uvicorn.run(make_app(sys.argv[1]), port=int(sys.argv[2]))
