"""The archive of members by bins: level where it can be, the best of each cell."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given, strategies as st
from numpy.random import default_rng

from envgraph.search import Archive, BinnedEntropy

Offers = list[tuple[float, float]]

offers: st.SearchStrategy[Offers] = st.lists(
    st.tuples(st.sampled_from([0.1, 0.3, 0.6, 0.9]), st.integers(0, 4).map(float)), min_size=1, max_size=60
)


def filled(
    size: int, offered: Offers, bins: Sequence[BinnedEntropy] = (BinnedEntropy(4),)
) -> tuple[Archive, Offers]:
    """An archive after some offers of a value and a quality, and those that were ever kept, by number."""
    archive, rng, kept = Archive(size, bins), default_rng(1), list[tuple[float, float]]()
    for value, quality in offered:
        found = archive.put(archive.cell([value] * len(bins)), quality, rng)
        if found is not None:
            assert found[0] == len(kept)
            kept.append((value, quality))
    return archive, kept


@given(offers, st.integers(1, 12))
def test_it_only_gets_more_level_once_it_is_full(offered: Offers, size: int) -> None:
    archive, rng, full = Archive(size, [BinnedEntropy(4)]), default_rng(1), list[tuple[int, int]]()
    for place, (value, quality) in enumerate(offered):
        archive.put(archive.cell([value]), quality, rng)
        counts = archive.counts().values()
        assert len(archive) == len([*archive]) == min(size, place + 1) == sum(counts) and 0 in archive
        if len(archive) == size:
            full.append((len(counts), -max(counts)))
    assert full == sorted(full)


@given(offers)
def test_a_cell_has_the_best_that_it_was_offered_once_each_has_one_place(offered: Offers) -> None:
    archive, kept = filled(4, [(0.1, 9.0), (0.3, 0.0), (0.6, 0.0), (0.9, 0.0), *offered])
    best = {value: max(quality for one, quality in offered if one == value) for value, _ in offered}
    assert archive.counts() == {(place,): 1 for place in range(4)}
    for value, quality in [kept[number] for number in archive]:
        assert quality == (9.0 if value == 0.1 else best.get(value, 0.0))  # the first one stays


def test_one_in_the_fullest_cell_makes_room_for_another_cell() -> None:
    archive, _ = filled(4, [(0.1, 0.0)] * 4 + [(0.9, 0.0)] * 3)
    assert archive.counts() == {(0,): 2, (3,): 2} and 0 in archive and not archive.level


def test_it_is_level_once_every_cell_has_its_share() -> None:
    assert filled(3, [(0.1, 0.0)] * 3, ())[0].level
    assert not filled(4, [(0.1, 0.0)] * 3, ())[0].level
    assert not filled(3, [(0.1, 0.0), (0.3, 0.0), (0.6, 0.0)])[0].level
    assert filled(5, [(0.1, 0.0), (0.3, 0.0), (0.6, 0.0), (0.9, 0.0), (0.3, 0.0)])[0].level


def test_bins_that_no_whole_number_falls_into_need_no_members() -> None:
    archive = Archive(2, [BinnedEntropy(4, 0, 1, whole=True)])
    for value in (0.0, 1.0):
        assert archive.put(archive.cell([value]), 0.0, default_rng(0)) is not None
    assert archive.level


def test_cells_of_several_measures_are_told_apart() -> None:
    archive = Archive(9, [BinnedEntropy(2), BinnedEntropy(3)])
    assert [archive.cell(values) for values in ([0.1, 0.9], [0.9, 0.1])] == [(0, 2), (1, 0)]


@pytest.mark.parametrize("crowd", [1, 50])
def test_each_cell_is_drawn_as_often_however_full_it_is(crowd: int) -> None:
    archive, kept = filled(60, [(0.1, 0.0)] * crowd + [(0.9, 0.0)])
    rng = default_rng(3)
    drawn = sum(kept[archive.draw(rng)][0] == 0.9 for _ in range(1000))
    assert 440 < drawn < 560


def test_of_several_qualities_the_first_counts_most() -> None:
    archive, rng = Archive(2), default_rng(1)
    for quality in [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 9.0), (1.0, 1.0)]:
        archive.put((), quality, rng)
    assert list(archive) == [0, 2], "the first one stays, and the best of the others"
