"""What there is to say of each object of a model, so that models are compared object by object."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from envgraph.graph import Model

_ROWS: Final = 64
"""Members that are compared with all others at once: with 10,000 members of 100 objects that takes 64 MB."""


def object_facts(model: Model) -> list[list[object]]:
    """Columns by the id of the object: first the number of its class, -1 where there is none, then values and links.

    A link belongs to the object whose reference is declared first; the order of links does not count.
    """
    store = model.graph.store
    links = [relation.forward for relation in store.relations if not relation.flipped]
    ends: Iterable[list[object]] = (
        [tuple(sorted(targets) if len(targets) > 1 else targets) for targets in column] for column in links
    )
    values = ([tuple(one) if isinstance(one, list) else one for one in column] for column in store.values)
    return [[*store.classes], *values, *ends]


class Describer:
    """Numbers of the objects of models, the same in all models that one instance describes."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[object, ...], int] = {}

    def __call__(self, model: Model) -> NDArray[np.int32]:
        """A number for each object by its id, 0 where there is none [objects]."""
        numbers = self._numbers
        facts = zip(*object_facts(model), strict=True)
        row = [numbers.setdefault(one, len(numbers) + 1) if one[0] != -1 else 0 for one in facts]
        return np.array(row, np.int32)


def described(models: Iterable[Model]) -> NDArray[np.int32]:
    """A number for each object of each model [models, objects], the same where nothing of the object differs.

    An object is what has the same id; see `object_facts` for what belongs to it. 0 stands for one that a model lacks.
    Models are looked at one after the other.
    """
    describe = Describer()
    rows = [describe(model) for model in models]
    found = np.zeros((len(rows), max(map(len, rows))), np.int32)
    for place, row in enumerate(rows):
        found[place, : len(row)] = row
    return found


def differing(one: NDArray[np.int32], other: NDArray[np.int32]) -> NDArray[np.int64]:
    """In how many objects each of some members differs from each of others [one, other]."""
    parts = [
        (one[start : start + _ROWS, None] != other[None]).sum(axis=2) for start in range(0, len(one), _ROWS)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, len(other)), np.int64)
