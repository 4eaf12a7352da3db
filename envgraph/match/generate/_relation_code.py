"""Emit expressions that read one relation: extents, links, matches of called patterns, closures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from envgraph import code
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._sinks import aggregate_function_name, length
from envgraph.match.generate._source_builder import SourceBuilder
from envgraph.match.generate._symbols import (
    Builtin,
    ClassTable,
    ClosureQuestion,
    PatternFunction,
    ReachAggregateSymbol,
    RecursiveFunction,
    ResultMode,
    StoreColumn,
    Valued,
    closure_function,
)
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._shared_searches import ReachAggregate
from envgraph.match.plan._step_candidates import query_of_call
from envgraph.metamodel import Attribute, Reference
from envgraph.pattern import (
    AggregateAtom,
    CallAtom,
    ClosureAtom,
    InstanceAtom,
    LinkAtom,
    RelationAtom,
    relation_variables,
)


class RelationCode:
    """An emitter of expressions for the tuples of a relation that agree with the bound variables.

    Args:
        planner: plans called patterns.
        module: receives symbols.
        bindings: the bound variables.
    """

    def __init__(self, planner: Planner, module: SourceBuilder, bindings: VariableBindings) -> None:
        self._planner = planner
        self._metamodel = planner.library.metamodel
        self._module = module
        self.bindings = bindings

    def concrete_class_indices(self, cls: str, exact: bool) -> list[int]:
        """Return the indices of the concrete classes with the objects of a class; if `exact`, only its own index."""
        names = (cls,) if exact else self._metamodel.concrete_classes(cls)
        return [index for index, each in enumerate(self._metamodel.class_list) if each.name in names]

    def extent_names(self, cls: str, exact: bool) -> list[code.Expression]:
        """Return the names of the extents with the objects of a class; if `exact`, without those of subclasses."""
        return [
            self._module.name_of(StoreColumn("extents", index)) for index in self.concrete_class_indices(cls, exact)
        ]

    def emit_extent(self, cls: str, exact: bool) -> code.Expression:
        """Return an expression for all objects of a class; if `exact`, without those of subclasses."""
        members = self.extent_names(cls, exact)
        if len(members) == 1:
            return members[0]
        return code.emit_call(self._module.name_of(Builtin("chain")), *members) if members else code.Tuple(())

    def emit_class_test(self, goal: InstanceAtom) -> code.Expression:
        """Return a test that an object is of a class; for an unbound object, a test that the class has objects."""
        if not self.bindings.has_value(goal.variable):
            return code.emit_joined("or", self.extent_names(goal.cls, goal.exact), False)
        cls = code.Subscript(self._module.name_of(StoreColumn("classes")), self.bindings.expression_of(goal.variable))
        indices = self.concrete_class_indices(goal.cls, goal.exact)
        if len(indices) == 1:
            return code.emit_equal(cls, code.Constant(indices[0]))
        return code.Subscript(self._module.name_of(ClassTable(goal.cls)), cls) if indices else code.Constant(False)

    def emit_ends(self, goal: LinkAtom) -> code.Expression:
        """Return code for the other ends of the links of the bound object, or the objects with the bound value."""
        reference = goal.reference
        if self.bindings.has_value(goal.source):
            return code.Subscript(
                self._module.name_of(forward_column(reference)), self.bindings.expression_of(goal.source)
            )
        if isinstance(reference, Attribute):
            valued = Valued(tuple(self.concrete_class_indices(reference.owner, False)), (reference.index,))
            return code.emit_call(self._module.name_of(valued), self.bindings.expression_of(goal.target))
        return code.Subscript(
            self._module.name_of(StoreColumn("backward", reference.index)),
            self.bindings.expression_of(goal.target),
        )

    def emit_link_test(self, goal: LinkAtom) -> code.Expression:
        """Return a test that two objects are linked. If one is not bound, return a test that the other has a link."""
        if not (self.bindings.has_value(goal.source) and self.bindings.has_value(goal.target)):
            return self.emit_ends(goal)
        source, target = self.bindings.expression_of(goal.source), self.bindings.expression_of(goal.target)
        sizes = self._planner.sizes
        reference = goal.reference
        if isinstance(reference, Reference) and sizes.sources_per_target(reference) < sizes.targets_per_source(
            reference
        ):
            backward = self._module.name_of(StoreColumn("backward", reference.index))  # the shorter side
            return code.Operation("in", (source, code.Subscript(backward, target)))
        return code.Operation("in", (target, code.Subscript(self._module.name_of(forward_column(reference)), source)))

    def emit_pattern_call(self, goal: CallAtom, wanted: Sequence[int], mode: ResultMode) -> code.Expression:
        """Return a call of a pattern's function with the bound arguments, for `wanted` variables in a result mode."""
        known = frozenset(v for v in goal.arguments if self.bindings.has_value(v))
        return self._emit_call(self._module.name_of(PatternFunction(query_of_call(goal, known, wanted), mode)), goal)

    def emit_recursive_call(self, goal: CallAtom) -> code.Expression:
        """Return a call of the function that lists the matches of a recursive pattern for the bound arguments."""
        bound = tuple(position for position, v in enumerate(goal.arguments) if self.bindings.has_value(v))
        return self._emit_call(self._module.name_of(RecursiveFunction(goal.pattern, bound)), goal)

    def emit_count(self, relation: RelationAtom) -> code.Expression | None:
        """Return code for the number of tuples that agree with the bound variables; None if a loop is needed."""
        called = relation_variables(relation)
        free = [v for v in called if not self.bindings.has_value(v)]
        if not free or len(set(free)) != len(free):
            return None
        match relation:
            case InstanceAtom(cls, _, exact):
                return code.emit_joined("+", [length(name) for name in self.extent_names(cls, exact)], 0)
            case LinkAtom() if len(free) == 1:
                return length(self.emit_ends(relation))
            case CallAtom(pattern) if self._planner.calls.is_recursive(pattern):
                return length(self.emit_recursive_call(relation))
            case CallAtom():
                return self.emit_pattern_call(relation, free, ResultMode.COUNT)
        return None

    def emit_column(self, relation: RelationAtom, column: int) -> code.Expression | None:
        """Return code for the values of a variable in the matches of a called pattern; None if a loop is needed."""
        free = [v for v in relation_variables(relation) if not self.bindings.has_value(v)]
        if not isinstance(relation, CallAtom) or column not in free or len(set(free)) != len(free):
            return None
        if self._planner.calls.is_recursive(relation.pattern):
            return None
        key = query_of_call(relation, frozenset(relation.arguments) - {*free}, free)
        last = relation.arguments.index(column)
        outputs = (*(place for place in key.outputs if place != last), last)
        return self._emit_call(
            self._module.name_of(PatternFunction(replace(key, outputs=outputs), ResultMode.BAG)), relation
        )

    def emit_aggregate(self, goal: AggregateAtom) -> code.Expression | None:
        """Return code for an aggregate that one existing function or column answers; None if a loop is needed."""
        if goal.column is None:
            return self.emit_count(goal.relation)
        values = self.emit_column(goal.relation, goal.column)
        return None if values is None else code.emit_call(aggregate_function_name(self._module, goal), values)

    def _emit_call(self, function: code.Name, goal: CallAtom) -> code.Expression:
        """Return a call of a function with the bound arguments of a goal."""
        return code.emit_call(
            function, *[self.bindings.expression_of(v) for v in goal.arguments if self.bindings.has_value(v)]
        )

    def emit_closure(self, goal: ClosureAtom) -> code.Expression:
        """Return code for the nodes reached from the bound end; if both are bound, a test; if none is, all pairs."""
        known = self.bindings.has_value(goal.source), self.bindings.has_value(goal.target)
        if known[0] == known[1]:
            return self._emit_closure_call(goal, ClosureQuestion.REACHES if known[0] else ClosureQuestion.PAIRS, True)
        return self._emit_closure_call(goal, ClosureQuestion.ALL, known[0])

    def emit_new_nodes(self, goal: ClosureAtom, seen: code.Local) -> code.Expression:
        """Return code for the nodes reached from the bound end, without those in `seen`, which is updated."""
        return self._emit_closure_call(goal, ClosureQuestion.NEW_NODES, self.bindings.has_value(goal.source), seen)

    def _emit_closure_call(
        self, goal: ClosureAtom, question: ClosureQuestion, forward: bool, *more: code.Expression
    ) -> code.Expression:
        """Return a call of the function that answers a question about a closure. `more` are further arguments."""
        inputs = [self.bindings.expression_of(v) for v in (goal.source, goal.target) if self.bindings.has_value(v)]
        return code.emit_call(self._module.name_of(closure_function(goal, question, forward)), *inputs, *more)


def forward_column(feature: Reference | Attribute) -> StoreColumn:
    """Return the column of a reference's targets, or of an attribute's values."""
    return StoreColumn("values" if isinstance(feature, Attribute) else "forward", feature.index)


def emit_shared_aggregate(
    module: SourceBuilder,
    alike: ReachAggregate,
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
            module.name_of(ReachAggregateSymbol(ends.pattern, ends.start, ends.given, ends.wanted, function, column)),
            outside,
        ]
    return code.emit_call(
        module.name_of(closure_function(alike.closure, ClosureQuestion.SHARED_VALUE, alike.forward)), *parts
    )
