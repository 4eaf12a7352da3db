"""Environments with more observations than there are numbers of 64 bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import envgraph
from envgraph.errors import EnvgraphError

FILES = {
    "a.metamodel": """
metamodel a
class Room { contains Lamp[*] lamps }
@key(x) class Lamp { int x
bool on = false }
""",
    "a.model": """
import "a.metamodel"
model m : a { room : Room { lamps = grid lamp { legend o = Lamp column x rows "%s" } } }
""",
    "a.query": 'package a\nimport "a.metamodel"\npattern dark(lamp : Lamp) { Lamp.on(lamp, false); }',
    "a.rules": """
package a
import "a.query"
rule light(lamp : Lamp) { lhs { find dark(lamp); } modify { set lamp.on = true; } }
""",
    "a.environment": """
import "a.rules"
environment A() {
    action light(lamp : Lamp) = light(lamp)
    on neg find dark(_) reward 1.0 terminate success
    observe lamp.on for lamp : Lamp
    draw grid Lamp at (x, x)
    limit 90 steps
}
""",
    "family.toml": """
model = "a.model"
environment = "a.environment"
measures.dark = { kind = "count", of = "a.dark" }
mutation.rules = ["a.light"]
""",
}
LAMPS = 70


@pytest.fixture
def domain(tmp_path: Path) -> str:
    for name, text in FILES.items():
        Path(tmp_path, name).write_text(text.replace("%s", "o" * LAMPS))
    return str(tmp_path)


@pytest.mark.parametrize("observation", ["multi", "flat", "dict", "image", "graph", "text"])
def test_observations_without_a_number_work_beyond_the_index_limit(domain: str, observation: str) -> None:
    seen: dict[str, list[Any]] = {}
    for engine in ("compiled", "live"):
        env = envgraph.make(domain=domain, observation=observation, engine=engine)
        seen[engine] = [env.reset(seed=0)[0], env.step(69)[0], env.step(3)[0]]
    for one, other in zip(seen["compiled"], seen["live"], strict=True):
        np.testing.assert_equal(one, other)
    last: Any = seen["live"][-1]
    if observation == "multi":
        assert last.shape == (LAMPS,) and np.flatnonzero(last).tolist() == [3, 69]


def test_vector_observations_work_beyond_the_index_limit(domain: str) -> None:
    envs = envgraph.make_vec(domain=domain, num_envs=2, observation="multi")
    envs.reset(seed=0)
    seen = envs.step(np.array([69, 0]))[0]
    assert [np.flatnonzero(row).tolist() for row in seen] == [[69], [0]]


@pytest.mark.parametrize("engine", ["compiled", "live", None])
def test_index_observation_beyond_the_limit_is_refused_with_alternatives(domain: str, engine: Any) -> None:
    with pytest.raises(EnvgraphError, match=r"1.18e\+21 observations cannot be numbered: the maximum") as caught:
        envgraph.make(domain=domain, engine=engine)
    assert 'use `observation="flat"`, "multi", "dict", "image", "graph" or "text"' in str(caught.value)


def test_table_with_too_many_observations_is_refused(domain: str) -> None:
    with pytest.raises(EnvgraphError, match="observations, but a table can have at most 9,223,372"):
        envgraph.make(domain=domain, engine="table", observation="flat")
