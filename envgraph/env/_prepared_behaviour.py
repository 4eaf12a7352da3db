"""Prepare a behaviour to run on one engine: resolve names, and prepare patterns and rules."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import Any

from envgraph.behaviour import (
    Action,
    Agent,
    Behaviour,
    Branch,
    Domain,
    EachStep,
    Effect,
    FeatureReader,
    HelperPattern,
    KeyIndex,
    Observation,
    ObserveAround,
    ObservedWindow,
    ObserveFind,
    ObserveObject,
    ObservePath,
    OnFind,
    OnRefused,
    RuleCall,
    bind_parameters,
    condition_helper,
    domain_type,
    expand_action,
    feature_reader,
    find_helper,
    is_lost,
    lost_object_error,
    path_root,
    read_variables,
)
from envgraph.env._observation_components import (
    KeyedObjects,
    component_reader,
    component_size,
    number_index,
    object_indexer,
    observed_range,
    path_target_reader,
    path_type,
    value_indexer,
)
from envgraph.env._prepared_clauses import (
    MAX_REWARD,
    NameClasses,
    NameValues,
    ObservationComponent,
    Owner,
    PreparedAction,
    PreparedBranches,
    PreparedCall,
    PreparedEachStep,
    PreparedOnFind,
    PreparedOnRefused,
    Reward,
    merge_clauses,
)
from envgraph.env._random_choices import missing_probability
from envgraph.env._rule_calls import prepare_call
from envgraph.errors import LARGEST_INT, EvaluationError, Span
from envgraph.graph import Model
from envgraph.match import Row
from envgraph.metamodel import EnumType, Scalar, Value
from envgraph.pattern import (
    Expression,
    Navigation,
    Negation,
    ObjectType,
    PatternCall,
    Variable,
    evaluate,
    explain_error,
    variables_in,
)
from envgraph.rewrite import Engine

NO_OWNER: Owner = "", lambda: 0

END_NUMBERS = {None: 0, "success": 1, "failure": 2, "truncation": -1}
"""The numbers of ends: positive if the episode is terminated, negative if it is truncated, 0 if it continues."""


class PreparedBehaviour:
    """A behaviour on one engine, prepared for one agent.

    Args:
        behaviour: a behaviour without errors.
        engine: an engine whose model is the initial state. Helper patterns are added to it.
        keys: the indices of objects over the family.
        agent: the agent's block, whose clauses are added to the shared ones, and the agent's object; None for a
            behaviour without agents.

    Raises:
        ResolutionError: a parameter cannot be bound to an object.

    Attributes:
        bound_values: the objects of the parameters and of the agent, by name.
        effects, components: the agent's prepared effects and observation components, in the order of the text.
        is_shared_effect, is_shared_component: for each of them, True if it stands outside of `agent` blocks.
        windows: the windows, each with a function that returns the matches of its `helpers`.
        effect_clauses: the `effects` as clauses of the behaviour, with the classes of the names in their scope.
        refusals: the refused calls of a step: by False those of the agent's actions and block, by True those of shared
            clauses. A refusal whose list is missing is an error.
    """

    def __init__(
        self,
        behaviour: Behaviour,
        engine: Engine,
        keys: KeyIndex,
        agent: tuple[Agent, int] | None = None,
    ) -> None:
        self.engine = engine
        self.model: Model = engine.model
        self._keys = keys
        self._name = behaviour.name
        self._read: FeatureReader = feature_reader(self.model)
        self._behaviour = behaviour
        self.calls_done: list[RuleCall] = []
        self.bound_values: dict[str, Value | None] = {}
        self.bound_values.update(bind_parameters(self.model, behaviour.parameters))
        shared = {parameter.name: parameter.type or "" for parameter in behaviour.parameters}
        own, block = shared, Agent("", "")
        if agent is not None:
            block, self.bound_values[agent[0].variable] = agent
            own = {**shared, block.variable: block.cls}
        self._objects: dict[str, KeyedObjects] = {}
        self.windows: list[tuple[ObservedWindow, Callable[[], list[Any]]]] = []
        effects = merge_clauses(block.effects, own, behaviour.effects, shared)
        handled = [types is shared for effect, types in effects if isinstance(effect, OnRefused)]
        self.refusals: dict[bool, list[RuleCall]] = {key: [] for key in ((False, True) if any(handled) else handled)}
        actions = merge_clauses(block.actions, own, behaviour.actions, shared)
        seen = merge_clauses(block.observations, own, behaviour.observations, shared)
        self.actions = [one for action, types in actions for one in self._prepare_actions(action, types, effects)]
        self.effects = [self._prepare_effect(effect, types, types is shared) for effect, types in effects]
        self.effect_clauses = effects
        self.is_shared_effect = [types is shared for _, types in effects]
        self.resets = [self._prepare_effect(reset.as_effect, shared, True) for reset in behaviour.resets]
        parts = [(part, types is shared) for clause, types in seen for part in self._prepare_components(clause, types)]
        self.components = [part for part, _ in parts]
        self.is_shared_component = [is_shared for _, is_shared in parts]

    # --- actions

    def _prepare_actions(
        self, action: Action, types: NameClasses, effects: Sequence[tuple[Effect, NameClasses]]
    ) -> Iterator[PreparedAction]:
        branches = self._prepare_branches(action.branches, self.refusals.get(False))
        types = {**types, **{name: domain.cls for name, domain in action.parameters if domain.cls}}
        reward, else_reward = (self._prepare_reward(one, types) for one in (action.reward, action.else_reward))
        before = sum(1 for effect, _ in effects if precedes_action(effect, action))
        takes = [self._value_getter(domain) for _, domain in action.parameters]
        for name, values in expand_action(action, self._keys, self.model.metamodel):
            named = tuple(
                (parameter, take(value))
                for (parameter, _), take, value in zip(action.parameters, takes, values, strict=True)
            )
            yield PreparedAction(name, named, branches, reward, else_reward, before)

    def _value_getter(self, domain: Domain) -> Callable[[Any], Callable[[], Value | None]]:
        """Return `f` such that `f(value)()` is the value, or for a domain of objects the object with this index.

        The object with an index can change when objects are created and deleted.
        """
        type_ = domain_type(domain, self.model.metamodel)
        return (
            partial(_object_getter, self._keyed_objects(type_.cls))
            if isinstance(type_, ObjectType)
            else lambda value: lambda: value
        )

    def _keyed_objects(self, cls: str) -> KeyedObjects:
        if cls not in self._objects:
            self._objects[cls] = KeyedObjects(self.model, self._keys, cls)
        return self._objects[cls]

    def _prepare_branches(self, branches: Sequence[Branch], refusals: list[RuleCall] | None) -> PreparedBranches:
        calls = tuple(self._prepare_call(branch.call, refusals) for branch in branches)
        return PreparedBranches(self._probability_function(branches), calls)

    def _probability_function(self, branches: Sequence[Branch]) -> Callable[[NameValues], Sequence[float]]:
        given = [branch.probability for branch in branches]
        fixed = [one for one in given if isinstance(one, int | float)]
        if len(fixed) == len(given):
            return lambda _: fixed

        def branch_probabilities(scope: NameValues) -> list[float]:
            found = [self._probability(one, scope) for one in given]
            if missing_probability(found) < -1e-9:
                span = branches[-1].probability_span or branches[-1].span
                added = f"{1.0 - missing_probability(found):.6g}"
                of = self._describe_objects([one for one in given if not isinstance(one, int | float)], scope)
                raise EvaluationError(f"the probabilities add up to {added}, which is above 1{of}", span)
            return found

        return branch_probabilities

    def _probability(self, given: float | Expression, scope: NameValues) -> float:
        if isinstance(given, int | float):
            return given
        try:
            value = _evaluate_number(given, scope, self._read, "a probability")
        except EvaluationError:
            if any(is_lost(self.model, scope[root.name], None) for root in read_variables(given)):
                return 0.0
            raise
        if not 0.0 <= value <= 1.0:
            message = f"{value:g} is not a probability from 0 to 1{self._describe_objects([given], scope)}"
            raise EvaluationError(message, given.span, "use an expression with a value from 0 to 1")
        return value

    def _describe_objects(self, given: Sequence[Expression], scope: NameValues) -> str:
        """Return a text such as ", where `x` is Tile t" with the objects that expressions read, for messages; or ""."""
        found = {root.name: scope[root.name] for one in given for root in read_variables(one)}
        reported = [
            f"`{name}` is {repr(self.model.node(node))[1:-1]}"
            for name, node in found.items()
            if isinstance(node, int) and not is_lost(self.model, node, None)
        ]
        return f", where {' and '.join(reported)}" if reported else ""

    def _prepare_call(self, call: RuleCall, refusals: list[RuleCall] | None) -> PreparedCall | None:
        if call.rule is None:
            return None
        pairs = list(zip(call.arguments, self.engine.signature(call.rule).parameters, strict=True))
        bound = [(argument, taken) for argument, taken in pairs if not taken.is_output]
        outputs = {
            taken.name: argument.name
            for argument, taken in pairs
            if taken.is_output and isinstance(argument, Variable) and not argument.is_anonymous
        }
        names = [taken.name for _, taken in bound]
        return PreparedCall(
            *prepare_call(self.engine, call.rule, names, tuple(outputs)),
            tuple(self._prepare_argument(argument, taken.type is Scalar.FLOAT) for argument, taken in bound),
            tuple(isinstance(taken.type, ObjectType) for _, taken in bound),
            tuple(outputs.values()),
            call,
            self.calls_done,
            refusals,
        )

    def _prepare_argument(self, argument: Expression, is_float: bool) -> Callable[[NameValues], Value | None]:
        if isinstance(argument, Variable):
            name = argument.name
            if not is_float:
                return lambda scope: scope[name]
        read = self._read

        def value(scope: NameValues) -> Value | None:
            try:
                found = evaluate(argument, scope, read)
            except EvaluationError as error:
                if any(is_lost(self.model, scope[root.name], None) for root in read_variables(argument)):
                    return None
                raise _no_value_error(error, "an argument", argument, scope, read) from None
            return float(found) if is_float and found is not None else found

        return value

    def _prepare_reward(self, reward: Expression | None, types: NameClasses) -> Reward | None:
        if reward is None:
            return None
        read = self._read
        if not any(True for _ in variables_in(reward)):
            fixed = _evaluate_number(reward, {}, read)
            return lambda _: fixed

        def value(scope: NameValues) -> float:
            try:
                return _evaluate_number(reward, scope, read)
            except EvaluationError as error:
                for root in read_variables(reward):
                    if is_lost(self.model, scope[root.name], types.get(root.name)):
                        raise self.deleted_object_error(root.name, types.get(root.name), "reward", root.span) from None
                raise error

        return value

    def deleted_object_error(self, name: str, cls: str | None, what: str, span: Span | None) -> EvaluationError:
        """Return the error of a clause that reads from a deleted object; it names the rule that deleted the object."""
        return lost_object_error(self.engine, self._behaviour, name, cls, what, span, self.calls_done)

    # --- effects

    def _prepare_effect(
        self, effect: Effect, types: NameClasses, is_shared: bool
    ) -> PreparedEachStep | PreparedOnFind | PreparedOnRefused:
        reward = self._prepare_reward(effect.reward, types)
        if isinstance(effect, OnRefused):
            return PreparedOnRefused(reward, END_NUMBERS[effect.end])
        apply = self._prepare_branches(effect.apply, self.refusals.get(is_shared)) if effect.apply else None
        if isinstance(effect, EachStep):
            return PreparedEachStep(reward, apply)
        question = self._add_condition(effect.condition, types)
        matches, holds = self._match_functions(question)
        if isinstance(effect.condition, Negation):
            matches, holds = self._negated_match_functions(question, types, matches, holds)
        end, weight = END_NUMBERS[effect.end], self._prepare_weight(effect.weight)
        return PreparedOnFind(matches, holds, question.free, reward, end, apply, weight)

    def _prepare_weight(self, given: Expression | None) -> Reward | None:
        if given is None:
            return None

        def weight(scope: NameValues) -> float:
            value = _evaluate_number(given, scope, self._read, "a weight")
            if value < 0.0:
                raise EvaluationError(f"{value:g} is not a weight", given.span, "use a number of at least 0")
            return value

        return weight

    def _add_condition(self, condition: PatternCall | Negation, types: NameClasses) -> HelperPattern:
        return self._add_pattern(lambda name: condition_helper(name, condition, types))

    def _add_pattern(self, make: Callable[[str], HelperPattern]) -> HelperPattern:
        return add_helper_pattern(self.engine, self._name, make)

    def _match_functions(self, question: HelperPattern) -> tuple[Callable[[], list[Row]], Callable[[Row], bool]]:
        name, count = question.pattern.qualified_name, len(question.bound)
        exists = self.engine.matcher.prepare(name, tuple(range(count + len(question.free))))
        types = self.engine.library.parameter_types(name)
        is_object = [isinstance(type_, ObjectType) for type_ in types[count:]]
        bound = tuple(self.bound_values[name] for name in question.bound)
        alive, find = self.model.graph.alive, self._owned_matches(question, NO_OWNER)

        def still_matches(row: Row) -> bool:
            nodes = [*bound, *(value for value, known in zip(row, is_object, strict=True) if known)]
            return all(alive(node) for node in nodes) and bool(exists(*bound, *row))  # type: ignore[arg-type]

        return lambda: sorted(row[count:] for row in find()), still_matches

    def _negated_match_functions(
        self,
        question: HelperPattern,
        types: NameClasses,
        matches: Callable[[], list[Row]],
        holds: Callable[[Row], bool],
    ) -> tuple[Callable[[], list[Row]], Callable[[Row], bool]]:
        """Return `matches` and `holds`, extended so that a negated condition also holds if an object was deleted."""
        bound = [(self.bound_values[name], types[name]) for name in question.bound]

        def is_object_lost() -> bool:
            return any(is_lost(self.model, node, cls) for node, cls in bound)

        return (
            lambda: matches() or ([()] if is_object_lost() else []),
            lambda row: holds(row) or is_object_lost(),
        )

    def obstacle_counter(self, end: int) -> Callable[[], int]:
        """Return a function that counts the matches which must vanish before an episode can have this end.

        The matches are those of `on neg find .. terminate` clauses.
        """
        questions = [
            self._match_reader(ObserveFind(effect.condition.relation, LARGEST_INT), types, NO_OWNER)
            for effect, types in self.effect_clauses
            if isinstance(effect, OnFind)
            and END_NUMBERS[effect.end] == end
            and isinstance(effect.condition, Negation)
            and isinstance(effect.condition.relation, PatternCall)
        ]
        return lambda: sum(count() for count in questions)

    # --- observations

    def _prepare_components(self, observation: Observation, types: NameClasses) -> Iterator[ObservationComponent]:
        if isinstance(observation, ObserveAround):
            yield from self._window_components(observation, types)
            return
        each, read, metamodel = observation.each, self._read, self.model.metamodel
        size = component_size(observation, types, self._keys, metamodel)
        names = types if each is None else {**types, each.name: each.type or ""}
        is_count = getattr(observation, "aggregate", None) == "count"
        is_range = not is_count and bool(observed_range(observation, types, metamodel))
        for owner in self._owners(observation, types):
            if isinstance(observation, ObserveFind):
                seen, shown = self._match_reader(observation, names, owner), owner[1] if each else None
            else:
                path, (index, padding) = observation.path, self._index_function(observation, types)
                seen = component_reader(path, owner, self.model, read, index, padding)
                owned = isinstance(path, Navigation) and not isinstance(observation, ObserveObject)
                target = path.object if owned else path  # type: ignore[union-attr]
                shown = path_target_reader(target, owner, read)
            if observation.visible is not None:
                seen = self._visible_reader(observation.visible, names, owner, seen, hidden=size - 1)
            yield ObservationComponent(size, seen, observation, shown, is_range, owner)

    def _match_reader(self, observation: ObserveFind, names: NameClasses, owner: Owner) -> Callable[[], int]:
        """Return a function that returns 1 if there is a match, or the index of the aggregate of all matches.

        It returns 0 if the owner is missing, or if an aggregate of no match has no value.
        """
        limits, value = observed_range(observation, names, self.model.metamodel), owner[1]
        index = number_index(*limits) if limits else None
        find = self._owned_matches(self._add_pattern(lambda name: find_helper(name, observation, names)), owner)

        def read() -> int:
            rows = find() if value() is not None else ()
            return index(rows[0][-1]) if rows and index else min(len(rows), 1)  # type: ignore[arg-type]

        return read

    def _owned_matches(self, question: HelperPattern, owner: Owner) -> Callable[[], Sequence[Row]]:
        """Return a function that finds the matches of a condition for an owner; none if a bound object is deleted."""
        find = self.engine.matcher.prepare(question.pattern.qualified_name, tuple(range(len(question.bound))))
        name, value = owner

        def matches() -> Sequence[Row]:
            nodes: list[Any] = [value() if one == name else self.bound_values[one] for one in question.bound]
            return [*find(*nodes)] if all(map(self.model.graph.alive, nodes)) else ()

        return matches

    def _window_components(self, observation: ObserveAround, types: NameClasses) -> Iterator[ObservationComponent]:
        window = ObservedWindow(observation, self._behaviour.draw, types, self.model.metamodel)
        finders = [self._match_functions(self._add_pattern(make))[0] for make in window.helpers]

        def rows() -> list[Any]:
            return sorted(row for find in finders for row in find())

        numbers = lru_cache(maxsize=1)(lambda _: {place: number for place, number, _ in rows()})
        self.windows.append((window, rows))
        for place, size in enumerate(window.sizes):
            read = partial(lambda place: numbers(self.model.graph.store.revision).get(place, 0), place)
            yield ObservationComponent(size, read, observation, words=window.words[place % 2])

    def _visible_reader(
        self, call: PatternCall, names: NameClasses, owner: Owner, seen: Callable[[], int], hidden: int
    ) -> Callable[[], int]:
        """Return a function that reads a component if its visibility condition holds, and otherwise returns `hidden`.

        If the observed object is missing, the condition is not evaluated, and the component is read.
        """
        find, value = self._owned_matches(self._add_condition(call, names), owner), owner[1]
        return lambda: seen() if value() is None or find() else hidden

    def _owners(self, observation: ObservePath | ObserveFind, types: NameClasses) -> Iterator[Owner]:
        """Yield the owner of each component of a clause: an object of `for`, or the one at which the path begins."""
        each = observation.each
        if each is not None:
            objects = self._keyed_objects(each.type or "")
            yield from ((each.name, _object_getter(objects, i)) for i in range(len(objects.keys)))
        elif isinstance(observation, ObserveFind):
            yield NO_OWNER
        else:
            name = path_root(observation.path).name
            node, cls = self.bound_values[name], types[name]
            yield name, lambda: None if is_lost(self.model, node, cls) else node

    def _index_function(
        self, observation: ObservePath, types: NameClasses
    ) -> tuple[Callable[[Value | None], int], int]:
        """Return a function from the value of a path to its index, and the index if the owner is missing."""
        metamodel = self.model.metamodel
        type_ = path_type(observation, types, metamodel)
        match observation:
            case ObserveObject(among=among, or_none=or_none):
                indexer = self._keys.indexer(self.model, among)
                missing = self._keys.size(among) if or_none else None
                assert isinstance(type_, ObjectType), "the behaviour was checked"
                index = object_indexer(self.model, indexer, missing, among, type_.cls)
                return index, missing or 0
        limits = observed_range(observation, types, metamodel)
        if limits is not None:
            return value_indexer(number_index(*limits)), 0
        return value_indexer((type_.literals if isinstance(type_, EnumType) else (False, True)).index), 0


def add_helper_pattern(engine: Engine, behaviour: str, make_question: Callable[[str], HelperPattern]) -> HelperPattern:
    """Return the question `make(name)` for the first free name `behaviour#N`, and add its pattern to the engine.

    If an equal pattern is already there under such a name, return the question for this name, and add nothing.
    """
    library = engine.library
    known = set(library.names())
    number = 0
    while True:
        question = make_question(f"{behaviour}#{number}")
        name = question.pattern.qualified_name
        if name not in known:
            engine.add(question.pattern)
            return question
        if library.get(name) == question.pattern:
            return question
        number += 1


def _object_getter(objects: KeyedObjects, position: int) -> Callable[[], Value | None]:
    return lambda: objects.get(position)


def _evaluate_number(expression: Expression, scope: NameValues, read: FeatureReader, what: str = "a reward") -> float:
    try:
        value = evaluate(expression, scope, read)
    except EvaluationError as error:
        raise _no_value_error(error, what, expression, scope, read) from None
    if value is None:
        hint = "check the paths in the expression: one has no value in this state"
        raise EvaluationError(f"{what} has no value", expression.span, hint)
    number = float(value)
    if abs(number) > MAX_REWARD:
        message = f"{what} is {number}, but must be from {-MAX_REWARD:g} to {MAX_REWARD:g}"
        raise EvaluationError(message, expression.span, "use smaller numbers: sums of such numbers overflow")
    return number


def _no_value_error(
    error: EvaluationError, what: str, expression: Expression, scope: NameValues, read: FeatureReader
) -> EvaluationError:
    found = explain_error(error, expression, scope, read, None, "write `{} ? .. : ..` around it")
    return EvaluationError(f"{what} has no value: {found.message}", found.span, found.hint)


def precedes_action(effect: Effect, action: Action) -> bool:
    if effect.span is None or action.span is None or effect.span.source is not action.span.source:
        return False
    return effect.span.start < action.span.start
