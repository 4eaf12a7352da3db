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


def filled(size: int, offered: Offers, bins: Sequence[BinnedEntropy] = (BinnedEntropy(4),)) -> tuple[Archive, Offers]:
    """An archive after some offers of a value and a quality, and those that were ever kept, by number."""
    archive, rng, kept = Archive(size, bins), default_rng(1), list[tuple[float, float]]()
    for value, quality in offered:
        found = archive.offer_member(archive.cell_of([value] * len(bins)), quality, rng)
        if found is not None:
            assert found[0] == len(kept)
            kept.append((value, quality))
    return archive, kept


@given(offers, st.integers(1, 12))
def test_full_archive_becomes_only_more_evenly_filled(offered: Offers, size: int) -> None:
    archive, rng, full = Archive(size, [BinnedEntropy(4)]), default_rng(1), list[tuple[int, int]]()
    for place, (value, quality) in enumerate(offered):
        archive.offer_member(archive.cell_of([value]), quality, rng)
        counts = archive.members_per_cell().values()
        assert len(archive) == len([*archive]) == min(size, place + 1) == sum(counts) and 0 in archive
        if len(archive) == size:
            full.append((len(counts), -max(counts)))
    assert full == sorted(full)


@given(offers)
def test_full_archive_keeps_the_best_offered_candidate_of_each_cell(offered: Offers) -> None:
    archive, kept = filled(4, [(0.1, 9.0), (0.3, 0.0), (0.6, 0.0), (0.9, 0.0), *offered])
    best = {value: max(quality for one, quality in offered if one == value) for value, _ in offered}
    assert archive.members_per_cell() == {(place,): 1 for place in range(4)}
    for value, quality in [kept[number] for number in archive]:
        assert quality == (9.0 if value == 0.1 else best.get(value, 0.0))  # the first one stays


def test_candidate_of_the_fullest_cell_is_replaced_by_one_of_another_cell() -> None:
    archive, _ = filled(4, [(0.1, 0.0)] * 4 + [(0.9, 0.0)] * 3)
    assert archive.members_per_cell() == {(0,): 2, (3,): 2} and 0 in archive and not archive.is_evenly_filled


def test_archive_is_level_when_every_cell_has_its_share() -> None:
    assert filled(3, [(0.1, 0.0)] * 3, ())[0].is_evenly_filled
    assert not filled(4, [(0.1, 0.0)] * 3, ())[0].is_evenly_filled
    assert not filled(3, [(0.1, 0.0), (0.3, 0.0), (0.6, 0.0)])[0].is_evenly_filled
    assert filled(5, [(0.1, 0.0), (0.3, 0.0), (0.6, 0.0), (0.9, 0.0), (0.3, 0.0)])[0].is_evenly_filled


def test_bins_without_a_whole_number_need_no_members() -> None:
    archive = Archive(2, [BinnedEntropy(4, 0, 1, whole=True)])
    for value in (0.0, 1.0):
        assert archive.offer_member(archive.cell_of([value]), 0.0, default_rng(0)) is not None
    assert archive.is_evenly_filled


def test_cells_combine_the_bins_of_several_measures() -> None:
    archive = Archive(9, [BinnedEntropy(2), BinnedEntropy(3)])
    assert [archive.cell_of(values) for values in ([0.1, 0.9], [0.9, 0.1])] == [(0, 2), (1, 0)]


@pytest.mark.parametrize("crowd", [1, 50])
def test_cells_are_sampled_equally_often_regardless_of_their_size(crowd: int) -> None:
    archive, kept = filled(60, [(0.1, 0.0)] * crowd + [(0.9, 0.0)])
    rng = default_rng(3)
    drawn = sum(kept[archive.sample_member(rng)][0] == 0.9 for _ in range(1000))
    assert 440 < drawn < 560


def test_several_qualities_are_compared_lexicographically() -> None:
    archive, rng = Archive(2), default_rng(1)
    for quality in [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 9.0), (1.0, 1.0)]:
        archive.offer_member((), quality, rng)
    assert list(archive) == [0, 2], "the first one stays, and the best of the others"
