"""Problem files whose initial model lacks something."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.errors import LoadError
from envgraph.lang import bundled_domain
from envgraph.search import Domain, optimise_domain

CONTEST = """<?xml version="1.0" encoding="ASCII"?>
<cra:ClassModel xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI"
    xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:cra="http://momot.big.tuwien.ac.at/architectureCRA/1.0">
  <features xsi:type="cra:Method" name="M0" dataDependency="//@features.2" functionalDependency="//@features.1"/>
  <features xsi:type="cra:Method" name="M1" dataDependency="//@features.2"/>
  <features xsi:type="cra:Attribute" name="A0"/>
</cra:ClassModel>
"""
"""As the inputs of the contest are: the root has no name, though the metamodel demands one."""

PROBLEM = f"""
model = "input.xmi"
imports = ["{bundled_domain("assignment") / "assignment.rules"}"]
[constraints]
forbid = ["unassigned"]
[measures.cra]
kind = "value"
of = "craIndex"
[mutation]
rules = ["introduce", "assign", "move", "extract", "join"]
[optimise]
maximise = ["cra"]
steps = 200
"""


def test_missing_attribute_of_the_initial_model_is_only_reported(tmp_path: Path) -> None:
    (tmp_path / "input.xmi").write_text(CONTEST)
    (tmp_path / "problem.toml").write_text(PROBLEM)
    domain = Domain.load(str(tmp_path / "problem.toml"))
    assert [one.message for one in domain.workspace.diagnostics] == ["`ClassModel#0` has no value of `name`"]
    engine, found = optimise_domain(domain)
    assert found.best.violation == 0 and found.best.values["cra"] == pytest.approx(1.5)
    assert not engine.exists("unassigned")


def test_search_adds_required_targets_missing_from_the_initial_model(tmp_path: Path) -> None:
    empty = '<classes name="C"/>\n</cra:ClassModel>'
    (tmp_path / "input.xmi").write_text(CONTEST.replace("</cra:ClassModel>", empty))
    (tmp_path / "problem.toml").write_text(PROBLEM)
    engine, found = optimise_domain(Domain.load(str(tmp_path / "problem.toml")))
    assert found.best.violation == 0
    assert all(cls.encapsulates for cls in engine.model.nodes("Class"))


def test_initial_model_of_a_family_with_missing_values_is_refused(tmp_path: Path) -> None:
    (tmp_path / "input.xmi").write_text(CONTEST)
    (tmp_path / "family.toml").write_text(PROBLEM.partition("[optimise]")[0])
    with pytest.raises(LoadError, match="has no value of `name`"):
        Domain.load(str(tmp_path / "family.toml"))
