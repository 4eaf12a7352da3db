"""One function of all delta functions that hear of the same change.

What two of them begin with alike is done once: the six places of one relation in a chain look at the same neighbours.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import field

from envgraph.code import dataclass
from envgraph.match.generate._symbols import Literal, Source
from envgraph.match.generate._write import Block, Module
from envgraph.match.views._delta import Delta, Role, write_delta
from envgraph.match.views._planning import ViewPlanner
from envgraph.metamodel import Value

Change = tuple[str, bool]
"""A view, and whether it gains derivations."""


@dataclass(slots=True)
class Group:
    """Statements that stand behind the same assignments, in order.

    Attributes:
        assignments: lines that give names values.
        statements: what is done with them.
    """

    assignments: tuple[str, ...]
    statements: list[Statement] = field(default_factory=list)


@dataclass(slots=True)
class Statement:
    """A line, and what stands under it if it ends with a colon.

    Attributes:
        line: with the indentation of its place.
        inside: what stands under it.
        changes: which views it changes, and whether it adds derivations to them.
    """

    line: str
    inside: list[Group] = field(default_factory=list)
    changes: set[Change] = field(default_factory=set)


class FusedModule(Module):
    """Equal constants have one name."""

    def __init__(self) -> None:
        super().__init__()
        self._literals: dict[tuple[type, str], str] = {}

    def literal(self, value: Value) -> str:
        key = (type(value), repr(value))
        if key not in self._literals:
            self._literals[key] = self.name(Literal(value))
        return self._literals[key]


def fused_source(planner: ViewPlanner, deltas: Sequence[Delta], coming: bool) -> Source:
    """The source of a function that does what the functions of several deltas do, one after the other.

    Each is a nest of loops and conditions around one line, whose effect none of them reads: so two that begin with the
    same loop can take turns inside it: neither what happens to different views has to stay in order, nor what a view
    gains, nor what it loses. But a view may lose what it has gained from the place before, in another pass of the loop:
    gains and losses of one view are never mixed.

    Args:
        planner: orders goals.
        deltas: of tuples of one relation.
        coming: whether the tuple has just come, or is about to go.

    Raises:
        Unplannable: some variables cannot be enumerated.
    """
    module, groups = FusedModule(), list[Group]()
    lines: list[str] = []
    for delta in deltas:
        block = Block()
        write_delta(planner, module, block, delta, coming)
        if _is_nest(delta):
            adding = coming != (delta.occurrence.role is Role.NONE)
            _insert(groups, _renamed(block.lines), (delta.name, adding))
        else:
            lines.extend([*_flat(groups), *block.lines])
            groups = []
    whole = Block()
    whole.lines = [*lines, *_flat(groups)]
    names = [f"a{position}" for position in range(len(deltas[0].occurrence.columns))]
    module.function("delta", names, whole)
    return module.source("delta")


def _is_nest(delta: Delta) -> bool:
    """Whether a function is one nest, and does not read what it changes."""
    return delta.occurrence.role is not Role.NUMBER and delta.own is None


def _renamed(lines: Sequence[str]) -> list[str]:
    """Variables numbered in the order in which they get their values, so that nests that do the same say the same."""
    numbers: dict[str, int] = {}

    def number(match: re.Match[str]) -> str:
        return f"{match[1]}{numbers.setdefault(match[2], len(numbers))}"

    return [re.sub(r"\b([vt])(\d+)\b", number, line) for line in lines]


def _insert(groups: list[Group], nest: Sequence[str], change: Change) -> None:
    """Add a nest inside what it has in common with one that is there, behind everything that changes its view."""
    count = next(index for index, line in enumerate(nest) if not re.match(r" *v\d+(,| =)", line))
    assignments, (first, *rest) = tuple(nest[:count]), nest[count:]
    statement = _alike(groups, assignments, first, change) if rest else None
    if statement is None:
        if not groups or groups[-1].assignments != assignments:
            groups.append(Group(assignments))
        statement = Statement(first)
        groups[-1].statements.append(statement)
    statement.changes.add(change)
    if rest:
        _insert(statement.inside, rest, change)


def _alike(
    groups: Sequence[Group], assignments: tuple[str, ...], line: str, change: Change
) -> Statement | None:
    """The last statement of this text, if it does not change the view the other way, nor anything behind it at all."""
    view, adding = change
    for group in reversed(groups):
        for statement in reversed(group.statements):
            if (view, not adding) in statement.changes:
                return None
            if statement.line == line and group.assignments == assignments:
                return statement
            if change in statement.changes:
                return None
    return None


def _flat(groups: Sequence[Group]) -> list[str]:
    """The lines in order; each has the indentation of its place already."""
    found: list[str] = []
    for group in groups:
        found.extend(group.assignments)
        for statement in group.statements:
            found.extend([statement.line, *_flat(statement.inside)])
    return found
