"""OpenEnv: a family is served to a client as tasks, `make test-integrations` installs and runs it.

It is no `test_*.py`: `make test` needs no OpenEnv.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest

import envgraph
from envgraph.search import generate

pytest.importorskip("openenv")  # modules are imported in `make test`, too, for their doctests

import requests
import uvicorn
from openenv import GenericEnvClient

pytestmark = pytest.mark.filterwarnings("default")  # theirs, not ours to fix

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "openenv_server.py"


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("openenv")
    generate("burning_forest/paper.toml", folder / "run.sqlite", overrides=["search.generations=2"])
    subprocess.run([sys.executable, "-m", "envgraph", "verify", str(folder / "run.sqlite")], check=True)
    return folder / "run.sqlite"


@pytest.fixture(scope="module")
def example() -> Any:
    spec = spec_from_file_location("openenv_server", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def address(family: Path, example: Any) -> Iterator[str]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = uvicorn.Server(uvicorn.Config(example.make_app(str(family)), port=port, log_level="error"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.05)
    yield f"http://127.0.0.1:{port}"
    server.should_exit = True
    thread.join()


def test_a_client_plays_each_member_by_names_of_actions(address: str, family: Path) -> None:
    with GenericEnvClient(base_url=address).sync() as client:
        for index, name in ((0, "E1"), (5, "E6")):
            single = envgraph.make(family, name, observation="text")
            wanted, _ = single.reset(seed=3)
            result = client.reset(seed=3, split="train", index=index)
            assert (result.observation["text"], result.done) == (wanted, False)
            done = False
            for step in range(200):
                action = (step * 7) % 4
                wanted, reward, terminated, truncated, info = single.step(action)
                result = client.step({"name": single.unwrapped.action_names[action]})
                done = terminated or truncated
                assert (result.observation["text"], result.reward, result.done) == (wanted, reward, done)
                assert result.observation["success"] == info["success"]
                if done:
                    break
            assert done
            assert client.state()["task"] == name
            assert "over" in client.step({"name": "left"}).observation["text"]


def test_a_wrong_action_is_answered_and_does_nothing(address: str) -> None:
    with GenericEnvClient(base_url=address).sync() as client:
        before = client.reset(seed=0, task="E2").observation["text"]
        result = client.step({"name": "jump"})
        assert result.observation["text"] == f"there is no action `jump`\n{before}"
        assert (result.reward, result.done, client.state()["step_count"]) == (0.0, False, 0)


def test_tasks_have_certificates_as_difficulty(address: str, family: Path, example: Any) -> None:
    environment = example.FamilyEnvironment(str(family))
    tasks = environment.list_tasks("train")
    assert [task["id"] for task in tasks] == [member.name for member in environment.members]
    assert requests.post(f"{address}/envgraph/tasks", json={"split": "train"}).json()["tasks"] == tasks
    assert environment.num_tasks("train") == len(tasks)
    assert tasks[0]["difficulty"] == environment.members[0].certificates["shortest_plan"] > 0
    with pytest.raises(IndexError):
        environment.get_task("train", len(tasks))
