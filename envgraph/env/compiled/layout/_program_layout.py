"""Assign offsets to tables and columns. The program reads the offsets from a vector.

So one program serves all families of a behaviour, and all members of a family.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from itertools import chain
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled.layout._batch_arrays import FamilyArrays
from envgraph.env.compiled.layout._member_data import NO_OBJECT, ProgramMembers
from envgraph.env.compiled.layout._relations import Cell, Row, StaticRelation
from envgraph.env.compiled.layout._symbols import (
    AtMostOneObject,
    AtMostOneRow,
    AttributeColumn,
    BitTable,
    ClassSet,
    CreatedCount,
    GroupedValues,
    GroupStarts,
    KeyValues,
    LinkColumn,
    LinkMatrix,
    MemberNumbers,
    ProgramTable,
    StateColumn,
    StateNumbers,
    ValueDomain,
    ValueTable,
)
from envgraph.env.compiled.layout._text_tables import TextTable
from envgraph.metamodel import Scalar

T, G = code.Local("T"), code.Local("G")
"""The tables of the member, which rules do not change: ints, and floats."""
S, F = code.Local("S"), code.Local("F")
"""The state of the environment: ints, and floats."""
L, K = code.Local("L"), code.Local("K")
"""The vector of offsets, followed by the constants of the family; and the offsets as a tuple."""
D = code.Local("D")
"""The source of random numbers, and the steps left of a run of a unit."""
STEPS_LEFT = code.Subscript(D, code.Name("STEPS"))
RI, RF = code.Local("RI"), code.Local("RF")
"""The row buffers, where matches are stored: ints, and floats."""
TOP = code.Local("top")
STATE: Final = (T, G, L, K, S, F, RI, RF, D, TOP)
"""The first parameters of each function."""

ZERO, ONE, TWO, NOBODY = map(code.Constant, (0, 1, 2, -1))

ERROR, TURN, FIRST_COLUMN = 0, 1, 2
"""Columns of each state: the error, and the agent whose turn it is."""


@dataclass(frozen=True, slots=True)
class Stride:
    """The number of objects of the largest member."""


@dataclass(frozen=True, slots=True)
class Width:
    """The number of ints (`S`) or floats (`F`) in a state, or of rows for saving a state."""

    of: Literal["S", "F", "rows"]


@dataclass(frozen=True, slots=True)
class StringNumber:
    """The number of a string among all strings of a family."""

    text: str


Symbol: TypeAlias = "ProgramTable | StateColumn | CreatedCount | Stride | Width | Constants | StringNumber | TextTable"


@dataclass(frozen=True, slots=True)
class Constants:
    """Named numbers that are the same for all members of a family."""

    name: Hashable
    values: tuple[int, ...]


class ProgramLayout:
    """The tables and columns that a program uses, with their indices in the vector of offsets.

    Args:
        broken: assumptions about members that do not hold and must not be made.

    Attributes:
        created_classes: the concrete classes of objects that rules create.
        reuses_numbers: True if created objects may be deleted, so that later ones may get their numbers.
    """

    def __init__(self, broken: Iterable[Hashable] = ()) -> None:
        self.broken_assumptions = frozenset(broken)
        self.created_classes: frozenset[str] = frozenset()
        self.reuses_numbers = False
        self._numbers: dict[Symbol, int] = {Stride(): 0}
        self._single: dict[tuple[str, ...] | ValueDomain, AtMostOneObject] = {}

    def offset(self, symbol: Symbol) -> code.Expression:
        """Return code for the offset of a table or column, which is added to the layout if it is new.

        The offsets of constants are indices of the vector of offsets itself.
        """
        number = self._numbers.setdefault(symbol, len(self._numbers))
        return code.Subscript(K, code.Constant(number))

    def emit_offsets(self) -> code.Body:
        """Return the body of a function that returns all offsets as a tuple, since numba need not read values again."""
        return (code.Return(code.emit_tuple(*(emit_entry(L, place) for place in range(len(self._numbers))))),)

    def stride(self) -> code.Expression:
        """Return code for the number of objects of the largest member."""
        return self.offset(Stride())

    def assume_single(self, classes: tuple[str, ...] | ValueDomain) -> bool:
        """Assume that every member has at most one object of some classes. Return False if it is known to be wrong."""
        assumed = AtMostOneObject(classes)
        if assumed in self.broken_assumptions:
            return False
        self._single[classes] = assumed
        return True

    def assumes_functional(self, assumed: AtMostOneRow) -> bool:
        """Return True if it can be assumed that each member has at most one row for each combination of key values."""
        return assumed not in self.broken_assumptions

    def columns(self) -> list[tuple[StateColumn, int]]:
        """Return the columns of states, each with its index in the vector of offsets."""
        kinds = AttributeColumn | LinkColumn | LinkMatrix | ClassSet
        return [(symbol, number) for symbol, number in self._numbers.items() if isinstance(symbol, kinds)]

    def stored_columns(self) -> list[tuple[StateColumn | CreatedCount, int]]:
        """Return everything that a state stores: the columns, as `columns`, and the counter of created objects."""
        made = [(symbol, number) for symbol, number in self._numbers.items() if isinstance(symbol, CreatedCount)]
        return [*self.columns(), *made]

    def relations(self) -> list[StaticRelation]:
        """Return the relations that are computed once for each member, and stored as tables."""
        kinds = BitTable | ValueTable | GroupStarts
        return list(dict.fromkeys(one.keys.relation for one in self._numbers if isinstance(one, kinds)))

    def number_strings(self, texts: Iterable[str]) -> dict[str, int]:
        """Return the number of each of some strings, and of each in the program, in alphabetical order."""
        own = [symbol.text for symbol in self._numbers if isinstance(symbol, StringNumber)]
        keys = chain(*(symbol.values for symbol in self._numbers if isinstance(symbol, KeyValues)))
        known = {*texts, *own, *(value for value in keys if isinstance(value, str))}
        return {text: number for number, text in enumerate(sorted(known))}

    def fill_arrays(self, members: ProgramMembers, stride: int) -> FamilyArrays:
        """Compute the tables, offsets and initial states of a family.

        Args:
            members: the members. Strings that queries compute are added to their `strings`, as `NO_OBJECT`.
            stride: the number of objects of the largest member.

        Raises:
            AssumptionViolated: a member does not meet an assumption.
        """
        symbols = [one for one in self._numbers if isinstance(one, MemberNumbers)]
        filled: list[list[Sequence[Cell]]] = [[]] * len(members)
        known: dict[MemberNumbers, tuple[list[Row], Sequence[Cell]]] = {}

        def fill(symbol: MemberNumbers) -> Sequence[Cell]:
            """Fill a symbol for the current member, like the last one if its relation has the same rows as there."""
            if not isinstance(symbol, BitTable | ValueTable | GroupStarts | GroupedValues):
                return symbol.fill(member, stride)
            rows = member.rows(symbol.keys.relation)
            if symbol not in known or known[symbol][0] != rows:
                known[symbol] = rows, symbol.fill(member, stride)
            return known[symbol][1]

        for place, member in members.read_all():
            for assumed in self._single.values():
                assumed.check(member)
            filled[place] = [fill(symbol) for symbol in symbols]
        offsets = np.zeros(len(self._numbers), dtype=np.int64)
        tails: list[int] = []
        ends = {"T": 0, "G": 0, "S": FIRST_COLUMN, "F": 0}
        homes: list[tuple[str, int]] = []
        for symbol, number in self._numbers.items():
            match symbol:
                case Stride():
                    offsets[number] = stride
                case StringNumber(text):
                    offsets[number] = members.strings[text]
                case Constants() | TextTable():
                    offsets[number] = len(self._numbers) + len(tails)
                    tails += symbol.values if isinstance(symbol, Constants) else symbol.entries(members.strings)
                case MemberNumbers():
                    where = ("SF" if isinstance(symbol, StateNumbers) else "TG")[symbol.is_float]
                    ends[where] += where in "TG"  # A gap between tables, because -1 is an index as well.
                    offsets[number] = ends[where]
                    ends[where] += max(len(each[len(homes)]) for each in filled)
                    homes.append((where, int(offsets[number])))
        for symbol, number in self._numbers.items():
            if isinstance(symbol, Width):  # known only after all columns have their offsets
                offsets[number] = max(ends["S"], ends["F"]) if symbol.of == "rows" else ends[symbol.of]
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
        return FamilyArrays(arrays["T"], arrays["G"], whole, arrays["S"], arrays["F"])


def emit_sum(*parts: code.Expression | int) -> code.Expression:
    """Return code for a sum, with constants added up."""
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
    return code.emit_joined("+", terms, 0)


def emit_result(first: code.Expression, others: Sequence[code.Expression]) -> code.Expression:
    """Return code for the result of a function: the first value, or a tuple of all values if there are others."""
    return code.emit_tuple(first, *others) if others else first


def emit_entry(array: code.Expression, *places: code.Expression | int) -> code.Subscript:
    """Return code for the entry of an array at one or more indices."""
    keys: list[code.Expression] = []
    for place in places:
        keys.append(code.Constant(place) if isinstance(place, int) else place)
    return code.Subscript(array, code.emit_tuple(*keys) if len(keys) > 1 else keys[0])


def emit_table_entry(place: code.Expression, is_float: bool = False) -> code.Expression:
    """Return code for an entry of the tables of the member: of the ints, or of the floats if `is_float`."""
    return emit_entry(G if is_float else T, place)


def emit_value_entry(
    layout: ProgramLayout, table: ValueTable | GroupedValues | KeyValues, place: code.Expression
) -> code.Expression:
    """Return code for the value at a place of a table."""
    if table.type is Scalar.INT:
        twice = code.Operation("*", (place, code.Constant(2)))
        return code.emit_call("wide", T, emit_sum(layout.offset(table), twice))
    return emit_table_entry(emit_sum(layout.offset(table), place), table.is_float)


def emit_state_entry(place: code.Expression | int, is_float: bool = False) -> code.Subscript:
    """Return code for an entry of the state: of its ints, or of its floats if `is_float`."""
    return emit_entry(F if is_float else S, place)


def emit_bit_test(word: code.Expression, place: code.Expression) -> code.Expression:
    """Return code that tests if the bit with the index `place` modulo 32 is set in a word."""
    return code.Operation("==", (code.emit_call("bit", word, place), code.Constant(1)))


def emit_call(name: str, *arguments: code.Expression, top: code.Expression = TOP) -> code.Call:
    """Return a call of a function of the program, which may use the row buffers from `top` on."""
    return code.emit_call(name, *STATE[:-1], top, *arguments)


def emit_error(error: str) -> code.Assign:
    """Return an assignment that stores an error in the state. `error` names a constant of `kernels`."""
    return code.Assign(emit_state_entry(ERROR), code.Name(error))
