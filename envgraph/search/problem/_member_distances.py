"""Distances between models: the number of objects in which two models differ."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from envgraph.graph import Model
from envgraph.search.problem._candidate_pool import Candidate, Pool
from envgraph.search.problem._object_columns import object_fact_columns
from envgraph.search.problem._statistics import Swaps

_ROWS_AT_ONCE: Final = 64
"""Number of members that are compared with all others at once; for 10,000 members of 100 objects this needs 64 MB."""


class ObjectNumbering:
    """A table that numbers descriptions of objects. Equal descriptions have equal numbers in all models."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[object, ...], int] = {}

    def __call__(self, model: Model) -> NDArray[np.int32]:
        """Return the numbers of the objects' descriptions [objects], by object id; 0 for ids without an object."""
        numbers = self._numbers
        facts = zip(*object_fact_columns(model), strict=True)
        row = [numbers.setdefault(one, len(numbers) + 1) if one[0] != -1 else 0 for one in facts]
        return np.array(row, np.int32)


def number_objects(models: Iterable[Model]) -> NDArray[np.int32]:
    """Return the number of each object's description in each model [models, objects].

    Two entries of a column are equal if the objects with that id do not differ; see `object_fact_columns` for their
    description. An entry is 0 if the model has no object with that id. The models are read one after the other.
    """
    return _padded_rows([*map(ObjectNumbering(), models)])


def _padded_rows(rows: Sequence[NDArray[np.int32]]) -> NDArray[np.int32]:
    found = np.zeros((len(rows), max(map(len, rows), default=0)), np.int32)
    for place, row in enumerate(rows):
        found[place, : len(row)] = row
    return found


def count_differing_objects(rows: NDArray[np.int32], other_rows: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the number of objects in which each row of `rows` differs from each row of `other_rows` [one, other]."""
    parts = [
        (rows[start : start + _ROWS_AT_ONCE, None] != other_rows[None]).sum(axis=2)
        for start in range(0, len(rows), _ROWS_AT_ONCE)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, len(other_rows)), np.int64)


class MemberDistance:
    """A family measure of the distances between members: the number of objects in which two members differ.

    The score is the mean over all pairs, or the distance of the closest pair. The order of the members does not matter.
    The score of fewer than two members is 0. See `Family.distances`.

    Args:
        is_least: True for the distance of the closest pair, False for the mean.
    """

    def __init__(self, is_least: bool) -> None:
        self._least, self._describe = is_least, ObjectNumbering()

    def score(self, members: Sequence[Candidate]) -> float:
        """Return the mean distance, or the distance of the closest pair; 0 for fewer than two members."""
        return self._score_of(self._distance_matrix(members), np.arange(len(members)))

    def swaps(self, pool: Pool, members: Sequence[int]) -> Swaps:
        """Return an object for the score changes if a member is exchanged. It computes all distances once."""
        between = self._distance_matrix(pool.candidates)
        return _LeastSwaps(self._score_of, between, members) if self._least else _MeanSwaps(between, members)

    def _distance_matrix(self, members: Sequence[Candidate]) -> NDArray[np.int64]:
        """Return the distance between each pair of members as a matrix [members, members]."""
        objects = _padded_rows([self._object_numbers(member) for member in members])
        return count_differing_objects(objects, objects)

    def _object_numbers(self, member: Candidate) -> NDArray[np.int32]:
        return member.once(self, lambda: self._describe(member.model))

    def _score_of(self, between: NDArray[np.int64], members: NDArray[np.int64]) -> float:
        pairs = between[members[:, None], members][np.triu_indices(len(members), 1)]
        if not len(pairs):
            return 0.0
        return float(pairs.min() if self._least else pairs.sum() / len(pairs))


class _MeanSwaps:
    """Changes of the mean distance if one member is exchanged for a candidate.

    Invariant: `_sums[c]` is the sum of the distances between candidate c and the members.
    """

    def __init__(self, between: NDArray[np.int64], members: Sequence[int]) -> None:
        self._between, self._pairs = between, max(1, len(members) * (len(members) - 1) // 2)
        self._sums = between[:, [*members]].sum(axis=1)

    def delta(self, leaving: int, entering: int) -> float:
        gained = self._sums[entering] - self._between[entering, leaving] - self._sums[leaving]
        return float(gained) / self._pairs

    def swap(self, leaving: int, entering: int) -> None:
        self._sums += self._between[entering] - self._between[leaving]


class _LeastSwaps:
    """Changes of the least distance if one member is exchanged for a candidate.

    Invariant: `_least` is the distance of the closest pair of `_members`.
    """

    def __init__(
        self,
        of: Callable[[NDArray[np.int64], NDArray[np.int64]], float],
        between: NDArray[np.int64],
        members: Sequence[int],
    ) -> None:
        self._of, self._between, self._members = of, between, np.array([*members])
        self._least = of(between, self._members)

    def delta(self, leaving: int, entering: int) -> float:
        return self._of(self._between, self._exchanged(leaving, entering)) - self._least

    def swap(self, leaving: int, entering: int) -> None:
        self._members = self._exchanged(leaving, entering)
        self._least = self._of(self._between, self._members)

    def _exchanged(self, leaving: int, entering: int) -> NDArray[np.int64]:
        return np.where(self._members == leaving, entering, self._members)
