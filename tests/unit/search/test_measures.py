"""Measures of one model that are computed of its objects, or of its states."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envgraph.env import Tabular, TooManyStates
from envgraph.env.compiled import TableBuilder
from envgraph.errors import EvaluationError, LoadError
from envgraph.graph import model_to_json
from envgraph.lang import bundled_domain
from envgraph.search import (
    Domain,
    Family,
    IndividualMeasure,
    certificates,
    generate,
)

KINDS = ("random_success", "optimal_return", "shortest_plan", "distance")
GIVEN = [f"measures.{kind}={{ kind = '{kind}', otherwise = 0 }}" for kind in KINDS]
DIVERSITY = "diversity={ of = 'random_success', bins = 5 }"


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family:
    path = tmp_path_factory.mktemp("made") / "run.sqlite"
    given = [*GIVEN, DIVERSITY, "limit=40", "samples.cover={ random_success = 4 }", "samples.attempts=10"]
    return generate("burning_forest/paper.toml", path, samples=5, overrides=given)


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


def test_distance_measure_equals_the_distances_of_the_family(family: Family) -> None:
    found = family.distances()[-1].tolist()
    assert [member.measures["distance"] for member in family.members] == found and found[-1] == 0
    assert sum(found) > 4


def measured(domain: Domain, *steps: Any) -> tuple[float, IndividualMeasure]:
    """The distance after some changes of the initial model."""
    problem = domain.problem(domain.engine())
    for step in steps:
        step(problem.engine.model)
    return problem.measures["distance"].evaluate(problem.engine), problem.measures["distance"]


def test_distance_measure_counts_retyped_created_and_deleted_objects() -> None:
    domain = Domain.load("keydoor/diverse.toml", overrides=["measures.distance.kind=distance", "diversity.of=plan"])
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


def test_measure_of_the_environment_without_an_environment_is_refused(tmp_path: Path) -> None:
    (tmp_path / "family.toml").write_text(
        'model = "burning_forest/target_8x8.model"\n[measures.luck]\nkind = "random_success"\n'
        '[mutation]\nrules = ["retypings"]\n'
    )
    with pytest.raises(LoadError, match="this needs an environment"):
        Domain.load(str(tmp_path))


@pytest.mark.parametrize("kind", ["random_success", "optimal_return"])
def test_measure_with_a_too_large_table_is_reported_with_its_position(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    def too_many(*_: object) -> Tabular:
        assert domain.behaviour is not None
        raise TooManyStates(domain.behaviour, 250_000)

    domain = Domain.load(
        "burning_forest/paper.toml", overrides=[f"measures.luck.kind={kind}", "diversity.of=complexity"]
    )
    monkeypatch.setattr(TableBuilder, "build", too_many)
    with pytest.raises(TooManyStates, match=r"measure `luck` needs a table of all states: .* 250,000") as caught:
        domain.problem(domain.engine()).compute_measures()
    (found,) = caught.value.diagnostics
    assert found.span is not None and found.span.source.name != domain.spec.path and kind in found.span.text
    assert found.hint and f"replace `{kind}`" in found.hint and "engine" not in found.hint


def expressed(text: str, *more: str) -> tuple[float, float, float]:
    """An expression, the complexity and the plan of the initial forest."""
    given = ["measures.plan.kind=shortest_plan", f"measures.mixed={{ kind = 'expression', of = '{text}' }}"]
    domain = Domain.load("burning_forest/paper.toml", overrides=[*given, *more, "diversity.of=complexity"])
    found = domain.problem(domain.engine()).compute_measures()
    return found["mixed"], found["complexity"], found["plan"]


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("complexity", lambda complexity, plan: complexity),
        ("2 * complexity - plan / 4", lambda complexity, plan: 2 * complexity - plan / 4),
        ("plan > 10 ? plan : complexity", lambda complexity, plan: plan if plan > 10 else complexity),
        ("sqrt(plan) + max(complexity, 0.5)", lambda complexity, plan: plan**0.5 + max(complexity, 0.5)),
        ("3", lambda complexity, plan: 3.0),
    ],
)
def test_expression_of_other_measures_can_be_a_measure(text: str, wanted: Any) -> None:
    found, complexity, plan = expressed(text)
    assert found == pytest.approx(wanted(complexity, plan)) and plan > 10 > complexity


def test_expression_measure_without_a_value_uses_its_otherwise_value() -> None:
    with pytest.raises(EvaluationError, match="the model has no value of `mixed`"):
        expressed("1 / (plan - plan)")
    assert expressed("1 / (plan - plan)", "measures.mixed.otherwise=7")[0] == 7
    walled = ["measures.plan.otherwise=100", "measures.mixed={ kind = 'expression', of = 'plan + 1' }"]
    domain = Domain.load(
        "burning_forest/paper.toml",
        overrides=["measures.plan.kind=shortest_plan", *walled, "diversity.of=plan"],
    )
    problem = domain.problem(domain.engine())
    for tile in [*problem.engine.model.nodes("Tile")][1:63]:
        tile.retype("BurningTile")
    assert problem.compute_measures()["mixed"] == 101


@pytest.mark.parametrize(
    ("text", "marked", "message"),
    [
        ("2 * complexiy", "complexiy", "unknown measure `complexiy`"),
        ("complexity + later", "later", "unknown measure `later`"),
        ("mixed + 1", "mixed", "unknown measure `mixed`"),
        ("complexity complexity", "complexity", "unexpected `complexity`"),
        ("complexity); find other(x", None, "this is not a single expression"),
        ("complexity > 1", "complexity > 1", "expected `float`, found `bool`"),
        ("complexity.right", "right", ""),
    ],
)
def test_mistakes_in_an_expression_measure_are_reported_with_their_position(
    text: str, marked: str | None, message: str, tmp_path: Path
) -> None:
    for file in bundled_domain("burning_forest").glob("*.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    family = tmp_path / "paper.toml"
    more = f'[measures.mixed]\nkind = "expression"\nof = "{text}"\n[measures.later]\nkind = "distance"\n'
    family.write_text(family.read_text().replace("[diversity]", more + "[diversity]"))
    with pytest.raises(LoadError) as caught:
        Domain.load(str(family))
    problem, *_ = caught.value.diagnostics
    assert message in problem.message and problem.hint and problem.span is not None
    assert problem.span.text == (f'"{text}"' if marked is None else marked)
