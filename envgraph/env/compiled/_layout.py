"""Where things are: every table and every column gets a place, and the program reads it from a vector of offsets.

So one program serves all families of a behaviour, and all their members.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._member import NO_OBJECT, Cell, Member
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._tables import (
    AttributeColumn,
    Bits,
    ClassSet,
    Column,
    LinkColumn,
    LinkMatrix,
    Made,
    One,
    Relation,
    Single,
    Starts,
    Table,
    Values,
)
from envgraph.env.compiled._world import Arrays
from envgraph.env.compiled.kernels import CAPACITY

T, G = code.Local("T"), code.Local("G")
"""What no rule changes about the member: ints, and floats."""
S, F = code.Local("S"), code.Local("F")
"""The state of the environment: ints, and floats."""
L, K = code.Local("L"), code.Local("K")
"""Offsets, and behind them what is the same for the whole family; the offsets again, as a tuple."""
D = code.Local("D")
"""What is drawn from."""
RI, RF = code.Local("RI"), code.Local("RF")
"""Space for rows: ints, and floats."""
TOP = code.Local("top")
STATE: Final = (T, G, L, K, S, F, RI, RF, D, TOP)
"""What each function gets."""

ZERO, ONE, NOBODY = code.Constant(0), code.Constant(1), code.Constant(-1)

ERROR, TURN, FIRST_COLUMN = 0, 1, 2
"""Columns of each state: what went wrong, and whose turn it is."""


@dataclass(frozen=True, slots=True)
class Stride:
    """The number of objects of the largest member."""


@dataclass(frozen=True, slots=True)
class Width:
    """How many numbers a state has: ints, or floats."""

    of: Literal["S", "F"]


@dataclass(frozen=True, slots=True)
class Text:
    """The number of a string, among all that a family has."""

    text: str


Symbol: TypeAlias = "Table | Column | Made | Stride | Width | Constants | Text"


@dataclass(frozen=True, slots=True)
class Constants:
    """Numbers that are the same for a family, under a name of their own."""

    name: Hashable
    values: tuple[int, ...]


class Layout:
    """The tables and columns that a program names.

    Args:
        broken: the assumptions that members do not meet.

    Attributes:
        created: the concrete classes of objects that rules create.
        renumbered: whether these may go, too, so that others get their numbers.
    """

    def __init__(self, broken: Iterable[Hashable] = ()) -> None:
        self.broken = frozenset(broken)
        self.created: frozenset[str] = frozenset()
        self.renumbered = False
        self._numbers: dict[Symbol, int] = {Stride(): 0}
        self._single: dict[tuple[str, ...], Single] = {}

    def offset(self, symbol: Symbol) -> code.Expression:
        """Code for where a table or column begins; of constants, within the vector of offsets."""
        number = self._numbers.setdefault(symbol, len(self._numbers))
        return code.Index(K, code.Constant(number))

    def places(self) -> code.Body:
        """The body of a function that returns the offsets: as values, they need not be read again after a change."""
        return (code.Return(code.tuple_of(*(entry(L, place) for place in range(len(self._numbers))))),)

    def stride(self) -> code.Expression:
        """Code for the number of objects of the largest member."""
        return self.offset(Stride())

    def single(self, classes: tuple[str, ...]) -> bool:
        """Whether every member has one object at most of some classes."""
        assumed = Single(classes)
        if assumed in self.broken:
            return False
        self._single[classes] = assumed
        return True

    def functional(self, assumed: One) -> bool:
        """Whether some values have one row at most, in every member."""
        return assumed not in self.broken

    def columns(self) -> list[tuple[Column, int]]:
        """The columns of states, each with the place in the vector of offsets that says where it begins."""
        kinds = AttributeColumn | LinkColumn | LinkMatrix | ClassSet
        return [(symbol, number) for symbol, number in self._numbers.items() if isinstance(symbol, kinds)]

    def stored(self) -> list[tuple[Column | Made, int]]:
        """All that states have, as `columns`."""
        made = [(symbol, number) for symbol, number in self._numbers.items() if isinstance(symbol, Made)]
        return [*self.columns(), *made]

    def relations(self) -> list[Relation]:
        """What is asked of members once."""
        kinds = Bits | Values | Starts
        return list(dict.fromkeys(one.keys.relation for one in self._numbers if isinstance(one, kinds)))

    @property
    def texts(self) -> set[str]:
        """The strings that the program names."""
        return {symbol.text for symbol in self._numbers if isinstance(symbol, Text)}

    def arrays(self, members: Iterable[Member], stride: int, strings: Mapping[str, int]) -> Arrays:
        """The data of a family.

        Args:
            members: each is asked before the next is.
            stride: the number of objects of the largest one.
            strings: number of each string.

        Raises:
            Misfit: a member does not meet an assumption.
        """
        symbols = [one for one in self._numbers if not isinstance(one, Stride | Width | Constants | Text)]
        filled: list[list[Sequence[Cell]]] = []
        for member in members:
            member.arrive()
            for assumed in self._single.values():
                assumed.check(member)
            filled.append([_numbers(symbol, member, stride) for symbol in symbols])
        offsets = np.zeros(len(self._numbers), dtype=np.int64)
        tails: list[int] = []
        ends = {"T": 0, "G": 0, "S": FIRST_COLUMN, "F": 0}
        homes: list[tuple[str, int]] = []
        for symbol, number in self._numbers.items():
            if isinstance(symbol, Stride):
                offsets[number] = stride
            elif isinstance(symbol, Width):
                pass  # not known before all columns have their places
            elif isinstance(symbol, Text):
                offsets[number] = strings[symbol.text]
            elif isinstance(symbol, Constants):
                offsets[number] = len(self._numbers) + len(tails)
                tails += symbol.values
            else:
                where = _where(symbol)
                ends[where] += where in "TG"  # an entry for what is not there: -1 is a place, too
                offsets[number] = ends[where]
                ends[where] += max(len(each[len(homes)]) for each in filled)
                homes.append((where, int(offsets[number])))
        for symbol, number in self._numbers.items():
            if isinstance(symbol, Width):
                offsets[number] = ends[symbol.of]
                if ends[symbol.of] > CAPACITY:  # it is kept where the rows of a question would be
                    raise NotCompiled("a rule in a unit that the model may refuse, where states are large")
        count = len(filled)
        arrays: dict[str, NDArray[Any]] = {
            "T": np.full((count, ends["T"]), NO_OBJECT, dtype=np.int32),
            "G": np.full((count, ends["G"]), np.nan),
            "S": np.zeros((count, ends["S"]), dtype=np.int64),
            "F": np.zeros((count, ends["F"])),
        }
        for row, each in enumerate(filled):
            for (where, start), values in zip(homes, each, strict=True):
                arrays[where][row, start : start + len(values)] = values
        whole = np.concatenate([offsets, np.array(tails, dtype=np.int64)])
        return Arrays(arrays["T"], arrays["G"], whole, arrays["S"], arrays["F"])


def _where(symbol: Symbol) -> str:
    assert not isinstance(symbol, Stride | Width | Constants | Text)
    if hasattr(symbol, "fill"):
        return "G" if symbol.is_float else "T"
    return "F" if symbol.is_float else "S"


def _numbers(symbol: Symbol, member: Member, stride: int) -> Sequence[Cell]:
    assert not isinstance(symbol, Stride | Width | Constants | Text)
    return symbol.fill(member, stride) if hasattr(symbol, "fill") else symbol.initial(member)


def plus(*parts: code.Expression | int) -> code.Expression:
    """Code for a sum."""
    known = 0
    terms: list[code.Expression] = []
    for part in parts:
        if isinstance(part, code.Constant):
            known += int(part.value or 0)
        elif isinstance(part, int):
            known += part
        else:
            terms.append(part)
    if known or not terms:
        terms.append(code.Constant(known))
    return code.joined("+", terms, 0)


def listed(first: code.Expression, others: Sequence[code.Expression]) -> code.Expression:
    """Code for what a function returns: a value, or a tuple of it and others."""
    return code.tuple_of(first, *others) if others else first


def entry(array: code.Expression, *places: code.Expression | int) -> code.Index:
    """Code for an entry of an array."""
    keys = [code.Constant(place) if isinstance(place, int) else place for place in places]
    return code.Index(array, code.tuple_of(*keys) if len(keys) > 1 else keys[0])


def table(place: code.Expression, is_float: bool = False) -> code.Expression:
    """Code for an entry of a table of the member."""
    return entry(G if is_float else T, place)


def cell(place: code.Expression | int, is_float: bool = False) -> code.Index:
    """Code for an entry of the state."""
    return entry(F if is_float else S, place)


def bit(word: code.Expression, place: code.Expression) -> code.Expression:
    """Code for a bit of a word, as a truth value."""
    return code.Operation("==", (code.call("bit", word, place), code.Constant(1)))


def call(name: str, *arguments: code.Expression, top: code.Expression = TOP) -> code.Call:
    """Code for a call of a function of the program, which may use the space for rows from `top` on."""
    return code.call(name, *STATE[:-1], top, *arguments)


def failed(error: str) -> code.Assign:
    """Code for what is done where the live engine raises an error, which has this name in `kernels`."""
    return code.Assign(cell(ERROR), code.Name(error))
