"""Fuse all delta functions of the same change into one function.

Common beginnings are executed only once. For example, six occurrences of a relation may loop over the same neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from envgraph.code import Assign, Body, BodyBuilder, For, If, Name, Statement, dataclass
from envgraph.match.generate._source_builder import SourceBuilder
from envgraph.match.generate._symbols import ConstantSymbol, GeneratedSource
from envgraph.match.views.delta._delta_functions import Delta, emit_delta, tuple_names
from envgraph.match.views.delta._occurrences import TupleEffect
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.metamodel import Value

Change = tuple[str, bool]
"""A view, and True if it gains derivations."""


@dataclass(slots=True)
class BranchGroup:
    """Branches that follow the same assignments, in order.

    Attributes:
        assignments: statements that assign variables.
        branches: the statements after them.
    """

    assignments: Body
    branches: list[CodeBranch] = field(default_factory=list)


@dataclass(slots=True)
class CodeBranch:
    """A loop or condition, and the statements inside it.

    Attributes:
        heads: the statement without its body; directly nested conditions count as one.
        inside: the statements inside.
        changes: the views that the branch changes, and True for each if it adds derivations.
    """

    heads: Body
    inside: list[BranchGroup] = field(default_factory=list)
    changes: set[Change] = field(default_factory=set)


class FusedSourceBuilder(SourceBuilder):
    """A generated source in which equal constants have the same name."""

    def __init__(self) -> None:
        super().__init__()
        self._literals: dict[tuple[type, str], Name] = {}

    def literal(self, value: Value) -> Name:
        key = (type(value), repr(value))
        if key not in self._literals:
            self._literals[key] = self.name_of(ConstantSymbol(value))
        return self._literals[key]


def fused_source(planner: ViewPlanner, deltas: Sequence[Delta], inserting: bool) -> GeneratedSource:
    """Return the source of a function that executes several delta functions one after the other.

    Each delta function is a nest of loops and conditions around one change, whose effect no nest reads. So two nests
    with the same outer loop can share this loop: changes of different views, additions to one view, and deletions from
    one view may be reordered. But a view may lose a row that it has gained in another pass of the loop. So additions
    and deletions of one view are never put into the same loop.

    Args:
        planner: orders goals.
        deltas: the deltas, of tuples of one relation.
        inserting: True if the tuple has just been inserted; False if it will be deleted.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, groups = FusedSourceBuilder(), list[BranchGroup]()
    whole: list[Statement] = []
    for delta in deltas:
        block = BodyBuilder()
        emit_delta(planner, module, block, delta, inserting)
        # Only a single nest that does not read its own changes can be fused.
        if delta.occurrence.role is not TupleEffect.COUNT and delta.own is None:
            adding = inserting != (delta.occurrence.role is TupleEffect.NEGATED)
            insert_nest(groups, block.finish_body(), (delta.name, adding))
        else:
            whole += [*merge_groups(groups), *block.finish_body()]
            groups = []
    whole += merge_groups(groups)
    return module.finish(module.add_function("delta", tuple_names(deltas[0].occurrence), tuple(whole)))


def insert_nest(groups: list[BranchGroup], nest: Body, change: Change) -> None:
    """Add a nest of loops and tests to the groups, if possible inside a branch that begins with the same statements."""
    count = next(index for index, statement in enumerate(nest) if not isinstance(statement, Assign))
    assignments, (first, *behind) = nest[:count], nest[count:]
    heads, inside = _split_head(first)
    rest = (*inside, *behind)
    branch = _find_branch(groups, assignments, heads, change) if rest else None
    if branch is None:
        if not groups or groups[-1].assignments != assignments:
            groups.append(BranchGroup(assignments))
        branch = CodeBranch(heads)
        groups[-1].branches.append(branch)
    branch.changes.add(change)
    if rest:
        insert_nest(branch.inside, rest, change)


def _split_head(statement: Statement) -> tuple[Body, Body]:
    """Return a statement without its body, and the statements in the body; directly nested conditions count as one."""
    match statement:
        case For(target, iterable, inside):
            return (For(target, iterable, ()),), inside
        case If(test, (If() as inner,)):
            heads, inside = _split_head(inner)
            return (If(test, ()), *heads), inside
        case If(test, inside):
            return (If(test, ()),), inside
        case _:
            return (statement,), ()


def _find_branch(groups: Sequence[BranchGroup], assignments: Body, heads: Body, change: Change) -> CodeBranch | None:
    """Return the last branch with this head after these assignments, to put a nest with this change into it.

    Return None if there is none, if a later branch changes the same view, or if the branch changes it the opposite way.
    """
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


def merge_groups(groups: Sequence[BranchGroup]) -> Body:
    """Return the statements of all groups in order."""
    found: list[Statement] = []
    for group in groups:
        found += group.assignments
        for branch in group.branches:
            found += _join_heads(branch.heads, merge_groups(branch.inside))
    return tuple(found)


def _join_heads(heads: Body, inside: Body) -> Body:
    """Return the statements with these heads around other statements; after an assignment, the others follow it."""
    for head in reversed(heads):
        match head:
            case For(target, iterable):
                inside = (For(target, iterable, inside),)
            case If(test):
                inside = (If(test, inside),)
            case _:
                inside = (head, *inside)
    return inside
