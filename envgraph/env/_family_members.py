"""Members of a family that an environment can switch to, and the facts about them in its infos."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

from envgraph.errors import InvalidArgument, list_names


class MemberFacts(TypedDict):
    """Facts about a member for info dictionaries: its name for every info, its certificates for infos of `reset`."""

    variant: str
    certificates: dict[str, float | None]


class SwitchableMembers(Protocol):
    """A family whose members an environment can switch to."""

    def place(self, variant: int | str) -> int:
        """Return the position of a member, from 0, given its name or its number from 1.

        Raises:
            InvalidArgument: the member does not exist.
        """

    def about(self, place: int) -> MemberFacts:
        """Return the facts about a member for infos."""

    def entered(self, place: int) -> Any:
        """Return the data for stepping a member: a table with pictures, a program, or a simulator.

        The type of environment that has the family determines the kind of data.
        """


class VectorVariants:
    """The members of a family that a vector environment contains.

    Args:
        members: the family.
        places: the positions of the members in the family, by their number in the vector environment.

    Attributes:
        names: the names of the members.
    """

    def __init__(self, members: SwitchableMembers, places: Sequence[int]) -> None:
        self._members, self._numbers = members, {place: number for number, place in reversed([*enumerate(places)])}
        self._abouts = [members.about(place) for place in places]
        self.names = np.array([about["variant"] for about in self._abouts], dtype=object)

    def names_for(self, member_numbers: NDArray[np.int64]) -> NDArray[Any]:
        """Return the member name of each environment as a read-only array, given the number of its member."""
        found = self.names[member_numbers]
        found.flags.writeable = False
        return found

    def member_numbers(self, variant_option: object, count: int) -> NDArray[np.int64]:
        """Return the member number for each of `count` environments.

        Args:
            variant_option: the name or number of one member for all environments, or a list of one for each
                environment.

        Raises:
            InvalidArgument: the list has a wrong length, or a member does not exist or is not in this environment.
        """
        each = [variant_option] * count if isinstance(variant_option, int | str) else list(variant_option)  # type: ignore[call-overload]
        if len(each) != count:
            raise InvalidArgument(
                f"`variant` lists {len(each)} members, but must list one for each of {count} environments"
            )
        places = [self._members.place(one) for one in each]
        for place in places:
            if place not in self._numbers:
                name, own = self._members.about(place)["variant"], list_names(dict.fromkeys(self.names))
                hint = "make the vector environment with `variant=[..]`, a list of all members to switch between"
                raise InvalidArgument(f"this vector environment has the members {own}, but not `{name}`", hint)
        return np.array([self._numbers[place] for place in places], dtype=np.int64)

    def certificates(self, member_numbers: NDArray[np.int64], has_begun: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the certificates of the members for an info, in the format of Gymnasium's vector environments.

        Each array has the type of its first value, and 0 or None for environments in which no episode begins.

        Args:
            member_numbers: the member number of each environment.
            has_begun: True for environments in which an episode begins; at least one is True.
        """
        found: dict[str, Any] = {}
        every = [self._abouts[number]["certificates"] for number in member_numbers.tolist()]
        first = every[int(np.argmax(has_begun))]
        for name, value in first.items():
            values = np.array([one.get(name) for one in every], dtype=object)
            values[~has_begun] = None if value is None else 0
            found |= {
                name: values if value is None else values.astype(type(value)),
                f"_{name}": has_begun.copy(),
            }
        return {"certificates": found, "_certificates": has_begun.copy()}
