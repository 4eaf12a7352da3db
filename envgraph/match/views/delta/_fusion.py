"""One function of all delta functions that hear of the same change.

What two of them begin with alike is done once: the six places of one relation in a chain look at the same neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from envgraph.code import Assign, Block, Body, For, If, Name, Statement, dataclass
from envgraph.match.generate._symbols import Literal, Source
from envgraph.match.generate._write import Module
from envgraph.match.views.delta._delta import Delta, tuple_names, write_delta
from envgraph.match.views.delta._occurrences import Role
from envgraph.match.views.delta._planning import ViewPlanner
from envgraph.metamodel import Value

Change = tuple[str, bool]
"""A view, and whether it gains derivations."""


@dataclass(slots=True)
class Group:
    """Branches that stand behind the same assignments, in order.

    Attributes:
        assignments: give variables values.
        branches: what is done with them.
    """

    assignments: Body
    branches: list[Branch] = field(default_factory=list)


@dataclass(slots=True)
class Branch:
    """A statement, and what follows only where it has led.

    Attributes:
        heads: the statement, without what stands inside it; tests that stand directly inside each other are one.
        inside: what follows.
        changes: which views it changes, and whether it adds derivations to them.
    """

    heads: Body
    inside: list[Group] = field(default_factory=list)
    changes: set[Change] = field(default_factory=set)


class FusedModule(Module):
    """Equal constants have one name."""

    def __init__(self) -> None:
        super().__init__()
        self._literals: dict[tuple[type, str], Name] = {}

    def literal(self, value: Value) -> Name:
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
    whole: list[Statement] = []
    for delta in deltas:
        block = Block()
        write_delta(planner, module, block, delta, coming)
        # Whether it is one nest, and does not read what it changes.
        if delta.occurrence.role is not Role.NUMBER and delta.own is None:
            adding = coming != (delta.occurrence.role is Role.NONE)
            insert(groups, block.body(), (delta.name, adding))
        else:
            whole += [*merged(groups), *block.body()]
            groups = []
    whole += merged(groups)
    return module.source(module.function("delta", tuple_names(deltas[0].occurrence), tuple(whole)))


def insert(groups: list[Group], nest: Body, change: Change) -> None:
    """Add a nest inside what it has in common with one that is there, behind everything that changes its view."""
    count = next(index for index, statement in enumerate(nest) if not isinstance(statement, Assign))
    assignments, (first, *behind) = nest[:count], nest[count:]
    heads, inside = _opened(first)
    rest = (*inside, *behind)
    branch = _alike(groups, assignments, heads, change) if rest else None
    if branch is None:
        if not groups or groups[-1].assignments != assignments:
            groups.append(Group(assignments))
        branch = Branch(heads)
        groups[-1].branches.append(branch)
    branch.changes.add(change)
    if rest:
        insert(branch.inside, rest, change)


def _opened(statement: Statement) -> tuple[Body, Body]:
    """Return what a statement begins with, and what stands inside it."""
    match statement:
        case For(target, iterable, inside):
            return (For(target, iterable, ()),), inside
        case If(test, (If() as inner,)):
            heads, inside = _opened(inner)
            return (If(test, ()), *heads), inside
        case If(test, inside):
            return (If(test, ()),), inside
        case _:
            return (statement,), ()


def _alike(groups: Sequence[Group], assignments: Body, heads: Body, change: Change) -> Branch | None:
    """The last branch with this head, if it does not change the view the other way, nor anything behind it at all."""
    view, adding = change
    for group in reversed(groups):
        for branch in reversed(group.branches):
            if (view, not adding) in branch.changes:
                return None
            if branch.heads == heads and group.assignments == assignments:
                return branch
            if change in branch.changes:
                return None
    return None


def merged(groups: Sequence[Group]) -> Body:
    """The statements in order."""
    found: list[Statement] = []
    for group in groups:
        found += group.assignments
        for branch in group.branches:
            found += _closed(branch.heads, merged(branch.inside))
    return tuple(found)


def _closed(heads: Body, inside: Body) -> Body:
    """The statements of which these are the heads, with something inside, or behind."""
    for head in reversed(heads):
        match head:
            case For(target, iterable):
                inside = (For(target, iterable, inside),)
            case If(test):
                inside = (If(test, inside),)
            case _:
                inside = (head, *inside)
    return inside
