"""Split the members of a family into training and test members, with a least distance between them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from numpy.random import default_rng

from envgraph.errors import InvalidArgument
from envgraph.graph import Model
from envgraph.search.problem._member_distances import count_differing_objects, number_objects

if TYPE_CHECKING:
    from envgraph.search.families._member_family import Member


def split_places(
    members: Sequence[Member],
    models: Iterable[Model],
    test: float | int | Callable[[Member], bool],
    least_distance: int,
    seed: int,
) -> tuple[list[int], list[int]]:
    """Return the places of the training members and of the test members; see `Family.split_places` for the arguments.

    Training members that differ in fewer than `least_distance` objects from a test member are left out.
    """
    everything = range(len(members))
    if callable(test):
        tested = [place for place in everything if test(members[place])]
    else:
        count = test if isinstance(test, int) else round(test * len(members))
        if not 0 < count < len(members):
            raise InvalidArgument(
                f"`test` is {test}, but both families need at least one of the {len(members)} members"
            )
        order = default_rng(seed).permutation(len(members)).tolist()
        tested = sorted([place for place in order if not members[place].initial][:count])
    held = dict.fromkeys(tested)
    trained = [place for place in everything if place not in held]
    if least_distance > 1:
        objects = number_objects(models)
        nearest = (
            count_differing_objects(objects[trained], objects[tested]).min(axis=1, initial=least_distance).tolist()
        )
        trained = [place for place, least in zip(trained, nearest, strict=True) if least >= least_distance]
    if not trained or not tested:
        what = "test" if not tested else "training"
        raise InvalidArgument(f"no {what} member is left", "change `test`, or give a smaller `apart`")
    return trained, tested
