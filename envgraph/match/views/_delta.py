"""Source of the functions that build a view and keep it current.

The delta function of an occurrence starts at a changed tuple and finds the derivations that have it there. While it
runs the tuple is present. All occurrences of its relation in the body are numbered, positive, negated and aggregated
together: those before this one see the relation as it is, those after it as it would be without the tuple.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Final

from envgraph.code import dataclass
from envgraph.match.generate._generate import Translation, forward_column
from envgraph.match.generate._sinks import EXISTENCE, Sink, gathering, row, value
from envgraph.match.generate._symbols import Backward, Bounded, Held, Source, Values
from envgraph.match.generate._write import Block, Module
from envgraph.match.plan._plan import Absence, Conjunction, Goal, Kind, Plan, Step, arguments, inputs
from envgraph.match.views._bodies import Relation, existential, free_inside, negated
from envgraph.match.views._planning import ViewPlanner
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    InstanceAtom,
    LinkAtom,
)


class Role(Enum):
    """How a tuple of a relation counts where it occurs."""

    EACH = "each"
    """Every tuple is a derivation of its own."""
    SOME = "some"
    """Only whether there is any."""
    NONE = "none"
    """Only whether there is none."""
    NUMBER = "number"
    """Their number is the value of a variable."""


@dataclass(frozen=True, slots=True)
class Occurrence:
    """A place of a body where a relation stands.

    Attributes:
        goal: its goal, by position in the body.
        relation: the atom; for a negation or a number the one inside.
        role: see `Role`.
        columns: number of the variable at each position of the relation; None for one that has no value outside.
    """

    goal: int
    relation: Relation
    role: Role
    columns: tuple[int | None, ...]


def occurrences(conjunction: Conjunction) -> list[Occurrence]:
    """All places of a body where a relation stands, in the order of its goals."""
    loose = existential(conjunction)
    found: list[Occurrence] = []
    for number, goal in enumerate(conjunction.goals):
        match goal:
            case Absence():
                relation = negated(goal)
                local = set(free_inside(goal))
                columns = tuple(None if v in local else v for v in arguments(relation))
                found.append(Occurrence(number, relation, Role.NONE, columns))
            case AggregateAtom(_, LinkAtom() as relation):
                local = set(free_inside(goal))
                columns = tuple(None if v in local else v for v in arguments(relation))
                found.append(Occurrence(number, relation, Role.NUMBER, columns))
            case AggregateAtom():
                # A value that a view holds for each group: the columns are the group and the value.
                folded = CallAtom(fold_of(goal), (*group_of(goal), goal.result))
                found.append(Occurrence(number, folded, Role.EACH, folded.arguments))
            case InstanceAtom() | AttributeAtom() | LinkAtom() | CallAtom() | ClosureAtom():
                columns = tuple(None if v in loose else v for v in arguments(goal))
                role = Role.SOME if None in columns else Role.EACH
                found.append(Occurrence(number, goal, role, columns))
            case _:
                pass
    return found


def group_of(goal: AggregateAtom) -> tuple[int, ...]:
    """The variables whose values tell the groups of an aggregate apart."""
    return tuple(dict.fromkeys(inputs(goal)))


def fold_of(goal: AggregateAtom) -> str:
    """Name of the view that holds the values of an aggregate over a view."""
    assert isinstance(goal.relation, CallAtom)
    return goal.relation.pattern


@dataclass(frozen=True, slots=True)
class Delta:
    """What one function does: find the derivations with a tuple at an occurrence.

    Attributes:
        name, body: of the view, and the number of its body.
        conjunction: the body.
        occurrence: where the tuple stands.
        later: the occurrences after it that must not see the tuple.
        symmetric: the tuple is a link that counts in both directions, and comes and goes in both at once.
        own: positions of the view's rows that tell which of them a lost tuple takes along, if they are looked up in
            the view itself; None if they are found by a search.
        queued: derivations wait for the view's turn, because others read it.
    """

    name: str
    body: int
    conjunction: Conjunction
    occurrence: Occurrence
    later: tuple[Occurrence, ...]
    symmetric: bool = False
    own: tuple[int, ...] | None = None
    queued: bool = False


DEAR: Final = 60.0
"""Estimated work of a search above which a view has an index of its own."""
SINKS: Final = {True: "derive", False: "underive"}


def delta_source(planner: ViewPlanner, delta: Delta, coming: bool) -> Source:
    """The source of a delta function, which takes the tuple.

    Args:
        planner: orders the other goals.
        delta: what to find.
        coming: whether the tuple has just come, or is about to go.

    Raises:
        Unplannable: some variables cannot be enumerated.
    """
    module, block = Module(), Block()
    write_delta(planner, module, block, delta, coming)
    module.function("delta", tuple_names(delta.occurrence), block)
    return module.source("delta")


def tuple_names(occurrence: Occurrence) -> list[str]:
    """The parameters of a delta function: the values of the tuple."""
    return [f"a{position}" for position in range(len(occurrence.columns))]


def write_delta(planner: ViewPlanner, module: Module, block: Block, delta: Delta, coming: bool) -> None:
    """Write the body of a delta function: see `delta_source`."""
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
        # With the tuple there is one more. A coming tuple ends the smaller number first, a going one the larger.
        halves = ((1, False), (0, True)) if coming else ((0, False), (1, True))
        for less, adding in halves:
            translation = DeltaTranslation(planner, module, block, delta, names)
            translation.bounded = Bounded(delta.name) if adding else None
            number = translation.number(occurrence, names, less)
            translation.run(plan, view_sink(module, delta, adding), {goal.result: number})
    else:
        translation = DeltaTranslation(planner, module, block, delta, names)
        translation.bounded = Bounded(delta.name) if plus else None
        alone = translation.alone(occurrence, names)
        translation.run(plan, view_sink(module, delta, plus), {}, alone)


def delta_plan(planner: ViewPlanner, delta: Delta) -> Plan:
    """The order of the other goals, when the tuple is known.

    Raises:
        Unplannable: some variables cannot be enumerated.
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
    """Where the view's rows hold the values of the tuple, if a search for the rows that it takes along is dear.

    For a view whose rows have one derivation each, and which is always up to date.
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
    return tuple(heads.index(v) for v in dict.fromkeys(columns)) if columns and cost > DEAR else None


def _write_lookup(
    planner: ViewPlanner, module: Module, block: Block, delta: Delta, own: tuple[int, ...]
) -> None:
    """Take the rows along that hold the values of the tuple."""
    occurrence = delta.occurrence
    names = tuple_names(occurrence)
    translation = DeltaTranslation(planner, module, block, delta, names)
    first: dict[int, str] = {}
    for variable, source in zip(occurrence.columns, names, strict=True):
        if variable is not None and first.setdefault(variable, source) != source:
            block.test(f"{first[variable]} == {source}")
    alone = translation.alone(occurrence, names)
    if alone:
        block.test(alone)
    group = module.name(Held("group", delta.name, own))
    key = next(iter(first.values())) if len(first) == 1 else f"({', '.join(first.values())},)"
    block.line(f"for row in tuple({group}({key}, ())):")
    block.line(f"    {changed(module, delta, False, 'row')}")


def build_source(planner: ViewPlanner, name: str, body: int, conjunction: Conjunction) -> Source:
    """The source of a function that lists all derivations of one body.

    Raises:
        Unplannable: some variables cannot be enumerated.
    """
    module, block = Module(), Block()
    plan = planner.plan(conjunction, conjunction.goals, frozenset())
    heads = conjunction.parameters
    sink = gathering(heads, lambda names: row(heads, names), "return out")
    block.raw(sink.head)
    delta = Delta(name, body, conjunction, Occurrence(-1, _NOTHING, Role.EACH, ()), ())
    translation = DeltaTranslation(planner, module, block, delta, [])
    translation.bounded = Bounded(name)
    translation.run(plan, sink, {})
    block.raw(sink.tail)
    module.function("build_rows", [], block)
    return module.source("build_rows")


def derivable_source(planner: ViewPlanner, name: str, body: int, conjunction: Conjunction) -> Source:
    """The source of a function that tells whether one body derives a row, which it takes.

    Raises:
        Unplannable: some variables cannot be enumerated.
    """
    module, block = Module(), Block()
    heads = conjunction.parameters
    head = Occurrence(-1, _NOTHING, Role.EACH, heads)
    names = [f"a{position}" for position in range(len(heads))]
    plan = planner.plan(conjunction, conjunction.goals, frozenset(heads))
    translation = DeltaTranslation(planner, module, block, Delta(name, body, conjunction, head, ()), names)
    translation.run(plan, EXISTENCE, {})
    block.raw(EXISTENCE.tail)
    module.function("derivable", names, block)
    return module.source("derivable")


_NOTHING = CallAtom("", ())
HELD: Final = "held"
"""Stands for the number of rows of a view, those included that wait for its turn."""


def view_sink(module: Module, delta: Delta, adding: bool) -> Sink:
    """Adds or removes a derivation of the view."""
    heads = delta.conjunction.parameters
    each = lambda names: [changed(module, delta, adding, row(heads, names))]  # noqa: E731
    return Sink(heads, (), each, (), size=HELD if adding else "0")


def changed(module: Module, delta: Delta, adding: bool, row_: str) -> str:
    """The line that adds or removes a derivation of a row, now or when it is the view's turn."""
    if delta.queued:
        return f"{module.name(Held('queue', delta.name))}(({row_}, {adding}))"
    return f"{module.name(Held(SINKS[adding], delta.name))}({row_})"


class DeltaTranslation(Translation):
    """Turns the plan of a body into lines, with the relation of a changed tuple seen as each place has to.

    Args:
        planner: tells about views.
        module: receives symbols and functions.
        block: where the lines go.
        delta: the body, and where the tuple stands.
        tuple_: source of the tuple's values.
    """

    _shares = False

    def __init__(
        self, planner: ViewPlanner, module: Module, block: Block, delta: Delta, tuple_: Sequence[str]
    ) -> None:
        super().__init__(planner, module, delta.conjunction, block, {})  # type: ignore[arg-type]
        self._held = planner.held
        self._delta = delta
        self._tuple = list(tuple_)
        goals = delta.conjunction.goals
        self._later = {id(goals[each.goal]): each for each in delta.later}

    def run(self, plan: Plan, sink: Sink, given: dict[int, str], condition: str = "") -> None:
        """Write everything.

        Args:
            plan: the other goals.
            sink: what is done with a derivation.
            given: further variables with their source.
            condition: of the whole.
        """
        block = self._block
        depth, loops = block.depth, block.loops
        if condition:
            block.test(condition)
        named = list(zip(self._delta.occurrence.columns, self._tuple, strict=True))
        for variable, source in [*named, *given.items()]:
            if variable is None:
                continue
            if self._known(variable):
                block.test(f"{self._source(variable)} == {source}")
            elif source.isidentifier():
                self._names[variable] = source
            else:
                block.line(f"v{variable} = {source}")
                self._names[variable] = f"v{variable}"
        self._steps(plan.steps, sink)
        block.flush()
        block.depth, block.loops = depth, loops

    def _inputs(self, steps: Sequence[Step], sink: Sink) -> list[int]:
        self._block.flush()
        return super()._inputs(steps, sink)

    def _function(self, prefix: str, steps: Sequence[Step], sink: Sink, continuation: bool = False) -> str:
        """As in `Translation`; the tuple goes along."""
        inputs_ = self._inputs(steps, sink)
        inner = self._inner(Block(), continuation)
        inner._names = {v: f"v{v}" for v in inputs_}
        inner._continues = continuation
        inner.bounded = self.bounded if continuation else None
        shared = sink.shared if continuation else ()
        inner._block.raw(() if shared else sink.head)
        inner._steps(steps, sink)
        inner._block.raw(() if shared and not sink.relay else sink.tail)
        name = self._module.fresh(prefix)
        passed = [*shared, *self._tuple]
        self._module.function(name, [*passed, *(f"v{v}" for v in inputs_)], inner._block)
        return f"{name}({', '.join([*passed, *(self._source(v) for v in inputs_)])})"

    def _size(self, sink: Sink) -> str:
        """As in `Translation`; what a delta adds to is the view."""
        return f"{self._module.name(Held('size', self._delta.name))}()" if sink.size == HELD else sink.size

    def _inner(self, block: Block, continuation: bool) -> DeltaTranslation:
        """Hook: the translation of a function inside this one, or of the rest of this one."""
        kind = type(self) if continuation else DeltaTranslation
        return kind(self._planner, self._module, block, self._delta, self._tuple)  # type: ignore[arg-type]

    # --- the relation without the tuple

    def _here(self, columns: Sequence[int | None]) -> str:
        """Whether the tuple agrees with what a place asks for; columns without a value agree with everything."""
        straight = self._agrees(columns, self._tuple)
        if not self._delta.symmetric:
            return straight
        crossed = self._agrees(columns, self._tuple[::-1])
        return straight if straight == crossed else f"({straight} or {crossed})"

    def _agrees(self, columns: Sequence[int | None], tuple_: Sequence[str]) -> str:
        tests = []
        for variable, source in zip(columns, tuple_, strict=True):
            if variable is not None:
                own = self._source(variable)
                if own != source:
                    tests.append(f"{own} == {source}")
        return f"({' and '.join(tests)})" if tests else "True"

    def _loop(self, step: Step) -> None:
        goal = step.goal
        if isinstance(goal, CallAtom):
            self._loop_view(goal)
        else:
            super()._loop(step)
        self._exclude(goal)

    def _bind(self, step: Step, inline: bool) -> None:
        super()._bind(step, inline)
        self._exclude(step.goal)

    def _exclude(self, goal: Goal) -> None:
        """The tuple itself is not what this place may find."""
        place = self._later.get(id(goal))
        if place is not None and place.role is Role.EACH:
            here = self._here(place.columns)
            self._block.test("False" if here == "True" else f"not {here}")
        elif place is not None and place.role is Role.SOME and isinstance(goal, AttributeAtom):
            self._block.test(f"not {self._here(place.columns)}")

    def _test(self, step: Step) -> str:
        goal = step.goal
        assert step.kind is Kind.TEST
        place = self._later.get(id(goal))
        match goal:
            case Absence():
                return self._absent(goal, place)
            case LinkAtom() if not (self._known(goal.source) and self._known(goal.target)):
                return self._number_of(goal) if place is None else f"{self._number_without(goal, place)} > 0"
            case CallAtom():
                found = self._has(goal)
            case AttributeAtom() if not self._known(goal.value):
                found = f"{self._value(step)} is not None"
            case _:
                found = super()._test(step)
        if place is None or place.role is Role.NUMBER:
            return found
        here = self._here(place.columns)
        return "False" if here == "True" else f"{found} and not {here}"

    def _number_of(self, goal: LinkAtom) -> str:
        return self._ends(goal)

    def _number_without(self, goal: LinkAtom, place: Occurrence) -> str:
        here = self._here(place.columns)
        return f"len({self._ends(goal)}) - {'1' if here == 'True' else here}"

    def _absent(self, goal: Absence, place: Occurrence | None) -> str:
        relation = negated(goal)
        if isinstance(relation, LinkAtom) and free_inside(goal):
            if place is None:
                return f"not {self._ends(relation)}"
            return f"{self._number_without(relation, place)} == 0"
        found = self._holds(relation)
        if place is None:
            return f"not {found}"
        here = self._here(place.columns)
        return "True" if here == "True" else f"(not {found} or {here})"

    def _holds(self, relation: Relation) -> str:
        """Whether a relation has a tuple."""
        match relation:
            case InstanceAtom():
                return f"({self._is_instance(relation)})"
            case AttributeAtom(attribute, owner, held):
                column = f"{self._module.name(Values(attribute.index))}[{self._source(owner)}]"
                if self._known(held):
                    return f"({column} == {self._source(held)})"
                return f"({column} is not None)"
            case LinkAtom():
                return f"({self._is_linked(relation)})"
            case CallAtom():
                return f"({self._has(relation)})"
            case ClosureAtom():
                return f"({self._closure(relation)})"

    def alone(self, occurrence: Occurrence, names: Sequence[str]) -> str:
        """Whether the tuple is the only one of its group; nothing for a group of one."""
        relation = occurrence.relation
        if isinstance(relation, LinkAtom) and None in occurrence.columns:
            return f"len({self._group(occurrence, names)}) == 1"
        return ""

    def number(self, occurrence: Occurrence, names: Sequence[str], less: int) -> str:
        """How many tuples the group of the tuple has, with it or without."""
        size = f"len({self._group(occurrence, names)})"
        return f"{size} - 1" if less else size

    def _group(self, occurrence: Occurrence, names: Sequence[str]) -> str:
        relation = occurrence.relation
        assert isinstance(relation, LinkAtom)
        if occurrence.columns[0] is not None:
            return f"{self._module.name(forward_column(relation.reference))}[{names[0]}]"
        return f"{self._module.name(Backward(relation.reference.index))}[{names[1]}]"

    # --- views

    def _has(self, goal: CallAtom) -> str:
        """Whether a view has a row, all of which is known."""
        rows = self._module.name(Held("position", goal.pattern))
        return f"{row(goal.arguments, self._source)} in {rows}"

    def _loop_view(self, goal: CallAtom) -> None:
        given = tuple(p for p, v in enumerate(goal.arguments) if self._known(v))
        if given:
            table = self._module.name(Held("group", goal.pattern, given))
            key = value([goal.arguments[p] for p in given], self._source)
            iterable = f"{table}({key}, ())"
        else:
            iterable = self._module.name(Held("rows", goal.pattern))
        columns = [None if p in given else v for p, v in enumerate(goal.arguments)]
        self._each(columns, iterable, tuples=True)

    def _value(self, step: Step) -> str:
        goal = step.goal
        if not isinstance(goal, AggregateAtom):
            return super()._value(step)
        if isinstance(goal.relation, LinkAtom):
            place = self._later.get(id(goal))
            if place is None:
                return f"len({self._ends(goal.relation)})"
            return f"({self._number_without(goal.relation, place)})"
        table = self._module.name(Held("fold", fold_of(goal)))
        return f"{table}({row(group_of(goal), self._source)})"

    # --- closures

    def _closure(self, goal: ClosureAtom) -> str:
        forward, _, _ = self._held.reached(goal.step)
        table = self._module.name(Held("reach", goal.step))
        start, other = (goal.source, goal.target) if forward else (goal.target, goal.source)
        if self._known(start) and self._known(other):
            return f"{self._source(other)} in {table}({self._source(start)}, ())"
        if self._known(start):
            return f"{table}({self._source(start)}, ())"
        pairs = self._module.name(Held("starts" if self._known(other) else "pairs", goal.step))
        return f"{pairs}({self._source(other)})" if self._known(other) else f"{pairs}()"
