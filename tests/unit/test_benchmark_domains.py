"""What the rewriting benchmarks do: counts after each phase, here and in CLIPS."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from benchmarks import _mutex
from benchmarks._clips import clips
from benchmarks._mutex import PHASES, Rewrite, facade, prepared, ring, rules
from benchmarks._philosophers import RULES, clips_table, table
from benchmarks._sierpinski import clips_levels, objects, split_all, triangle
from envgraph.rewrite import Engine

with_clips = pytest.mark.skipif(clips is None, reason="clipspy is not installed")


# --- mutual exclusion


def links(engine: Engine) -> dict[str, int]:
    """How many there are of each reference."""
    model = engine.model
    return {
        reference.name: sum(len(model.graph.targets(node, reference)) for node in model.graph.extent(reference.owner))
        for reference in model.metamodel.references
    }


@pytest.mark.parametrize("size", [2, 3, 40])
@pytest.mark.parametrize("way", [prepared, facade])
@pytest.mark.parametrize("watched", [True, False])
def test_the_ring_has_the_expected_links_after_each_phase(
    size: int, way: Callable[[Engine], Rewrite], watched: bool
) -> None:
    engine = ring(watched)
    rewrite = way(engine)
    done = 0
    for phase in PHASES:
        for rule in rules(phase, size):
            assert rewrite(rule) is not None
            done += 1
        found = links(engine)
        model = engine.model
        assert len(model.graph.extent("Process")) == found["next"] == size
        assert len(model.graph.extent("Resource")) == found["token"] == (phase != "grow")
        assert found["request"] == (size if phase == "request" else 0)
        assert found["heldBy"] == found["release"] == 0
    assert done == 5 * size - 1
    ring_of = model.nodes("Process")[0]
    seen = [ring_of.id]
    while (ring_of := ring_of.next[0]).id != seen[0]:
        seen.append(ring_of.id)
    assert sorted(seen) == sorted(model.graph.extent("Process"))
    engine.check_integrity()


def test_only_one_process_holds_the_resource_while_the_token_is_passed() -> None:
    engine = ring()
    rewrite = prepared(engine)
    for phase in PHASES[:3]:
        for rule in rules(phase, 5):
            rewrite(rule)
    for number in range(5):
        assert links(engine)["request"] == 5 - number
        rewrite("take")
        assert (links(engine)["heldBy"], engine.count("take"), engine.count("release")) == (1, 0, 1)
        rewrite("release")
        assert (links(engine)["release"], engine.count("give")) == (1, 1)
        rewrite("give")
        assert links(engine)["token"] == 1
    assert not engine.exists("take") and engine.count("request") == 5


def test_the_unit_passes_the_token_until_no_request_is_left() -> None:
    engine = ring()
    rewrite = prepared(engine)
    for phase in PHASES[:3]:
        for rule in rules(phase, 6):
            rewrite(rule)
    with engine.recording() as trace:
        assert engine.run("passOn")
    assert [firing.rule.split(".")[1] for firing in trace] == ["take", "release", "give"] * 6
    assert links(engine)["request"] == 0


@with_clips
def test_clips_does_as_many_rewrites_of_the_ring() -> None:
    run, environment = _mutex.clips_sequence(20)
    assert run() == 99
    names = ("process", "next", "resource", "token", "request", "heldBy", "release", "phase")
    assert [environment.count(name) for name in names] == [20, 20, 1, 1, 0, 0, 0, 0]


# --- triangles


@pytest.mark.parametrize("watched", [True, False])
def test_triangles_have_the_expected_counts_at_each_level(watched: bool) -> None:
    engine = triangle(watched)
    for level in range(1, 6):
        assert split_all(engine, level) == 3 ** (level - 1)
        assert len(engine.model) == objects(level)
        now, before = links(engine)[f"e{level % 2}"], links(engine)[f"e{(level - 1) % 2}"]
        assert (now, before) == (3 ** (level + 1), 0)
    engine.check_integrity()


def test_units_split_the_same_triangles() -> None:
    engine, other = triangle(), triangle()
    for level in range(4):
        engine.run(f"level{level % 2}")
        split_all(other, level + 1)
    assert engine.model.canonical_hash() == other.model.canonical_hash()
    assert len(engine.model) == objects(4)


@with_clips
def test_clips_splits_as_many_triangles() -> None:
    done, environment = clips_levels(4)
    assert done == 1 + 3 + 9 + 27
    assert environment.count("link") == 3**5
    assert objects(4) == 123


# --- philosophers


@pytest.mark.parametrize(("size", "transitions"), [(3, 63), (4, 252), (5, 945), (6, 3402)])
def test_philosophers_have_the_published_states_and_transitions(size: int, transitions: int) -> None:
    engine = table(size)
    before = engine.model.state_hash()
    found = engine.explore(RULES)
    assert (len(found), len(found.transitions), found.complete) == (3**size, transitions, True)
    assert len(found.deadlocks) == 2  # all hold their left forks, or all their right ones
    assert engine.model.state_hash() == before


def test_philosopher_states_up_to_isomorphism_are_as_many_as_necklaces() -> None:
    """Necklaces of n beads of three colours (Moreau 1872): 11, 24, 51 and 130."""
    sizes = [len(table(size).explore(RULES, up_to="isomorphism")) for size in (3, 4, 5, 6)]
    assert sizes == [11, 24, 51, 130]


@with_clips
def test_clips_finds_the_same_states() -> None:
    environment = clips_table(4)
    assert environment.run() == 252
    assert environment.count("state") == 81
