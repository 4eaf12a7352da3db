"""Rows sorted by the key of a search are in the order in which the search lists them, on random worlds."""

from __future__ import annotations

from random import Random

from hypothesis import example, given, settings, strategies as st

from envgraph.graph import Store
from envgraph.match import CompiledMatcher
from tests.oracle.test_matchers_agree import free, sizes
from tests.oracle.worlds import random_case
from tests.profile import examples


def count_patterns_in_search_order(seed: int, size: int) -> int:
    """Check all patterns of a world; return how many of them had several rows and a key."""
    world = random_case(seed, size)
    matcher, found = CompiledMatcher(world.model, world.library), 0
    for pattern, arity in sizes(world.library).items():
        if world.library.inputs(pattern):
            continue
        rows = matcher.rows(pattern, free(arity))
        key = matcher.sort_key(pattern)
        if key is not None:
            shuffled = Random(seed).sample(rows, len(rows))
            assert sorted(shuffled, key=key) == rows, pattern
            found += len(rows) > 1
    return found


@settings(max_examples=examples(20))
@given(st.integers(0, 2**32), st.integers(1, 12))
@example(0, 1)
def test_sort_key_orders_rows_like_the_search(seed: int, size: int) -> None:
    count_patterns_in_search_order(seed, size)


def test_a_third_of_the_random_cases_has_patterns_with_a_sort_key() -> None:
    assert sum(count_patterns_in_search_order(seed, 3) > 0 for seed in range(12)) >= 4


def test_sort_key_orders_rows_of_nodes_with_many_links() -> None:
    assert Store.crowd < 40 and sum(count_patterns_in_search_order(seed, 40) for seed in range(3)) > 0
