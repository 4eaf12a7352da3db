"""The members of a family that an environment may go over to, and what its infos tell of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

from envgraph.errors import InvalidArgument, listed


class About(TypedDict):
    """What infos tell of a member: its name, in each of them, and what was verified of it, in those of `reset`."""

    variant: str
    certificates: dict[str, float | None]


class Members(Protocol):
    """A family, as an environment asks for its members."""

    def place(self, variant: int | str) -> int:
        """The place of a member, from 0, by its name or its number from 1.

        Raises:
            InvalidArgument: there is no such member.
        """

    def about(self, place: int) -> About:
        """What infos tell of a member."""

    def entered(self, place: int) -> Any:
        """What steps a member: a table with pictures, a program, or a simulator, as the environment has it."""


class Variants:
    """The members that a vector environment is over, of a family.

    Args:
        members: the family.
        places: of the members, in the order of their numbers in the vector environment.

    Attributes:
        names: of the members.
    """

    def __init__(self, members: Members, places: Sequence[int]) -> None:
        self._members, self._places = members, [*places]
        self._abouts = [members.about(place) for place in places]
        self.names = np.array([about["variant"] for about in self._abouts], dtype=object)

    def of(self, which: NDArray[np.int64]) -> NDArray[Any]:
        """The name of the member of each environment: one array for many infos, so nothing may write into it."""
        found = self.names[which]
        found.flags.writeable = False
        return found

    def numbers(self, wanted: object, count: int) -> NDArray[np.int64]:
        """The number of the member of each environment: the same for all of them, or one for each.

        Raises:
            InvalidArgument: there is no such member, or it is none of those of this vector environment.
        """
        each = [wanted] * count if isinstance(wanted, int | str) else list(wanted)  # type: ignore[call-overload]
        if len(each) != count:
            raise InvalidArgument(f"`variant` has {len(each)} members for {count} environments")
        places = [self._members.place(one) for one in each]
        for place in places:
            if place not in self._places:
                name, own = self._members.about(place)["variant"], listed(dict.fromkeys(self.names))
                hint = "make it with a list as `variant`, of all that it is to go over to"
                raise InvalidArgument(f"this vector environment is of {own}, not of `{name}`", hint)
        return np.array([self._places.index(place) for place in places], dtype=np.int64)

    def certificates(self, which: NDArray[np.int64], begun: NDArray[np.bool_]) -> dict[str, Any]:
        """What was verified of the members, as infos tell where episodes begin, of which there are some.

        The types are those that Gymnasium's vector environments find: of the first value.

        Args:
            which: the number of the member of each environment.
            begun: where an episode begins.
        """
        found: dict[str, Any] = {}
        every = [about["certificates"] for about in self._abouts]
        first = every[which[int(np.argmax(begun))]]
        for name, value in first.items():
            values = np.array([one.get(name) for one in every], dtype=object)[which]
            values[~begun] = None if value is None else 0
            found |= {name: values if value is None else values.astype(type(value)), f"_{name}": begun.copy()}
        return {"certificates": found, "_certificates": begun.copy()}
