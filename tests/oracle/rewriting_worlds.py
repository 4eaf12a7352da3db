"""Random metamodels, graphs of a few objects, patterns and rules of every kind, for what rules mean.

A rule is made around a witness, some object for each name, so that most left sides have a match.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from envgraph.graph import Model
from envgraph.metamodel import Attribute, AttributeType, EnumType, Metamodel, Reference, Scalar
from envgraph.pattern import (
    Aggregate,
    Assignment,
    Binary,
    Body,
    Check,
    Closure,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    EnumLiteral,
    Evaluation,
    Expression,
    LeftSide,
    MergeAction,
    Modification,
    MoveAction,
    Navigation,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    RedirectAction,
    RetypeAction,
    RightSide,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
    TypeConstraint,
    Variable,
)
from tests.oracle.rewriting_search import Item, State, Thing, several
from tests.oracle.worlds import Dice, domain, edit

MOST = 8
"""Objects of a graph."""


# --- graphs


def random_model(dice: Dice, metamodel: Metamodel) -> Model:
    """One to eight objects with links and values."""
    model = Model(metamodel)
    concrete = [cls.name for cls in metamodel.class_list if not cls.abstract]
    for _ in range(dice.number(1, MOST)):
        model.graph.new(dice.one(concrete))
    for _ in range(dice.number(0, 30)):
        before = len(model)
        savepoint = model.graph.history.savepoint()
        edit(dice, model)
        if len(model) != before:
            model.graph.history.rollback(savepoint)
        else:
            model.graph.history.release(savepoint)
    return model


def state_of(model: Model) -> State:
    """The graph as the oracle sees it."""
    metamodel = model.metamodel
    nodes = [
        Thing(node) for cls in metamodel.class_list if not cls.abstract for node in model.graph.exact_extent(cls.name)
    ]
    classes = {node: model.graph.class_of(node) for node in sorted(nodes)}
    values: dict[tuple[Thing, str], Item | tuple[Item, ...] | None] = {
        (node, attribute.name): several(attribute, model.graph.values(node, attribute))
        if attribute.many
        else model.graph.value(node, attribute)
        for node in nodes
        for attribute in metamodel.attributes
        if metamodel.feature(classes[node], attribute.name)
    }
    links = {
        (reference.name, node, Thing(target))
        for reference in metamodel.references
        for node in nodes
        for target in model.graph.targets(node, reference)
    }
    return State(metamodel, classes, values, links)


# --- patterns


def random_patterns(dice: Dice, metamodel: Metamodel) -> list[Pattern]:
    """A relation between objects, objects with a value, and objects without something."""
    references = metamodel.references
    found: list[Pattern] = []
    r = dice.one(references)
    x, y, z, v = (Variable(name) for name in "xyzv")
    path = PathConstraint(r.owner, (r.name,), x, y)
    bodies = [Body((path,))]
    back = [
        o for o in references if metamodel.may_overlap(o.owner, r.target) and metamodel.may_overlap(o.target, r.owner)
    ]
    if back and dice.chance(60):
        other = dice.one(back)
        bodies.append(Body((PathConstraint(other.owner, (other.name,), y, x),)))
    ends = (Parameter("x", r.owner), Parameter("y", r.target))
    found.append(Pattern("linked", ends, tuple(bodies)))
    found.append(
        Pattern(
            "alone",
            (ends[0],),
            (Body((TypeConstraint(r.owner, x), Negation(replace(path, target=Variable("_"))))),),
        )
    )
    if metamodel.attributes:
        a = dice.one(metamodel.attributes)
        body = Body((PathConstraint(a.owner, (a.name,), x, v), PathConstraint(a.owner, (a.name,), z, v)))
        type_ = a.type.name if isinstance(a.type, EnumType) else a.type.value
        found.append(
            Pattern("valued", (Parameter("x", a.owner), Parameter("z", a.owner), Parameter("v", type_)), (body,))
        )
    return found


# --- rules


@dataclass
class Scope:
    """The names that a part of a rule sees."""

    dice: Dice
    state: State
    patterns: Sequence[Pattern]
    classes: dict[str, str] = field(default_factory=dict)
    """Static classes of objects."""
    data: dict[str, AttributeType] = field(default_factory=dict)
    witness: dict[str, Thing] = field(default_factory=dict)
    counter: list[int] = field(default_factory=lambda: [0])

    def inner(self) -> Scope:
        return replace(self, classes=dict(self.classes), data=dict(self.data), witness=dict(self.witness))

    @property
    def metamodel(self) -> Metamodel:
        return self.state.metamodel

    def fresh(self, letter: str) -> str:
        self.counter[0] += 1
        return f"{letter}{self.counter[0]}"

    def thing(self, name: str) -> Thing | None:
        return self.witness.get(name)

    def object(self, cls: str, thing: Thing | None) -> str:
        """A new name for an object."""
        name = self.fresh("x")
        self.classes[name] = cls
        if thing is not None:
            self.witness[name] = thing
        return name

    def features(self, name: str) -> list[Attribute | Reference]:
        return list(self.metamodel.features(self.classes[name]).values())

    def attributes(self, name: str) -> list[Attribute]:
        return [one for one in self.features(name) if isinstance(one, Attribute)]

    def references(self, name: str) -> list[Reference]:
        return [one for one in self.features(name) if isinstance(one, Reference)]

    def fitting(self, cls: str) -> list[str]:
        """Names of objects that are surely of a class."""
        return [name for name, own in self.classes.items() if self.metamodel.is_a(own, cls)]


def above(scope: Scope, thing: Thing) -> str:
    """A class of an object."""
    return scope.dice.one(scope.metamodel.supertypes(scope.state.classes[thing]))


def random_left(scope: Scope, size: int) -> LeftSide:
    """Nodes, arrows and constraints that mostly hold for the witness."""
    dice, state = scope.dice, scope.state
    nodes: list[RuleNode] = []
    edges: list[RuleEdge] = []
    constraints: list[Constraint] = []
    things = sorted(state.classes)
    new: list[str] = []
    for _ in range(size):
        taken = {scope.witness[name] for name in scope.witness}
        free = [thing for thing in things if thing not in taken] or things
        roll = dice.number(0, 9)
        if scope.classes and roll < 7:
            grow(scope, nodes, edges, free)
        elif free:
            thing = dice.one(free)
            cls = above(scope, thing)
            name = scope.object(cls, thing)
            if dice.chance(90):
                nodes.append(RuleNode(name, cls))
            else:
                constraints.append(TypeConstraint(cls, Variable(name)))
            new.append(name)
    for _ in range(dice.one([0, 0, 0, 1, 1, 2])):
        made = constraint(scope)
        if made is not None:
            constraints.append(made)
    return LeftSide(tuple(nodes), tuple(edges), tuple(constraints))


def grow(scope: Scope, nodes: list[RuleNode], edges: list[RuleEdge], free: Sequence[Thing]) -> None:
    """An arrow from a known name, to a new name or a known one."""
    dice, state = scope.dice, scope.state
    source = dice.one(list(scope.classes))
    references = scope.references(source)
    if not references:
        return
    start = scope.thing(source)
    real = [(r, t) for r, s, t in sorted(state.links) if s == start and any(one.name == r for one in references)]
    if real and dice.chance(85):
        name, thing = dice.one(real)
    else:
        name, thing = dice.one(references).name, None
    reference = state.reference(name)
    known = [o for o, cls in scope.classes.items() if scope.metamodel.may_overlap(cls, reference.target)
             and (thing is None or scope.thing(o) == thing)]  # fmt: skip
    closure = dice.one(["+", "*"]) if scope.metamodel.is_a(reference.target, reference.owner) and dice.chance(8) else ""
    if known and (dice.chance(70) or thing is None):
        target = dice.one(known)
    elif dice.chance(5):
        target = "_"
    else:
        cls = reference.target
        if thing is not None and dice.chance(50):
            below = [c for c in scope.metamodel.supertypes(state.classes[thing]) if scope.metamodel.is_a(c, cls)]
            cls = dice.one(below)
        target = scope.object(cls, thing)
        if cls != reference.target or dice.chance(60):
            nodes.append(RuleNode(target, cls))
    edges.append(RuleEdge(source, name, target, closure))  # type: ignore[arg-type]


def constraint(scope: Scope) -> Constraint | None:
    """Something a query can say."""
    dice, metamodel = scope.dice, scope.metamodel
    if not scope.classes:
        return None
    name = dice.one(list(scope.classes))
    roll = dice.number(0, 13)
    attributes, references = scope.attributes(name), scope.references(name)
    if roll < 3 and attributes:
        attribute = dice.one(attributes)
        known = [v for v, type_ in scope.data.items() if type_ == attribute.type]
        if known and dice.chance(50):
            return PathConstraint(attribute.owner, (attribute.name,), Variable(name), Variable(dice.one(known)))
        fresh = scope.fresh("v")
        scope.data[fresh] = attribute.type
        return PathConstraint(attribute.owner, (attribute.name,), Variable(name), Variable(fresh))
    if roll < 5 and references:
        return path(scope, name, dice.one(references))
    if roll < 6:
        below = [c for c in metamodel.classes if metamodel.may_overlap(c, scope.classes[name])] or [scope.classes[name]]
        made: TypeConstraint | PathConstraint | PatternCall = TypeConstraint(dice.one(below), Variable(name))
        return Negation(made) if dice.chance(40) else made
    if roll < 9:
        return call(scope, name)
    if roll < 10 and references:
        reference = dice.one(references)
        others = [Variable("_"), *map(Variable, scope.fitting(reference.target))]
        return Negation(PathConstraint(reference.owner, (reference.name,), Variable(name), dice.one(others)))
    if roll < 11:
        others = [
            o for o, cls in scope.classes.items() if o != name and metamodel.may_overlap(cls, scope.classes[name])
        ]
        return Comparison(dice.one(["==", "!=", "!="]), Variable(name), Variable(dice.one(others))) if others else None
    if roll < 12 and references:
        reference = dice.one(references)
        over = PathConstraint(reference.owner, (reference.name,), Variable(name), Variable("_"))
        fresh = scope.fresh("n")
        scope.data[fresh] = Scalar.INT
        return Comparison("==", Variable(fresh), Aggregate("count", over))
    if roll < 13:
        value = number(scope)
        if value is not None:
            fresh = scope.fresh("n")
            scope.data[fresh] = Scalar.INT
            return Comparison("==", Variable(fresh), Evaluation(value))
    test = condition(scope)
    return None if test is None else Check(test)


def path(scope: Scope, name: str, reference: Reference) -> Constraint:
    """A path of one or two references from a name."""
    dice, metamodel = scope.dice, scope.metamodel
    features, cls = [reference.name], reference.target
    more = [one for one in metamodel.features(cls).values() if isinstance(one, Reference)]
    if more and dice.chance(40):
        second = dice.one(more)
        features.append(second.name)
        cls = second.target
    closure = Closure.ONCE
    if metamodel.is_a(cls, reference.owner) and dice.chance(25):
        closure = dice.one([Closure.PLUS, Closure.STAR])
    known = [o for o, own in scope.classes.items() if metamodel.may_overlap(own, cls)]
    target = dice.one(known) if known and dice.chance(60) else scope.object(cls, None)
    return PathConstraint(reference.owner, tuple(features), Variable(name), Variable(target), closure)


def call(scope: Scope, name: str) -> Constraint | None:
    """A call of a pattern, maybe negated or counted."""
    dice, metamodel = scope.dice, scope.metamodel
    pattern = dice.one(scope.patterns)
    if not metamodel.may_overlap(pattern.parameters[0].type or "", scope.classes[name]):
        return None
    negative = dice.chance(35)
    arguments = [Variable(name)]
    for parameter in pattern.parameters[1:]:
        cls = parameter.type or ""
        if cls in metamodel.classes:
            known = [o for o, own in scope.classes.items() if metamodel.may_overlap(own, cls)]
            if known and dice.chance(50):
                arguments.append(Variable(dice.one(known)))
            elif negative or dice.chance(15):
                arguments.append(Variable("_"))
            else:
                arguments.append(Variable(scope.object(cls, None)))
        elif negative or dice.chance(50):
            arguments.append(Variable("_"))
        else:
            fresh = scope.fresh("v")
            scope.data[fresh] = type_named(metamodel, cls)
            arguments.append(Variable(fresh))
    made = PatternCall(pattern.name, tuple(arguments))
    if negative:
        return Negation(made)
    if (
        len(arguments) == 2
        and metamodel.may_overlap(pattern.parameters[0].type or "", pattern.parameters[1].type or "")
        and dice.chance(15)
    ):
        return replace(made, closure=dice.one([Closure.PLUS, Closure.STAR]))
    return made


def type_named(metamodel: Metamodel, name: str) -> AttributeType:
    return next((enum for enum in metamodel.enums.values() if enum.name == name), None) or Scalar(name)


def number(scope: Scope) -> Expression | None:
    """An expression of type int."""
    leaves = values(scope, Scalar.INT)
    if not leaves:
        return None
    leaf = scope.dice.one(leaves)
    if scope.dice.chance(40):
        return Binary(scope.dice.one(["+", "-", "*"]), leaf, Constant(scope.dice.number(1, 2)))
    return leaf


def values(scope: Scope, type_: AttributeType) -> list[Expression]:
    """Where a value of a type can be read."""
    found: list[Expression] = [Variable(name) for name, own in scope.data.items() if own == type_]
    for name in scope.classes:
        found += [
            Navigation(Variable(name), one.name) for one in scope.attributes(name) if one.type == type_ and not one.many
        ]
        for reference in scope.references(name):
            if not reference.many:
                inner = Navigation(Variable(name), reference.name)
                features = scope.metamodel.features(reference.target).values()
                found += [
                    Navigation(inner, one.name)
                    for one in features
                    if isinstance(one, Attribute) and one.type == type_ and not one.many
                ]
    return found


def literal(dice: Dice, type_: AttributeType) -> Constant | EnumLiteral:
    value = dice.one(domain(type_))
    return EnumLiteral(type_.name, str(value)) if isinstance(type_, EnumType) else Constant(value)


def value(scope: Scope, type_: AttributeType) -> Expression:
    """An expression of a type."""
    dice = scope.dice
    if type_ is Scalar.INT and dice.chance(50):
        made = number(scope)
        if made is not None:
            return made
    known = values(scope, type_)
    if known and dice.chance(50):
        leaf = dice.one(known)
        test = condition(scope) if dice.chance(15) else None
        return leaf if test is None else Conditional(test, leaf, literal(dice, type_))
    return literal(dice, type_)


def condition(scope: Scope) -> Expression | None:
    """A truth value."""
    dice = scope.dice
    roll = dice.number(0, 3)
    if roll == 0:
        single = [
            Navigation(Variable(name), one.name)
            for name in scope.classes
            for one in scope.features(name)
            if not one.many
        ]
        if single:
            return Binary(dice.one(["==", "!="]), dice.one(single), Constant(None))
    type_ = dice.one([Scalar.INT, Scalar.INT, Scalar.BOOL, Scalar.STRING, scope_enum(scope)])
    known = values(scope, type_)
    if not known:
        return None
    operators = ["==", "!=", "<", "<="] if type_ is Scalar.INT else ["==", "!="]
    right = dice.one(known) if dice.chance(40) else literal(dice, type_)
    test = Binary(dice.one(operators), dice.one(known), right)
    if roll == 1:
        other = condition(scope)
        return test if other is None else Binary(dice.one(["&&", "||"]), test, other)
    return test


def scope_enum(scope: Scope) -> EnumType:
    return next(iter(scope.metamodel.enums.values()))


# --- right sides


@dataclass
class Right:
    """A right side in the making."""

    scope: Scope
    left: LeftSide
    deleted: set[str] = field(default_factory=set)

    def objects(self) -> list[str]:
        return [name for name in self.scope.classes if name not in self.deleted]

    def arrows(self) -> list[RuleEdge]:
        return [e for e in self.left.edges if not e.closure and "_" not in (e.source, e.target)]


def random_modification(scope: Scope, left: LeftSide) -> Modification:
    right = Right(scope, left)
    actions = [action(right) for _ in range(scope.dice.one([1, 1, 2, 2, 3, 4]))]
    return Modification(tuple(one for one in actions if one is not None))


def action(right: Right) -> object:
    scope, dice = right.scope, right.scope.dice
    objects = right.objects()
    roll = dice.number(0, 19)
    if not objects or roll < 3:
        return creation(right)
    name = dice.one(objects)
    if roll < 5:
        right.deleted.add(name)
        return DeleteNode(Variable(name))
    if roll < 7:
        edge = some_arrow(right, name)
        return DeleteEdge(edge) if edge else None
    if roll < 13:
        return assignment(right, name)
    if roll < 15:
        return RetypeAction(Variable(name), dice.one(concrete(scope.metamodel)))
    if roll < 16:
        edge = some_arrow(right, name)
        if edge is None:
            return None
        others = [o for o in scope.fitting(scope.state.reference(edge.reference).target) if o in objects]
        return RedirectAction(edge, Variable(dice.one(others))) if others else None
    if roll < 17:
        others = [o for o in objects if o != name]
        if not others:
            return None
        kept = dice.one(others)
        right.deleted.add(name)
        return MergeAction(Variable(kept), Variable(name))
    if roll < 18:
        holders = [(r.name, o) for o in objects for r in scope.references(o) if r.containment
                   and scope.metamodel.is_a(scope.classes[name], r.target)]  # fmt: skip
        if not holders:
            return None
        reference, holder = dice.one(holders)
        return MoveAction(Variable(name), Variable(holder), reference)
    edge = new_edge(right, name)
    return CreateAction((), (edge,)) if edge else None


def some_arrow(right: Right, name: str) -> RuleEdge | None:
    """An arrow of the left side, or now and then one that may not be there."""
    dice, arrows = right.scope.dice, right.arrows()
    return dice.one(arrows) if arrows and dice.chance(80) else new_edge(right, name)


def concrete(metamodel: Metamodel) -> list[str]:
    return [cls.name for cls in metamodel.class_list if not cls.abstract]


def new_edge(right: Right, source: str) -> RuleEdge | None:
    scope, dice = right.scope, right.scope.dice
    choices = [
        RuleEdge(source, reference.name, target)
        for reference in scope.references(source)
        for target in scope.fitting(reference.target)
        if target not in right.deleted
    ]
    return dice.one(choices) if choices else None


def creation(right: Right) -> CreateAction:
    """A new object, with values and links."""
    scope, dice = right.scope, right.scope.dice
    node = new_node(right)
    edges: list[RuleEdge] = []
    if dice.chance(50):
        holders = [
            RuleEdge(o, r.name, node.name)
            for o in right.objects()
            for r in scope.references(o)
            if o != node.name and scope.metamodel.is_a(scope.classes[node.name], r.target)
        ]
        if holders:
            edges.append(dice.one(holders))
    if dice.chance(40):
        edge = new_edge(right, node.name)
        edges += [edge] if edge else []
    return CreateAction((node,), tuple(edges))


def new_node(right: Right) -> RuleNode:
    scope, dice = right.scope, right.scope.dice
    cls = dice.one(concrete(scope.metamodel))
    given: dict[str, Assignment] = {}
    for _ in range(dice.one([0, 0, 1, 2])):
        features = list(scope.metamodel.features(cls).values())
        if features:
            feature = dice.one(features)
            made = assigned(right, feature)
            if made is not None:
                given[feature.name] = Assignment(feature.name, made)
    name = scope.object(cls, None)
    return RuleNode(name, cls, tuple(given.values()))


def assigned(right: Right, feature: Attribute | Reference) -> Expression | tuple[Expression, ...] | None:
    """What a feature may be set to."""
    scope, dice = right.scope, right.scope.dice
    readable = replace(
        scope, classes={n: c for n, c in scope.classes.items() if n in scope.witness or n in matched(right)}
    )
    if isinstance(feature, Attribute) and feature.many:
        if dice.chance(10):
            return Constant(None)
        listed = tuple(value(readable, feature.type) for _ in range(dice.one([0, 1, 1, 2])))
        return listed if len(listed) != 1 or dice.chance(30) else listed[0]
    if isinstance(feature, Attribute):
        return Constant(None) if dice.chance(5) else value(readable, feature.type)
    targets = [o for o in scope.fitting(feature.target) if o not in right.deleted]
    if dice.chance(12):
        return Constant(None)
    if feature.many and dice.chance(60):
        return tuple(Variable(dice.one(targets)) for _ in range(dice.number(0, 2))) if targets else ()
    if dice.chance(20):
        paths = [
            Navigation(Variable(name), one.name)
            for name in readable.classes
            for one in readable.references(name)
            if not one.many and scope.metamodel.is_a(one.target, feature.target)
        ]
        if paths:
            return dice.one(paths)
    return Variable(dice.one(targets)) if targets else None


def matched(right: Right) -> set[str]:
    """Names that the left side has, so that their values can be read."""
    nodes = {node.name for node in right.left.nodes}
    return nodes | {end for edge in right.left.edges for end in (edge.source, edge.target)}


def assignment(right: Right, name: str) -> SetAction | None:
    scope, dice = right.scope, right.scope.dice
    features = scope.features(name)
    if not features:
        return None
    feature = dice.one(features)
    made = assigned(right, feature)
    if made is None:
        return None
    operator = "="
    if isinstance(feature, Reference) and feature.many and dice.chance(60):
        operator = dice.one(["+=", "-="])
    if feature.many and isinstance(feature, Attribute):
        operator = "=" if made == Constant(None) else dice.one(["=", "+=", "+=", "-="])
    elif isinstance(feature, Attribute) and dice.chance(40):
        if feature.type in (Scalar.INT, Scalar.FLOAT):
            operator = dice.one(["+=", "-="])
        elif feature.type is Scalar.STRING:
            operator, made = "+=", Constant("a")
    return SetAction(Variable(name), feature.name, operator, made)  # type: ignore[arg-type]


def random_graph(scope: Scope, left: LeftSide, own: Sequence[str]) -> RightSide:
    """The graph after the rule: most of the left side, and something new."""
    dice = scope.dice
    right = Right(scope, left)
    nodes: list[RuleNode] = []
    actions: list[object] = []
    types = {node.name: node.type for node in left.nodes}
    for name in own:
        if dice.chance(80):
            cls = types.get(name)
            if cls is not None and dice.chance(20):
                cls = dice.one(concrete(scope.metamodel))
            nodes.append(RuleNode(name, cls if dice.chance(50) else None))
        else:
            right.deleted.add(name)
            if dice.chance(50):
                actions.append(DeleteNode(Variable(name)))
    edges = [e for e in right.arrows() if not {e.source, e.target} & right.deleted and dice.chance(75)]
    nodes += [new_node(right) for _ in range(dice.one([0, 0, 1, 2]))]
    for _ in range(dice.one([0, 0, 1, 2])):
        objects = right.objects()
        edge = new_edge(right, dice.one(objects)) if objects else None
        edges += [edge] if edge else []
    for _ in range(dice.one([0, 0, 1])):
        objects = [o for o in right.objects() if o in scope.witness]
        made = assignment(right, dice.one(objects)) if objects else None
        actions += [made] if made else []
    return RightSide(tuple(nodes), tuple(edges), tuple(actions))  # type: ignore[arg-type]


def own_nodes(left: LeftSide, outside: set[str]) -> list[str]:
    """The nodes of a left side that are its own."""
    ends = [end for edge in left.edges for end in (edge.source, edge.target)]
    return [
        name for name in dict.fromkeys([*(n.name for n in left.nodes), *ends]) if name != "_" and name not in outside
    ]


def random_right(scope: Scope, left: LeftSide, outside: set[str]) -> RightSide | Modification | None:
    roll = scope.dice.number(0, 19)
    if roll < 1:
        return None
    return random_graph(scope, left, own_nodes(left, outside)) if roll < 7 else random_modification(scope, left)


# --- blocks and rules


def random_block(scope: Scope, depth: int, conditional: bool, made: Mapping[str, str] | None = None) -> RuleBlock:
    """A block; one inside a condition is a condition. What encloses it may make objects for its right side."""
    dice = scope.dice
    kinds = ["not", "require"] if conditional else ["not", "require", "forall", "forall", "forall+", "optional"]
    kind = dice.one(kinds)
    inner = scope.inner()
    outside = set(inner.classes)
    left = random_left(inner, dice.one([1, 1, 2]))
    condition = kind in ("not", "require")
    right, seen, known = None, inner.inner(), dict(made or {})
    if not condition:
        inner.classes |= known
        right = random_right(inner, left, outside | set(known))
        known = {name: cls for name, cls in inner.classes.items() if name not in seen.classes}
    blocks = [random_block(seen, depth + 1, condition, known)] if depth < 2 and dice.chance(30) else []
    return RuleBlock(kind, left, tuple(blocks), right)  # type: ignore[arg-type]


def random_rule(dice: Dice, state: State, patterns: Sequence[Pattern], name: str = "r") -> Rule:
    scope = Scope(dice, state, patterns)
    parameters: list[Parameter] = []
    things = sorted(state.classes)
    for _ in range(dice.one([0, 0, 0, 1, 1, 2])):
        if dice.chance(30):
            type_ = dice.one([Scalar.INT, Scalar.STRING, scope_enum(scope)])
            given = scope.fresh("g")
            scope.data[given] = type_
            spelled = type_.name if isinstance(type_, EnumType) else type_.value
            parameters.append(Parameter(given, spelled, dice.one([None, "in"])))
        else:
            thing = dice.one(things)
            cls = above(scope, thing)
            parameters.append(Parameter(scope.object(cls, thing), cls, dice.one([None, None, "in"])))
    left = random_left(scope, dice.one([0, 1, 2, 2, 3, 3]))
    outside = {parameter.name for parameter in parameters}
    if dice.chance(10):
        outputs = [n for n in own_nodes(left, outside) if n in {node.name for node in left.nodes}]
        if outputs:
            out = dice.one(outputs)
            parameters.append(Parameter(out, scope.classes[out], "out"))
            outside.add(out)
    objects = list(scope.classes)
    seen = scope.inner()
    right = random_right(scope, left, outside)
    made = {name: cls for name, cls in scope.classes.items() if name not in seen.classes}
    conditions = [random_block(seen, 0, True) for _ in range(dice.one([0, 0, 0, 1, 1, 2]))]
    blocks = [*conditions, *(random_block(seen, 0, False, made) for _ in range(dice.one([0, 0, 0, 1, 1, 2])))]
    if blocks and dice.chance(50):
        blocks = blocks[::-1]
    groups = []
    if len(objects) > 1 and dice.chance(20):
        first = dice.one(objects)
        groups.append((first, dice.one([o for o in objects if o != first])))
    return Rule(
        name,
        tuple(parameters),
        left,
        tuple(blocks),
        right,
        semantics="dpo" if dice.chance(50) else "spo",
        injective=dice.chance(70),
        homomorphic=tuple(groups),
    )
