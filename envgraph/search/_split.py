"""How far members of a family are from each other, and which of them are kept for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.search._object_facts import object_facts

if TYPE_CHECKING:
    from envgraph.search._family import Member

_ROWS: Final = 64
"""Members that are compared with all others at once: with 10,000 members of 100 objects that takes 64 MB."""


def described(models: Iterable[Model]) -> NDArray[np.int32]:
    """A number for each object of each model [models, objects], the same where nothing of the object differs.

    An object is what has the same id; see `object_facts` for what belongs to it. 0 stands for one that a model lacks.
    Models are looked at one after the other.
    """
    numbers: dict[tuple[object, ...], int] = {}
    rows = [
        [
            numbers.setdefault(one, len(numbers) + 1) if one[0] != -1 else 0
            for one in zip(*object_facts(model), strict=True)
        ]
        for model in models
    ]
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


def split(
    members: Sequence[Member],
    models: Iterable[Model],
    test: float | int | Callable[[Member], bool],
    apart: int,
    seed: int,
) -> tuple[list[int], list[int]]:
    """The places of members to train on, and of those to test; see `Family.split`."""
    everything = range(len(members))
    if callable(test):
        tested = [place for place in everything if test(members[place])]
    else:
        count = test if isinstance(test, int) else round(test * len(members))
        if not 0 < count < len(members):
            raise InvalidArgument(f"{test} of {len(members)} members leaves none to train on or to test")
        tested = sorted(default_rng(seed).permutation(len(members))[:count].tolist())
    held = dict.fromkeys(tested)
    trained = [place for place in everything if place not in held]
    if apart > 1:
        objects = described(models)
        nearest = differing(objects[trained], objects[tested]).min(axis=1, initial=apart).tolist()
        trained = [place for place, least in zip(trained, nearest, strict=True) if least >= apart]
    if not trained or not tested:
        what = "tested" if not tested else "trained on"
        raise InvalidArgument(f"no member is left to be {what}", "ask for less, or for a smaller `apart`")
    return trained, tested
