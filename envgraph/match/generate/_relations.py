"""Emit expressions that read one relation: extents, links, matches of called patterns, closures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from envgraph import code
from envgraph.match.generate._bindings import Bindings
from envgraph.match.generate._sinks import length
from envgraph.match.generate._symbols import (
    Aggregated,
    Builtin,
    ClassTable,
    ClosureQuestion,
    Column,
    Mode,
    Recursive,
    Valued,
    View,
    closed,
)
from envgraph.match.generate._write import Module
from envgraph.match.plan._options import call_key
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._sharing import Alike
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import CallAtom, ClosureAtom, InstanceAtom, LinkAtom, RelationAtom, arguments


class Relations:
    """An emitter of expressions for the tuples of a relation that agree with the bound variables.

    Args:
        planner: plans called patterns.
        module: receives symbols.
        bindings: the bound variables.
    """

    def __init__(self, planner: Planner, module: Module, bindings: Bindings) -> None:
        self._planner = planner
        self._metamodel = planner.library.metamodel
        self._module = module
        self.bindings = bindings

    def indices(self, cls: str, exact: bool) -> list[int]:
        """Return the indices of the concrete classes with the objects of a class; if `exact`, only its own index."""
        names = (cls,) if exact else self._metamodel.concrete(cls)
        return [index for index, each in enumerate(self._metamodel.class_list) if each.name in names]

    def members(self, cls: str, exact: bool) -> list[code.Expression]:
        """Return the names of the extents with the objects of a class; if `exact`, without those of subclasses."""
        return [self._module.name(Column("extents", index)) for index in self.indices(cls, exact)]

    def extent(self, cls: str, exact: bool) -> code.Expression:
        """Return an expression for all objects of a class; if `exact`, without those of subclasses."""
        members = self.members(cls, exact)
        if len(members) == 1:
            return members[0]
        return code.call(self._module.name(Builtin("chain")), *members) if members else code.Tuple(())

    def is_instance(self, goal: InstanceAtom) -> code.Expression:
        """Return a test that an object is of a class; for an unbound object, a test that the class has objects."""
        if not self.bindings.known(goal.variable):
            return code.joined("or", self.members(goal.cls, goal.exact), False)
        cls = code.Index(self._module.name(Column("classes")), self.bindings.source(goal.variable))
        indices = self.indices(goal.cls, goal.exact)
        if len(indices) == 1:
            return code.equal(cls, code.Constant(indices[0]))
        return code.Index(self._module.name(ClassTable(goal.cls)), cls) if indices else code.Constant(False)

    def ends(self, goal: LinkAtom) -> code.Expression:
        """Return code for the other ends of the links of the bound object, or the objects with the bound value."""
        reference = goal.reference
        if self.bindings.known(goal.source):
            return code.Index(self._module.name(forward_column(reference)), self.bindings.source(goal.source))
        if isinstance(reference, Attribute):
            valued = Valued(tuple(self.indices(reference.owner, False)), (reference.index,))
            return code.call(self._module.name(valued), self.bindings.source(goal.target))
        return code.Index(
            self._module.name(Column("backward", reference.index)), self.bindings.source(goal.target)
        )

    def is_linked(self, goal: LinkAtom) -> code.Expression:
        """Return a test that two objects are linked. If one is not bound, return a test that the other has a link."""
        if not (self.bindings.known(goal.source) and self.bindings.known(goal.target)):
            return self.ends(goal)
        source, target = self.bindings.source(goal.source), self.bindings.source(goal.target)
        sizes = self._planner.sizes
        reference = goal.reference
        if isinstance(reference, Reference) and sizes.backward(reference) < sizes.forward(reference):
            backward = self._module.name(Column("backward", reference.index))  # the shorter side
            return code.Operation("in", (source, code.Index(backward, target)))
        return code.Operation(
            "in", (target, code.Index(self._module.name(forward_column(reference)), source))
        )

    def view(self, goal: CallAtom, wanted: Sequence[int], mode: Mode) -> code.Expression:
        """Return a call of a pattern's function with the bound arguments, for `wanted` variables in a result mode."""
        known = frozenset(v for v in goal.arguments if self.bindings.known(v))
        return self._call(self._module.name(View(call_key(goal, known, wanted), mode)), goal)

    def rows(self, goal: CallAtom) -> code.Expression:
        """Return a call of the function that lists the matches of a recursive pattern for the bound arguments."""
        bound = tuple(position for position, v in enumerate(goal.arguments) if self.bindings.known(v))
        return self._call(self._module.name(Recursive(goal.pattern, bound)), goal)

    def count(self, relation: RelationAtom) -> code.Expression | None:
        """Return code for the number of tuples that agree with the bound variables; None if a loop is needed."""
        called = arguments(relation)
        free = [v for v in called if not self.bindings.known(v)]
        if not free or len(set(free)) != len(free):
            return None
        match relation:
            case InstanceAtom(cls, _, exact):
                return code.joined("+", [length(name) for name in self.members(cls, exact)], 0)
            case LinkAtom() if len(free) == 1:
                return length(self.ends(relation))
            case CallAtom(pattern) if self._planner.calls.recursive(pattern):
                return length(self.rows(relation))
            case CallAtom():
                return self.view(relation, free, Mode.COUNT)
        return None

    def column(self, relation: RelationAtom, column: int) -> code.Expression | None:
        """Return code for the values of a variable in the matches of a called pattern; None if a loop is needed."""
        free = [v for v in arguments(relation) if not self.bindings.known(v)]
        if not isinstance(relation, CallAtom) or column not in free or len(set(free)) != len(free):
            return None
        if self._planner.calls.recursive(relation.pattern):
            return None
        key = call_key(relation, frozenset(relation.arguments) - {*free}, free)
        last = relation.arguments.index(column)
        outputs = (*(place for place in key.outputs if place != last), last)
        return self._call(self._module.name(View(replace(key, outputs=outputs), Mode.BAG)), relation)

    def _call(self, function: code.Name, goal: CallAtom) -> code.Expression:
        """Return a call of a function with the bound arguments of a goal."""
        return code.call(
            function, *[self.bindings.source(v) for v in goal.arguments if self.bindings.known(v)]
        )

    def closure(self, goal: ClosureAtom) -> code.Expression:
        """Return code for the nodes reached from the bound end; if both are bound, a test; if none is, all pairs."""
        known = self.bindings.known(goal.source), self.bindings.known(goal.target)
        if known[0] == known[1]:
            return self._reach(goal, ClosureQuestion.HOLDS if known[0] else ClosureQuestion.PAIRS, True)
        return self._reach(goal, ClosureQuestion.ALL, known[0])

    def spread(self, goal: ClosureAtom, seen: code.Local) -> code.Expression:
        """Return code for the nodes reached from the bound end, without those in `seen`, which is updated."""
        return self._reach(goal, ClosureQuestion.SPREAD, self.bindings.known(goal.source), seen)

    def _reach(
        self, goal: ClosureAtom, question: ClosureQuestion, forward: bool, *more: code.Expression
    ) -> code.Expression:
        """Return a call of the function that answers a question about a closure. `more` are further arguments."""
        inputs = [self.bindings.source(v) for v in (goal.source, goal.target) if self.bindings.known(v)]
        return code.call(self._module.name(closed(goal, question, forward)), *inputs, *more)


def forward_column(feature: Reference | Attribute) -> Column:
    """Return the column of a reference's targets, or of an attribute's values."""
    return Column("values" if isinstance(feature, Attribute) else "forward", feature.index)


def same_for_all(
    module: Module,
    alike: Alike,
    start: code.Expression,
    direct: code.Name,
    given: Sequence[code.Expression],
    outside: code.Expression,
    function: str = "count",
    column: int | None = None,
) -> code.Expression:
    """Return code for an aggregate whose value is shared by all starts from which a closure reaches the same nodes.

    Args:
        module: receives symbols.
        alike: the closure, and the aggregate's dependence on the reached nodes.
        start: code for the start.
        direct: the name of the function that computes the value directly.
        given: the arguments of this function, including the start.
        outside: code for the tuple of other values on which the possible ends depend.
        function: count, sum, avg, min or max.
        column: the position that is aggregated; None for count.
    """
    others = code.Tuple(tuple(each for each in given if each != start))
    parts = [start, direct, code.Tuple(tuple(given)), others]
    if alike.ends is not None:
        ends = alike.ends
        parts += [
            module.name(Aggregated(ends.pattern, ends.start, ends.given, ends.wanted, function, column)),
            outside,
        ]
    return code.call(module.name(closed(alike.closure, ClosureQuestion.ALIKE, alike.forward)), *parts)
