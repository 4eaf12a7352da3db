"""The network of views: which operators there are, in which order they take their turn, and who hears of what."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from envgraph.graph import Store
from envgraph.match._calls import CallGraph
from envgraph.match._live import LiveSizes
from envgraph.match._options import Unplannable
from envgraph.match._plan import Absence, Conjunction, Goal, arguments, variables
from envgraph.match._planner import determined, disjoint
from envgraph.match._symbols import Held, Source
from envgraph.match.views._bodies import (
    Relation,
    ViewSimplifier,
    canonical,
    component,
    existential,
    free_inside,
    negated,
    split_negations,
)
from envgraph.match.views._delta import (
    Delta,
    Occurrence,
    build_source,
    delta_source,
    derivable_source,
    occurrences,
    own_positions,
)
from envgraph.match.views._explain import explain_views
from envgraph.match.views._operators import Evaluated, Fold, Hook, Operator, Rows, View
from envgraph.match.views._planning import ViewPlanner
from envgraph.match.views._reach import LinkSteps, Reach, RowSteps
from envgraph.match.views._recursive import Component, Member
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    InstanceAtom,
    Library,
    LinkAtom,
    ObjectType,
)

Build = Callable[[Source], Any]
"""Makes a function of generated source; symbols that a view holds are asked from the network."""


class NotIncremental(Exception):
    """There is no delta for a body."""


@dataclass(slots=True)
class Definition:
    """How a view is made: the bodies over the relations of the network."""

    view: View | Member
    bodies: tuple[Conjunction, ...]


Entered = TypeVar("Entered", bound=Operator)
Consumer = tuple[Hook, Hook]
"""What is called with a tuple that has come, and with one that is about to go."""
Kind = frozenset[tuple[str, bool]]
"""Classes that an object is an instance of, and whether directly, as far as anybody asks."""
Key = tuple[str, int | str]
"""A relation: a value or a link by its index, an operator by its name."""


class Network:
    """Operators in an order in which each stands after those that it is made of.

    Args:
        store: what the views are about.
        library: the patterns.
        calls: which of them are recursive.
        build: see `Build`.
        evaluate: all rows of a pattern, on demand.
    """

    def __init__(
        self,
        store: Store,
        library: Library,
        calls: CallGraph,
        build: Callable[[Source], Any],
        evaluate: Callable[[str], Callable[[], Sequence[Any]]],
    ) -> None:
        self.store = store
        self.library = library
        self.calls = calls
        self.operators: dict[str, Operator] = {}
        self.definitions: dict[str, Definition] = {}
        self.edges: dict[str, tuple[Key, bool]] = {}
        self.deltas: list[Delta] = []
        self._build = build
        self._evaluate = evaluate
        self._simplifier = ViewSimplifier(library, calls)
        self._planner = ViewPlanner(library, calls, LiveSizes(library, store), self)
        self._consumers: dict[Key, list[Consumer]] = {}
        self._classes: list[tuple[View | Member, int, Conjunction, tuple[Occurrence, ...]]] = []
        self._retypings: dict[tuple[Kind, Kind], tuple[Hook | None, Hook | None]] = {}
        self._membership: dict[tuple[str, int, frozenset[int]], Consumer] = {}
        self._turns: list[Operator] = []
        self._queued: set[str] = set()
        self._open: set[str] = set()

    # --- Held: what plans ask

    def rows(self, view: str) -> float:
        """Matches of a view."""
        return max(self.operators[view].size(), 0.5)

    def matching(self, view: str, positions: tuple[int, ...]) -> float:
        """Matches of a view that agree with values at these positions, on average."""
        operator = self.operators[view]
        assert isinstance(operator, Rows)
        keys = len({tuple([row[p] for p in positions]) for row in operator.rows[:512]})
        sample = min(len(operator.rows), 512)
        return max(sample / keys, 0.5) if keys else 0.5

    def reached(self, closure: str) -> tuple[bool, float, float]:
        """Whether it is followed from the source, how many starts it has, and what each reaches."""
        operator = self.operators[closure]
        assert isinstance(operator, Reach)
        starts = max(len(operator.begun), 1)
        return operator.forward, float(starts), max(operator.size() / starts, 1.0)

    # --- growing

    def view(self, pattern: str) -> Rows:
        """The operator that holds the matches of a pattern."""
        known = self.operators.get(pattern)
        if known is not None:
            assert isinstance(known, Rows)
            return known
        before = len(self.operators)
        under_way = set(self._open)
        try:
            if self.library.inputs(pattern):
                raise NotIncremental
            if self.calls.recursive(pattern):
                return self._recursive(pattern)
            return self._define(pattern, self._simplifier.conjunctions(pattern))
        except NotIncremental:
            self._open = under_way
            for name in list(self.operators)[before:]:
                del self.operators[name]
                self.definitions.pop(name, None)
            for name in self._together(pattern):
                self._enter(Evaluated(name, self.store, self._evaluate(name)))
            found = self.operators[pattern]
            assert isinstance(found, Rows)
            return found

    def _enter(self, operator: Entered) -> Entered:
        self.operators[operator.name] = operator
        operator.fill()
        return operator

    def _define(self, name: str, bodies: Iterable[Conjunction]) -> View:
        """A view of some bodies."""
        prepared = [self._prepared(name, number, body) for number, body in enumerate(bodies)]
        view = View(name, self.store, counted=self._repeats(prepared))
        try:
            lists = [
                self._build(build_source(self._planner, name, number, body))
                for number, body in enumerate(prepared)
            ]
        except Unplannable:
            raise NotIncremental from None
        view.list_derivations = _together(lists)
        self.definitions[name] = Definition(view, tuple(prepared))
        return self._enter(view)

    def _recursive(self, pattern: str) -> Member:
        """The operators of all patterns that call each other with this one."""
        component = self.calls.component(pattern)
        names = self._together(pattern)
        if len(names) < len(component):
            raise NotIncremental
        members = {name: self._enter(Member(name, self.store)) for name in names}
        self._open |= component
        for name, member in members.items():
            bodies = tuple(
                self._prepared(name, number, body)
                for number, body in enumerate(self._simplifier.conjunctions(name))
            )
            self.definitions[name] = Definition(member, bodies)
        self._open -= component
        for member in members.values():
            try:
                self._make_member(member, component)
            except Unplannable:
                raise NotIncremental from None
        self._enter(Component(f"{names[0]}/component", self.store, list(members.values())))
        return members[pattern]

    def _together(self, pattern: str) -> list[str]:
        """The patterns that call each other with this one, or the pattern alone; those that can be enumerated."""
        component = self.calls.component(pattern) or {pattern}
        names = [name for name in self.library.names() if name in component] or [pattern]
        return [name for name in names if not self.library.inputs(name)]

    def _prepared(self, name: str, number: int, body: Conjunction) -> Conjunction:
        """A body over relations of the network."""
        goals = split_negations(canonical(goal, self.store) for goal in body.goals)
        body = replace(body, goals=tuple(goals))
        return replace(body, goals=tuple(self._goals(body, f"{name}/{number}")))

    def _make_member(self, member: Member, component: frozenset[str]) -> None:
        """The functions of a member's bodies."""
        bases, derivable = [], []
        planner = self._planner
        for number, body in enumerate(self.definitions[member.name].bodies):
            inside = [place for place in occurrences(body) if _called(place) in component]
            if not inside:
                bases.append(self._build(build_source(planner, member.name, number, body)))
            derivable.append(self._build(derivable_source(planner, member.name, number, body)))
            for place in inside:
                called = self.operators[_called(place) or ""]
                assert isinstance(called, Member)
                delta = Delta(member.name, number, body, place, (), queued=True)
                called.spread = (*called.spread, self._build(delta_source(planner, delta, True)))
                called.retract = (*called.retract, self._build(delta_source(planner, delta, False)))
        member.list_base, member.derivable = bases, derivable

    def _repeats(self, bodies: Sequence[Conjunction]) -> bool:
        """Whether a row may have several derivations."""
        for body in bodies:
            known = {*body.parameters, *(number for number, _ in body.constants)}
            counted = {v for goal in body.goals for v in variables(goal)} - existential(body)
            if not counted <= determined(body.goals, known, self._planner.sizes):
                return True
        return not disjoint(tuple(range(len(bodies[0].parameters))) if bodies else (), bodies)

    def _goals(self, body: Conjunction, name: str) -> list[Goal]:
        """The goals over relations of the network."""
        found: list[Goal] = []
        for number, goal in enumerate(body.goals):
            place = f"{name}/{number}"
            match goal:
                case CallAtom(pattern):
                    self._usable(pattern, positive=True)
                    found.append(goal)
                case ClosureAtom():
                    found.append(self._closure(body, goal, place))
                case Absence():
                    found.append(self._absence(body, goal, place))
                case AggregateAtom():
                    found.append(self._aggregate(body, goal, place))
                case _:
                    found.append(goal)
        return found

    def _usable(self, pattern: str, positive: bool = False) -> Rows:
        """The operator of a pattern; one that is not finished can only be called."""
        if self.library.inputs(pattern) or (pattern in self._open and not positive):
            raise NotIncremental
        return self.view(pattern)

    def _absence(self, body: Conjunction, goal: Absence, place: str) -> Goal:
        relation, local = negated(goal), set(free_inside(goal))
        if isinstance(relation, ClosureAtom):
            if local:
                raise NotIncremental
            closure = self._closure(body, relation, place)
            return replace(goal, alternatives=((closure,),))
        if isinstance(relation, CallAtom):
            self._usable(relation.pattern)
        whole = {v for v in arguments(relation) if v not in local}
        direct = not local if isinstance(relation, InstanceAtom | CallAtom) else bool(whole)
        if isinstance(relation, AttributeAtom):
            direct = relation.object not in local
        if direct:
            return goal
        projected = self._projected(body, relation, tuple(goal.outer), place)
        return replace(goal, alternatives=((CallAtom(projected.name, goal.outer),),))

    def _projected(self, body: Conjunction, relation: Relation, heads: tuple[int, ...], place: str) -> View:
        """A view of one relation with other columns."""
        fixed = dict(body.constants)
        kept = {v for v in arguments(relation) if v in fixed}
        constants = tuple((number, value) for number, value in body.constants if number in kept)
        alone = Conjunction(body.types, constants, heads, (relation,))
        return self._define(place, [alone])

    def _aggregate(self, body: Conjunction, goal: AggregateAtom, place: str) -> Goal:
        relation = goal.relation
        local = set(free_inside(goal))
        called = arguments(relation)
        if (
            isinstance(relation, LinkAtom)
            and goal.function == "count"
            and len([v for v in called if v in local]) == 1
        ):
            return goal
        if isinstance(relation, ClosureAtom):
            raise NotIncremental
        if isinstance(relation, CallAtom):
            self._usable(relation.pattern)
        fixed = {number for number, _ in body.constants}
        if isinstance(relation, CallAtom) and len(set(called)) == len(called) and fixed.isdisjoint(called):
            source = self.view(relation.pattern)
            columns = called
        else:
            columns = tuple(dict.fromkeys(called))
            source = self._projected(body, relation, columns, f"{place}/of")
        group = tuple(dict.fromkeys(v for v in called if v not in local))
        positions = tuple(columns.index(v) for v in group)
        column = None if goal.column is None else columns.index(goal.column)
        fold = Fold(f"{place}/{goal.function}", source, positions, goal.function, column)
        self._enter(fold)
        return replace(goal, relation=CallAtom(fold.name, columns))

    # --- closures

    def _closure(self, body: Conjunction, goal: ClosureAtom, place: str) -> ClosureAtom:
        """A closure from those starts that the rest of the body asks for."""
        link = self._link_of(goal.step)
        if link is None:
            self._usable(goal.step)
        reflexive = goal.closure is Closure.STAR
        types = self.library.parameter_types(goal.step)
        both = not reflexive or types[0] == types[1]
        options = [self._starts(body, goal, forward, place) for forward in (True, False) if forward or both]
        asked = [option for option in options if option is not None]
        if not asked:
            raise NotIncremental
        forward, starts = min(asked, key=lambda option: option[1].size())
        for _, other in asked:
            if other is not starts:
                self._discard(other.name)
        if link is not None:
            side = self.store.forward if forward == (not link[1]) else self.store.backward
            steps: Any = LinkSteps(side[link[0]])
        else:
            rows = self.operators[goal.step]
            assert isinstance(rows, Rows)
            steps = RowSteps(rows, forward)
        reach = Reach(f"{place}/{goal.closure}", self.store, starts, steps, forward, reflexive)
        self.edges[reach.name] = (("link", link[0]), link[1]) if link else (("rows", goal.step), False)
        self._enter(reach)
        return replace(goal, step=reach.name)

    def _discard(self, name: str) -> None:
        del self.operators[name]
        self.definitions.pop(name, None)

    def _link_of(self, step: str) -> tuple[int, bool] | None:
        """Index of the reference, and whether it is crossed, if a step is one link."""
        bodies = self._simplifier.conjunctions(step)
        if len(bodies) != 1 or len(bodies[0].goals) != 1 or bodies[0].constants:
            return None
        goal = canonical(bodies[0].goals[0], self.store)
        if not isinstance(goal, LinkAtom):
            return None
        ends = (goal.source, goal.target)
        if bodies[0].parameters == ends:
            return goal.reference.index, False
        return (goal.reference.index, True) if bodies[0].parameters == ends[::-1] else None

    def _starts(
        self, body: Conjunction, goal: ClosureAtom, forward: bool, place: str
    ) -> tuple[bool, View] | None:
        """The view of what the rest of the body allows at one end."""
        start = goal.source if forward else goal.target
        fixed = frozenset(number for number, _ in body.constants)
        others = [g for g in body.goals if isinstance(g, InstanceAtom | AttributeAtom | LinkAtom | CallAtom)]
        goals: list[Goal] = list(component(others, start, fixed))
        types = list(body.types)
        type_ = self.library.parameter_types(goal.step)[0 if forward else 1]
        if goal.closure is Closure.STAR and isinstance(type_, ObjectType):
            goals.append(InstanceAtom(type_.cls, start))
        if not goals and start not in fixed:
            other = len(types)
            types.append(self.library.parameter_types(goal.step)[1 if forward else 0])
            ends = (start, other) if forward else (other, start)
            goals = [self._step(goal.step, ends)]
        used = {v for g in goals for v in arguments(g)} | {start}  # type: ignore[arg-type]
        constants = tuple((number, value) for number, value in body.constants if number in used)
        for each in goals:
            if isinstance(each, CallAtom):
                self._usable(each.pattern)
        try:
            name = f"{place}/{'from' if forward else 'to'}"
            return forward, self._define(name, [Conjunction(tuple(types), constants, (start,), tuple(goals))])
        except NotIncremental:
            return None

    def _step(self, step: str, ends: tuple[int, int]) -> Goal:
        link = self._link_of(step)
        if link is None:
            return CallAtom(step, ends)
        reference = self.library.metamodel.references[link[0]]
        return LinkAtom(reference, *(ends[::-1] if link[1] else ends))

    # --- who hears of what

    def connect(self) -> None:
        """Make the functions of all operators, and hang them into the store."""
        self.deltas.clear()
        self._consumers.clear()
        self._classes.clear()
        self._retypings.clear()
        self._membership.clear()
        self._queued = self._read()
        deltas = self._deltas()
        # What nobody reads is changed in place, and has all its groups by now.
        for operator in self.operators.values():
            operator.added = operator.removing = None
            if operator.name not in self._queued:
                self._make(operator)
        for operator in self.operators.values():
            self._subscribe(operator)
        for key, delta in deltas:
            self._listen(key, self._delta(delta))
        self._hang()
        for operator in self.operators.values():
            if operator.name in self._queued:
                operator.added, operator.removing = self._fan(("rows", operator.name))
                self._make(operator)
        self._turns = [
            operator
            for operator in self.operators.values()
            if not isinstance(operator, View) or operator.name in self._queued
        ]

    def _make(self, operator: Operator) -> None:
        if isinstance(operator, View):
            bodies = self.definitions[operator.name].bodies
            operator.make(len(bodies[0].parameters) if bodies else 0)

    def _read(self) -> set[str]:
        """Names of operators that take their turn, because others read them."""
        found = {name for name, operator in self.operators.items() if isinstance(operator, Member)}
        for name in self.operators:
            found.update(self._made_of(name))
        return found

    def _subscribe(self, operator: Operator) -> None:
        match operator:
            case Fold():
                self._listen(("rows", operator.source.name), (operator.touch, operator.touch))
            case Reach():
                self._listen(("rows", operator.starts.name), (operator.ask, operator.unask))
                gain: Hook = operator.gain
                lose: Hook = operator.lose
                key, crossed = self.edges[operator.name]
                if crossed:
                    gain, lose = _crossed(gain), _crossed(lose)
                self._listen(key, (gain, lose))

    def _deltas(self) -> list[tuple[Key, Delta]]:
        """What changes of which relation concern which place; for classes that is found out when they change."""
        found: list[tuple[Key, Delta]] = []
        for name, definition in self.definitions.items():
            for number, body in enumerate(definition.bodies):
                places = occurrences(body)
                members = tuple(place for place in places if isinstance(place.relation, InstanceAtom))
                if members:
                    self._classes.append((definition.view, number, body, members))
                for index, place in enumerate(places):
                    key = _key(place)
                    if key is not None and not self._inside(definition, key):
                        later = tuple(other for other in places[index + 1 :] if _key(other) == key)
                        symmetric = key[0] == "link" and self.store.relations[int(key[1])].symmetric
                        delta = Delta(
                            name, number, body, place, later, symmetric, queued=name in self._queued
                        )
                        # What is looked up in the rows must not be a row of another body.
                        if name not in self._queued and len(definition.bodies) == 1:
                            delta = self._with_own(delta, definition.view)
                        found.append((key, delta))
        return found

    def _inside(self, definition: Definition, key: Key) -> bool:
        """Whether a relation is a pattern of the same component, whose rows spread on their own."""
        if not isinstance(definition.view, Member) or key[0] != "rows":
            return False
        return key[1] in self.calls.component(definition.view.name)

    def _with_own(self, delta: Delta, view: View | Member) -> Delta:
        """The delta with an index of the view on its own rows, where that pays."""
        if isinstance(view, Member) or view.counts is not None:
            return delta
        own = own_positions(self._planner, delta)
        if own is not None:
            view.group(own)
        return replace(delta, own=own)

    def _delta(self, delta: Delta) -> Consumer:
        self.deltas.append(delta)
        try:
            added, removing = (
                self._build(delta_source(self._planner, delta, coming)) for coming in (True, False)
            )
        except Unplannable as reason:
            raise AssertionError(f"{delta} cannot be planned") from reason
        return added, removing

    def _listen(self, key: Key, consumer: Consumer) -> None:
        self._consumers.setdefault(key, []).append(consumer)

    def _fan(self, key: Key) -> Consumer | tuple[None, None]:
        consumers = self._consumers.get(key)
        if not consumers:
            return None, None
        added = _fan([consumer[0] for consumer in consumers])
        # A deletion is the mirror of an insertion.
        removing = _fan([consumer[1] for consumer in reversed(consumers)])
        return added, removing

    def _hang(self) -> None:
        """Hang the functions into the store."""
        store = self.store
        for relation in store.relations:
            key = ("link", relation.fact.index)
            added, removing = self._fan(key)
            if relation.symmetric and added is not None and removing is not None:
                added, removing = _both_ways(added), _both_ways(removing)
            relation.added, relation.removing = added, removing
        for index in range(len(store.value_added)):
            store.value_added[index], store.value_removing[index] = self._fan(("value", index))
        self._hang_classes()

    def _hang_classes(self) -> None:
        """All functions are made now: one that is made later might ask for an index that has no history."""
        store, metamodel = self.store, self.library.metamodel
        kinds = [self._kind(index) for index in range(len(metamodel.class_list))]
        hooks = {kind: self._class_hooks(kind) for kind in dict.fromkeys(kinds)}
        for index, kind in enumerate(kinds):
            store.class_removing[index], store.class_added[index] = hooks[kind]
        if not self._classes:
            store.retyping = None
            return
        for old in hooks:
            for new in hooks:
                self._retypings[old, new] = (
                    self._class_hooks(old - new)[0],
                    self._class_hooks(new - old)[1],
                )
        retypings = self._retypings
        store.retyping = lambda old, new: retypings[kinds[old], kinds[new]]

    def unhang(self) -> None:
        """Hear nothing any more."""
        store = self.store
        for relation in store.relations:
            relation.added = relation.removing = None
        for hooks in (store.value_added, store.value_removing, store.class_added, store.class_removing):
            for index in range(len(hooks)):
                hooks[index] = None
        store.retyping = None

    # --- classes: an object that comes or goes changes the relation of every class that it is an instance of

    def _kind(self, cls: int) -> Kind:
        """The class atoms that hold for the direct instances of a class."""
        metamodel = self.library.metamodel
        name = metamodel.class_list[cls].name
        atoms = {
            (atom.cls, atom.exact) for _, _, _, members in self._classes for atom in map(_class, members)
        }
        return frozenset(
            (above, exact)
            for above, exact in atoms
            if name == above or (not exact and metamodel.is_a(name, above))
        )

    def _class_hooks(self, change: Kind) -> tuple[Hook | None, Hook | None]:
        """What happens before an object ceases to be what these atoms say, and after it has begun to be that."""
        consumers = self._affected(change)
        if not consumers:
            return None, None
        return _fan([each[1] for each in reversed(consumers)]), _fan([each[0] for each in consumers])

    def _affected(self, change: Kind) -> list[Consumer]:
        """The delta functions of all places whose class an object enters or leaves in one step."""
        found: list[Consumer] = []
        for view, number, body, members in self._classes:
            places = [p for p in members if (_class(p).cls, _class(p).exact) in change]
            group = frozenset(place.goal for place in places)
            for index, place in enumerate(places):
                key = (f"{view.name}/{number}", place.goal, group)
                if key not in self._membership:
                    later = tuple(places[index + 1 :])
                    queued = view.name in self._queued
                    delta = Delta(view.name, number, body, place, later, queued=queued)
                    self._membership[key] = self._delta(delta)
                found.append(self._membership[key])
        return found

    # --- turns

    def settle(self) -> None:
        """Bring everything up to date: each operator once, after those that it is made of."""
        for operator in self._turns:
            if operator.pending:
                operator.process()

    def forget(self) -> None:
        """The state that the operators hold is right as it is: what is pending is void."""
        for operator in self._turns:
            operator.forget()

    def refill(self) -> None:
        """Compute everything anew."""
        self.forget()
        for operator in self.operators.values():
            operator.fill()

    def held(self, symbol: Held) -> object:
        """What a name in generated source stands for."""
        operator = self.operators[symbol.name]
        match symbol.what, operator:
            case "derive", View():
                return operator.derive
            case "underive", View():
                return operator.underive
            case "queue", View() | Member():
                return operator.queue.extend
            case "position", Rows():
                return operator.rows.position
            case "rows", Rows():
                return operator.rows
            case "group", Rows():
                return operator.group(symbol.positions).table.get
            case "fold", Fold():
                return operator.value
            case "reach", Reach():
                return operator.reached.get
            case "starts", Reach():
                return operator.starts_to
            case "pairs", Reach():
                return operator.pairs
        raise AssertionError(symbol)

    def explain(self, pattern: str) -> str:
        """What a watched pattern is made of, and how it is kept current."""
        needed: set[str] = set()
        todo = [pattern]
        for name in todo:
            if name not in needed:
                needed.add(name)
                todo.extend(self._made_of(name))
        operators = [operator for name, operator in self.operators.items() if name in needed]
        return explain_views(operators, self.deltas, self._planner, pattern)

    def _made_of(self, name: str) -> Iterator[str]:
        """The operators that one reads."""
        operator = self.operators[name]
        if name in self.definitions:
            for body in self.definitions[name].bodies:
                for place in occurrences(body):
                    if isinstance(place.relation, CallAtom):
                        yield place.relation.pattern
                    if isinstance(place.relation, ClosureAtom):
                        yield place.relation.step
        if isinstance(operator, Fold):
            yield operator.source.name
        if isinstance(operator, Reach):
            yield operator.starts.name
            kind, edges = self.edges[name][0]
            if kind == "rows":
                yield str(edges)

    def check(self) -> None:
        """Assert that every operator holds what a new computation finds."""
        for operator in self.operators.values():
            match operator:
                case View():
                    operator.check_derivations()
                case Fold() | Reach():
                    operator.check()
                case Component():
                    assert not operator.pending
                case Rows():
                    operator.check(self._evaluate(operator.name)())


def _key(place: Occurrence) -> Key | None:
    """The relation of an occurrence; None for a class, which has functions of its own."""
    match place.relation:
        case AttributeAtom(attribute):
            return "value", attribute.index
        case LinkAtom(reference):
            return "link", reference.index
        case CallAtom(name):
            return "rows", name
        case ClosureAtom(name):
            return "rows", name
        case InstanceAtom():
            return None


def _called(place: Occurrence) -> str | None:
    return place.relation.pattern if isinstance(place.relation, CallAtom) else None


def _class(place: Occurrence) -> InstanceAtom:
    assert isinstance(place.relation, InstanceAtom)
    return place.relation


def _together(lists: Sequence[Callable[[], list[Any]]]) -> Callable[[], list[Any]]:
    if len(lists) == 1:
        return lists[0]
    return lambda: [row for each in lists for row in each()]


def _fan(hooks: Sequence[Hook]) -> Hook:
    """One function that calls several."""
    if len(hooks) == 1:
        return hooks[0]
    if len(hooks) == 2:
        first, second = hooks

        def two(*values: Any) -> None:
            first(*values)
            second(*values)

        return two
    several = tuple(hooks)

    def all_(*values: Any) -> None:
        for hook in several:
            hook(*values)

    return all_


def _crossed(hook: Hook) -> Hook:
    return lambda source, target: hook(target, source)


def _both_ways(hook: Hook) -> Hook:
    """A link that counts in both directions is two tuples, or one if it leads from an object to itself."""

    def both(source: int, target: int) -> None:
        hook(source, target)
        if source != target:
            hook(target, source)

    return both
