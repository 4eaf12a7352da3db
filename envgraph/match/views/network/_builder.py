"""Build the operators of a view network: the relations needed to keep a pattern's matches up to date."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import replace
from math import inf
from typing import Any, TypeVar

from envgraph.code import dataclass
from envgraph.graph import Store
from envgraph.match._match_costs import VIEWS
from envgraph.match.generate._symbols import GeneratedSource
from envgraph.match.passes import FOR_VIEWS, RewrittenBodies
from envgraph.match.passes._call_graph import CallGraph
from envgraph.match.plan._search_plan import attribute_and_variables
from envgraph.match.plan._step_candidates import Unplannable
from envgraph.match.views.delta._delta_functions import Delta, build_source, delta_source, derivable_source
from envgraph.match.views.delta._magic_sets import (
    Definitions,
    RestrictedDefinitions,
    restrict_changed,
    restrict_unchanged,
    transitive_body,
)
from envgraph.match.views.delta._occurrences import RelationOccurrence, occurrences
from envgraph.match.views.delta._value_views import (
    call_value_views,
    value_join_attributes,
    value_view_body,
    values_of,
)
from envgraph.match.views.delta._view_bodies import (
    connected_goals,
    local_variables,
    negated,
    single_closure_of,
    single_link_of,
)
from envgraph.match.views.delta._view_planner import ViewPlanner
from envgraph.match.views.operators._closure import ClosureOperator, CycleOperator, EdgeTables
from envgraph.match.views.operators._delete_and_rederive import RecursiveComponent, RecursiveView
from envgraph.match.views.operators._group_aggregates import AggregateOperator, NthRow
from envgraph.match.views.operators._materialized_view import (
    MaterializedView,
    Operator,
    RecomputedRows,
    RowOperator,
    recompute_unrecorded,
)
from envgraph.metamodel import Reference
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    CallAtom,
    Closure,
    ClosureAtom,
    ConditionAtom,
    Conjunction,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    RelationAtom,
    UnequalAtom,
    ValuationAtom,
    is_relation,
    relation_variables,
    visible_variables,
)

Build = Callable[[GeneratedSource], Any]
"""Creates a function of generated source. Values of operator symbols come from the network."""
Evaluate = Callable[[str], Callable[[], Sequence[Any]]]
"""Returns a function that lists all rows of a pattern on demand."""


class NotIncremental(Exception):
    """The error raised if a body cannot have delta functions; its pattern is then recomputed after every change."""


@dataclass(slots=True)
class Definition:
    """The definition of a view: its bodies over relations of the network."""

    view: MaterializedView | RecursiveView
    bodies: tuple[Conjunction, ...]


Entered = TypeVar("Entered", bound=Operator)
Key = tuple[str, int | str]
"""A relation: "value" or "link" with the index of the feature, or "rows" with the name of an operator."""


class NetworkBuilder:
    """A network under construction: the operators so far, each placed after the operators that it reads.

    Attributes:
        operators: by name. An operator with the name of a pattern holds its matches.
        definitions: the definitions of the views.
        edges: for each closure the relation that it follows, and True if source and target are swapped.
        component_deltas: the delta functions between rows of a recursive component.
        max_closure_pairs: the largest number of pairs of a new closure; more raise an `EvaluationError`.

    Args:
        store: the store of the model.
        calls: the call graph of the patterns.
        planner: orders goals.
        build: see `Build`.
        evaluate: see `Evaluate`.
    """

    def __init__(self, store: Store, calls: CallGraph, planner: ViewPlanner, build: Build, evaluate: Evaluate) -> None:
        self.store = store
        self.library = planner.library
        self.calls = calls
        self.operators: dict[str, Operator] = {}
        self.definitions: dict[str, Definition] = {}
        self.edges: dict[str, tuple[Key, bool]] = {}
        self.component_deltas: list[Delta] = []
        self.max_closure_pairs = inf
        self._planner = planner
        self._build = build
        self._evaluate = evaluate
        self._bodies = RewrittenBodies(self.library, calls, FOR_VIEWS)
        self._under_construction: set[str] = set()
        self._is_product_cache: dict[str, bool] = {}

    def view(self, pattern: str) -> RowOperator:
        """Return the operator with the matches of a pattern; create it and the operators that it reads if necessary.

        If delta functions are impossible, it is an `RecomputedRows` operator, which recomputes its rows after every
        change.
        """
        known = self.operators.get(pattern)
        if known is not None:
            assert isinstance(known, RowOperator)
            return known
        before = len(self.operators)
        under_way = set(self._under_construction)
        try:
            if self.library.inputs(pattern):
                raise NotIncremental
            if self.calls.is_recursive(pattern):
                return self._create_component(self._definitions(pattern))[pattern]
            return self._create_view(pattern, self._bodies.bodies_of(pattern))
        except NotIncremental:
            self._under_construction = under_way
            self._discard(*list(self.operators)[before:])
            for name in self._component_names(pattern):
                self._add_operator(RecomputedRows(name, self.store, self._evaluate(name)))
            found = self.operators[pattern]
            assert isinstance(found, RowOperator)
            return found

    def recursive(self, pattern: str) -> RecursiveView | None:
        """Create the operators of a recursive component. Return the pattern's; None if it has no delta functions."""
        try:
            return self._create_component(self._definitions(pattern))[pattern]
        except NotIncremental:
            return None

    def _add_operator(self, operator: Entered) -> Entered:
        """Add an operator to the network, compute its relation without journalling, and return it."""
        self.operators[operator.name] = operator
        if isinstance(operator, ClosureOperator) and self.max_closure_pairs < inf:
            operator.check_pair_limit(self.max_closure_pairs)
        recompute_unrecorded(operator)
        return operator

    def _create_view(self, name: str, bodies: Iterable[Conjunction]) -> MaterializedView:
        """Create a view of some bodies, add it and missing operators that it reads to the network, and return it."""
        prepared = [self._prepare_body(name, number, body) for number, body in enumerate(bodies)]
        view = MaterializedView(name, self.store, counted=self._planner.may_repeat(prepared))
        try:
            lists = [
                self._build(build_source(self._planner, name, number, body)) for number, body in enumerate(prepared)
            ]
        except Unplannable:
            raise NotIncremental from None
        view.list_derivations = lists[0] if len(lists) == 1 else lambda: [row for each in lists for row in each()]
        self.definitions[name] = Definition(view, tuple(prepared))
        return self._add_operator(view)

    def _definitions(self, pattern: str) -> Definitions:
        """Return the bodies of all patterns in the recursive component of a pattern.

        A body `p(a, m), p(m, b)` is rewritten to call a new view of the non-recursive bodies in place of one recursive
        call. Raise `NotIncremental` if a pattern needs inputs.
        """
        names = self._component_names(pattern)
        if len(names) < len(self.calls.component(pattern)):
            raise NotIncremental
        definitions: Definitions = {name: self._bodies.bodies_of(name) for name in names}
        if found := transitive_body(definitions):
            # The last call needs only the non-recursive bodies: the rows are the same, with fewer derivations each.
            (body, first, last), exits = found, f"{pattern}/exits"
            if exits not in self.operators:
                self._create_view(exits, [each for each in definitions[pattern] if each is not body])
            steps = ((CallAtom(exits, body.parameters),), (first, replace(last, pattern=exits)))
            return {pattern: [replace(body, goals=goals) for goals in steps]}
        return definitions

    def _create_component(self, definitions: Definitions) -> dict[str, RecursiveView]:
        """Create the operators and delta functions of a recursive component, and return its views by pattern."""
        component = frozenset(definitions)
        members = {name: self._add_operator(RecursiveView(name, self.store, component)) for name in definitions}
        self._under_construction |= component
        each = [(name, number, body) for name in members for number, body in enumerate(definitions[name])]
        prepared = [(name, number, self._prepare_body(name, number, body)) for name, number, body in each]
        for name, member in members.items():
            self.definitions[name] = Definition(member, tuple(body for of, _, body in prepared if of == name))
        self._under_construction -= component
        try:
            for name, number, body in prepared:
                member = members[name]
                inside = [place for place in occurrences(body) if called_operator(place) in component]
                if not inside:
                    base = self._build(build_source(self._planner, name, number, body))
                    member.base_functions = (*member.base_functions, base)
                for place in inside:
                    target = members[called_operator(place) or ""]
                    delta = Delta(name, number, body, place, (), is_queued=True)
                    self.component_deltas.append(delta)
                    spread, retract = (delta_source(self._planner, delta, new) for new in (True, False))
                    target.spread_functions = (*target.spread_functions, self._build(spread))
                    target.retract_functions = (*target.retract_functions, self._build(retract))
            self._add_operator(
                RecursiveComponent(f"{next(iter(members))}/component", self.store, list(members.values()))
            )
            for name, number, body in prepared:  # last, so that they are planned for the present sizes
                derivable = self._build(derivable_source(self._planner, name, number, body))
                members[name].derivability_tests = (*members[name].derivability_tests, derivable)
        except Unplannable:
            raise NotIncremental from None
        return members

    def _component_names(self, pattern: str) -> list[str]:
        """Return the patterns of the recursive component, or the pattern alone, without patterns that need inputs."""
        component = self.calls.component(pattern) or {pattern}
        names = [name for name in self.library.names() if name in component] or [pattern]
        return [name for name in names if not self.library.inputs(name)]

    def _prepare_body(self, name: str, number: int, body: Conjunction) -> Conjunction:
        """Return a body rewritten to read only the model and operators of the network; create missing operators."""
        if len(body.goals) > VIEWS.most_goals:
            raise NotIncremental
        body = self._split_unconnected(body, f"{name}/{number}/apart")
        return self._use_value_views(replace(body, goals=tuple(self._prepare_goals(body, f"{name}/{number}"))))

    def _use_value_views(self, body: Conjunction) -> Conjunction:
        """Return the body in which joins by attribute value call views of objects and values; create missing views."""
        attributes = value_join_attributes(self.store, self._planner, body)
        for goal in body.goals:
            held = attribute_and_variables(goal)
            if held and held[0].index in attributes:
                name = values_of(held[0])
                if name not in self.operators:
                    self._create_view(name, [value_view_body(goal)])
        return call_value_views(body, attributes) if attributes else body

    def _split_unconnected(self, body: Conjunction, name_prefix: str) -> Conjunction:
        """Return the body with each group of connected goals that mentions no parameter replaced by a call of a view.

        Only the existence of a solution of such a group matters; its solutions would multiply the derivations of each
        match.
        """
        fixed = frozenset(number for number, _ in body.constants)
        pending = [goal for goal in body.goals if not fixed.issuperset(visible_variables(goal))]
        kept = [goal for goal in body.goals if fixed.issuperset(visible_variables(goal))]
        groups: list[list[Goal]] = []
        while pending:
            start = next(v for v in visible_variables(pending[0]) if v not in fixed)
            group = connected_goals(pending, [start], fixed)
            pending = [goal for goal in pending if not any(goal is other for other in group)]
            groups.append(group)
        found: list[Goal] = list(kept)
        for number, group in enumerate(groups):
            named = {v for goal in group for v in visible_variables(goal)}
            open_ = any(isinstance(goal, CallAtom) and goal.pattern in self._under_construction for goal in group)
            if len(groups) + len(kept) == 1 or not named.isdisjoint(body.parameters) or open_:
                found.extend(group)
                continue
            alone = replace(body, parameters=(), goals=tuple(group))
            found.append(CallAtom(self._create_view(f"{name_prefix}/{number}", [alone]).name, ()))
        return replace(body, goals=tuple(found))

    def _prepare_goals(self, body: Conjunction, name_prefix: str) -> list[Goal]:
        """Return the goals rewritten to read operators; create missing operators, first those that restrict others."""

        def turn(number: int) -> int:
            """Return the priority of a goal; goals with lower numbers are prepared earlier."""
            goal = pending[number]
            if isinstance(goal, CallAtom) and not self._is_product(goal.pattern):
                return 0 if self._is_readable(goal) or self._restricted_positions(body, goal) else 1
            return 2 if isinstance(goal, ClosureAtom) else 3 if isinstance(goal, CallAtom) else 4

        pending = dict(enumerate(body.goals))
        while pending:
            number = min(pending, key=turn)
            goal, place = pending.pop(number), f"{name_prefix}/{number}"
            match goal:
                case CallAtom(pattern) if pattern not in self._under_construction:
                    goal = self._prepare_call(body, goal, place)
                case ClosureAtom() if not self._is_readable(goal):
                    goal = self._prepare_closure(body, goal, place)
                case AbsenceAtom():
                    goal = self._prepare_negation(body, goal, place)
                case AggregateAtom():
                    goal = self._prepare_aggregate(body, goal, place)
            body = replace(body, goals=(*body.goals[:number], goal, *body.goals[number + 1 :]))
        return list(body.goals)

    def _is_readable(self, goal: RelationAtom) -> bool:
        """Return True if a body may read a relation unrestricted: it is not recursive, or its operator exists."""
        if isinstance(goal, CallAtom):
            return goal.pattern in self.operators or not self.calls.is_recursive(goal.pattern)
        return not isinstance(goal, ClosureAtom) or isinstance(self.operators.get(goal.step), ClosureOperator)

    def _restricting_goals(self, body: Conjunction, heads: Iterable[int]) -> list[Goal]:
        """Return the goals that restrict the variables `heads`: relations connected with them, and tests."""
        fixed = frozenset(dict(body.constants))
        near = connected_goals(
            [each for each in self._connecting_relations(body.goals) if self._is_readable(each)], heads, fixed
        )
        known = fixed.union(*map(visible_variables, near))
        tests = [each for each in body.goals if isinstance(each, UnequalAtom | ConditionAtom | ValuationAtom)]
        return [*near, *(each for each in tests if near and known.issuperset(visible_variables(each)))]

    def _restricted_positions(self, body: Conjunction, goal: CallAtom) -> tuple[int, ...]:
        """Return the argument positions of a call that have a constant, or that the rest of the body restricts."""
        fixed = dict(body.constants)
        return tuple(p for p, v in enumerate(goal.arguments) if v in fixed or self._restricting_goals(body, [v]))

    def _prepare_call(
        self, body: Conjunction, goal: CallAtom, name_prefix: str, inner_variables: Container[int] = ()
    ) -> CallAtom:
        """Return a call of the pattern's view or, if that may be large, of a view of only the rows that the body needs.

        `not { y -next-> z : N; }` is a pattern over `x` and `y` if `z` must differ from an outer `x`: a product of all
        `x` with all `y`. Its view holds only the `x` and `y` that other goals of the body allow, without columns for
        `inner_variables` variables. The view of a recursive pattern holds only rows with the values allowed at one
        position.
        """
        definitions: Definitions = {}
        places = self._restricted_positions(body, goal)
        choices: list[tuple[int, ...]] = [(p,) for p in places]
        if not self._is_readable(goal):
            definitions = self._definitions(goal.pattern)
        elif places and self._is_product(goal.pattern):
            kept = [p for p, v in enumerate(goal.arguments) if v not in inner_variables or p in places]
            goal = replace(goal, arguments=tuple(goal.arguments[p] for p in kept))
            bodies: list[Conjunction] = []
            for number, inner in enumerate(self._bodies.bodies_of(goal.pattern)):
                inner = replace(inner, parameters=tuple(inner.parameters[p] for p in kept))
                bodies += self._with_first_values(inner, f"{name_prefix}/{number}")
            definitions, choices = {goal.pattern: bodies}, [tuple(map(kept.index, places))]
        found: dict[MaterializedView, RestrictedDefinitions] = {}
        for positions in choices if definitions else ():
            name, heads = f"{name_prefix}/{positions[0]}", tuple(goal.arguments[p] for p in positions)
            wanted = restrict_unchanged(definitions, positions, name) or restrict_changed(
                definitions, positions[0], name
            )
            if wanted:
                near = tuple(self._restricting_goals(body, heads))
                found[self._create_view(f"{name}/asked", [replace(body, parameters=heads, goals=near)])] = wanted
        if not found:
            self._readable_view(goal.pattern)
            return goal
        asked = min(found, key=MaterializedView.size)
        self._discard(*(other.name for other in found if other is not asked))
        members, views = found[asked]
        if members:
            self._create_component(members)
        for name, rows in views.items():
            self._create_view(name, rows)
        return replace(goal, pattern=asked.name.removesuffix("asked") + goal.pattern)

    def _with_first_values(self, body: Conjunction, name_prefix: str) -> list[Conjunction]:
        """Return bodies with the same rows as a body that read only a few values of one variable; else only the body.

        The variable occurs in other goals only in comparisons by `!=` with `n` other variables. These exclude at most
        `n` of its values, so the first `n + 1` values of each group suffice.
        """
        fixed = frozenset(dict(body.constants))
        unequal = [each for each in body.goals if isinstance(each, UnequalAtom)]
        rest = [each for each in body.goals if each not in unequal]
        for z in (v for each in unequal for v in visible_variables(each) if v not in fixed.union(body.parameters)):
            goals = connected_goals(rest, [z], fixed)
            own = {z}.union(*map(visible_variables, goals))
            goals += (each for each in unequal if own.issuperset(visible_variables(each)))
            others = [each for each in body.goals if each not in goals]
            apart = [each for each in others if not own.isdisjoint(visible_variables(each))]
            keys = tuple(v for v in dict.fromkeys(body.parameters) if v in own)
            inner = replace(body, parameters=(*keys, z), goals=tuple(goals))
            if apart and all(z in visible_variables(each) for each in apart) and self._is_connected(inner):
                break
        else:
            return [body]
        view = self._create_view(f"{name_prefix}/all", [inner])
        last, group = len(body.types), tuple(range(len(keys)))
        rows = [self._add_operator(NthRow(f"{name_prefix}/{n}", view, group, n)) for n in range(len(apart) + 1)]
        calls = (CallAtom(each.name, (*keys, last)) for each in rows)
        values = (AggregateAtom("min", each, frozenset([last]), z) for each in calls)
        body = replace(body, types=(*body.types, body.types[z]))
        return [replace(body, goals=(each, *others)) for each in values]

    def _is_product(self, pattern: str) -> bool:
        """Return True if relations do not connect all parameters of some body. False for recursive patterns and
        views.
        """
        if pattern in self.operators or self.calls.is_recursive(pattern):
            return False
        if pattern not in self._is_product_cache:
            self._is_product_cache[pattern] = not all(map(self._is_connected, self._bodies.bodies_of(pattern)))
        return self._is_product_cache[pattern]

    def _is_connected(self, body: Conjunction) -> bool:
        """Return True if relations connect all parameters of a body that have no constant value with each other."""
        fixed, heads = frozenset(dict(body.constants)), body.parameters
        linked = connected_goals(self._connecting_relations(body.goals), heads[:1], fixed)
        return fixed.union(*map(visible_variables, linked)).issuperset(heads)

    def _connecting_relations(self, goals: Iterable[Goal]) -> list[RelationAtom]:
        """Return the relations among goals, without calls of products (see `_is_product`) or of unfinished patterns."""
        calls = {each.pattern for each in goals if isinstance(each, CallAtom)}
        apart = {name for name in calls if name in self._under_construction or self._is_product(name)}
        return [g for g in goals if is_relation(g) and not (isinstance(g, CallAtom) and g.pattern in apart)]

    def _readable_view(self, pattern: str) -> RowOperator:
        """Return the operator of a pattern, created if missing; raise `NotIncremental` if unfinished or with inputs."""
        if pattern in self._under_construction:
            raise NotIncremental
        known = self.operators.get(pattern)
        if isinstance(known, RowOperator):
            return known
        if self.library.inputs(pattern):
            raise NotIncremental
        return self.view(pattern)

    def _prepare_negation(self, body: Conjunction, goal: AbsenceAtom, name_prefix: str) -> Goal:
        """Return a negation that tests one relation, created if necessary; raise `NotIncremental` if impossible."""
        if isinstance(call := negated(goal), CallAtom):
            if call.pattern not in self.operators and self._planner.is_large_ordering(
                self._bodies.bodies_of(call.pattern)
            ):
                raise NotIncremental
            goal = replace(goal, alternatives=((self._prepare_call(body, call, name_prefix, local_variables(goal)),),))
        relation, local = negated(goal), set(local_variables(goal))
        if isinstance(relation, ClosureAtom):
            if local:
                raise NotIncremental
            closure = self._prepare_closure(body, relation, name_prefix)
            return replace(goal, alternatives=((closure,),))
        whole = {v for v in relation_variables(relation) if v not in local}
        direct = not local if isinstance(relation, InstanceAtom | CallAtom) else bool(whole)
        if held := attribute_and_variables(relation):
            direct = held[1] not in local
        if direct:
            return goal
        outer = tuple(v for v in goal.outer if v not in dict(body.constants))
        projected = self._create_view(name_prefix, [replace(body, parameters=outer, goals=(relation,))])
        return replace(goal, alternatives=((CallAtom(projected.name, outer),),), outer=outer)

    def _prepare_aggregate(self, body: Conjunction, goal: AggregateAtom, name_prefix: str) -> Goal:
        """Return an aggregate that reads its value from an operator, created if necessary, or a count of links.

        Raise `NotIncremental` if the operator cannot be updated by changes, or may have very many rows.
        """
        relation = goal.relation
        local = set(local_variables(goal))
        called = relation_variables(relation)
        if (
            isinstance(relation, LinkAtom)
            and goal.function == "count"
            and len([v for v in called if v in local]) == 1
            and (isinstance(relation.reference, Reference) or relation.target in local)
        ):
            return goal
        if isinstance(relation, CallAtom) and isinstance(self.operators.get(relation.pattern), AggregateOperator):
            return goal
        if isinstance(relation, ClosureAtom):
            raise NotIncremental
        reached = single_closure_of(relation, self._bodies)
        if reached is not None and goal.function == "count" and len(local) == 1 and len(set(called)) == 2:
            return self._prepare_reach_count(body, goal, reached, name_prefix)
        if isinstance(relation, CallAtom):
            if relation.pattern not in self.operators and self._planner.is_large_ordering(
                self._bodies.bodies_of(relation.pattern)
            ):
                raise NotIncremental
            relation = self._prepare_call(body, relation, name_prefix)
        columns = tuple(dict.fromkeys(called))
        if isinstance(relation, CallAtom) and columns == called and dict(body.constants).keys().isdisjoint(called):
            source = self._readable_view(relation.pattern)
        else:
            source = self._create_view(f"{name_prefix}/of", [replace(body, parameters=columns, goals=(relation,))])
        group = tuple(dict.fromkeys(v for v in called if v not in local))
        positions = tuple(columns.index(v) for v in group)
        column = None if goal.column is None else columns.index(goal.column)
        fold = AggregateOperator(f"{name_prefix}/{goal.function}", source, positions, goal.function, column)
        self._add_operator(fold)
        return replace(goal, relation=CallAtom(fold.name, columns))

    def _prepare_reach_count(
        self, body: Conjunction, goal: AggregateAtom, reached: ClosureAtom, name_prefix: str
    ) -> Goal:
        """Return a count that reads the sizes of a new closure, whose starts are restricted by the rest of the body."""
        forward = reached.target in goal.local
        closure = self._prepare_closure(body, reached, name_prefix, forward)
        assert isinstance(closure, ClosureAtom)
        source = self.operators[closure.step]
        assert isinstance(source, ClosureOperator)
        fold = AggregateOperator(f"{name_prefix}/count", source, (0 if forward else 1,), "count", None)
        self._add_operator(fold)
        ends = (reached.source, reached.target)
        return replace(goal, relation=CallAtom(fold.name, ends))

    # --- closures

    def _prepare_closure(
        self, body: Conjunction, goal: ClosureAtom, name_prefix: str, direction: bool | None = None
    ) -> ClosureAtom | CallAtom:
        """Return a call of a new closure from the starts that the rest of the body allows, or of a view of cycle nodes.

        Args:
            body, goal: the body, and its closure.
            name_prefix: the name prefix of new operators.
            direction: True to start at the sources, False at the targets, None for the direction with fewer starts.
        """
        if single_link_of(self._bodies.bodies_of(goal.step)) is None:
            self._readable_view(goal.step)
        if goal.source == goal.target and goal.closure is Closure.PLUS:
            name = f"{goal.step}/circles"  # shared by all calls, so without restriction
            if name not in self.operators:
                self._add_operator(CycleOperator(name, self.store, self._steps(name, goal.step, True)))
            return CallAtom(name, (goal.source,))
        reflexive = goal.closure is Closure.STAR
        types = self.library.parameter_types(goal.step)
        both = not reflexive or types[0] == types[1]
        possible = (True, False) if direction is None else (direction,)
        options = [self._create_starts(body, goal, forward, name_prefix) for forward in possible if forward or both]
        asked = [option for option in options if option is not None]
        if not asked:
            raise NotIncremental
        forward, starts = min(asked, key=lambda option: option[1].size())
        self._discard(*(other.name for _, other in asked if other is not starts))
        name = f"{name_prefix}/{goal.closure}"
        steps = self._steps(name, goal.step, forward)
        self._add_operator(ClosureOperator(name, self.store, starts, steps, forward, reflexive))
        return replace(goal, step=name)

    def _steps(self, name: str, step: str, forward: bool) -> EdgeTables:
        """Return the edges that a closure operator follows, and set in `edges` the relation that they come from."""
        link = single_link_of(self._bodies.bodies_of(step))
        self.edges[name] = (("link", link[0]), link[1]) if link else (("rows", step), False)
        if link:
            sides = (self.store.forward[link[0]], self.store.backward[link[0]])
            return EdgeTables(*(sides if forward == (not link[1]) else sides[::-1]))
        rows, near = self._readable_view(step), 0 if forward else 1
        return EdgeTables(rows.group((near,), 1 - near).table, rows.group((1 - near,), near).table)

    def _discard(self, *names: str) -> None:
        """Remove operators by name, with their definitions."""
        for name in names:
            del self.operators[name]
            self.definitions.pop(name, None)

    def _create_starts(
        self, body: Conjunction, goal: ClosureAtom, forward: bool, name_prefix: str
    ) -> tuple[bool, MaterializedView] | None:
        """Create the view of allowed starts of a closure; return the direction and the view, or None without deltas."""
        way = 1 if forward else -1
        start = goal.source if forward else goal.target
        others = tuple(each for each in body.goals if not isinstance(each, ClosureAtom))
        goals = self._restricting_goals(replace(body, goals=others), [start])
        types, (near, far) = body.types, self.library.parameter_types(goal.step)[::way]
        if goal.closure is Closure.STAR and isinstance(near, ObjectType):
            goals.append(InstanceAtom(near.cls, start))
        if not goals and start not in dict(body.constants):
            link, ends = single_link_of(self._bodies.bodies_of(goal.step)), (start, len(types))[::way]
            goals, types = [CallAtom(goal.step, ends)], (*types, far)
            if link:
                goals = [LinkAtom(self.library.metamodel.references[link[0]], *ends[:: -1 if link[1] else 1])]
        try:
            name = f"{name_prefix}/{'from' if forward else 'to'}"
            starts = replace(body, types=types, parameters=(start,), goals=tuple(goals))
            return forward, self._create_view(name, [starts])
        except NotIncremental:
            return None

    # --- dependencies between operators

    def read_operators(self) -> set[str]:
        """Return the names of the operators that other operators read, and of all recursive views."""
        found = {name for name, operator in self.operators.items() if isinstance(operator, RecursiveView)}
        for name in self.operators:
            found.update(self.inputs_of(name))
        return found

    def inputs_of(self, name: str) -> Iterator[str]:
        """Yield the names of the operators that an operator reads."""
        operator = self.operators[name]
        if name in self.definitions:
            for body in self.definitions[name].bodies:
                for place in occurrences(body):
                    if isinstance(place.relation, CallAtom):
                        yield place.relation.pattern
                    if isinstance(place.relation, ClosureAtom):
                        yield place.relation.step
        if isinstance(operator, AggregateOperator):
            yield operator.source.name
        if isinstance(operator, ClosureOperator):
            yield operator.starts.name
        if name in self.edges:
            kind, edges = self.edges[name][0]
            if kind == "rows":
                yield str(edges)


def called_operator(place: RelationOccurrence) -> str | None:
    """Return the name of the operator that an occurrence calls; None if the occurrence is no call."""
    return place.relation.pattern if isinstance(place.relation, CallAtom) else None
