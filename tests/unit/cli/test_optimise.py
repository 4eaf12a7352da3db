"""`envgraph optimise`: what is found, written and refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.unit.cli.test_runs import envgraph

Call = Callable[..., str]
__all__ = ["envgraph"]

TWO = """
model = "shop.model"
imports = ["assignment.rules"]
constraints.forbid = ["unassigned"]
measures.cohesion = { kind = "value", of = "cohesion" }
measures.coupling = { kind = "value", of = "coupling" }
mutation.rules = ["introduce", "move", "extract", "join"]

[optimise]
maximise = "cohesion"
minimise = "coupling"
strategy = { name = "beam", width = 5, branching = 3 }
steps = 300
"""


@pytest.fixture
def domain(envgraph: Call) -> Path:
    envgraph("new", "classes", "--domain", "assignment")
    Path("classes/two.toml").write_text(TWO, encoding="utf-8")
    return Path("classes")


def test_the_best_model_and_its_trace_are_written(envgraph: Call, domain: Path) -> None:
    said = envgraph("optimise", domain, "--steps", 300, "-o", "best.model", "--trace", "best.trace")
    assert said.startswith("Assignment: 300 moves tried\nsolution")
    assert said.endswith("wrote best.model\nwrote best.trace\n")
    found = json.loads(envgraph("optimise", domain, "--steps", 300, "--format", "json"))
    (best,) = found["front"]
    assert best["violation"] == 0
    assert not found["violated"]
    told = envgraph("match", "best.model", domain / "assignment.query", "craIndex", "--format", "json")
    assert json.loads(told)[0]["index"] == pytest.approx(best["values"]["cra"])
    replayed = envgraph("replay", domain / "shop.model", domain / "assignment.rules", "best.trace", "--format", "json")
    assert json.loads(replayed)["model"] == found["model"]


def test_a_front_is_drawn_and_a_chosen_solution_is_written(envgraph: Call, domain: Path) -> None:
    found = json.loads(envgraph("optimise", domain / "two.toml", "--format", "json"))
    assert len(found["front"]) > 2
    assert found["objectives"] == {"cohesion": "maximise", "coupling": "minimise"}
    envgraph("optimise", domain / "two.toml", "--picture", "front.svg", "--solution", 2, "-o", "two.model")
    assert Path("front.svg").read_text().count("<circle") == len(found["front"])
    told = envgraph("match", "two.model", domain / "assignment.query", "coupling", "--format", "json")
    assert json.loads(told)[0]["ratio"] == pytest.approx(found["front"][1]["values"]["coupling"])


def test_optimise_fails_and_names_the_violated_constraints(envgraph: Call, domain: Path) -> None:
    said = envgraph("optimise", domain, "--steps", 3, code=1)
    assert said.endswith("no model that satisfies all constraints was found: forbid unassigned\n")


def test_invalid_options_and_settings_are_refused(envgraph: Call, domain: Path) -> None:
    assert "the family file has no `[optimise]`" in envgraph("optimise", "burning_forest", code=1)
    assert "use `envgraph optimise`" in envgraph("generate", domain, code=1)
    assert "the file has one" in envgraph("optimise", domain, "--picture", "front.svg", code=1)
    said = envgraph("optimise", domain / "two.toml", "--steps", 20, "--solution", 99, code=1)
    assert "`--solution` is 99" in said
    said = envgraph("optimise", domain, "--set", "optimise.strategy=anneling", code=1)
    assert "unknown name of strategy `anneling`" in said
    said = envgraph(
        "optimise", domain, "--set", "optimise.strategy={ name = 'beam', widht = 3, branching = 0 }", code=1
    )
    assert "unknown key `widht` in `[optimise.strategy]`" in said
    assert "`branching` is 0, but must be at least 1" in said
    assert "there is no" in envgraph("optimise", "nowhere", code=1)
