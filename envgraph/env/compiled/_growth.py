"""Enlarge the space for objects that rules create: the same program with longer rows, and the states copied to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from envgraph.env.compiled._layout import FIRST_COLUMN
from envgraph.env.compiled._member import Member
from envgraph.env.compiled._program import Program
from envgraph.env.compiled._tables import Column, LinkMatrix, Made, members

Numbers = NDArray[Any]


def grown(program: Program) -> Program:
    """Return a program with twice the space for created objects."""
    spare = 2 * program.spare
    found = tuple(member.with_spare(spare) for member in program.members)
    stride = max(member.size for member in found)
    arrays = program.layout.arrays(found, stride, found[0].strings)
    return replace(program, arrays=arrays, members=found, spare=spare)


def carried(
    old: Program, new: Program, of: Numbers, states: Numbers, floats: Numbers
) -> tuple[Numbers, Numbers]:
    """Return the states of a program in the longer rows of the grown program.

    Args:
        old: the program of the states.
        new: the grown program.
        of: int64 [n], the number of the member of each state.
        states, floats: [n, ..].
    """
    found = new.arrays.ints[of].copy(), new.arrays.floats[of].copy()
    found[0][:, :FIRST_COLUMN] = states[:, :FIRST_COLUMN]
    for number, member in enumerate(old.members):
        rows = of == number
        for column, place in old.layout.stored():
            source, target = int(old.arrays.offsets[place]), int(new.arrays.offsets[place])
            before, after = (floats, found[1]) if column.is_float else (states, found[0])
            (height, width), (_, wider) = (_shape(column, one) for one in (member, new.members[number]))
            for row in range(height):
                start, end = source + row * width, target + row * wider
                after[rows, end : end + width] = before[rows, start : start + width]
    return found


def _shape(column: Column | Made, member: Member) -> tuple[int, int]:
    """Return the numbers of rows and columns of a state column: one row, unless it is a matrix."""
    if isinstance(column, LinkMatrix):
        return len(members(member, column.sources)), len(members(member, column.targets))
    return 1, len(column.initial(member))
