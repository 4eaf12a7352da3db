"""Prepare a behaviour to run on one engine: resolve names, and prepare patterns and rules."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from envgraph.behaviour import (
    Action,
    Agent,
    Behaviour,
    Branch,
    Domain,
    EachStep,
    Effect,
    KeyIndex,
    Observation,
    ObserveFind,
    ObserveObject,
    ObservePath,
    ObserveRange,
    OnFind,
    Question,
    Reader,
    RuleCall,
    bind_parameters,
    condition_question,
    count_question,
    domain_type,
    expanded,
    is_gone,
    lost,
    reader,
    root_of,
    roots,
)
from envgraph.env._observing import (
    KeyedObjects,
    leading_to,
    literal_index,
    object_index,
    observer,
    path_type,
    range_index,
    size_of,
)
from envgraph.env._prepared import (
    Alternatives,
    Component,
    PreparedAction,
    PreparedCall,
    PreparedClause,
    PreparedEach,
    Reward,
    Scope,
    Types,
    together,
)
from envgraph.env._rulebook import applying
from envgraph.env._sampling import lacking
from envgraph.env._tabular import MOST_REWARD
from envgraph.errors import EvaluationError, Span
from envgraph.graph import Model
from envgraph.match import Row
from envgraph.metamodel import EnumType, Scalar, Value
from envgraph.pattern import (
    Expression,
    Navigation,
    Negation,
    ObjectType,
    Parameter,
    PatternCall,
    Variable,
    evaluate,
    explained,
    variables_in,
)
from envgraph.rewrite import Engine

ENDS = {None: 0, "success": 1, "failure": 2, "truncation": -1}
"""The numbers of ends: positive if the episode is terminated, negative if it is truncated, 0 if it continues."""


def worst(one: int, other: int) -> int:
    """Return the end that takes precedence: failure before success before truncation before no end."""
    return max(one, other) or min(one, other)


class Program:
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
        bound: the objects of the parameters and of the agent, by name.
        effects, components: the agent's prepared effects and observation components, in the order of the text.
        shared, shared_components: for each of them, True if it stands outside of `agent` blocks.
        asked: the `effects` as clauses of the behaviour, with the classes of the names in their scope.
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
        self._read: Reader = reader(self.model)
        self._behaviour = behaviour
        self.done: list[RuleCall] = []
        self.bound: dict[str, Value | None] = {}
        self.bound.update(bind_parameters(self.model, behaviour.parameters))
        shared = {parameter.name: parameter.type or "" for parameter in behaviour.parameters}
        own, block = shared, Agent("", "")
        if agent is not None:
            block, self.bound[agent[0].variable] = agent
            own = {**shared, block.variable: block.cls}
        self._objects: dict[str, KeyedObjects] = {}
        effects = together(block.effects, own, behaviour.effects, shared)
        actions = together(block.actions, own, behaviour.actions, shared)
        seen = together(block.observations, own, behaviour.observations, shared)
        self.actions = [one for action, types in actions for one in self._actions(action, types, effects)]
        self.effects = [self._effect(effect, types) for effect, types in effects]
        self.asked = effects
        self.shared = [types is shared for _, types in effects]
        self.resets = [self._effect(reset.effect, shared) for reset in behaviour.resets]
        parts = [
            (part, types is shared) for clause, types in seen for part in self._components(clause, types)
        ]
        self.components = [part for part, _ in parts]
        self.shared_components = [is_shared for _, is_shared in parts]

    # --- actions

    def _actions(
        self, action: Action, types: Types, effects: Sequence[tuple[Effect, Types]]
    ) -> Iterator[PreparedAction]:
        branches = self._alternatives(action.branches)
        types = {**types, **{name: domain.cls for name, domain in action.parameters if domain.cls}}
        reward, else_reward = self._reward(action.reward, types), self._reward(action.else_reward, types)
        before = sum(1 for effect, _ in effects if stands_before(effect, action))
        takes = [self._taking(domain) for _, domain in action.parameters]
        for name, values in expanded(action, self._keys, self.model.metamodel):
            named = tuple(
                (parameter, take(value))
                for (parameter, _), take, value in zip(action.parameters, takes, values, strict=True)
            )
            yield PreparedAction(name, named, branches, reward, else_reward, before)

    def _taking(self, domain: Domain) -> Callable[[Any], Callable[[], Value | None]]:
        """Return `f` such that `f(value)()` is the value, or for a domain of objects the object with this index.

        The object with an index can change when objects are created and deleted.
        """
        type_ = domain_type(domain, self.model.metamodel)
        return partial(_item, self._keyed(type_.cls)) if isinstance(type_, ObjectType) else _constant

    def _keyed(self, cls: str) -> KeyedObjects:
        if cls not in self._objects:
            self._objects[cls] = KeyedObjects(self.model, self._keys, cls)
        return self._objects[cls]

    def _alternatives(self, branches: Sequence[Branch]) -> Alternatives:
        return Alternatives(self._chances(branches), tuple(self._call(branch.call) for branch in branches))

    def _chances(self, branches: Sequence[Branch]) -> Callable[[Scope], Sequence[float]]:
        given = [branch.probability for branch in branches]
        fixed = [one for one in given if isinstance(one, int | float)]
        if len(fixed) == len(given):
            return lambda _: fixed

        def chances(scope: Scope) -> list[float]:
            found = [self._chance(one, scope) for one in given]
            if lacking(found) < -1e-9:
                span = branches[-1].probability_span or branches[-1].span
                added = f"{1.0 - lacking(found):.6g}"
                of = self._of([one for one in given if not isinstance(one, int | float)], scope)
                raise EvaluationError(f"the probabilities add up to {added}, which is above 1{of}", span)
            return found

        return chances

    def _chance(self, given: float | Expression, scope: Scope) -> float:
        if isinstance(given, int | float):
            return given
        try:
            value = _number(given, scope, self._read, "a probability")
        except EvaluationError:
            if any(is_gone(self.model, scope[root.name], None) for root in roots(given)):
                return 0.0
            raise
        if not 0.0 <= value <= 1.0:
            message = f"{value:g} is not a probability from 0 to 1{self._of([given], scope)}"
            raise EvaluationError(message, given.span, "use an expression with a value from 0 to 1")
        return value

    def _of(self, given: Sequence[Expression], scope: Scope) -> str:
        """Return a text such as ", where `x` is Tile t" with the objects that expressions read, for messages; or ""."""
        found = {root.name: scope[root.name] for one in given for root in roots(one)}
        told = [
            f"`{name}` is {repr(self.model.node(node))[1:-1]}"
            for name, node in found.items()
            if isinstance(node, int) and not is_gone(self.model, node, None)
        ]
        return f", where {' and '.join(told)}" if told else ""

    def _call(self, call: RuleCall) -> PreparedCall | None:
        if call.rule is None:
            return None
        pairs = list(zip(call.arguments, self.engine.signature(call.rule).parameters, strict=True))
        bound = [(argument, taken) for argument, taken in pairs if not taken.output]
        outputs = {
            taken.name: argument.name
            for argument, taken in pairs
            if taken.output and isinstance(argument, Variable) and not argument.anonymous
        }
        names = [taken.name for _, taken in bound]
        return PreparedCall(
            *applying(self.engine, call.rule, names, tuple(outputs)),
            tuple(self._argument(argument, taken.type is Scalar.FLOAT) for argument, taken in bound),
            tuple(isinstance(taken.type, ObjectType) for _, taken in bound),
            tuple(outputs.values()),
            call,
            self.done,
        )

    def _argument(self, argument: Expression, is_float: bool) -> Callable[[Scope], Value | None]:
        if isinstance(argument, Variable):
            name = argument.name
            if not is_float:
                return lambda scope: scope[name]
        read = self._read

        def value(scope: Scope) -> Value | None:
            try:
                found = evaluate(argument, scope, read)
            except EvaluationError as error:
                if any(is_gone(self.model, scope[root.name], None) for root in roots(argument)):
                    return None
                raise _unvalued(error, "an argument", argument, scope, read) from None
            return float(found) if is_float and found is not None else found

        return value

    def _reward(self, reward: Expression | None, types: Types) -> Reward | None:
        if reward is None:
            return None
        read = self._read
        if not any(True for _ in variables_in(reward)):
            return _fixed(_number(reward, {}, read))

        def value(scope: Scope) -> float:
            try:
                return _number(reward, scope, read)
            except EvaluationError as error:
                for root in roots(reward):
                    if is_gone(self.model, scope[root.name], types.get(root.name)):
                        raise self.lost(root.name, types.get(root.name), "reward", root.span) from None
                raise error

        return value

    def lost(self, name: str, cls: str | None, what: str, span: Span | None) -> EvaluationError:
        """Return the error of a clause that reads from a deleted object; it names the rule that deleted the object."""
        return lost(self.engine, self._behaviour, name, cls, what, span, self.done)

    # --- effects

    def _effect(self, effect: Effect, types: Types) -> PreparedEach | PreparedClause:
        if isinstance(effect, EachStep):
            apply = self._alternatives(effect.apply) if effect.apply else None
            return PreparedEach(self._reward(effect.reward, types), apply)
        question = self._ask(effect.condition, types)
        matches, holds = self._matches(question)
        if isinstance(effect.condition, Negation):
            matches, holds = self._without(question, types, matches, holds)
        return PreparedClause(
            matches,
            holds,
            question.free,
            self._reward(effect.reward, types),
            ENDS[effect.end],
            self._alternatives(effect.apply) if effect.apply else None,
            self._weight(effect.weight),
        )

    def _weight(self, given: Expression | None) -> Reward | None:
        if given is None:
            return None

        def weight(scope: Scope) -> float:
            value = _number(given, scope, self._read, "a weight")
            if value < 0.0:
                raise EvaluationError(f"{value:g} is not a weight", given.span, "use a number of at least 0")
            return value

        return weight

    def _ask(self, condition: PatternCall | Negation, types: Types) -> Question:
        return self._added(lambda name: condition_question(name, condition, types))

    def _added(self, make: Callable[[str], Question]) -> Question:
        return added(self.engine, self._name, make)

    def _matches(self, question: Question) -> tuple[Callable[[], list[Row]], Callable[[Row], bool]]:
        name, count = question.pattern.qualified_name, len(question.bound)
        find = self.engine.matcher.prepare(name, tuple(range(count)))
        exists = self.engine.matcher.prepare(name, tuple(range(count + len(question.free))))
        types = self.engine.library.parameter_types(name)
        is_object = [isinstance(type_, ObjectType) for type_ in types[count:]]
        bound = tuple(self.bound[name] for name in question.bound)
        alive = self.model.graph.alive

        def matches() -> list[Row]:
            if not all(alive(node) for node in bound):  # type: ignore[arg-type]
                return []
            return sorted(row[count:] for row in find(*bound))

        def holds(row: Row) -> bool:
            nodes = [*bound, *(value for value, known in zip(row, is_object, strict=True) if known)]
            return all(alive(node) for node in nodes) and bool(exists(*bound, *row))  # type: ignore[arg-type]

        return matches, holds

    def _without(
        self,
        question: Question,
        types: Types,
        matches: Callable[[], list[Row]],
        holds: Callable[[Row], bool],
    ) -> tuple[Callable[[], list[Row]], Callable[[Row], bool]]:
        """Return `matches` and `holds`, extended so that a negated condition also holds if an object was deleted."""
        bound = [(self.bound[name], types[name]) for name in question.bound]

        def gone() -> bool:
            return any(is_gone(self.model, node, cls) for node, cls in bound)

        return lambda: matches() or ([()] if gone() else []), lambda row: holds(row) or gone()

    def in_the_way(self, end: int) -> Callable[[], int]:
        """Return a function that counts the matches which must vanish before an episode can have this end.

        The matches are those of `on neg find .. terminate` clauses.
        """
        questions = [
            self._counting(effect.condition.relation, types)
            for effect, types in self.asked
            if isinstance(effect, OnFind)
            and ENDS[effect.end] == end
            and isinstance(effect.condition, Negation)
            and isinstance(effect.condition.relation, PatternCall)
        ]
        return lambda: sum(count() for count in questions)

    # --- observations

    def _components(self, observation: Observation, types: Types) -> Iterator[Component]:
        if isinstance(observation, ObserveFind):
            yield self._found(observation, types)
            return
        size, index, padding = self._meaning(observation, types)
        path, read = observation.path, self._read
        for value in self._owners(observation.each) if observation.each else [self._owner(path, types)]:
            seen = observer(path, value, self.model, read, index, padding, self.bound)
            if observation.visible is not None:
                seen = self._in_sight(observation, types, value, seen, hidden=size - 1)
            owned = isinstance(path, Navigation) and not isinstance(observation, ObserveObject)
            shown = path.object if owned else path  # type: ignore[union-attr]
            yield Component(size, seen, observation, leading_to(shown, value, self.bound, read))

    def _in_sight(
        self,
        observation: ObservePath,
        types: Types,
        owner: tuple[str, Callable[[], Value | None]],
        seen: Callable[[], int],
        hidden: int,
    ) -> Callable[[], int]:
        """Return a function that reads a component if its visibility condition holds, and otherwise returns `hidden`.

        If the observed object is missing, the condition is not evaluated, and the component is read.
        """
        each, call = observation.each, observation.visible
        assert call is not None
        question = self._ask(call, types if each is None else {**types, each.name: each.type or ""})
        find = self.engine.matcher.prepare(question.pattern.qualified_name, tuple(range(len(question.bound))))
        name, value = owner

        def read() -> int:
            node = value()
            if node is None:
                return seen()
            nodes: list[Any] = [node if one == name else self.bound[one] for one in question.bound]
            return seen() if all(map(self.model.graph.alive, nodes)) and find(*nodes) else hidden

        return read

    def _owner(self, path: Expression, types: Types) -> tuple[str, Callable[[], Value | None]]:
        """Return the name at which a path begins, and a function that returns its object, or None if it was deleted."""
        name = root_of(path).name
        node, cls = self.bound[name], types[name]
        return name, lambda: None if is_gone(self.model, node, cls) else node

    def _owners(self, each: Parameter) -> Iterator[tuple[str, Callable[[], Value | None]]]:
        """Yield for each component of a `for` observation the variable and a function that returns its object."""
        assert each.type is not None
        objects = self._keyed(each.type)
        yield from ((each.name, _item(objects, i)) for i in range(len(objects.keys)))

    def _meaning(
        self, observation: ObservePath, types: Types
    ) -> tuple[int, Callable[[Value | None], int], int]:
        """Return a path's number of values, a function from value to index, and the index if the owner is missing."""
        metamodel = self.model.metamodel
        size = size_of(observation, types, self._keys, metamodel)
        type_ = path_type(observation, types, metamodel)
        match observation:
            case ObserveObject(among=among, or_none=or_none):
                indexer = self._keys.indexer(self.model, among)
                missing = self._keys.size(among) if or_none else None
                assert isinstance(type_, ObjectType), "the behaviour was checked"
                index = object_index(self.model, indexer, missing, among, type_.cls)
                return size, index, missing or 0
            case ObserveRange(low=low, high=high):
                return size, range_index(low, high), 0
            case _:
                literals = type_.literals if isinstance(type_, EnumType) else (False, True)
                return size, literal_index(literals), 0

    def _found(self, observation: ObserveFind, types: Types) -> Component:
        size = size_of(observation, types, self._keys, self.model.metamodel)
        if observation.up_to is None:
            matches, _ = self._matches(self._ask(observation.call, types))
            return Component(size, lambda: 1 if matches() else 0, observation)
        count = self._counting(observation.call, types)
        return Component(size, lambda: min(count(), size - 1), observation)

    def _counting(self, call: PatternCall, types: Types) -> Callable[[], int]:
        counted, _ = self._matches(self._added(lambda name: count_question(name, call, types)))

        def count() -> int:
            rows = counted()
            return int(rows[0][0]) if rows else 0

        return count


def added(engine: Engine, behaviour: str, make: Callable[[str], Question]) -> Question:
    """Return the question `make(name)` for the first free name `behaviour#N`, and add its pattern to the engine.

    If an equal pattern is already there under such a name, return the question for this name, and add nothing.
    """
    library = engine.library
    known = set(library.names())
    number = 0
    while True:
        question = make(f"{behaviour}#{number}")
        name = question.pattern.qualified_name
        if name not in known:
            engine.add(question.pattern)
            return question
        if library.get(name) == question.pattern:
            return question
        number += 1


def _item(objects: KeyedObjects, position: int) -> Callable[[], Value | None]:
    return lambda: objects.get(position)


def _constant(value: Value) -> Callable[[], Value | None]:
    return lambda: value


def _fixed(value: float) -> Reward:
    return lambda _: value


def _number(expression: Expression, scope: Scope, read: Reader, what: str = "a reward") -> float:
    try:
        value = evaluate(expression, scope, read)
    except EvaluationError as error:
        raise _unvalued(error, what, expression, scope, read) from None
    if value is None:
        hint = "check the paths in the expression: one has no value in this state"
        raise EvaluationError(f"{what} has no value", expression.span, hint)
    number = float(value)
    if abs(number) > MOST_REWARD:
        message = f"{what} is {number}, but must be from {-MOST_REWARD:g} to {MOST_REWARD:g}"
        raise EvaluationError(message, expression.span, "use smaller numbers: sums of such numbers overflow")
    return number


def _unvalued(
    error: EvaluationError, what: str, expression: Expression, scope: Scope, read: Reader
) -> EvaluationError:
    found = explained(error, expression, scope, read, None, "write `{} ? .. : ..` around it")
    return EvaluationError(f"{what} has no value: {found.message}", found.span, found.hint)


def stands_before(effect: Effect, action: Action) -> bool:
    if effect.span is None or action.span is None or effect.span.source is not action.span.source:
        return False
    return effect.span.start < action.span.start
