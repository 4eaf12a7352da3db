"""Generate the delta functions of a network, and subscribe them to the store and to the operators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, product

from envgraph.code import Call, ExpressionStatement, Function, Local, Name, Return, define_functions
from envgraph.graph import Store
from envgraph.match.plan._step_candidates import Unplannable
from envgraph.match.views.delta._delta_functions import Delta, own_positions
from envgraph.match.views.delta._fusion import fused_source
from envgraph.match.views.delta._occurrences import RelationOccurrence, occurrences
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.match.views.network._builder import Build, Definition, Key, NetworkBuilder
from envgraph.match.views.operators._closure import ClosureOperator, CycleOperator
from envgraph.match.views.operators._delete_and_rederive import RecursiveView
from envgraph.match.views.operators._group_aggregates import AggregateOperator
from envgraph.match.views.operators._materialized_view import Hook, MaterializedView, Operator, RecomputedRows
from envgraph.metamodel import Attribute
from envgraph.pattern import AttributeAtom, CallAtom, ClosureAtom, Conjunction, InstanceAtom, LinkAtom

Consumer = tuple[Hook, Hook]
"""The functions to call after a tuple is inserted, and before a tuple is deleted."""
ClassAtoms = frozenset[tuple[str, bool]]
"""The class atoms (class, exact) used by views that hold for the direct instances of a class."""


class NetworkSubscriptions:
    """The subscriptions of a network: the functions that bring changes of the model to the operators.

    Attributes:
        deltas: the definitions of the delta functions.
        scheduled: the operators that the network processes in order; delta functions update the other views at once.
        recomputed: the operators among them that are recomputed when the store's revision has changed.

    Args:
        store: notifies of changes.
        builder: the operators.
        planner: orders goals.
        build: creates a function from source.
    """

    def __init__(self, store: Store, builder: NetworkBuilder, planner: ViewPlanner, build: Build) -> None:
        self.store = store
        self.deltas: list[Delta] = []
        self.scheduled: list[Operator] = []
        self.recomputed: list[RecomputedRows] = []
        self._builder = builder
        self._planner = planner
        self._build = build
        self._consumers: dict[Key, list[Consumer | Delta]] = {}
        self._classes: list[
            tuple[MaterializedView | RecursiveView, int, Conjunction, tuple[RelationOccurrence, ...]]
        ] = []
        self._membership: dict[tuple[str, int, frozenset[int]], Consumer] = {}
        self._queued: set[str] = set()

    def connect(self) -> None:
        """Create the functions of all operators, replacing earlier ones, and subscribe them to the store."""
        self.deltas.clear()
        self._consumers.clear()
        self._classes.clear()
        self._membership.clear()
        self._queued = self._builder.read_operators()
        deltas = self._deltas()
        # Views without readers are updated at once; all of their groups exist by now.
        for operator in self._builder.operators.values():
            operator.on_inserted = operator.on_deleting = None
            if operator.name not in self._queued:
                self._make(operator)
        for operator in self._builder.operators.values():
            self._subscribe(operator)
        for key, delta in deltas:
            self.deltas.append(delta)
            self._add_consumer(key, delta)
        self.subscribe()
        queued = [each for each in self._builder.operators.values() if each.name in self._queued]
        for operator in queued:
            operator.on_inserted, operator.on_deleting = self._combined_hooks(
                ("rows", operator.name), self._arity(operator)
            )
        for operator in queued:  # after all readers are known
            if isinstance(operator, MaterializedView):
                if operator.groups and not operator.is_read and all(item is not None for _, item in operator.groups):
                    operator.drop_rows()  # only closures read it, so it needs to store only its groups
                self._make(operator)
        self.scheduled = [
            operator
            for operator in self._builder.operators.values()
            if not isinstance(operator, MaterializedView) or operator.name in self._queued
        ]
        self.recomputed = [operator for operator in self.scheduled if isinstance(operator, RecomputedRows)]

    def _make(self, operator: Operator) -> None:
        """Generate the update functions of a view. Do nothing for other operators."""
        if isinstance(operator, MaterializedView):
            operator.build_functions(self._arity(operator))

    def _arity(self, operator: Operator) -> int:
        """Return the number of values in a tuple of an operator."""
        definition = self._builder.definitions.get(operator.name)
        match operator:
            case AggregateOperator():
                return len(operator.group) + 1
            case ClosureOperator() | CycleOperator():
                return 2 if isinstance(operator, ClosureOperator) else 1
            case _ if definition is not None:
                return len(definition.bodies[0].parameters) if definition.bodies else 0
            case _:
                return len(self._builder.library.parameter_types(operator.name))

    def _subscribe(self, operator: Operator) -> None:
        """Register an aggregate or closure operator as a consumer of the relations it reads. Do nothing for others."""
        match operator:
            case AggregateOperator():
                self._add_consumer(("rows", operator.source.name), operator.hooks)
            case ClosureOperator() | CycleOperator():
                if isinstance(operator, ClosureOperator):
                    self._add_consumer(
                        ("rows", operator.starts.name), (operator.on_start_added, operator.on_start_removed)
                    )
                gain: Hook = operator.on_edge_inserted
                lose: Hook = operator.on_edge_deleted
                key, crossed = self._builder.edges[operator.name]
                if crossed:
                    gain, lose = _swap_ends(gain), _swap_ends(lose)
                self._add_consumer(key, (gain, lose))

    def _deltas(self) -> list[tuple[Key, Delta]]:
        """Return each occurrence in a body as a delta with its relation. Add class tests to `_classes` instead."""
        found: list[tuple[Key, Delta]] = []
        for name, definition in self._builder.definitions.items():
            for number, body in enumerate(definition.bodies):
                places = occurrences(body)
                members = tuple(place for place in places if isinstance(place.relation, InstanceAtom))
                if members:
                    self._classes.append((definition.view, number, body, members))
                for index, place in enumerate(places):
                    key = _key(place)
                    if key is not None and not self._is_in_component(definition, key):
                        later = tuple(other for other in places[index + 1 :] if _key(other) == key)
                        symmetric = key[0] == "link" and self.store.relations[int(key[1])].is_symmetric
                        delta = Delta(name, number, body, place, later, symmetric, is_queued=name in self._queued)
                        # Rows found by a lookup in the view must not belong to another body.
                        if name not in self._queued and len(definition.bodies) == 1:
                            delta = self._with_row_index(delta, definition.view)
                        found.append((key, delta))
        return found

    def _is_in_component(self, definition: Definition, key: Key) -> bool:
        """Return True if a relation belongs to the view's own recursive component, which updates its rows by itself."""
        return isinstance(definition.view, RecursiveView) and key[0] == "rows" and key[1] in definition.view.component

    def _with_row_index(self, delta: Delta, view: MaterializedView | RecursiveView) -> Delta:
        """Return the delta; if an index of the view finds lost rows faster than a search, create it and set `own`."""
        if isinstance(view, RecursiveView) or view.counts is not None:
            return delta
        own = own_positions(self._planner, delta)
        if own is not None:
            view.group(own)
        return replace(delta, own=own)

    def _build_delta_function(self, deltas: Sequence[Delta], inserting: bool) -> Hook:
        """Generate one function for several deltas of one relation, for insertions if `inserting`, else for
        deletions.
        """
        try:
            hook: Hook = self._build(fused_source(self._planner, deltas, inserting))
        except Unplannable as reason:
            raise AssertionError(f"{deltas} cannot be planned") from reason
        return hook

    def _delta_consumer(self, delta: Delta) -> Consumer:
        """Generate the functions of a delta for insertion and deletion."""
        return self._build_delta_function([delta], True), self._build_delta_function([delta], False)

    def _add_consumer(self, key: Key, consumer: Consumer | Delta) -> None:
        """Add a consumer of a relation: a pair of functions, or a delta whose functions are generated later."""
        self._consumers.setdefault(key, []).append(consumer)

    def _combined_hooks(self, key: Key, arity: int, symmetric: bool = False) -> Consumer | tuple[None, None]:
        """Return one function for insertions and one for deletions that call all consumers; None without consumers.

        If `symmetric`, they call the consumers for both directions of a link.
        """
        consumers = self._consumers.get(key)
        if not consumers:
            return None, None
        if symmetric:  # both directions at one occurrence, then both at the next: they change together
            pairs = [self._delta_consumer(each) if isinstance(each, Delta) else each for each in consumers]
            consumers = [(_call_both_directions(added), _call_both_directions(removing)) for added, removing in pairs]
        # Deletions call the consumers in reverse order.
        return (
            _call_all(self._consumer_functions(consumers, True), arity),
            _call_all(self._consumer_functions(consumers[::-1], False), arity),
        )

    def _consumer_functions(self, consumers: Sequence[Consumer | Delta], inserting: bool) -> list[Hook]:
        """Return the consumers' functions for insertion or deletion (`inserting`); adjacent deltas share a function."""
        found: list[Hook] = []
        for is_delta, run in groupby(consumers, lambda each: isinstance(each, Delta)):
            if is_delta:
                found.append(self._build_delta_function(list(run), inserting))  # type: ignore[arg-type]
            else:
                found.extend(each[0 if inserting else 1] for each in run)  # type: ignore[index]
        return found

    def subscribe(self) -> None:
        """Subscribe all functions to the store, for changes of links, attribute values and objects."""
        store = self.store
        for relation in store.relations:
            key = ("link", relation.fact.index)
            relation.added, relation.removing = self._combined_hooks(key, 2, relation.is_symmetric)
        for index in range(len(store.value_added)):
            store.value_added[index], store.value_removing[index] = self._combined_hooks(("value", index), 2)
        self._subscribe_classes()

    def _subscribe_classes(self) -> None:
        """Create all functions for creation, deletion and retyping of objects, and subscribe them.

        They are not created later, when needed: they could then need a new index, which a rollback could not restore.
        """
        store, metamodel = self.store, self._builder.library.metamodel
        kinds = [self._kind(index) for index in range(len(metamodel.class_list))]
        hooks = {kind: self._class_hooks(kind) for kind in dict.fromkeys(kinds)}
        for index, kind in enumerate(kinds):
            store.class_removing[index], store.class_added[index] = hooks[kind]
        if not self._classes:
            store.retyping_callbacks = None
            return
        retypings = {}
        for old, new in product(tuple(hooks), repeat=2):
            for change in (old - new, new - old):
                if change not in hooks:
                    hooks[change] = self._class_hooks(change)
            retypings[old, new] = hooks[old - new][0], hooks[new - old][1]
        store.retyping_callbacks = lambda old, new: retypings[kinds[old], kinds[new]]

    def unsubscribe(self) -> None:
        """Remove all functions from the store, so that the network is no longer notified."""
        store = self.store
        for relation in store.relations:
            relation.added = relation.removing = None
        for hooks in (store.value_added, store.value_removing, store.class_added, store.class_removing):
            for index in range(len(hooks)):
                hooks[index] = None
        store.retyping_callbacks = None

    # --- classes: creating or deleting an object changes the relation of every class that it is an instance of

    def _kind(self, cls: int) -> ClassAtoms:
        """Return the class atoms in view bodies that hold for the direct instances of the class with this index."""
        metamodel = self._builder.library.metamodel
        name = metamodel.class_list[cls].name
        atoms = {(atom.cls, atom.exact) for _, _, _, members in self._classes for atom in map(_class, members)}
        return frozenset(
            (above, exact) for above, exact in atoms if name == above or (not exact and metamodel.is_a(name, above))
        )

    def _class_hooks(self, atoms: ClassAtoms) -> tuple[Hook | None, Hook | None]:
        """Return the functions to call before class atoms cease to hold for an object, and after they begin to hold.

        Both are None if no body contains one of these atoms.
        """
        consumers = self._class_consumers(atoms)
        if not consumers:
            return None, None
        return _call_all([each[1] for each in reversed(consumers)], 1), _call_all([each[0] for each in consumers], 1)

    def _class_consumers(self, atoms: ClassAtoms) -> list[Consumer]:
        """Return the functions of all class tests in bodies that are among these atoms; generate missing ones."""
        found: list[Consumer] = []
        for view, number, body, members in self._classes:
            places = [p for p in members if (_class(p).cls, _class(p).exact) in atoms]
            group = frozenset(place.goal for place in places)
            for index, place in enumerate(places):
                key = (f"{view.name}/{number}", place.goal, group)
                if key not in self._membership:
                    later = tuple(places[index + 1 :])
                    queued = view.name in self._queued
                    delta = Delta(view.name, number, body, place, later, is_queued=queued)
                    self.deltas.append(delta)
                    self._membership[key] = self._delta_consumer(delta)
                found.append(self._membership[key])
        return found


def _key(place: RelationOccurrence) -> Key | None:
    """Return the relation of an occurrence; None for a class test."""
    match place.relation:
        case AttributeAtom(attribute) | LinkAtom(Attribute() as attribute):
            return "value", attribute.index
        case LinkAtom(reference):
            return "link", reference.index
        case CallAtom(name):
            return "rows", name
        case ClosureAtom(name):
            return "rows", name
        case InstanceAtom():
            return None


def _class(place: RelationOccurrence) -> InstanceAtom:
    """Return the class test of an occurrence; no other relation is allowed."""
    assert isinstance(place.relation, InstanceAtom)
    return place.relation


def _call_all(hooks: Sequence[Hook], arity: int) -> Hook:
    """Return a generated function that calls several functions with its arguments. A single hook is returned itself."""
    if len(hooks) == 1:
        return hooks[0]
    values = tuple(Local(f"a{number}") for number in range(arity))
    names = tuple(Name(f"h{number}") for number in range(len(hooks)))
    fan = Function("fan", values, tuple(ExpressionStatement(Call(name, values)) for name in names))
    build = define_functions((Function("build", names, (fan, Return(Name("fan")))),), "<fan of envgraph>", {})["build"]
    return build(*hooks)  # type: ignore[no-any-return]


def _swap_ends(hook: Hook) -> Hook:
    """Return a function that calls `hook` with source and target swapped."""
    return lambda source, target: hook(target, source)


def _call_both_directions(hook: Hook) -> Hook:
    """Return a function for symmetric links that calls `hook` for both directions, for a self-link only once."""

    def both(source: int, target: int) -> None:
        hook(source, target)
        if source != target:
            hook(target, source)

    return both
