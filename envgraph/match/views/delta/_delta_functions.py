"""Generate the functions that build a view and update it (incremental maintenance).

The delta function of an occurrence starts at a changed tuple and finds the derivations with the tuple there. The tuple
is present while the function runs. The occurrences of its relation in the body have an order, whether they are
positive, negated or aggregated. Earlier occurrences see the relation with the tuple, later ones without, so each
derivation is found only once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.match._match_costs import VIEWS
from envgraph.match.generate._bindings import VariableBindings
from envgraph.match.generate._relation_code import RelationCode, forward_column
from envgraph.match.generate._sinks import EXISTENCE, OUT, SolutionSink, length, list_sink, row, value
from envgraph.match.generate._source_builder import SourceBuilder, local_variable
from envgraph.match.generate._symbols import GeneratedSource, MatchLimitCheck, OperatorSymbol, StoreColumn
from envgraph.match.generate._translation import PlanTranslation
from envgraph.match.plan._search_plan import PlanStep, SearchPlan, StepKind
from envgraph.match.views.delta._occurrences import (
    RelationOccurrence,
    TupleEffect,
    aggregate_operator_of,
    group_variables_of,
)
from envgraph.match.views.delta._view_bodies import local_variables, negated
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Conjunction,
    InstanceAtom,
    LinkAtom,
    RelationAtom,
)


@dataclass(frozen=True, slots=True)
class Delta:
    """The definition of a delta function: finds the derivations of a body with a changed tuple at an occurrence.

    Attributes:
        name, body: the view, and the number of its body.
        conjunction: the body.
        occurrence: the occurrence of the tuple.
        later: the later occurrences of the relation, which must not see the tuple.
        is_symmetric: True if the tuple is a link that counts in both directions, both of which change at once.
        own: the positions of the tuple's values in the view's rows, if an index by them finds the rows lost with a
            tuple; None if a search finds them.
        is_queued: True if derivations are queued until the view is processed, because other operators read the view.
    """

    name: str
    body: int
    conjunction: Conjunction
    occurrence: RelationOccurrence
    later: tuple[RelationOccurrence, ...]
    is_symmetric: bool = False
    own: tuple[int, ...] | None = None
    is_queued: bool = False


DERIVATION_METHODS: Final = {True: "derive", False: "underive"}


def delta_source(planner: ViewPlanner, delta: Delta, inserting: bool) -> GeneratedSource:
    """Return the source of a delta function: it takes the values of a tuple, and adds or removes derivations.

    Args:
        planner: orders the other goals.
        delta: the derivations to find.
        inserting: True if the tuple has just been inserted; False if it will be deleted.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, block = SourceBuilder(), code.BodyBuilder()
    emit_delta(planner, module, block, delta, inserting)
    return module.finish(module.add_function("delta", tuple_names(delta.occurrence), block.finish_body()))


def tuple_names(occurrence: RelationOccurrence) -> list[code.Local]:
    """Return the parameters of a delta function: one for each value of the tuple."""
    return [local_variable("a", position) for position in range(len(occurrence.columns))]


def emit_delta(
    planner: ViewPlanner, module: SourceBuilder, block: code.BodyBuilder, delta: Delta, inserting: bool
) -> None:
    """Emit the body of a delta function, as described at `delta_source`, into `block`."""
    conjunction, occurrence = delta.conjunction, delta.occurrence
    names = tuple_names(occurrence)
    goal = conjunction.goals[occurrence.goal]
    plus = inserting != (occurrence.role is TupleEffect.NEGATED)
    if delta.own is not None and not plus:
        _emit_lookup(planner, module, block, delta, delta.own)
        return
    plan = delta_plan(planner, delta)
    if occurrence.role is TupleEffect.COUNT:
        assert isinstance(goal, AggregateAtom)
        # The count includes the tuple. An insertion first removes derivations of the smaller number, a deletion those
        # of the larger.
        halves = ((1, False), (0, True)) if inserting else ((0, False), (1, True))
        for less, adding in halves:
            translation = DeltaTranslation(planner, module, block, delta, names)
            translation.limit_check = MatchLimitCheck(delta.name) if adding else None
            number = translation.emit_group_size(occurrence, names, less)
            translation.emit_all(plan, view_sink(module, delta, adding), {goal.result: number})
    else:
        translation = DeltaTranslation(planner, module, block, delta, names)
        translation.limit_check = MatchLimitCheck(delta.name) if plus else None
        translation.emit_only_link_test(occurrence, names)
        translation.emit_all(plan, view_sink(module, delta, plus), {})


def delta_plan(planner: ViewPlanner, delta: Delta) -> SearchPlan:
    """Return the plan for all goals of a delta's body but the one of the tuple, whose variables are bound; cached.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    conjunction, occurrence = delta.conjunction, delta.occurrence
    place = (delta.name, delta.body, occurrence.goal)
    if place in planner.plans:
        return planner.plans[place]
    known = {v for v in occurrence.columns if v is not None}
    goal = conjunction.goals[occurrence.goal]
    if occurrence.role is TupleEffect.COUNT and isinstance(goal, AggregateAtom):
        known.add(goal.result)
    others = [goal for number, goal in enumerate(conjunction.goals) if number != occurrence.goal]
    planner.plans[place] = planner.plan(conjunction, others, frozenset(known))
    return planner.plans[place]


def own_positions(planner: ViewPlanner, delta: Delta) -> tuple[int, ...] | None:
    """Return the positions of the tuple's values in the view's rows, if an index is cheaper than a search; else None.

    Only for a view that is updated at once, and whose rows have one derivation each.
    """
    heads = delta.conjunction.parameters
    columns = [v for v in delta.occurrence.columns if v is not None]
    fixed = {number for number, _ in delta.conjunction.constants}
    if delta.occurrence.role is TupleEffect.COUNT or not fixed.isdisjoint(columns) or not set(columns) <= set(heads):
        return None
    cost = delta_plan(planner, delta).cost
    return tuple(heads.index(v) for v in dict.fromkeys(columns)) if columns and cost > VIEWS.min_indexed_cost else None


def _emit_lookup(
    planner: ViewPlanner, module: SourceBuilder, block: code.BodyBuilder, delta: Delta, own: tuple[int, ...]
) -> None:
    """Emit code that finds the view's rows with the tuple's values by an index, and removes their only derivation."""
    occurrence = delta.occurrence
    names = tuple_names(occurrence)
    translation = DeltaTranslation(planner, module, block, delta, names)
    first: dict[int, code.Local] = {}
    for variable, each in zip(occurrence.columns, names, strict=True):
        if variable is not None and first.setdefault(variable, each) != each:
            block.open_test(code.emit_equal(first[variable], each))
    translation.emit_only_link_test(occurrence, names)
    group = module.name_of(OperatorSymbol("group", delta.name, own))
    key = value(list(first), first.__getitem__)
    row_ = code.Local("row")
    block.add(
        code.For(
            row_,
            code.emit_call("tuple", code.emit_call(group, key, code.emit_tuple())),
            (emit_change(module, delta, False, row_),),
        )
    )


def build_source(planner: ViewPlanner, name: str, body: int, conjunction: Conjunction) -> GeneratedSource:
    """Return the source of a function that lists all derivations of one body.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, block = SourceBuilder(), code.BodyBuilder()
    plan = planner.plan(conjunction, conjunction.goals, frozenset())
    heads = conjunction.parameters
    sink = list_sink(heads, lambda names: row(heads, names), OUT)
    delta = Delta(name, body, conjunction, RelationOccurrence(-1, _NO_RELATION, TupleEffect.EACH, ()), ())
    translation = DeltaTranslation(planner, module, block, delta, [])
    translation.limit_check = MatchLimitCheck(name)
    translation.emit_all(plan, sink, {})
    return module.finish(module.add_function("build_rows", [], (*sink.head, *block.finish_body(), *sink.tail)))


def derivable_source(planner: ViewPlanner, name: str, body: int, conjunction: Conjunction) -> GeneratedSource:
    """Return the source of a function that takes a row and returns True if one body derives it.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, block = SourceBuilder(), code.BodyBuilder()
    heads = conjunction.parameters
    head = RelationOccurrence(-1, _NO_RELATION, TupleEffect.EACH, heads)
    names = tuple_names(head)
    plan = planner.plan(conjunction, conjunction.goals, frozenset(heads))
    translation = DeltaTranslation(planner, module, block, Delta(name, body, conjunction, head, ()), names)
    translation.emit_all(plan, EXISTENCE, {})
    return module.finish(module.add_function("derivable", names, (*block.finish_body(), *EXISTENCE.tail)))


_NO_RELATION = CallAtom("", ())
_ROWS_WITH_QUEUE: Final = code.Name("")
"""A marker for the number of rows of a view, including queued rows."""


def view_sink(module: SourceBuilder, delta: Delta, adding: bool) -> SolutionSink:
    """Return the sink that, for each solution, adds a derivation to the delta's view or removes one (`adding`)."""
    heads = delta.conjunction.parameters
    each = lambda names: (emit_change(module, delta, adding, row(heads, names)),)  # noqa: E731
    return SolutionSink(heads, (), each, (), size=_ROWS_WITH_QUEUE if adding else code.Constant(0))


def emit_change(module: SourceBuilder, delta: Delta, adding: bool, row_: code.Expression) -> code.ExpressionStatement:
    """Return code that adds or removes a derivation of a row; it queues the change if other operators read the view."""
    if delta.is_queued:
        return code.emit_call_statement(
            module.name_of(OperatorSymbol("queue", delta.name)), code.emit_tuple(row_, code.Constant(adding))
        )
    return code.emit_call_statement(module.name_of(OperatorSymbol(DERIVATION_METHODS[adding], delta.name)), row_)


class ViewRelationCode(RelationCode):
    """An emitter of expressions for relations, in which calls and closures read the operators of the network."""

    def __init__(self, planner: ViewPlanner, module: SourceBuilder, bindings: VariableBindings) -> None:
        super().__init__(planner, module, bindings)  # type: ignore[arg-type]
        self._held = planner.view_sizes

    def emit_row_test(self, goal: CallAtom) -> code.Expression:
        """Return a test that a view contains a row; all arguments must be bound."""
        rows = self._module.name_of(OperatorSymbol("position", goal.pattern))
        return code.Operation("in", (row(goal.arguments, self.bindings.expression_of), rows))

    def emit_closure(self, goal: ClosureAtom) -> code.Expression:
        forward, _, _ = self._held.closure_sizes(goal.step)
        table = self._module.name_of(OperatorSymbol("reach", goal.step))
        start, other = (goal.source, goal.target) if forward else (goal.target, goal.source)
        if self.bindings.has_value(start):
            found = code.emit_call(table, self.bindings.expression_of(start), code.emit_tuple())
            return (
                code.Operation("in", (self.bindings.expression_of(other), found))
                if self.bindings.has_value(other)
                else found
            )
        pairs = self._module.name_of(OperatorSymbol("starts" if self.bindings.has_value(other) else "pairs", goal.step))
        return code.emit_call(pairs, *([self.bindings.expression_of(other)] if self.bindings.has_value(other) else []))


class DeltaTranslation(PlanTranslation):
    """A translation of a body's plan in which each occurrence sees the relation with or without the changed tuple.

    Args:
        planner: sizes and plans of views.
        module: receives symbols and functions.
        block: receives the code.
        delta: the body, and the occurrence of the tuple.
        tuple_: the local variables with the values of the tuple.
    """

    _shares_searches = False

    def __init__(
        self,
        planner: ViewPlanner,
        module: SourceBuilder,
        block: code.BodyBuilder,
        delta: Delta,
        tuple_: Sequence[code.Local],
    ) -> None:
        bindings = VariableBindings(delta.conjunction, lambda value, _: module.literal(value), renumbered=True)
        relations = ViewRelationCode(planner, module, bindings)
        super().__init__(planner, module, delta.conjunction, block, {}, relations)  # type: ignore[arg-type]
        self._views = relations
        self._delta = delta
        self._tuple = self._extra_parameters = list(tuple_)
        goals = delta.conjunction.goals
        self._later = {id(goals[each.goal]): each for each in delta.later}

    def emit_all(self, plan: SearchPlan, sink: SolutionSink, given: Mapping[int, code.Expression]) -> None:
        """Emit code that binds the tuple's values, executes a plan, and runs the sink for each derivation.

        Args:
            plan: the plan of the other goals.
            sink: the code for each derivation.
            given: code for the values of further variables.
        """
        block = self.block
        place = block.position
        named = list(zip(self._delta.occurrence.columns, self._tuple, strict=True))
        for variable, each in [*named, *given.items()]:
            if variable is None:
                continue
            if self.is_bound(variable):
                block.open_test(code.emit_equal(self.value_of(variable), each))
            elif isinstance(each, code.Local):
                self.bindings.expressions[variable] = each
            else:
                self.bindings.expressions[variable] = kept = self.bindings.local(variable)
                block.add(code.Assign(kept, each))
        self.emit_steps(plan.steps, sink)
        block.close_to(place)

    def _emit_size(self, sink: SolutionSink) -> code.Expression:
        """Return code for the number of matches so far; for a sink that adds derivations, of rows in the view."""
        return (
            code.emit_call(self._module.name_of(OperatorSymbol("size", self._delta.name)))
            if sink.size == _ROWS_WITH_QUEUE
            else sink.size
        )

    def _new_part(self, continuation: bool) -> PlanTranslation:
        block = code.BodyBuilder()
        return DeltaTranslation(self._planner, self._module, block, self._delta, self._tuple)  # type: ignore[arg-type]

    # --- the relation without the tuple

    def _emit_agreement(self, columns: Sequence[int | None]) -> code.Expression:
        """Return a test that the changed tuple agrees with the bound variables of an occurrence's columns.

        A symmetric link may agree in either direction.
        """
        straight = self._emit_column_tests(columns, self._tuple)
        if not self._delta.is_symmetric:
            return straight
        crossed = self._emit_column_tests(columns, self._tuple[::-1])
        return straight if straight == crossed else code.Operation("or", (straight, crossed))

    def _emit_column_tests(self, columns: Sequence[int | None], tuple_: Sequence[code.Local]) -> code.Expression:
        """Return a test that a tuple agrees with the bound variables in an occurrence's columns, in one direction."""
        asked = ((self.value_of(v), each) for v, each in zip(columns, tuple_, strict=True) if v is not None)
        return code.emit_joined("and", [code.emit_equal(own, each) for own, each in asked if own != each], True)

    def _emit_exclusion(self, step: PlanStep) -> None:
        place = self._later.get(id(step.goal))
        if step.kind is StepKind.TEST or place is None:
            return
        if place.role is TupleEffect.EACH or (
            place.role is TupleEffect.EXISTS and isinstance(step.goal, AttributeAtom)
        ):
            self.block.open_test(code.emit_not(self._emit_agreement(place.columns)))

    def solve(self, step: PlanStep) -> None:
        """Emit code that solves the goal of a step; a test fails for the changed tuple if it must not see it."""
        super().solve(step)
        goal, place = step.goal, self._later.get(id(step.goal))
        if step.kind is not StepKind.TEST or place is None or place.role is TupleEffect.COUNT:
            return
        if isinstance(goal, AbsenceAtom) or (isinstance(goal, LinkAtom) and self._has_free_end(goal)):
            return  # solved without the tuple
        found, _ = self.block.pending_tests.pop()
        here = self._emit_agreement(place.columns)
        alone = code.FALSE if here == code.TRUE else code.Operation("and", (found, code.emit_not(here)))
        self.block.open_test(alone)

    def _has_free_end(self, goal: LinkAtom) -> bool:
        """Return True if an end of a link has no value."""
        return not (self.is_bound(goal.source) and self.is_bound(goal.target))

    def solve_absence(self, goal: AbsenceAtom, step: PlanStep) -> None:
        self.block.open_test(self._emit_negation(goal, self._later.get(id(goal))))

    def solve_link(self, goal: LinkAtom, step: PlanStep) -> None:
        place = self._later.get(id(goal))
        if step.kind is StepKind.TEST and self._has_free_end(goal) and place is not None:
            self.block.open_test(code.Operation(">", (self._emit_count_without(goal, place), code.Constant(0))))
        else:
            super().solve_link(goal, step)

    def solve_attribute(self, goal: AttributeAtom, step: PlanStep) -> None:
        if step.kind is StepKind.TEST and not self.is_bound(goal.value):
            self.block.open_test(self._emit_holds(goal))
        else:
            super().solve_attribute(goal, step)

    def solve_call(self, goal: CallAtom, step: PlanStep) -> None:
        if step.kind is StepKind.LOOP:
            self._emit_view_loop(goal)
        else:
            self.block.open_test(self._views.emit_row_test(goal))

    def _emit_count_without(self, goal: LinkAtom, place: RelationOccurrence) -> code.Expression:
        """Return code for the number of links at the bound end of a goal, without the changed tuple."""
        here = self._emit_agreement(place.columns)
        return code.Operation(
            "-", (length(self._relations.emit_ends(goal)), code.Constant(1) if here == code.TRUE else here)
        )

    def _emit_negation(self, goal: AbsenceAtom, place: RelationOccurrence | None) -> code.Expression:
        """Return a test of a negation, which ignores the changed tuple if the occurrence must not see it."""
        relation = negated(goal)
        if isinstance(relation, LinkAtom) and local_variables(goal):
            if place is None:
                return code.emit_not(self._relations.emit_ends(relation))
            return code.emit_equal(self._emit_count_without(relation, place), code.Constant(0))
        found = code.emit_not(self._emit_holds(relation))
        if place is None:
            return found
        here = self._emit_agreement(place.columns)
        return code.TRUE if here == code.TRUE else code.Operation("or", (found, here))

    def _emit_holds(self, relation: RelationAtom) -> code.Expression:
        """Return a test that a relation contains the bound values; for an unbound attribute value, that it exists."""
        match relation:
            case InstanceAtom():
                return self._relations.emit_class_test(relation)
            case AttributeAtom(attribute, owner, held):
                found = code.Subscript(
                    self._module.name_of(StoreColumn("values", attribute.index)),
                    self.value_of(owner),
                )
                return (
                    code.emit_equal(found, self.value_of(held)) if self.is_bound(held) else code.emit_is_not_none(found)
                )
            case LinkAtom():
                return self._relations.emit_link_test(relation)
            case CallAtom():
                return self._views.emit_row_test(relation)
            case ClosureAtom():
                return self._relations.emit_closure(relation)

    def emit_only_link_test(self, occurrence: RelationOccurrence, names: Sequence[code.Local]) -> None:
        """If a link's other end only needs to exist, emit a test that the tuple is the only link at its bound end."""
        if isinstance(occurrence.relation, LinkAtom) and None in occurrence.columns:
            self.block.open_test(code.emit_equal(self.emit_group_size(occurrence, names, 0), code.Constant(1)))

    def emit_group_size(
        self, occurrence: RelationOccurrence, names: Sequence[code.Local], subtracted: int
    ) -> code.Expression:
        """Return code for the number of links at the tuple's bound end, minus `subtracted` (1 to leave out the
        tuple).
        """
        size = length(self._group(occurrence, names))
        return code.Operation("-", (size, code.Constant(1))) if subtracted else size

    def _group(self, occurrence: RelationOccurrence, names: Sequence[code.Local]) -> code.Expression:
        """Return code for the collection of nodes or values that are linked with the tuple's bound end."""
        relation = occurrence.relation
        assert isinstance(relation, LinkAtom)
        if occurrence.columns[0] is not None:
            return code.Subscript(self._module.name_of(forward_column(relation.reference)), names[0])
        return code.Subscript(self._module.name_of(StoreColumn("backward", relation.reference.index)), names[1])

    # --- views

    def _emit_view_loop(self, goal: CallAtom) -> None:
        """Emit a loop over the rows of a view that agree with the bound arguments."""
        given = tuple(p for p, v in enumerate(goal.arguments) if self.is_bound(v))
        iterable: code.Expression
        if given:
            table = self._module.name_of(OperatorSymbol("group", goal.pattern, given))
            iterable = code.emit_call(
                table,
                value([goal.arguments[p] for p in given], self.value_of),
                code.emit_tuple(),
            )
        else:
            iterable = self._module.name_of(OperatorSymbol("rows", goal.pattern))
        columns = [None if p in given else v for p, v in enumerate(goal.arguments)]
        self.emit_loop_over(columns, iterable, tuples=True)

    def solve_aggregate(self, goal: AggregateAtom, step: PlanStep) -> None:
        found: code.Expression
        if not isinstance(goal.relation, LinkAtom):
            table = self._module.name_of(OperatorSymbol("fold", aggregate_operator_of(goal)))
            found = code.emit_call(table, row(group_variables_of(goal), self.value_of))
        elif (place := self._later.get(id(goal))) is None:
            found = length(self._relations.emit_ends(goal.relation))
        else:
            found = self._emit_count_without(goal.relation, place)
        self.bind_or_test(goal.result, found, step)
