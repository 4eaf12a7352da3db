"""Rows of grids where a blank is a letter, and what objects of grids are called."""

from __future__ import annotations

import pickle
from copy import copy

import pytest

from envgraph.errors import InvalidArgument
from envgraph.lang import TextFiles, Workspace, load_workspace

BOARD = """metamodel board
class Board { contains Cell[] cells }
class Cell { int x int y refers Cell[0..1] next }
@glyph(".") class Floor extends Cell
"""
BLANK = BOARD + '@glyph(" ") class Gap extends Cell\n'


def read(rows: str, metamodel: str = BLANK, legend: str = "") -> Workspace:
    grid = f'grid cell {{ {legend} column x next next row y rows """{rows}""" }}'
    text = f'import "b.metamodel"\nmodel m : board {{ board : Board {{ cells = {grid} }} }}'
    return load_workspace(["b.model"], files=TextFiles({"b.metamodel": metamodel, "b.model": text}))


def size(workspace: Workspace) -> tuple[int, int, int]:
    cells = workspace.model().nodes("Cell")
    return len(cells), 1 + max(cell.x for cell in cells), 1 + max(cell.y for cell in cells)


@pytest.mark.parametrize(
    ("rows", "metamodel", "legend"),
    [
        ("\n  ...\n  ..\n  ...\n", BLANK, ""),
        ("\n  ...\n  ....  \n  ...\n", BLANK, ""),
        ("\n  ...\n\n  ...\n  ", BLANK, ""),
        ("\n  ...\n    \n  ...\n  ", BLANK, ""),
        ("\n  ...\n  ..\n  ...\n", BOARD, ""),
        ("\n  ...\n  .. .\n  ...\n", BOARD, 'legend "." = Floor, " " = none'),
    ],
)
def test_rows_of_unequal_length_are_an_error(rows: str, metamodel: str, legend: str) -> None:
    problems = read(rows, metamodel, legend).errors
    assert [one.code for one in problems] == ["unequal-rows"]
    blanks = metamodel == BLANK or legend
    assert str(problems[0].hint).endswith("blanks at the end of a row count" if blanks else "equally long")


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("\n  ...\n  .  \n     \n  ", (9, 3, 3)),
        ("\n\n  ...\n  .. \n\n      ", (6, 3, 2)),
        ("...\n. .", (6, 3, 2)),
        ("\n...\n   \n...", (9, 3, 3)),
    ],
)
def test_blanks_are_cells_but_the_common_indentation_is_removed(rows: str, expected: tuple[int, int, int]) -> None:
    assert size(read(rows)) == expected


def test_an_object_of_a_grid_is_found_by_its_column_and_row() -> None:
    model = read("\n ..\n ..\n", BOARD).model()
    cell = model["cell[1, 0]"]
    assert (cell.x, cell.y) == (1, 0) and model.graph.find_object("cell[1,0]") == cell.id and "cell[0, 1]" in model
    assert cell.object_name is None
    for other in (copy(model), pickle.loads(pickle.dumps(model))):
        assert other["cell[1,0]"].id == cell.id
    cell.next = None
    model["cell[0, 0]"].next = None
    cell.delete()
    with pytest.raises(InvalidArgument, match=r"no object `cell\[1, 0\]`; did you mean `cell\[\d,\d\]`"):
        model["cell[1, 0]"]
