"""More space for objects that rules create: the same program over longer rows, to which states are carried over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from envgraph.env.compiled._layout import FIRST_COLUMN
from envgraph.env.compiled._program import Program

Numbers = NDArray[Any]


def grown(program: Program) -> Program:
    """The program with twice the space for new objects."""
    spare = 2 * program.spare
    members = tuple(member.with_spare(spare) for member in program.members)
    stride = max(member.size for member in members)
    arrays = program.layout.arrays(members, stride, members[0].strings)
    return replace(program, arrays=arrays, members=members, spare=spare)


def carried(
    old: Program, new: Program, members: Numbers, states: Numbers, floats: Numbers
) -> tuple[Numbers, Numbers]:
    """States of a program as those of the grown one.

    Args:
        old: the program that they are of.
        new: that one, grown.
        members: int64 [n], the number of the member of each state.
        states, floats: [n, ..].
    """
    found = new.arrays.states[members].copy(), new.arrays.float_states[members].copy()
    found[0][:, :FIRST_COLUMN] = states[:, :FIRST_COLUMN]
    for number, member in enumerate(old.members):
        rows = members == number
        for column, place in old.layout.stored():
            length = len(column.initial(member))
            source, target = int(old.arrays.offsets[place]), int(new.arrays.offsets[place])
            before, after = (floats, found[1]) if column.is_float else (states, found[0])
            after[rows, target : target + length] = before[rows, source : source + length]
    return found
