"""Random behaviours over the random metamodels, patterns and rules of the oracle.

Rules and patterns are less wild than those of `rewriting_worlds`: mostly of constructs that can be compiled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import get_args

import numpy as np

from envgraph.behaviour import (
    Action,
    Agent,
    Behaviour,
    Branch,
    Domain,
    DrawGrid,
    EachStep,
    Observation,
    ObserveAround,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    OnFind,
    OnRefused,
    OnReset,
    RuleCall,
    check_behaviour,
)
from envgraph.env.compiled import CompiledBatch, CompiledProgram, NotCompiled, program_of
from envgraph.errors import EnvgraphError, EvaluationError, ResolutionError, RuleError, Severity
from envgraph.metamodel import Attribute, Class, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import (
    AggregateFunction,
    Alap,
    Applicable,
    AtomicStep,
    Binary,
    Check,
    ColumnMark,
    Conditional,
    Constant,
    CreateAction,
    EnumLiteral,
    Expression,
    FunctionCall,
    IfStep,
    Library,
    MergeAction,
    Modification,
    Navigation,
    Negation,
    ObjectType,
    Parameter,
    Pattern,
    PatternCall,
    Repeat,
    RightSide,
    Rule,
    RuleBlock,
    StaticType,
    Step,
    StepSequence as Steps,
    Term,
    TryStep,
    Unary,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
)
from envgraph.rewrite import Engine
from tests.oracle.random_moves import random_moves
from tests.oracle.random_observations import (
    random_grid,
    random_sight,
    random_window,
    with_keys_of_keyboard,
    with_marks,
    with_places,
)
from tests.oracle.rewriting_smaller import without_refused_parts
from tests.oracle.rewriting_worlds import concrete, random_model, random_patterns, random_rule, state_of
from tests.oracle.worlds import COLOUR, Dice, add, body, domain, edit, parameters, random_metamodel
from tests.unit.env.side_by_side import family_keys
from tests.unit.rewrite.graphs import definitions

ENUM = COLOUR.name
STEP_LIMIT = 100
"""Of a run of a unit, which may never end."""
MOST_COMPONENTS = 200
"""Of an observation."""


@dataclass(frozen=True)
class BehaviourCase:
    """A family with a behaviour."""

    engines: tuple[Engine, ...]
    behaviour: Behaviour
    refused: tuple[str, ...]
    """What clauses had that is not compiled; they are left out."""


def random_behaviour_case(seed: int) -> BehaviourCase:
    """What follows from a number."""
    dice = Dice(seed)
    metamodel = _simplified_metamodel(dice, random_metamodel(dice))
    while not metamodel.references or not concrete(metamodel):
        metamodel = _simplified_metamodel(dice, random_metamodel(dice))
    if seed % 3:
        metamodel = with_places(Dice(seed + 4), metamodel)
    if seed % 2:
        metamodel = _with_keys(Dice(seed), metamodel)
    metamodel = with_marks(Dice(seed + 5), metamodel)
    model = random_model(dice, metamodel)
    more = Dice(seed + 8)
    for name in concrete(metamodel) * 2:
        if more.chance(50):
            model.graph.new(name)
    for _ in range(15):
        edit(more, model)
    for cls in metamodel.class_list:
        for number, node in enumerate(sorted(model.graph.extent(cls.name)) if cls.key else ()):
            model.graph.set_value(node, metamodel.feature(cls.name, cls.key[0]), number)  # type: ignore[arg-type]
    known = random_patterns(dice, metamodel)
    library = Library(metamodel)
    for number in range(dice.number(1, 3)):
        own = parameters(dice, metamodel)
        made = body(dice, metamodel, own, library.patterns, ())
        add(library, [Pattern(f"q{number}", own, (made,))])
    engine = Engine(model)
    engine.add(*known, *library.patterns)
    state = state_of(model)
    for number in range(dice.number(2, 5)):
        rule = without_refused_parts(engine, _simplified_rule(dice, random_rule(dice, state, known, f"r{number}")))
        if rule is not None:
            engine.add(replace(rule, weight=dice.one([1.0, 1.0, 0.3, 2.5]), priority=dice.one([0, 0, 0, 1])))
    for text in random_moves(Dice(seed + 7), model, 6):
        with suppress(ResolutionError, EvaluationError, EnvgraphError):
            engine.add(*definitions(text))
    for node in state.classes:
        model.graph.set_object_name(int(node), f"n{node}")
    engines = [engine]
    for _ in range(dice.number(0, 2)):
        other = engine.copy()
        for _ in range(dice.number(1, 6)):
            edit(dice, other.model)
        engines.append(other)
    builder = _Builder(dice, engines, Dice(seed + 1), Dice(seed + 3))
    behaviour = builder.with_refusals(builder.behaviour(), Dice(seed + 2))
    keys = family_keys(engines, behaviour)
    behaviour = with_keys_of_keyboard(Dice(seed + 6), behaviour, keys, metamodel)
    if not builder.is_compiled(behaviour):  # all of it together
        return random_behaviour_case(seed + 1)
    return BehaviourCase(tuple(engines), behaviour, tuple(builder.refused))


def _simplified_metamodel(dice: Dice, metamodel: Metamodel) -> Metamodel:
    """The metamodel with fewer features with many values, and a class to retype to without a loss."""
    plain = {
        reference.name
        for reference in metamodel.references
        if reference.many
        and not reference.containment
        and ((opposite := metamodel.opposite(reference)) is None or opposite.many)
        and dice.chance(30)
    }
    classes = []
    for cls in metamodel.class_list:
        features: list[Attribute | Reference] = []
        for feature in cls.features:
            if (isinstance(feature, Attribute) and feature.many and dice.chance(40)) or feature.name in plain:
                feature = replace(feature, upper=1)
            features.append(feature)
        classes.append(Class(cls.name, cls.abstract, cls.supertypes, tuple(features)))
    if dice.chance(50):
        classes.append(Class("E", False, (dice.one(classes).name,)))
    return Metamodel(metamodel.name, tuple(classes), tuple(metamodel.enums.values()))


def _with_keys(dice: Dice, metamodel: Metamodel) -> Metamodel:
    """The metamodel, half of whose classes with ints have one as key."""
    classes = []
    for cls in metamodel.class_list:
        ints = [one for one in cls.features if isinstance(one, Attribute) and one.type is Scalar.INT]
        names = [one.name for one in ints if not one.many]
        key = (dice.one(names),) if names and dice.chance(50) else ()
        classes.append(Class(cls.name, cls.abstract, cls.supertypes, cls.features, key))
    return Metamodel(metamodel.name, tuple(classes), tuple(metamodel.enums.values()))


def _simplified_rule(dice: Dice, rule: Rule) -> Rule:
    """The rule, often without blocks that change something, and without what it creates or merges."""
    right = _simplified_right_side(dice, rule.right, rule)
    blocks = rule.blocks
    if dice.chance(50):
        blocks = tuple(one for one in blocks if one.kind in ("not", "require"))
    return replace(rule, blocks=tuple(_block(dice, one, rule) for one in blocks), right=right)


def _block(dice: Dice, block: RuleBlock, rule: Rule) -> RuleBlock:
    return block if block.right is None else replace(block, right=_simplified_right_side(dice, block.right, rule))


def _simplified_right_side(
    dice: Dice, right: RightSide | Modification | None, rule: Rule
) -> RightSide | Modification | None:
    """The right side, half of the time without what is created, and then often without what is merged."""
    making = dice.chance(50)
    if dice.chance(40):
        return right
    if isinstance(right, Modification):
        return Modification(tuple(one for one in right.actions if not _makes(one, making)))
    if isinstance(right, RightSide) and not making and right is rule.right:
        old = {node.name for node in rule.left.nodes} | {
            end for edge in rule.left.edges for end in (edge.source, edge.target)
        }
        return replace(
            right,
            nodes=tuple(node for node in right.nodes if node.name in old),
            actions=tuple(one for one in right.actions if not _makes(one, making)),
        )
    return right


def _makes(action: object, making: bool) -> bool:
    return isinstance(action, MergeAction) or (not making and isinstance(action, CreateAction) and bool(action.nodes))


def _domain(type_: StaticType | None) -> Domain:
    assert isinstance(type_, ObjectType)
    return Domain(cls=type_.cls)


def _runs(program: CompiledProgram) -> bool:
    """True if some steps of all members have no errors."""
    count, rng = 2 * len(program.members), np.random.default_rng(0)
    batch = CompiledBatch(program, [*range(len(program.members))] * 2)
    batch.seed([np.random.default_rng(number) for number in range(count)])
    try:
        batch.reset(np.ones(count, dtype=np.bool_))
        for _ in range(6):
            batch.step(rng.integers(len(program.action_names), size=count), resets_ended=True)
    except (RuleError, EvaluationError):
        return False
    return True


def _added(found: Behaviour, made: Behaviour) -> Behaviour:
    """The second behaviour, without what the first has already that others do not depend on: it compiles faster."""

    def fewer(old: Behaviour | Agent, new: Behaviour | Agent) -> dict[str, object]:
        known = {*old.actions[1:], *old.effects, *(one for one in old.observations if isinstance(one, ObserveAround))}
        parts = {"actions": new.actions, "effects": new.effects, "observations": new.observations}
        return {name: tuple(one for one in part if one not in known) for name, part in parts.items()}

    pairs = zip_longest(found.agents, made.agents)
    agents = tuple(one if old is None else replace(one, **fewer(old, one)) for old, one in pairs)
    resets = tuple(one for one in made.resets if one not in found.resets)
    return replace(made, **fewer(found, made), agents=agents, resets=resets)


class _Builder:
    """Adds clause after clause; one that is refused by the check is left out, and so is one that is not compiled.

    Attributes:
        refused: what is not compiled.
    """

    def __init__(self, dice: Dice, engines: Sequence[Engine], operations: Dice, views: Dice) -> None:
        self._dice = dice
        self._operations = operations
        self._views = views
        self._engines = engines
        self._engine = engines[0]
        self._metamodel = engines[0].model.metamodel
        self._scope: dict[str, StaticType] = {}
        self.refused: list[str] = []
        self._callable = [*engines[0].rules]
        for number in range(dice.number(0, 3)):
            self._add_unit(f"u{number}")
        self._copies = [one.copy() for one in engines]

    def behaviour(self) -> Behaviour:
        """All of it."""
        dice, model = self._dice, self._engine.model
        found = Behaviour("random", actions=(Action("wait", (Branch(1.0, RuleCall(None)),)),))
        everywhere = [
            node
            for cls in concrete(self._metamodel)
            for node in model.graph.exact_extent(cls)
            if all(one.model.graph.alive(node) and one.model.graph.class_of(node) == cls for one in self._engines)
        ]
        for _ in range(dice.number(0, 2)):
            if everywhere:
                node = dice.one(everywhere)
                cls = dice.one(self._metamodel.supertypes(model.graph.class_of(node)))
                found = self._with(found, parameters=(*found.parameters, Parameter(f"n{node}", cls)))
        if self._views.chance(80) and (grid := random_grid(self._views, self._metamodel)) is not None:
            found = self._with(found, draw=grid)
            drawn = [grid.cls, *(one.cls or "" for one in grid.tokens)]
            nodes = [one for one in everywhere if {*self._metamodel.supertypes(model.graph.class_of(one))} & {*drawn}]
            if nodes and not found.parameters:
                node = self._views.one(nodes)
                found = self._with(found, parameters=(Parameter(f"n{node}", model.graph.class_of(node)),))
        for rule in [one for one in self._engine.rules if one.startswith("move") and self._views.chance(60)]:
            found = self._with(found, actions=(*found.actions, self._move(rule)))
        self._scope = {one.name: ObjectType(one.type or "") for one in found.parameters}
        found = self._observed(self._clauses(found, dice.number(3, 9)), self._scope)
        if dice.chance(35):
            together = dice.chance(40)
            for number in range(dice.number(1, 2)):
                found = self._agent(found, number, together)
        for _ in range(dice.one([0, 0, 1, 2])):
            condition, free = self._condition(dice.chance(25)) if dice.chance(40) else (None, {})
            scope = {**self._scope, **free}
            branches, weight = self._applied(scope) if condition else (self._branches(scope)[0], None)
            found = self._with(found, resets=(*found.resets, OnReset(branches, condition, weight)))
        return found

    def with_refusals(self, found: Behaviour, dice: Dice) -> Behaviour:
        """The behaviour, mostly with `on refused` clauses, shared ones or of blocks: by dice of their own, as above."""
        self._dice = dice
        for _ in range(dice.one([0, 1, 1, 2])):
            block = dice.number(-1, len(found.agents) - 1)
            scope = dict(self._scope)
            if block >= 0:
                scope[found.agents[block].variable] = ObjectType(found.agents[block].cls)
            reward = self._reward(scope) if dice.chance(60) else None
            end = dice.one([None, None, None, "success", "failure", "truncation"])
            clause = OnRefused(reward, end)  # type: ignore[arg-type]
            owner: Behaviour | Agent = found if block < 0 else found.agents[block]
            effects = dice.one([(clause, *owner.effects), (*owner.effects, clause)])
            if block < 0:
                found = self._with(found, effects=effects)
            else:
                changed = replace(found.agents[block], effects=effects)
                found = self._with(found, agents=(*found.agents[:block], changed, *found.agents[block + 1 :]))
        return found

    def _agent(self, found: Behaviour, number: int, together: bool) -> Behaviour:
        classes = [cls for cls in self._metamodel.classes if all(one.model.graph.extent(cls) for one in self._engines)]
        if not classes:
            return found
        cls, outer = self._dice.one(classes), self._scope
        self._scope = {**outer, f"me{number}": ObjectType(cls)}
        rest = Action(f"rest{number}", (Branch(1.0, RuleCall(None)),))
        block = Agent(f"me{number}", cls, (rest,))
        found = self._with(found, agents=(*found.agents, block), together=together)
        if found.agents and found.agents[-1] == block:
            found = self._clauses(found, self._dice.number(1, 4), agent=True)
            found = self._observed(found, {f"me{number}": ObjectType(cls)})
        self._scope = outer
        return found

    def _clauses(self, found: Behaviour, count: int, agent: bool = False) -> Behaviour:
        for number in range(count):
            roll = self._dice.number(0, 9)
            name = f"a{number}{'m' * len(found.agents) if agent else ''}"
            owner: Behaviour | Agent = found.agents[-1] if agent else found
            part: dict[str, object]
            if roll < 4:
                part = {"actions": (*owner.actions, self._action(name))}
            elif roll < 7:
                part = {"effects": (*owner.effects, self._effect())}
            else:
                observation = self._observation()
                if observation is None:
                    continue
                part = {"observations": (*owner.observations, observation)}
            if agent:
                part = {"agents": (*found.agents[:-1], replace(owner, **part))}
            found = self._with(found, **part)
        return found

    def _observed(self, found: Behaviour, names: Mapping[str, StaticType]) -> Behaviour:
        """Often observations of floats, patterns for each object, and windows: by dice of their own, as above."""
        dice, more = self._views, list[Observation | None]()
        for _ in range(dice.one([0, 1, 1, 2])):
            more.append(self._float(names))
        if dice.chance(40):
            condition, _ = self._condition(False)
            assert isinstance(condition, PatternCall)
            more.append(self._for_each(ObserveFind(condition, dice.one([None, 2])), always=True))
        for name in names:
            if isinstance(found.draw, DrawGrid) and dice.chance(80):
                more.append(random_window(dice, self._engine, found.draw, name, {**self._scope, **names}))
        for one in more:
            if one is not None and names is self._scope:
                found = self._with(found, observations=(*found.observations, one))
            elif one is not None:
                block = replace(found.agents[-1], observations=(*found.agents[-1].observations, one))
                found = self._with(found, agents=(*found.agents[:-1], block))
        return found

    def _float(self, names: Mapping[str, StaticType]) -> Observation | None:
        """A float of an object, or of each object of a class; None if there is none."""
        dice = self._views
        each = Parameter("each", dice.one(list(self._metamodel.classes))) if dice.chance(60) or not names else None
        scope = dict(names) if each is None else {"each": ObjectType(each.type or "")}
        paths = [one for one, type_ in self._paths(scope) if type_ is Scalar.FLOAT]
        if not paths:
            return None
        path, visible, name = dice.one(paths), None, "each" if each is not None else dice.one([*names])
        if dice.chance(40):
            known = {**self._scope, **names}
            visible = random_sight(dice, self._engine, name, scope[name].cls, known)  # type: ignore[union-attr]
        if self._has_range(path, scope) and dice.chance(60):
            return ObserveAttribute(path, each, visible)
        return ObserveRange(path, *dice.one([(0.0, 1.0), (-2.5, 0.6), (0, 3), (0.1, 1e200)]), each, visible)

    def _has_range(self, path: Expression, scope: dict[str, StaticType]) -> bool:
        """True if a path leads to an attribute with `@range`."""
        owners = [own for one, own in self._paths(scope) if isinstance(path, Navigation) and one == path.object]
        return any(
            isinstance(own, ObjectType) and self._metamodel.feature(own.cls, path.feature).range  # type: ignore
            for own in owners
        )

    def _with(self, found: Behaviour, **changes: object) -> Behaviour:
        """The behaviour with a clause more, if that is one that can be compiled."""
        made = replace(found, **changes)  # type: ignore[arg-type]
        problems = check_behaviour(made, self._engine)
        if any(one.severity is Severity.ERROR for one in problems):
            return found
        must_run = self._views.chance(80)
        return made if self.is_compiled(_added(found, made), must_run=must_run) else found

    def is_compiled(self, behaviour: Behaviour, *, must_run: bool = False) -> bool:
        """True if there is a program of a behaviour, of few observations; and if some steps end without an error."""
        try:
            keys = family_keys(self._copies, behaviour)
            program = program_of(self._copies[0], behaviour, self._copies, keys, native=False)
        except NotCompiled as reason:
            self.refused.append(reason.construct)
            return False
        except (EvaluationError, ResolutionError):
            return False
        return len(program.observation_shape) <= MOST_COMPONENTS and (not must_run or _runs(program))

    # --- clauses

    def _move(self, rule: str) -> Action:
        """An action that does a rule, to any object that it takes."""
        taken = self._engine.signature(rule).parameters
        call = RuleCall(rule, tuple(Variable(one.name) for one in taken))
        return Action(rule, (Branch(1.0, call),), tuple((one.name, _domain(one.type)) for one in taken))

    def _action(self, name: str) -> Action:
        dice = self._dice
        domains: list[tuple[str, Domain]] = []
        scope = dict(self._scope)
        for number in range(dice.one([0, 0, 1, 1, 2])):
            parameter = f"p{number}"
            roll = dice.number(0, 5)
            if roll < 4:
                cls = dice.one(list(self._metamodel.classes))
                domains.append((parameter, Domain(cls=cls)))
                scope[parameter] = ObjectType(cls)
            elif roll < 5:
                domains.append((parameter, Domain(low=dice.number(-1, 0), high=dice.number(0, 2))))
                scope[parameter] = Scalar.INT
            else:
                domains.append((parameter, Domain(enum=ENUM)))
                scope[parameter] = COLOUR
        branches, outputs = self._branches(scope)
        return Action(
            name,
            branches,
            tuple(domains),
            self._reward({**scope, **outputs}) if dice.chance(60) else None,
            self._reward(scope) if dice.chance(30) else None,
        )

    def _branches(self, scope: dict[str, StaticType]) -> tuple[tuple[Branch, ...], dict[str, StaticType]]:
        dice = self._dice
        call, outputs = self._call(scope)
        if dice.chance(60):
            return (Branch(1.0, call),), outputs
        chances = dice.one([(0.5,), (0.3, 0.7), (0.1, 0.2, 0.3), (0.7, 0.2, 0.1), (0.0, 0.4)])
        others = [RuleCall(None) if dice.chance(20) else self._call(scope)[0] for _ in chances[1:]]
        made = zip(chances, (call, *others), strict=True)
        branches = tuple(Branch(self._chance(chance, scope), one) for chance, one in made)
        return branches, {} if others else outputs

    def _chance(self, most: float, scope: dict[str, StaticType]) -> float | Expression:
        """A probability: a number, one of two numbers as the state is, or whatever there is, even no probability."""
        dice = self._dice
        if dice.chance(10):
            return self._value(scope, Scalar.FLOAT, depth=1)
        test = self._test(scope) if dice.chance(40) else None
        return most if test is None else Conditional(test, Constant(most), Constant(most / 2))

    def _call(self, scope: dict[str, StaticType]) -> tuple[RuleCall, dict[str, StaticType]]:
        dice, engine = self._dice, self._engine
        if not self._callable:
            return RuleCall(None), {}
        rule = dice.one(self._callable)
        arguments: list[Expression] = []
        outputs: dict[str, StaticType] = {}
        for taken in engine.signature(rule).parameters:
            if taken.is_output:
                outputs[f"o{len(outputs)}"] = taken.type or Scalar.INT
                arguments.append(Variable(f"o{len(outputs) - 1}"))
            else:
                arguments.append(self._value(scope, taken.type or Scalar.INT, depth=1))
        return RuleCall(rule, tuple(arguments)), outputs

    # --- units

    def _add_unit(self, name: str) -> None:
        """A unit of all engines, if it has no errors; behaviours call it more often than a rule."""
        dice = self._dice
        classes = [dice.one(list(self._metamodel.classes)) for _ in range(dice.number(0, 2))]
        scope: dict[str, StaticType] = {f"x{number}": ObjectType(cls) for number, cls in enumerate(classes)}
        parameters = tuple(Parameter(f"x{number}", cls) for number, cls in enumerate(classes))
        unit = Unit(name, parameters, self._step(scope, 2))
        for engine in self._engines:
            engine.step_limit = STEP_LIMIT
        with suppress(ResolutionError, EvaluationError):
            for engine in self._engines:
                engine.add(unit)
            self._callable += [name, name]

    def _step(self, scope: dict[str, StaticType], depth: int) -> Step:
        dice = self._dice
        roll = dice.number(0, 14) if depth else 0
        if roll < 3 or not self._callable:
            return self._unit_call(scope)
        inner = [self._step(scope, depth - 1) for _ in range(dice.number(2, 3))]
        if roll < 6:
            return UnitChoice(tuple(inner))
        if roll < 8:
            return TryStep(inner[0], inner[1] if dice.chance(50) else None)
        if roll < 10:
            test = self._test(scope)
            condition: Check | PatternCall | Negation | Applicable = (
                Check(test) if test is not None and dice.chance(50) else self._condition(dice.chance(30), scope)[0]
            )
            if dice.chance(25):
                asked = self._call(scope)[0]
                condition = Applicable(asked.rule or "nobody", asked.arguments, dice.chance(30))
            return IfStep(condition, inner[0], inner[1] if dice.chance(50) else None)
        if roll < 12:
            return Steps(tuple(inner) if dice.chance(60) else (inner[0], *(TryStep(one) for one in inner[1:])))
        if roll < 13:
            return Alap(Steps(tuple(inner[:2])))
        if roll < 14:
            lower = dice.number(0, 2)
            bound = self._value(scope, Scalar.INT, depth=1) if dice.chance(30) else lower + dice.number(0, 1)
            return Repeat(lower, bound, inner[0])
        return AtomicStep(Steps(tuple(inner)))

    def _unit_call(self, scope: dict[str, StaticType]) -> UnitCall:
        """A call of a unit, or of a rule at one of its matches, or all of them."""
        dice, call = self._dice, self._call(scope)[0]
        made = UnitCall(call.rule or "nobody", tuple(self._opened(one) for one in call.arguments))
        if call.rule is None or self._engine.signature(call.rule).kind == "unit" or dice.chance(60):
            return made
        outputs = [one.is_output for one in self._engine.signature(call.rule).parameters]
        plain = tuple(Variable("_") if each else one for one, each in zip(made.arguments, outputs, strict=True))
        test = self._test(scope) if dice.chance(40) else None
        where = () if test is None else (Check(test),)
        if dice.chance(30):
            return replace(made, first=True, where=where)
        by = self._value(scope, dice.one([Scalar.INT, Scalar.FLOAT]), depth=1) if dice.chance(40) else None
        limit = dice.number(1, 2) if by is not None and dice.chance(50) else None
        return replace(made, arguments=plain, every=True, where=where, by=by, limit=limit)

    def _opened(self, argument: Expression) -> Expression:
        """An argument, or often `_` for one that has no value."""
        known = isinstance(argument, Variable) and argument.name == "nobody"
        return Variable("_") if known or self._dice.chance(20) else argument

    # --- effects

    def _effect(self) -> EachStep | OnFind:
        dice = self._dice
        if dice.chance(25):
            apply = self._branches(self._scope)[0] if dice.chance(70) else ()
            return EachStep(self._reward(self._scope) if not apply or dice.chance(40) else None, apply)
        condition, free = self._condition(dice.chance(25))
        scope = {**self._scope, **free}
        apply, weight = self._applied(scope) if dice.chance(35) else ((), None)
        return OnFind(
            condition,
            self._reward(scope) if dice.chance(65) else None,
            dice.one([None, None, None, "success", "failure", "truncation"]),  # type: ignore[arg-type]
            apply,
            weight,
        )

    def _applied(self, scope: dict[str, StaticType]) -> tuple[tuple[Branch, ...], Expression | None]:
        """What is done for each match, or for one that is drawn by a weight."""
        if self._dice.chance(70):
            return self._branches(scope)[0], None
        return self._branches(scope)[0], self._value(scope, Scalar.FLOAT, depth=1)

    def _condition(
        self, negative: bool, scope: dict[str, StaticType] | None = None
    ) -> tuple[PatternCall | Negation, dict[str, StaticType]]:
        dice = self._dice
        pattern = dice.one([one for one in self._engine.library.patterns if not one.package and "#" not in one.name])
        arguments: list[Term] = []
        free: dict[str, StaticType] = {}
        for type_ in self._engine.library.parameter_types(pattern.qualified_name):
            known = self._fitting(scope or self._scope, type_)
            roll = dice.number(0, 9)
            if known and roll < 5:
                arguments.append(Variable(dice.one(known)))
            elif not isinstance(type_, ObjectType) and roll < 7:
                arguments.append(self._literal(type_))
            elif roll < 8 or negative:
                arguments.append(Variable("_"))
            else:
                free[f"f{len(free)}"] = type_
                arguments.append(Variable(f"f{len(free) - 1}"))
        call = PatternCall(pattern.qualified_name, tuple(arguments))
        return (Negation(call), {}) if negative else (call, free)

    def _observation(self) -> Observation | None:
        dice, scope = self._dice, dict(self._scope)
        if dice.chance(35):
            condition, _ = self._condition(False)
            assert isinstance(condition, PatternCall)
            return self._aggregate(self._for_each(ObserveFind(condition, dice.one([None, 1, 3]))))
        each = None
        if dice.chance(50):
            each = Parameter("each", dice.one(list(self._metamodel.classes)))
            scope = {"each": ObjectType(each.type or "")}
        paths = [(path, type_) for path, type_ in self._paths(scope) if isinstance(path, Navigation)]
        if not paths:
            return None
        path, type_ = dice.one(paths)
        visible: PatternCall | None = None
        if dice.chance(30):
            condition, _ = self._condition(False, {**self._scope, **scope})
            visible = condition if isinstance(condition, PatternCall) else None
        if isinstance(type_, ObjectType):
            return ObserveObject(path, type_.cls, dice.chance(80), each, visible)
        if type_ is Scalar.INT:
            lowest, highest = dice.number(-1, 0), dice.number(1, 3)
            if self._has_range(path, scope) and self._operations.chance(50):
                return ObserveAttribute(path, each, visible)
            return ObserveRange(path, lowest * self._operations.one([1, 1.5]), highest, each, visible)
        if type_ is Scalar.FLOAT:
            low, high = self._operations.one([(0.0, 1.0), (-2.5, 0.6), (0, 3), (0.1, 1e200)])
            return ObserveRange(path, low, high, each, visible)
        return ObserveAttribute(path, each, visible)

    def _for_each(self, seen: ObserveFind, *, always: bool = False) -> ObserveFind:
        """The observation, half of the time or always for each object of a class that its pattern takes."""
        other, call = self._operations, seen.call
        types = self._engine.library.parameter_types(call.pattern)
        places = [number for number, type_ in enumerate(types) if isinstance(type_, ObjectType)]
        if not places or not (always or other.chance(50)):
            return seen
        place, each = other.one(places), Variable("each")
        arguments = tuple(each if number == place else one for number, one in enumerate(call.arguments))
        others = tuple(each if number == place else Variable("_") for number in range(len(types)))
        visible = replace(call, arguments=others) if other.chance(40) else None
        parameter = Parameter("each", getattr(types[place], "cls", None))
        return ObserveFind(replace(call, arguments=arguments), seen.up_to, parameter, visible)

    def _aggregate(self, seen: ObserveFind) -> ObserveFind:
        """The observation, or often that of an aggregate of a number that a pattern has."""
        other, library, each = self._operations, self._engine.library, seen.each
        names = [one.qualified_name for one in library.patterns if not one.package and "#" not in one.name]
        taken = {name: library.parameter_types(name) for name in names}
        numbers = (Scalar.INT, Scalar.FLOAT)
        columns = [(name, place) for name in names for place, one in enumerate(taken[name]) if one in numbers]
        if not columns or other.chance(40):
            return seen
        pattern, column = other.one(columns)
        scope = {**self._scope, **({each.name: ObjectType(each.type or "")} if each is not None else {})}
        fitting = [self._fitting(scope, one) for one in taken[pattern] if one is not None]
        arguments: list[Term] = [Variable(other.one([*known, *known, "_"])) for known in fitting]
        arguments[column] = ColumnMark()
        function = other.one([*get_args(AggregateFunction)][1:])
        low, high = other.one([(-1, 3), (0, 5), (0.5, 4), (-2.5, 1e200)])
        made = replace(seen, call=PatternCall(pattern, tuple(arguments)), up_to=high, aggregate=function, low=low)
        is_used = each is not None and Variable(each.name) in arguments
        return made if is_used else replace(made, each=None, visible=None)

    # --- values

    def _fitting(self, scope: dict[str, StaticType], type_: StaticType) -> list[str]:
        return [
            name
            for name, own in scope.items()
            if own == type_
            or (
                isinstance(own, ObjectType)
                and isinstance(type_, ObjectType)
                and self._metamodel.may_overlap(own.cls, type_.cls)
            )
        ]

    def _paths(self, scope: dict[str, StaticType], depth: int = 2) -> list[tuple[Expression, StaticType]]:
        """What can be read from some names."""
        found: list[tuple[Expression, StaticType]] = [(Variable(name), type_) for name, type_ in scope.items()]
        last = found
        for _ in range(depth):
            new: list[tuple[Expression, StaticType]] = []
            for path, type_ in last:
                if isinstance(type_, ObjectType):
                    for feature in self._metamodel.features(type_.cls).values():
                        if not feature.many:
                            end = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
                            new.append((Navigation(path, feature.name), end))
            found, last = [*found, *new], new
        return found

    def _literal(self, type_: StaticType) -> Constant | EnumLiteral:
        assert not isinstance(type_, ObjectType)
        value = self._dice.one(domain(type_))
        return EnumLiteral(type_.name, str(value)) if isinstance(type_, EnumType) else Constant(value)

    def _value(self, scope: dict[str, StaticType], type_: StaticType, depth: int) -> Expression:
        """An expression of a type."""
        dice = self._dice
        known = [path for path, own in self._paths(scope, depth) if own == type_]
        if isinstance(type_, ObjectType):
            known += [Variable(name) for name in self._fitting(scope, type_)] * 2
            return dice.one(known or [Variable("nobody")])
        if known and dice.chance(60):
            made = dice.one(known)
            operated = self._operated(made, type_)
            if type_ is Scalar.STRING and operated is not made:  # compiled environments only compare new strings
                return Conditional(Binary("<", operated, Constant("C")), made, Constant("b"))
            return operated
        if dice.chance(30) and (test := self._test(scope)) is not None:
            return Conditional(test, self._literal(type_), self._literal(type_))
        if type_ is Scalar.INT and known and dice.chance(50):
            return Binary(dice.one(["+", "-", "*", "/", "%"]), dice.one(known), self._literal(type_))
        return self._literal(type_)

    def _operated(self, made: Expression, type_: StaticType) -> Expression:
        """The expression, or an operation on it: by dice of its own, so that earlier cases stay what they were."""
        dice, other = self._operations, Constant(self._operations.one([2, 3, -7, 2**31, 2**62, -(2**63) + 1]))
        if dice.chance(60) or type_ not in (Scalar.INT, Scalar.FLOAT, Scalar.STRING):
            return made
        if type_ is Scalar.STRING:
            cut = FunctionCall("substring", (Binary("+", made, Constant("b")), Constant(dice.number(0, 2))))
            return dice.one([FunctionCall("toUpper", (made,)), cut])
        if type_ is Scalar.INT and dice.chance(60):
            return Binary(dice.one(["+", "-", "*", "*", "/", "%"]), dice.one([made, Binary("*", made, made)]), other)
        real = FunctionCall("toFloat", (made,)) if dice.chance(50) else Binary("-", made, Constant(1.25))
        name = dice.one(["sqrt", "exp", "log", "pow", "mod", "min"])
        real = FunctionCall(name, (real, other) if name in ("pow", "mod", "min") else (real,))
        return FunctionCall(dice.one(["floor", "ceil", "round", "toInt"]), (real,)) if type_ is Scalar.INT else real

    def _test(self, scope: dict[str, StaticType]) -> Expression | None:
        dice = self._dice
        paths = [one for one in self._paths(scope, 1) if isinstance(one[0], Navigation)]
        if not paths:
            return None
        path, type_ = dice.one(paths)
        if dice.chance(40):
            return Binary(dice.one(["==", "!="]), path, Constant(None))
        others = [one for one, own in paths if own == type_]
        if isinstance(type_, ObjectType):
            return Binary(dice.one(["==", "!="]), path, dice.one(others))
        right = self._operated(dice.one(others), type_) if dice.chance(50) else self._literal(type_)
        operators = ["==", "!=", "<", ">="] if type_ in (Scalar.INT, Scalar.FLOAT) else ["==", "!="]
        return Binary(dice.one(operators), path, right)

    def _reward(self, scope: dict[str, StaticType]) -> Expression:
        dice = self._dice
        if dice.chance(40):
            return Constant(dice.one([1, -1, 0.1, 0.3, 2]))
        type_ = dice.one([Scalar.INT, Scalar.FLOAT])
        made = self._value(scope, type_, depth=2)
        if dice.chance(30):
            return Binary(dice.one(["+", "-", "*", "/", "%"]), made, self._value(scope, type_, depth=1))
        return Unary("-", made) if dice.chance(10) else made
