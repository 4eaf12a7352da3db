"""Enlarge the space for objects that rules create: the same program with longer rows, and the states copied to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from envgraph.env.compiled.layout._member_data import MemberData
from envgraph.env.compiled.layout._program_layout import FIRST_COLUMN
from envgraph.env.compiled.layout._symbols import CreatedCount, LinkMatrix, StateColumn, object_numbers
from envgraph.env.compiled.programs._compiled_program import CompiledProgram

Numbers = NDArray[Any]


def with_more_space(program: CompiledProgram) -> CompiledProgram:
    """Return a program with twice the space for created objects."""
    members = replace(program.members, spare=2 * program.members.spare)
    stride = int(program.arrays.offsets[0]) + program.members.spare
    return replace(program, arrays=program.layout.fill_arrays(members, stride), members=members)


def copy_states(
    old: CompiledProgram, new: CompiledProgram, members: Numbers, states: Numbers, floats: Numbers
) -> tuple[Numbers, Numbers]:
    """Return the states of a program in the longer rows of the grown program.

    Args:
        old: the program of the states.
        new: the grown program.
        members: int64 [n], the number of the member of each state.
        states, floats: [n, ..].
    """
    found = new.arrays.ints[members].copy(), new.arrays.floats[members].copy()
    found[0][:, :FIRST_COLUMN] = states[:, :FIRST_COLUMN]
    for number in np.unique(members).tolist():
        rows, member, other = members == number, old.members[number], new.members[number]
        for column, place in old.layout.stored_columns():
            source, target = int(old.arrays.offsets[place]), int(new.arrays.offsets[place])
            before, after = (floats, found[1]) if column.is_float else (states, found[0])
            (height, width), (_, wider) = (_column_shape(column, one) for one in (member, other))
            for row in range(height):
                start, end = source + row * width, target + row * wider
                after[rows, end : end + width] = before[rows, start : start + width]
    return found


def _column_shape(column: StateColumn | CreatedCount, member: MemberData) -> tuple[int, int]:
    """Return the numbers of rows and columns of a state column: one row, unless it is a matrix."""
    if isinstance(column, LinkMatrix):
        return len(object_numbers(member, column.sources)), len(object_numbers(member, column.targets))
    return 1, len(column.fill(member, 0))
