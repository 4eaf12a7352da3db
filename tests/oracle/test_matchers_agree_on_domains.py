"""Both matchers on the queries of four domains, and on what their metamodels demand, after random edits."""

from __future__ import annotations

from pathlib import Path

import pytest

from envgraph.lang import load_workspace
from envgraph.match import CompiledMatcher, NaiveMatcher
from envgraph.pattern import Library, conformance_patterns
from tests.oracle.test_matchers_agree import assert_agree, snapshot
from tests.oracle.worlds import Dice, World

HERE = Path(__file__).parent / "domains"
FOREST = Path(__file__).parents[2] / "rules" / "burning_forest"

DOMAINS = {
    "burning_forest": (FOREST / "burning_forest.query", FOREST / "running_4x4.model"),
    "keydoor": (HERE / "keydoor.query", HERE / "two_rooms.model"),
    "network": (HERE / "network.query", HERE / "backbone.model"),
    "warehouse": (HERE / "warehouse.query", HERE / "small_hall.model"),
}


@pytest.mark.parametrize("name", DOMAINS)
def test_matchers_agree_on_the_queries_of_a_domain(name: str) -> None:
    workspace = load_workspace(map(str, DOMAINS[name]))
    assert workspace.metamodel is not None
    library = Library(workspace.metamodel)
    library.add(*workspace.patterns)
    library.add(*conformance_patterns(workspace.metamodel))
    world = World(library, workspace.model(), Dice(1))
    compiled, naive = (kind(world.model, library) for kind in (CompiledMatcher, NaiveMatcher))
    assert_agree(world, compiled, naive)
    before = snapshot(compiled, library)
    savepoint = world.model.savepoint()
    for _ in range(3):
        world.edit(10)
        assert_agree(world, compiled, naive)
    world.model.rollback(savepoint)
    assert snapshot(compiled, library) == before
