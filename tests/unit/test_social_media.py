"""The social media domain gives the published answers of the Transformation Tool Contest 2018."""

from __future__ import annotations

import pytest

from benchmarks._social_media import (
    CHANGE_SETS,
    QUERIES,
    SCALES,
    Podium,
    best,
    change_sets,
    expected_answers,
    initial_lines,
    open_network,
)
from envgraph.lang import open as open_engine
from envgraph.match import FREE, CompiledMatcher
from envgraph.rewrite import Match
from tests.oracle.naive._naive import NaiveMatcher

EXPECTED = expected_answers()


def test_there_are_84_published_answers() -> None:
    assert len(EXPECTED) == len(QUERIES) * len(SCALES) * (1 + CHANGE_SETS) == 84


@pytest.mark.parametrize("scale", SCALES)
def test_matches_on_demand_give_the_published_answers(scale: int) -> None:
    engine, network = open_network(initial_lines(scale))
    for number, lines in enumerate([[], *change_sets(scale)]):
        network.insert(lines)
        for query, pattern in QUERIES.items():
            assert best(engine.matches(pattern)) == EXPECTED[query, scale, number]


@pytest.mark.parametrize("scale", SCALES)
def test_views_give_the_published_answers(scale: int) -> None:
    engine, network = open_network(initial_lines(scale))
    engine.watch(*QUERIES.values())
    podiums = {query: Podium(engine.matches(pattern)) for query, pattern in QUERIES.items()}
    for query, podium in podiums.items():
        engine.listen(QUERIES[query], podium.update)
    for number, lines in enumerate([[], *change_sets(scale)]):
        with engine.transaction():
            network.insert(lines)
        for query, podium in podiums.items():
            assert podium.best() == EXPECTED[query, scale, number]
    on_demand = CompiledMatcher(engine.model, engine.library)
    for pattern in QUERIES.values():
        arguments = f"social_media.{pattern}", (FREE, FREE)
        assert sorted(engine.matcher.rows(*arguments)) == sorted(on_demand.rows(*arguments))


def test_the_naive_matcher_agrees() -> None:
    engine, network = open_network(initial_lines(1))
    network.insert(line for lines in change_sets(1) for line in lines)
    naive = NaiveMatcher(engine.model, engine.library)
    for pattern in QUERIES.values():
        arguments = f"social_media.{pattern}", (FREE, FREE)
        assert sorted(naive.rows(*arguments)) == sorted(engine.matcher.rows(*arguments))


def test_scores_of_the_small_model_agree_with_its_comments() -> None:
    engine = open_engine("social_media")
    assert [(match.post.object_name, match.score) for match in engine.matches("postScore")] == [
        ("hello", 2 * 10 + 4 + 2),
        ("quiet", 0),
    ]
    assert [(match.comment.object_name, match.score) for match in engine.matches("commentScore")] == [
        ("riddle", 3 * 3 + 1 * 1),
        ("answer", 1 * 1 + 1 * 1),
    ]


def test_a_podium_is_updated_when_scores_rise_and_fall() -> None:
    engine = open_engine("social_media")
    riddle = engine.model["riddle"]
    podium = Podium(before := engine.matches("commentScore"), size=1)
    assert podium.best() == [11]
    for likers, leader in (
        (["ann"], 12),
        (["ann", "ben"], 11),
        ([], 12),
        (["ann", "ben"], 11),
        (["cem", "dora"], 12),
    ):
        riddle.likedBy = [engine.model[name] for name in likers]
        after = engine.matches("commentScore")
        podium.update(*appeared_and_disappeared(before, after))
        before = after
        assert podium.best() == [leader] == best(after, 1)
    riddle.delete("spo")
    podium.update((), before)
    assert podium.best() == []


def test_a_podium_removes_outdated_scores_from_its_heap() -> None:
    engine = open_engine("social_media")
    riddle, ann = engine.model["riddle"], engine.model["ann"]
    podium = Podium(before := engine.matches("commentScore"))
    for number in range(300):
        if number % 2:
            riddle.likedBy.append(ann)
        else:
            riddle.likedBy.remove(ann)
        after = engine.matches("commentScore")
        podium.update(*appeared_and_disappeared(before, after))
        before = after
    assert podium.best() == [11, 12]
    assert len(podium._heap) <= 2 * 2 + 64


def appeared_and_disappeared(before: list[Match], after: list[Match]) -> tuple[list[Match], list[Match]]:
    """What appeared and what disappeared."""
    return [match for match in after if match not in before], [match for match in before if match not in after]
