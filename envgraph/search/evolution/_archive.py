"""An archive of members by bins of their measures, as level as it can be (after MAP-Elites, Mouret and Clune 2015)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod
from typing import TYPE_CHECKING

from envgraph.search.problem._diversity import BinnedEntropy

if TYPE_CHECKING:
    from numpy.random import Generator

Cell = tuple[int, ...]


class Archive:
    """Members, each in the cell of its bins. The first one that is put in stays.

    Until there are `size` of them every member is kept. From then on a new one takes the place of one in the fullest
    cell, where that has at least two more than its own: so the cells that can be reached become equally full. With
    qualities it also takes the place of the worst in its own cell, if that is worse; and from the fullest cell it is
    the worst that leaves. So an archive of as many members as cells that can be reached has the best of each.

    Args:
        size: how many members there may be, at least 1.
        bins: of each measure that is covered; without any there is one cell.

    Invariant: `_filled[n]` are the cells with n members, for n from 1 on; none of them is empty but for a moment.
    """

    def __init__(self, size: int, bins: Sequence[BinnedEntropy] = ()) -> None:
        self._size, self._bins = size, bins
        self._cells: dict[Cell, list[int]] = {}
        self._filled: dict[int, dict[Cell, None]] = {}
        self._quality: list[tuple[float, ...]] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        """The members, those that were put in first first."""
        return iter(sorted(one for members in self._cells.values() for one in members))

    def cell(self, values: Sequence[float]) -> Cell:
        """The cell of a member, by the values of the measures that are covered."""
        return tuple(bins.bin(value) for bins, value in zip(self._bins, values, strict=True))

    def counts(self) -> dict[Cell, int]:
        """How many members each cell has, of those that have any."""
        return {cell: len(self._cells[cell]) for cell in sorted(self._cells)}

    @property
    def level(self) -> bool:
        """Whether it is full, all cells have members, and none has two more than another."""
        possible = prod(bins.usable for bins in self._bins)
        counts = self._filled
        return self._count == self._size and len(self._cells) == possible and max(counts) - min(counts) < 2

    def draw(self, rng: Generator) -> int:
        """A member of any cell, each cell as likely, in it each member."""
        cells = [*self._cells.values()]
        members = cells[int(rng.integers(len(cells)))]
        return members[int(rng.integers(len(members)))]

    def put(
        self, cell: Cell, quality: float | tuple[float, ...], rng: Generator
    ) -> tuple[int, int | None] | None:
        """Offer a member.

        Args:
            cell: its cell.
            quality: of members in one cell larger is better, of several numbers the first counts most; the same for all
                where nothing is better.
            rng: draws which of equals leaves.

        Returns:
            The number of the member, from 0 in the order in which they are kept, and that of the one that left, if one
            did; None if it is not kept.
        """
        quality = quality if isinstance(quality, tuple) else (quality,)
        if self._count < self._size:
            return self._keep(cell, quality), None
        most = max(self._filled)
        if most - len(self._cells.get(cell, ())) < 2:
            leaving = self._worst(cell, rng)
            if leaving is None or self._quality[self._cells[cell][leaving]] >= quality:
                return None
            left = self._leave(cell, leaving)
        else:
            fullest = [*self._filled[most]]
            crowd = fullest[int(rng.integers(len(fullest)))]
            place = self._worst(crowd, rng)
            assert place is not None, "it has at least two members"
            left = self._leave(crowd, place)
        return self._keep(cell, quality), left

    def _worst(self, cell: Cell, rng: Generator) -> int | None:
        """The place of the member of a cell that is worst, any of equals, but for the first of all members."""
        places = [place for place, one in enumerate(self._cells.get(cell, ())) if one]
        if not places:
            return None
        members, quality = self._cells[cell], self._quality
        least = min(quality[members[place]] for place in places)
        worst = [place for place in places if quality[members[place]] == least]
        return worst[int(rng.integers(len(worst)))]

    def _keep(self, cell: Cell, quality: tuple[float, ...]) -> int:
        number = len(self._quality)
        self._quality.append(quality)
        members = self._cells.setdefault(cell, [])
        self._moved(cell, len(members), len(members) + 1)
        members.append(number)
        self._count += 1
        return number

    def _leave(self, cell: Cell, place: int) -> int:
        members = self._cells[cell]
        self._moved(cell, len(members), len(members) - 1)
        members[place], left = members[-1], members[place]
        members.pop()
        self._count -= 1
        if not members:
            del self._cells[cell]
        return left

    def _moved(self, cell: Cell, before: int, after: int) -> None:
        if before:
            del self._filled[before][cell]
            if not self._filled[before]:
                del self._filled[before]
        if after:
            self._filled.setdefault(after, {})[cell] = None
