"""How far members of a family are from each other, and which of them are kept for tests."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from envgraph.errors import InvalidArgument
from envgraph.search._store import dump_json

if TYPE_CHECKING:
    from envgraph.search._family import Member

_ROWS: Final = 64
"""Members that are compared with all others at once: with 10,000 members of 100 objects that takes 64 MB."""


def described(members: Sequence[Member]) -> NDArray[np.int32]:
    """A number for each object of each member [members, objects], the same where nothing of the object differs.

    An object is what has the same id: members of a run share the objects of the initial model. What belongs to it are
    its class, its values, and its links as `model_to_json` shows them. 0 stands for an object that a member lacks.
    """
    numbers: dict[str, int] = {}
    rows = []
    for member in members:
        objects = json.loads(member.model)["objects"]
        rows.append({one["id"]: numbers.setdefault(dump_json(one), len(numbers) + 1) for one in objects})
    columns = {id_: place for place, id_ in enumerate(sorted({id_ for row in rows for id_ in row}))}
    found = np.zeros((len(rows), len(columns)), np.int32)
    for place, row in enumerate(rows):
        found[place, [columns[id_] for id_ in row]] = [*row.values()]
    return found


def differing(one: NDArray[np.int32], other: NDArray[np.int32]) -> NDArray[np.int64]:
    """In how many objects each of some members differs from each of others [one, other]."""
    parts = [
        (one[start : start + _ROWS, None] != other[None]).sum(axis=2) for start in range(0, len(one), _ROWS)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, len(other)), np.int64)


def split(
    members: Sequence[Member], test: float | int | Callable[[Member], bool], apart: int, seed: int
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
        objects = described(members)
        nearest = differing(objects[trained], objects[tested]).min(axis=1, initial=apart).tolist()
        trained = [place for place, least in zip(trained, nearest, strict=True) if least >= apart]
    if not trained or not tested:
        what = "tested" if not tested else "trained on"
        raise InvalidArgument(f"no member is left to be {what}", "ask for less, or for a smaller `apart`")
    return trained, tested
