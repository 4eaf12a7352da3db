"""The numbered variables of one body during its lowering."""

from __future__ import annotations

from envgraph.code import dataclass
from envgraph.metamodel import Metamodel, Value
from envgraph.pattern._goals import StaticType
from envgraph.pattern._types import coerce, meet


class Unsatisfiable(Exception):
    """Raised if no model can satisfy a body. The lowering then omits the body."""


@dataclass(slots=True)
class _Slot:
    name: str | None
    type: StaticType | None


class Slots:
    """Numbered variables (slots) of one body. Slots can be united with each other and fixed to a value.

    Numbers are assigned in the order of first mention, parameters first. The representative of a united group is the
    slot with the lowest number, so it is a parameter if the group has one.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._slots: list[_Slot] = []
        self._by_name: dict[str, int] = {}
        self._parent: list[int] = []
        self._values: dict[int, Value] = {}

    def create_slot(self, type_: StaticType | None, name: str | None = None) -> int:
        """Create a slot and return its number. `type_` is None if the type is unknown."""
        self._slots.append(_Slot(name, type_))
        number = len(self._slots) - 1
        self._parent.append(number)
        if name is not None:
            self._by_name[name] = number
        return number

    def named_slot(self, name: str, type_: StaticType | None) -> int:
        """Return the slot of a named variable. Create it with this type at the first call."""
        return self._by_name[name] if name in self._by_name else self.create_slot(type_, name)

    def representative(self, number: int) -> int:
        """Return the representative of the slots united with a slot, or the slot itself if it is not united."""
        while self._parent[number] != number:
            number = self._parent[number]
        return number

    def unite(self, one: int, other: int) -> None:
        """Unite two slots, and the slots that each is united with.

        Raises:
            Unsatisfiable: they are fixed to different values, or no value has both types.
        """
        low, high = sorted((self.representative(one), self.representative(other)))
        if low == high:
            return
        first, second = self._slots[low].type, self._slots[high].type
        if first is not None and second is not None:
            both = meet(first, second, self._metamodel)
            if both is None:
                raise Unsatisfiable
            self._slots[low].type = both
        else:
            self._slots[low].type = first or second
        self._parent[high] = low
        if high in self._values:
            self.fix_value(low, self._values.pop(high))

    def fix_value(self, number: int, value: Value) -> None:
        """Fix a slot to a value.

        Raises:
            Unsatisfiable: the slot is fixed to another value.
        """
        root = self.representative(number)
        if self._values.setdefault(root, value) != value:
            raise Unsatisfiable

    def fixed_value(self, number: int) -> Value | None:
        """Return the value to which a slot is fixed, as its type stores it, or None if the slot is not fixed."""
        root = self.representative(number)
        return coerce(self._values[root], self._slots[root].type) if root in self._values else None

    def type_of(self, number: int) -> StaticType | None:
        """Return the static type of a slot, or None if unknown."""
        return self._slots[self.representative(number)].type

    def name_of(self, number: int) -> str | None:
        """Return the name that the variable of a slot has in the text, or None."""
        return self._slots[number].name

    def __len__(self) -> int:
        return len(self._slots)
