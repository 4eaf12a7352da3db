"""Measures of one model that are computed of its objects, or of its states."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.errors import LoadError
from envgraph.graph import model_to_json
from envgraph.search import Domain, Family, IndividualMeasure, certificates, generate

KINDS = ("random_success", "optimal_return", "shortest_plan", "distance")
GIVEN = [f"measures.{kind}={{ kind = '{kind}', otherwise = 0 }}" for kind in KINDS]
DIVERSITY = "diversity={ of = 'random_success', bins = 5 }"


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family:
    path = tmp_path_factory.mktemp("made") / "run.sqlite"
    given = [*GIVEN, DIVERSITY, "limit=40", "samples.cover={ random_success = 4 }", "samples.attempts=10"]
    return generate("burning_forest", path, samples=5, overrides=given)


def walked(tabular: Tabular, limit: int) -> float:
    """How likely a random walk succeeds, by carrying probabilities forward."""
    at, done = np.zeros(tabular.n_states), 0.0
    np.add.at(at, tabular.start_states, tabular.start_probability)
    for _ in range(limit):
        flow = at[:, None, None] * tabular.probability / tabular.n_actions
        done += flow[tabular.terminated == 1].sum()
        at = np.zeros(tabular.n_states)
        np.add.at(at, tabular.next_state, np.where(tabular.terminated == 0, flow, 0.0))
    return float(done)


def best(tabular: Tabular, limit: int) -> float:
    """The greatest return within so many steps, by backward induction."""
    value = np.zeros(tabular.n_states)
    for _ in range(limit):
        then = np.where(tabular.terminated == 0, value[tabular.next_state], 0.0)
        value = (tabular.probability * (tabular.reward + then)).sum(axis=2).max(axis=1)
    return float(value[tabular.start_states] @ tabular.start_probability)


def test_certificates_are_measures(family: Family) -> None:
    for member in family.members:
        tabular = family.explored(member).tabular
        assert member.measures["random_success"] == pytest.approx(walked(tabular, 40), abs=1e-12)
        assert member.measures["optimal_return"] == pytest.approx(best(tabular, 40), abs=1e-9)
        known = certificates(family, member)
        assert known.limit == 40 and known.random_success == member.measures["random_success"]
        assert known.shortest_plan == member.measures["shortest_plan"] < inf


def test_a_distance_is_that_of_the_family(family: Family) -> None:
    found = family.distances()[-1].tolist()
    assert [member.measures["distance"] for member in family.members] == found and found[-1] == 0
    assert sum(found) > 4


def measured(domain: Domain, *steps: Any) -> tuple[float, IndividualMeasure]:
    """The distance after some changes of the initial model."""
    problem = domain.problem(domain.engine())
    for step in steps:
        step(problem.engine.model)
    return problem.measures["distance"].evaluate(problem.engine), problem.measures["distance"]


def test_objects_that_come_and_go_and_links_count() -> None:
    domain = Domain.load("keydoor", overrides=["measures.distance.kind=distance", "diversity.of=plan"])
    cells = [one["id"] for one in model_to_json(domain.initial())["objects"] if one["class"] == "Floor"]

    def retyped(model: Any) -> None:
        for cell in cells[:3]:
            model.node(cell).retype("Wall")

    def made(model: Any) -> None:
        model.create("Floor")

    def gone(model: Any) -> None:
        model.nodes("Floor")[-1].delete(semantics="spo")

    assert measured(domain)[0] == 0 and measured(domain, retyped)[0] == 3
    assert measured(domain, made)[0] == 1 and measured(domain, made, gone)[0] >= 0
    before, measure = measured(domain, made, made)
    assert before == 2 and measure.range == (0.0, float(len(domain.initial())))  # type: ignore[attr-defined]


def test_what_is_of_environments_needs_one(tmp_path: Path) -> None:
    (tmp_path / "family.toml").write_text(
        'model = "burning_forest/target_8x8.model"\n[measures.luck]\nkind = "random_success"\n'
        '[mutation]\nrules = ["retypings"]\n'
    )
    with pytest.raises(LoadError, match="this needs an environment"):
        Domain.load(str(tmp_path))
