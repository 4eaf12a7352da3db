"""Both matchers on the queries of four domains, and on what their metamodels demand, after random edits."""

from __future__ import annotations

import pytest

from envgraph.lang import bundled_domain, load_workspace
from envgraph.match import CompiledMatcher
from envgraph.pattern import Library, conformance_patterns
from tests.oracle.naive._naive import NaiveMatcher
from tests.oracle.test_matchers_agree import assert_agree, snapshot
from tests.oracle.worlds import Dice, RandomCase

MODELS = {
    "burning_forest": "running_4x4",
    "keydoor": "two_rooms",
    "network": "backbone",
    "warehouse": "small_hall",
}


@pytest.mark.parametrize("name", MODELS)
def test_matchers_agree_on_the_queries_of_a_domain(name: str) -> None:
    files = (f"{name}.query", f"{MODELS[name]}.model")
    workspace = load_workspace([str(bundled_domain(name) / file) for file in files])
    assert workspace.metamodel is not None
    library = Library(workspace.metamodel)
    library.add(*workspace.patterns)
    library.add(*conformance_patterns(workspace.metamodel))
    world = RandomCase(library, workspace.model(), Dice(1))
    compiled, naive = (kind(world.model, library) for kind in (CompiledMatcher, NaiveMatcher))
    assert_agree(world, compiled, naive)
    before = snapshot(compiled, library)
    savepoint = world.model.graph.history.savepoint()
    for _ in range(3):
        world.edit(10)
        assert_agree(world, compiled, naive)
    world.model.graph.history.rollback(savepoint)
    assert snapshot(compiled, library) == before
