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
from envgraph.match._costs import VIEWS
from envgraph.match.generate._bindings import Bindings
from envgraph.match.generate._generate import Translation
from envgraph.match.generate._relations import Relations, forward_column
from envgraph.match.generate._sinks import EXISTENCE, OUT, Sink, gathering, length, row, value
from envgraph.match.generate._symbols import Bounded, Column, Held, Source
from envgraph.match.generate._value_joins import ValueJoin
from envgraph.match.generate._write import Module, local
from envgraph.match.plan._plan import Kind, Plan, Step
from envgraph.match.views.delta._bodies import free_inside, negated
from envgraph.match.views.delta._occurrences import Occurrence, Role, fold_of, group_of
from envgraph.match.views.delta._planning import ViewPlanner
from envgraph.pattern import (
    Absence,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Conjunction,
    Goal,
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
        symmetric: True if the tuple is a link that counts in both directions, both of which change at once.
        own: the positions of the tuple's values in the view's rows, if an index by them finds the rows lost with a
            tuple; None if a search finds them.
        queued: True if derivations are queued until the view is processed, because other operators read the view.
    """

    name: str
    body: int
    conjunction: Conjunction
    occurrence: Occurrence
    later: tuple[Occurrence, ...]
    symmetric: bool = False
    own: tuple[int, ...] | None = None
    queued: bool = False


SINKS: Final = {True: "derive", False: "underive"}


def delta_source(planner: ViewPlanner, delta: Delta, coming: bool) -> Source:
    """Return the source of a delta function: it takes the values of a tuple, and adds or removes derivations.

    Args:
        planner: orders the other goals.
        delta: the derivations to find.
        coming: True if the tuple has just been inserted; False if it will be deleted.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, block = Module(), code.Block()
    write_delta(planner, module, block, delta, coming)
    return module.source(module.function("delta", tuple_names(delta.occurrence), block.body()))


def tuple_names(occurrence: Occurrence) -> list[code.Local]:
    """Return the parameters of a delta function: one for each value of the tuple."""
    return [local("a", position) for position in range(len(occurrence.columns))]


def write_delta(planner: ViewPlanner, module: Module, block: code.Block, delta: Delta, coming: bool) -> None:
    """Emit the body of a delta function, as described at `delta_source`, into `block`."""
    conjunction, occurrence = delta.conjunction, delta.occurrence
    names = tuple_names(occurrence)
    goal = conjunction.goals[occurrence.goal]
    plus = coming != (occurrence.role is Role.NONE)
    if delta.own is not None and not plus:
        _write_lookup(planner, module, block, delta, delta.own)
        return
    plan = delta_plan(planner, delta)
    if occurrence.role is Role.NUMBER:
        assert isinstance(goal, AggregateAtom)
        # The count includes the tuple. An insertion first removes derivations of the smaller number, a deletion those
        # of the larger.
        halves = ((1, False), (0, True)) if coming else ((0, False), (1, True))
        for less, adding in halves:
            translation = DeltaTranslation(planner, module, block, delta, names)
            translation.bounded = Bounded(delta.name) if adding else None
            number = translation.number(occurrence, names, less)
            translation.run(plan, view_sink(module, delta, adding), {goal.result: number})
    else:
        translation = DeltaTranslation(planner, module, block, delta, names)
        translation.bounded = Bounded(delta.name) if plus else None
        translation.alone(occurrence, names)
        translation.run(plan, view_sink(module, delta, plus), {})


def delta_plan(planner: ViewPlanner, delta: Delta) -> Plan:
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
    if occurrence.role is Role.NUMBER and isinstance(goal, AggregateAtom):
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
    if (
        delta.occurrence.role is Role.NUMBER
        or not fixed.isdisjoint(columns)
        or not set(columns) <= set(heads)
    ):
        return None
    cost = delta_plan(planner, delta).cost
    return tuple(heads.index(v) for v in dict.fromkeys(columns)) if columns and cost > VIEWS.dear else None


def _write_lookup(
    planner: ViewPlanner, module: Module, block: code.Block, delta: Delta, own: tuple[int, ...]
) -> None:
    """Emit code that finds the view's rows with the tuple's values by an index, and removes their only derivation."""
    occurrence = delta.occurrence
    names = tuple_names(occurrence)
    translation = DeltaTranslation(planner, module, block, delta, names)
    first: dict[int, code.Local] = {}
    for variable, each in zip(occurrence.columns, names, strict=True):
        if variable is not None and first.setdefault(variable, each) != each:
            block.test(code.equal(first[variable], each))
    translation.alone(occurrence, names)
    group = module.name(Held("group", delta.name, own))
    key = value(list(first), first.__getitem__)
    row_ = code.Local("row")
    block.add(
        code.For(
            row_,
            code.call("tuple", code.call(group, key, code.tuple_of())),
            (changed(module, delta, False, row_),),
        )
    )


def build_source(planner: ViewPlanner, name: str, body: int, conjunction: Conjunction) -> Source:
    """Return the source of a function that lists all derivations of one body.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, block = Module(), code.Block()
    plan = planner.plan(conjunction, conjunction.goals, frozenset())
    heads = conjunction.parameters
    sink = gathering(heads, lambda names: row(heads, names), OUT)
    delta = Delta(name, body, conjunction, Occurrence(-1, _NOTHING, Role.EACH, ()), ())
    translation = DeltaTranslation(planner, module, block, delta, [])
    translation.bounded = Bounded(name)
    translation.run(plan, sink, {})
    return module.source(module.function("build_rows", [], (*sink.head, *block.body(), *sink.tail)))


def derivable_source(planner: ViewPlanner, name: str, body: int, conjunction: Conjunction) -> Source:
    """Return the source of a function that takes a row and returns True if one body derives it.

    Raises:
        Unplannable: a variable cannot be enumerated.
    """
    module, block = Module(), code.Block()
    heads = conjunction.parameters
    head = Occurrence(-1, _NOTHING, Role.EACH, heads)
    names = tuple_names(head)
    plan = planner.plan(conjunction, conjunction.goals, frozenset(heads))
    translation = DeltaTranslation(planner, module, block, Delta(name, body, conjunction, head, ()), names)
    translation.run(plan, EXISTENCE, {})
    return module.source(module.function("derivable", names, (*block.body(), *EXISTENCE.tail)))


_NOTHING = CallAtom("", ())
_WAITING: Final = code.Name("")
"""A marker for the number of rows of a view, including queued rows."""


def view_sink(module: Module, delta: Delta, adding: bool) -> Sink:
    """Return the sink that, for each solution, adds a derivation to the delta's view or removes one (`adding`)."""
    heads = delta.conjunction.parameters
    each = lambda names: (changed(module, delta, adding, row(heads, names)),)  # noqa: E731
    return Sink(heads, (), each, (), size=_WAITING if adding else code.Constant(0))


def changed(module: Module, delta: Delta, adding: bool, row_: code.Expression) -> code.Do:
    """Return code that adds or removes a derivation of a row; it queues the change if other operators read the view."""
    if delta.queued:
        return code.Do(
            code.call(module.name(Held("queue", delta.name)), code.tuple_of(row_, code.Constant(adding)))
        )
    return code.Do(code.call(module.name(Held(SINKS[adding], delta.name)), row_))


class ViewRelations(Relations):
    """An emitter of expressions for relations, in which calls and closures read the operators of the network."""

    def __init__(self, planner: ViewPlanner, module: Module, bindings: Bindings) -> None:
        super().__init__(planner, module, bindings)  # type: ignore[arg-type]
        self._held = planner.held

    def has(self, goal: CallAtom) -> code.Expression:
        """Return a test that a view contains a row; all arguments must be bound."""
        rows = self._module.name(Held("position", goal.pattern))
        return code.Operation("in", (row(goal.arguments, self.bindings.source), rows))

    def closure(self, goal: ClosureAtom) -> code.Expression:
        forward, _, _ = self._held.reached(goal.step)
        table = self._module.name(Held("reach", goal.step))
        start, other = (goal.source, goal.target) if forward else (goal.target, goal.source)
        if self.bindings.known(start):
            found = code.call(table, self.bindings.source(start), code.tuple_of())
            return (
                code.Operation("in", (self.bindings.source(other), found))
                if self.bindings.known(other)
                else found
            )
        pairs = self._module.name(Held("starts" if self.bindings.known(other) else "pairs", goal.step))
        return code.call(pairs, *([self.bindings.source(other)] if self.bindings.known(other) else []))


class DeltaTranslation(Translation):
    """A translation of a body's plan in which each occurrence sees the relation with or without the changed tuple.

    Args:
        planner: sizes and plans of views.
        module: receives symbols and functions.
        block: receives the code.
        delta: the body, and the occurrence of the tuple.
        tuple_: the local variables with the values of the tuple.
    """

    _shares = False

    def __init__(
        self,
        planner: ViewPlanner,
        module: Module,
        block: code.Block,
        delta: Delta,
        tuple_: Sequence[code.Local],
    ) -> None:
        relations = ViewRelations(planner, module, Bindings(delta.conjunction, module, renumbered=True))
        super().__init__(planner, module, delta.conjunction, block, {}, relations)  # type: ignore[arg-type]
        self._views = relations
        self._delta = delta
        self._tuple = self._carried = list(tuple_)
        goals = delta.conjunction.goals
        self._later = {id(goals[each.goal]): each for each in delta.later}

    def run(self, plan: Plan, sink: Sink, given: Mapping[int, code.Expression]) -> None:
        """Emit code that binds the tuple's values, executes a plan, and runs the sink for each derivation.

        Args:
            plan: the plan of the other goals.
            sink: the code for each derivation.
            given: code for the values of further variables.
        """
        block = self._block
        place = block.place
        named = list(zip(self._delta.occurrence.columns, self._tuple, strict=True))
        for variable, each in [*named, *given.items()]:
            if variable is None:
                continue
            if self._bindings.known(variable):
                block.test(code.equal(self._bindings.source(variable), each))
            elif isinstance(each, code.Local):
                self._bindings.names[variable] = each
            else:
                self._bindings.names[variable] = kept = self._bindings.local(variable)
                block.add(code.Assign(kept, each))
        self._steps(plan.steps, sink)
        block.back_to(place)

    def _size(self, sink: Sink) -> code.Expression:
        """Return code for the number of matches so far; for a sink that adds derivations, of rows in the view."""
        return (
            code.call(self._module.name(Held("size", self._delta.name)))
            if sink.size == _WAITING
            else sink.size
        )

    def _fork(self, block: code.Block, continuation: bool) -> Translation:
        return DeltaTranslation(self._planner, self._module, block, self._delta, self._tuple)  # type: ignore[arg-type]

    # --- the relation without the tuple

    def _here(self, columns: Sequence[int | None]) -> code.Expression:
        """Return a test that the changed tuple agrees with the bound variables of an occurrence's columns.

        A symmetric link may agree in either direction.
        """
        straight = self._agrees(columns, self._tuple)
        if not self._delta.symmetric:
            return straight
        crossed = self._agrees(columns, self._tuple[::-1])
        return straight if straight == crossed else code.Operation("or", (straight, crossed))

    def _agrees(self, columns: Sequence[int | None], tuple_: Sequence[code.Local]) -> code.Expression:
        """Return a test that a tuple agrees with the bound variables in an occurrence's columns, in one direction."""
        asked = (
            (self._bindings.source(v), each) for v, each in zip(columns, tuple_, strict=True) if v is not None
        )
        return code.joined("and", [code.equal(own, each) for own, each in asked if own != each], True)

    def _loop(self, step: Step) -> None:
        goal = step.goal
        if isinstance(goal, CallAtom):
            self._loop_view(goal)
        else:
            super()._loop(step)
        self._exclude(goal)

    def _loop_joined(self, step: Step, join: ValueJoin, sink: Sink) -> None:
        super()._loop_joined(step, join, sink)
        self._exclude(step.goal)

    def _bind(self, step: Step, inline: bool) -> None:
        super()._bind(step, inline)
        self._exclude(step.goal)

    def _exclude(self, goal: Goal) -> None:
        """Emit a test that skips the changed tuple if the occurrence of the goal must not see it; else nothing."""
        place = self._later.get(id(goal))
        if place is None:
            return
        if place.role is Role.EACH or (place.role is Role.SOME and isinstance(goal, AttributeAtom)):
            self._block.test(code.inverse(self._here(place.columns)))

    def _test(self, step: Step) -> code.Expression:
        goal = step.goal
        assert step.kind is Kind.TEST
        place = self._later.get(id(goal))
        match goal:
            case Absence():
                return self._absent(goal, place)
            case LinkAtom() if not (self._bindings.known(goal.source) and self._bindings.known(goal.target)):
                return (
                    self._relations.ends(goal) if place is None else _more(self._number_without(goal, place))
                )
            case CallAtom():
                found = self._views.has(goal)
            case AttributeAtom() if not self._bindings.known(goal.value):
                found = code.some(self._value(step))
            case _:
                found = super()._test(step)
        if place is None or place.role is Role.NUMBER:
            return found
        here = self._here(place.columns)
        return code.FALSE if here == code.TRUE else code.Operation("and", (found, code.inverse(here)))

    def _number_without(self, goal: LinkAtom, place: Occurrence) -> code.Expression:
        """Return code for the number of links at the bound end of a goal, without the changed tuple."""
        here = self._here(place.columns)
        return code.Operation(
            "-", (length(self._relations.ends(goal)), code.Constant(1) if here == code.TRUE else here)
        )

    def _absent(self, goal: Absence, place: Occurrence | None) -> code.Expression:
        """Return a test of a negation, which ignores the changed tuple if the occurrence must not see it."""
        relation = negated(goal)
        if isinstance(relation, LinkAtom) and free_inside(goal):
            if place is None:
                return code.inverse(self._relations.ends(relation))
            return code.equal(self._number_without(relation, place), code.Constant(0))
        found = code.inverse(self._holds(relation))
        if place is None:
            return found
        here = self._here(place.columns)
        return code.TRUE if here == code.TRUE else code.Operation("or", (found, here))

    def _holds(self, relation: RelationAtom) -> code.Expression:
        """Return a test that a relation contains the bound values; for an unbound attribute value, that it exists."""
        match relation:
            case InstanceAtom():
                return self._relations.is_instance(relation)
            case AttributeAtom(attribute, owner, held):
                found = code.Index(
                    self._module.name(Column("values", attribute.index)), self._bindings.source(owner)
                )
                return (
                    code.equal(found, self._bindings.source(held))
                    if self._bindings.known(held)
                    else code.some(found)
                )
            case LinkAtom():
                return self._relations.is_linked(relation)
            case CallAtom():
                return self._views.has(relation)
            case ClosureAtom():
                return self._relations.closure(relation)

    def alone(self, occurrence: Occurrence, names: Sequence[code.Local]) -> None:
        """If a link's other end only needs to exist, emit a test that the tuple is the only link at its bound end."""
        if isinstance(occurrence.relation, LinkAtom) and None in occurrence.columns:
            self._block.test(code.equal(self.number(occurrence, names, 0), code.Constant(1)))

    def number(self, occurrence: Occurrence, names: Sequence[code.Local], less: int) -> code.Expression:
        """Return code for the number of links at the tuple's bound end, minus `less` (1 to leave out the tuple)."""
        size = length(self._group(occurrence, names))
        return code.Operation("-", (size, code.Constant(1))) if less else size

    def _group(self, occurrence: Occurrence, names: Sequence[code.Local]) -> code.Expression:
        """Return code for the collection of nodes or values that are linked with the tuple's bound end."""
        relation = occurrence.relation
        assert isinstance(relation, LinkAtom)
        if occurrence.columns[0] is not None:
            return code.Index(self._module.name(forward_column(relation.reference)), names[0])
        return code.Index(self._module.name(Column("backward", relation.reference.index)), names[1])

    # --- views

    def _loop_view(self, goal: CallAtom) -> None:
        """Emit a loop over the rows of a view that agree with the bound arguments."""
        given = tuple(p for p, v in enumerate(goal.arguments) if self._bindings.known(v))
        iterable: code.Expression
        if given:
            table = self._module.name(Held("group", goal.pattern, given))
            iterable = code.call(
                table, value([goal.arguments[p] for p in given], self._bindings.source), code.tuple_of()
            )
        else:
            iterable = self._module.name(Held("rows", goal.pattern))
        columns = [None if p in given else v for p, v in enumerate(goal.arguments)]
        self._each(columns, iterable, tuples=True)

    def _value(self, step: Step) -> code.Expression:
        goal = step.goal
        if not isinstance(goal, AggregateAtom):
            return super()._value(step)
        if isinstance(goal.relation, LinkAtom):
            place = self._later.get(id(goal))
            if place is None:
                return length(self._relations.ends(goal.relation))
            return self._number_without(goal.relation, place)
        table = self._module.name(Held("fold", fold_of(goal)))
        return code.call(table, row(group_of(goal), self._bindings.source))


def _more(number: code.Expression) -> code.Operation:
    """Return the test `number > 0`."""
    return code.Operation(">", (number, code.Constant(0)))
