"""An archive that spreads its members evenly over bins of measures (after MAP-Elites, Mouret and Clune 2015)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod
from typing import TYPE_CHECKING

from envgraph.search.problem._statistics import BinnedEntropy

if TYPE_CHECKING:
    from numpy.random import Generator

Cell = tuple[int, ...]


class Archive:
    """An archive of members, each in the cell given by the bins of its measures. The first member always stays.

    Until there are `size` members every new member is added. From then on a new member replaces one in the fullest cell
    if that cell has at least two more members than its own. So all cells become equally full. Members may have
    qualities. A new member then also replaces the worst member of its own cell if that is worse. From the fullest cell
    the worst member is removed. An archive with as many members as usable cells thus contains the best member of each
    cell.

    Args:
        size: the largest number of members, at least 1.
        bins: the bins of each measure that the archive covers. Without bins there is a single cell.

    Invariant: `_filled[n]` contains the cells with n members, for n from 1 on, and is not empty.
    """

    def __init__(self, size: int, bins: Sequence[BinnedEntropy] = ()) -> None:
        self._size, self._bins = size, bins
        self._cells: dict[Cell, list[int]] = {}
        self._cells_by_size: dict[int, dict[Cell, None]] = {}
        self._quality: list[tuple[float, ...]] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        """Yield the members in the order in which they were added."""
        return iter(sorted(one for members in self._cells.values() for one in members))

    def cell_of(self, values: Sequence[float]) -> Cell:
        """Return the cell of a member, given its values of the covered measures."""
        return tuple(bins.bin_of(value) for bins, value in zip(self._bins, values, strict=True))

    def members_per_cell(self) -> dict[Cell, int]:
        """Return the number of members of each non-empty cell, sorted by cell."""
        return {cell: len(self._cells[cell]) for cell in sorted(self._cells)}

    @property
    def is_evenly_filled(self) -> bool:
        """Return True if the archive is full, every cell has members, and their numbers differ by at most one."""
        possible = prod(bins.usable_bins for bins in self._bins)
        counts = self._cells_by_size
        return self._count == self._size and len(self._cells) == possible and max(counts) - min(counts) < 2

    def sample_member(self, rng: Generator) -> int:
        """Sample a member: a non-empty cell uniformly, then a member of the cell uniformly."""
        cells = [*self._cells.values()]
        members = cells[int(rng.integers(len(cells)))]
        return members[int(rng.integers(len(members)))]

    def offer_member(
        self, cell: Cell, quality: float | tuple[float, ...], rng: Generator
    ) -> tuple[int, int | None] | None:
        """Offer a member to the archive.

        Args:
            cell: the cell of the member.
            quality: larger is better within a cell; tuples are compared in order. Use a constant if no member is
                better.
            rng: samples the member that is removed among equally bad ones.

        Returns:
            The number of the member, counted from 0 in the order of addition, and the number of the member that it
            replaced or None. The result is None if the member is not added.
        """
        quality = quality if isinstance(quality, tuple) else (quality,)
        if self._count < self._size:
            return self._add_member(cell, quality), None
        most = max(self._cells_by_size)
        if most - len(self._cells.get(cell, ())) < 2:
            leaving = self._worst_place(cell, rng)
            if leaving is None or self._quality[self._cells[cell][leaving]] >= quality:
                return None
            left = self._remove_member(cell, leaving)
        else:
            fullest = [*self._cells_by_size[most]]
            crowd = fullest[int(rng.integers(len(fullest)))]
            place = self._worst_place(crowd, rng)
            assert place is not None, "it has at least two members"
            left = self._remove_member(crowd, place)
        return self._add_member(cell, quality), left

    def _worst_place(self, cell: Cell, rng: Generator) -> int | None:
        """Return the place of the worst member within a cell, sampled among equals.

        The first member of the archive is never chosen. Return None if the cell has no other member.
        """
        places = [place for place, one in enumerate(self._cells.get(cell, ())) if one]
        if not places:
            return None
        members, quality = self._cells[cell], self._quality
        least = min(quality[members[place]] for place in places)
        worst = [place for place in places if quality[members[place]] == least]
        return worst[int(rng.integers(len(worst)))]

    def _add_member(self, cell: Cell, quality: tuple[float, ...]) -> int:
        number = len(self._quality)
        self._quality.append(quality)
        members = self._cells.setdefault(cell, [])
        self._update_cell_size(cell, len(members), len(members) + 1)
        members.append(number)
        self._count += 1
        return number

    def _remove_member(self, cell: Cell, place: int) -> int:
        members = self._cells[cell]
        self._update_cell_size(cell, len(members), len(members) - 1)
        members[place], left = members[-1], members[place]
        members.pop()
        self._count -= 1
        if not members:
            del self._cells[cell]
        return left

    def _update_cell_size(self, cell: Cell, old_size: int, new_size: int) -> None:
        if old_size:
            del self._cells_by_size[old_size][cell]
            if not self._cells_by_size[old_size]:
                del self._cells_by_size[old_size]
        if new_size:
            self._cells_by_size.setdefault(new_size, {})[cell] = None
