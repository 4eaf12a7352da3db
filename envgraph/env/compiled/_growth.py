"""More space for objects that rules create: the same program over longer rows, to which states are carried over."""

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
    """The program with twice the space for new objects."""
    spare = 2 * program.spare
    found = tuple(member.with_spare(spare) for member in program.members)
    stride = max(member.size for member in found)
    arrays = program.layout.arrays(found, stride, found[0].strings)
    return replace(program, arrays=arrays, members=found, spare=spare)


def carried(
    old: Program, new: Program, of: Numbers, states: Numbers, floats: Numbers
) -> tuple[Numbers, Numbers]:
    """States of a program as those of the grown one.

    Args:
        old: the program that they are of.
        new: that one, grown.
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
    """How many rows a column has, of how many numbers: one, but for a matrix."""
    if isinstance(column, LinkMatrix):
        return len(members(member, column.sources)), len(members(member, column.targets))
    return 1, len(column.initial(member))
