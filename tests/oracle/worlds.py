"""Random metamodels, models, edits and patterns: what the matchers are compared on.

Everything is small on purpose, so that coincidences (a link to itself, two equal values, an empty extent) are
frequent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from random import Random
from typing import TypeVar

from hypothesis import strategies as st

from envgraph.errors import RuleError, Severity
from envgraph.graph import Model
from envgraph.metamodel import Attribute, AttributeType, Class, EnumType, Metamodel, Reference, Scalar, Value
from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    Library,
    Navigation,
    Negation,
    ObjectType,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    StaticType,
    Term,
    TypeConstraint,
    Unary,
    Variable,
)

Item = TypeVar("Item")

COLOUR = EnumType("Colour", ("red", "green"))
DOMAINS: dict[AttributeType, tuple[Value, ...]] = {
    Scalar.INT: (0, 1, 2),
    Scalar.FLOAT: (0.0, 0.5, 1.0),
    Scalar.BOOL: (False, True),
    Scalar.STRING: ("", "a"),
    COLOUR: COLOUR.literals,
}


def domain(type_: AttributeType) -> tuple[Value, ...]:
    """Values to choose from."""
    return type_.literals if isinstance(type_, EnumType) else DOMAINS[type_]


class Dice:
    """Choices that follow from one number.

    Hypothesis draws the number and not each choice: its choices favour the simplest, and patterns made of the
    simplest choices find nothing.
    """

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)

    def number(self, low: int, high: int) -> int:
        """An int in low..high."""
        return self._random.randint(low, high)

    def one(self, items: Sequence[Item]) -> Item:
        """One of several."""
        return self._random.choice(items)

    def chance(self, percent: int) -> bool:
        """True so often."""
        return self._random.randrange(100) < percent


# --- metamodels and models


def random_metamodel(dice: Dice) -> Metamodel:
    """Two to four classes with a few features each."""
    names = ["A", "B", "C", "D"][: dice.number(2, 4)]
    features: dict[str, list[Attribute | Reference]] = {name: [] for name in names}
    for number in range(dice.number(1, 3)):
        attribute = Attribute(f"a{number}", dice.one(list(DOMAINS)))
        if dice.chance(35):
            bounds = {"lower": 0, "upper": dice.one([None, None, 2]), "unique": dice.chance(60)}
            attribute = replace(attribute, **bounds)
        features[dice.one(names)].append(attribute)
    for number in range(dice.number(2, 5)):
        owner, target = dice.one(names), dice.one(names)
        forward = Reference(f"r{number}", target, 0, dice.one([1, None, None, 2]))
        if dice.chance(12):
            forward = replace(forward, target=owner, opposite=forward.name)  # its own opposite
        elif dice.chance(40):
            kind = dice.number(0, 3)
            backward = Reference(f"o{number}", owner, 0, dice.one([1, None]), opposite=forward.name)
            forward = replace(forward, opposite=backward.name, containment=kind == 0)
            if kind == 0:
                backward = replace(backward, upper=1)
            features[target].append(backward)
        elif dice.chance(20):
            forward = replace(forward, containment=True)
        features[owner].append(forward)
    classes = []
    for position, name in enumerate(names):
        above = [names[dice.number(0, position - 1)]] if position and dice.chance(60) else []
        abstract = position < len(names) - 1 and dice.chance(25)
        classes.append(Class(name, abstract, tuple(above), tuple(features[name])))
    return Metamodel("random", tuple(classes), (COLOUR,))


def edit(dice: Dice, model: Model, thin: bool = False) -> None:
    """One random change; what the model refuses is not done.

    Args:
        dice: chooses.
        model: changed in place.
        thin: rather take something away.
    """
    metamodel = model.metamodel
    concrete = [cls.name for cls in metamodel.class_list if not cls.abstract]
    nodes = [node for cls in concrete for node in model.graph.exact_extent(cls)]
    kind = dice.one([2, 3, 4, 11, 11, 11]) if thin else dice.number(0, 11)
    if kind < 2 or len(nodes) < 2:
        model.graph.new(dice.one(concrete))
        return
    node = dice.one(nodes)
    try:
        if kind == 2:
            model.graph.delete(node, "spo")
        elif kind == 3:
            model.graph.retype(node, dice.one(concrete), lossy=True)
        elif kind < 6:
            attributes = [
                f for f in metamodel.features(model.graph.class_of(node)).values() if isinstance(f, Attribute)
            ]
            if attributes:
                _edit_value(dice, model, node, dice.one(attributes))
        else:
            _edit_link(dice, model, node, unlink=kind > 10)
    except RuleError:
        pass


def _edit_value(dice: Dice, model: Model, node: int, attribute: Attribute) -> None:
    values = domain(attribute.type)
    if not attribute.many:
        model.graph.set_value(node, attribute, dice.one([*values, None]))
    elif dice.chance(50):
        model.node(node)[attribute.name].append(dice.one(values))
    elif dice.chance(50):
        gone = dice.one(values)
        model.graph.set_value(node, attribute, [v for v in model.graph.values(node, attribute) if v != gone])
    else:
        several = [value for value in values for _ in range(dice.number(0, 2 - attribute.unique))]
        model.graph.set_value(node, attribute, several if dice.chance(50) else several[::-1])


def _edit_link(dice: Dice, model: Model, node: int, unlink: bool) -> None:
    features = model.metamodel.features(model.graph.class_of(node)).values()
    references = [f for f in features if isinstance(f, Reference)]
    if not references:
        return
    reference = dice.one(references)
    if unlink:
        targets = list(model.graph.targets(node, reference))
        if targets:
            model.graph.unlink(node, reference, dice.one(targets))
        return
    candidates = list(model.graph.extent(reference.target))
    if not candidates:
        return
    # Links from an object to itself are where relations that occur twice in a body meet.
    target = node if node in candidates and dice.chance(25) else dice.one(candidates)
    roll = dice.number(0, 9)
    if not reference.many and roll < 5:
        model.graph.set_target(node, reference, target)
    elif reference.many and roll < 1:
        model.graph.set_targets(node, reference, [each for each in candidates if dice.chance(40)])
    else:
        model.graph.link(node, reference, target)


# --- patterns


@dataclass
class Scope:
    """A body in the making: its variables and their types, and the paths that it has."""

    dice: Dice
    metamodel: Metamodel
    callable: Sequence[Pattern]
    partners: Sequence[Pattern] = ()
    variables: dict[str, StaticType] = field(default_factory=dict)
    paths: list[tuple[str, tuple[str, ...], StaticType]] = field(default_factory=list)
    fresh: int = 0

    def names(self, type_: StaticType) -> list[str]:
        """Variables that may stand where a type is expected."""
        return [name for name, own in self.variables.items() if self.fits(own, type_)]

    def fits(self, own: StaticType, type_: StaticType) -> bool:
        """Whether some value has both types."""
        if isinstance(own, ObjectType) and isinstance(type_, ObjectType):
            return self.metamodel.may_overlap(own.cls, type_.cls)
        return own == type_

    def new(self, type_: StaticType) -> str:
        """A new local variable."""
        self.fresh += 1
        name = f"x{self.fresh}"
        self.variables[name] = type_
        return name

    def term(self, type_: StaticType, positive: bool = True) -> Term:
        """An argument: mostly a known variable."""
        known = self.names(type_)
        roll = self.dice.number(0, 9)
        if not isinstance(type_, ObjectType) and self.dice.chance(25):
            return self.literal(type_)
        if roll < 6 and known:
            return Variable(self.dice.one(known))
        if roll < 9 and positive:
            return Variable(self.new(type_))
        return Variable("_")

    def literal(self, type_: AttributeType) -> Constant | EnumLiteral:
        """A constant."""
        value = self.dice.one(DOMAINS[type_])
        if isinstance(type_, EnumType):
            assert isinstance(value, str)
            return EnumLiteral(type_.name, value)
        return Constant(value)


def type_of(name: str | None) -> StaticType:
    """The type that a declared parameter has."""
    assert name is not None
    if name == COLOUR.name:
        return COLOUR
    return next((scalar for scalar in Scalar if scalar.value == name), ObjectType(name))


def relation(scope: Scope, positive: bool = True) -> Relation:
    """A type constraint, path or call."""
    dice = scope.dice
    roll = dice.number(0, 9)
    if roll < 2:
        cls = dice.one(list(scope.metamodel.classes))
        return TypeConstraint(
            cls, scope.term(ObjectType(cls), positive), exact=dice.chance(15) and cls in _concrete(scope)
        )
    called = [*scope.callable, *(scope.partners * 2 if positive else ())]
    # What would otherwise be seldom: closures of patterns, and patterns with closures under `neg` and `count`.
    special = [each for each in scope.callable if (_steps(scope, each) if positive else _closed(each))]
    if special and roll < 5 and dice.chance(40):
        return call(scope, dice.one(special), positive)
    if roll < 7 or not called:
        return path(scope, positive)
    return call(scope, dice.one(called), positive)


def _steps(scope: Scope, called: Pattern) -> bool:
    """Whether a pattern may be followed by a closure."""
    types = [type_of(parameter.type) for parameter in called.parameters]
    return len(types) == 2 and scope.fits(*types)


def _closed(called: Pattern) -> bool:
    """Whether a pattern has a closure."""
    return any(
        isinstance(each, PathConstraint | PatternCall) and each.closure is not Closure.ONCE
        for body in called.bodies
        for each in body.constraints
    )


def _concrete(scope: Scope) -> set[str]:
    return {cls.name for cls in scope.metamodel.class_list if not cls.abstract}


def path(scope: Scope, positive: bool) -> Relation:
    """A path of one or two steps, sometimes with a closure."""
    dice, metamodel = scope.dice, scope.metamodel
    # The same relation, positive and under `neg` or `count`.
    if not positive and scope.paths and dice.chance(40):
        cls, features, last = dice.one(scope.paths)
        return PathConstraint(cls, features, scope.term(ObjectType(cls), positive), scope.term(last, positive))
    cls = dice.one([name for name in metamodel.classes if metamodel.features(name)] or list(metamodel.classes))
    steps: list[str] = []
    current: StaticType = ObjectType(cls)
    for _ in range(dice.one([1, 1, 1, 2])):
        features = list(metamodel.features(current.cls).values()) if isinstance(current, ObjectType) else []
        if not features:
            break
        feature = dice.one(features)
        steps.append(feature.name)
        current = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
    source = scope.term(ObjectType(cls), positive)
    if not steps:
        return TypeConstraint(cls, source)
    closure = Closure.ONCE
    if positive and scope.fits(current, ObjectType(cls)) and dice.chance(40):
        closure = dice.one([Closure.PLUS, Closure.STAR])
    # Without a class, as arrows in rules are written. (Not for a closure: there the class matters to every step.)
    if positive and closure is Closure.ONCE:
        scope.paths.append((cls, tuple(steps), current))
    written = "" if closure is Closure.ONCE and dice.chance(15) else cls
    return PathConstraint(written, tuple(steps), source, scope.term(current, positive), closure)


def call(scope: Scope, called: Pattern, positive: bool) -> PatternCall:
    """A call, sometimes with a closure."""
    types = [type_of(parameter.type) for parameter in called.parameters]
    closure = Closure.ONCE
    if positive and called not in scope.partners and _steps(scope, called) and scope.dice.chance(50):
        closure = scope.dice.one([Closure.PLUS, Closure.STAR])
    return PatternCall(called.name, tuple(scope.term(type_, positive) for type_ in types), closure)


def aggregate(scope: Scope) -> tuple[Aggregate, StaticType] | None:
    """An aggregate and the type of its value."""
    dice = scope.dice
    over = _over_numbers(scope) if dice.chance(60) else None
    if over is None:
        return Aggregate("count", relation(scope, positive=False)), Scalar.INT
    function = dice.one(["sum", "min", "max", "avg"])
    return Aggregate(function, over[0]), Scalar.FLOAT if function == "avg" else over[1]  # type: ignore[arg-type]


def _over_numbers(scope: Scope) -> tuple[Relation, StaticType] | None:
    """A call or path with a number for each tuple in place of `#`, and the type of the number; None without any."""
    dice = scope.dice
    calls = [
        (called, position)
        for called in scope.callable
        for position, parameter in enumerate(called.parameters)
        if parameter.type in ("int", "float")
    ]
    if calls and dice.chance(60):
        called, position = dice.one(calls)
        made = call(scope, called, positive=False)
        arguments = (*made.arguments[:position], ColumnMark(), *made.arguments[position + 1 :])
        return replace(made, arguments=arguments), type_of(called.parameters[position].type)
    for _ in range(3):
        over = path(scope, positive=False)
        if isinstance(over, PathConstraint):
            feature = _last(scope, over)
            if isinstance(feature, Attribute) and feature.type in (Scalar.INT, Scalar.FLOAT):
                return replace(over, target=ColumnMark()), feature.type
    return None


def _last(scope: Scope, over: PathConstraint) -> Attribute | Reference | None:
    if not over.type:
        return None
    cls, found = over.type, None
    for name in over.features:
        found = scope.metamodel.feature(cls, name)
        if isinstance(found, Reference):
            cls = found.target
    return found


def number(scope: Scope, depth: int = 0) -> Expression | None:
    """An expression of type int over known variables."""
    dice = scope.dice
    leaves: list[Expression] = [Variable(name) for name in scope.names(Scalar.INT)]
    for name, type_ in scope.variables.items():
        if isinstance(type_, ObjectType):
            for feature in scope.metamodel.features(type_.cls).values():
                if isinstance(feature, Attribute) and feature.type is Scalar.INT and not feature.many:
                    leaves.append(Navigation(Variable(name), feature.name))
    if not leaves:
        return None
    leaf = dice.one(leaves)
    roll = dice.number(0, 5)
    if roll < 3 or depth > 1:
        return leaf
    if roll == 3:
        return Binary(dice.one(["+", "-", "*", "/", "%"]), leaf, number(scope, depth + 1) or Constant(1))
    if roll == 4:
        return FunctionCall("max", (leaf, Constant(1)))
    return Conditional(Binary(">", leaf, Constant(0)), leaf, Unary("-", leaf))


def condition(scope: Scope) -> Expression | None:
    """A truth value over known variables."""
    dice = scope.dice
    roll = dice.number(0, 3)
    if roll == 0:
        data = [(name, type_) for name, type_ in scope.variables.items() if not isinstance(type_, ObjectType)]
        if data:
            name, type_ = dice.one(data)
            return Binary(dice.one(["==", "!="]), Variable(name), scope.literal(type_))
    if roll == 1:
        links = [
            Navigation(Variable(name), feature.name)
            for name, type_ in scope.variables.items()
            if isinstance(type_, ObjectType)
            for feature in scope.metamodel.features(type_.cls).values()
            if not feature.many
        ]
        if links:
            return Binary(dice.one(["==", "!="]), dice.one(links), Constant(None))
    left, right = number(scope), number(scope)
    if left is None or right is None:
        return None
    test = Binary(dice.one(["==", "!=", "<", "<="]), left, right)
    if roll == 2:
        other = condition(scope)
        if other is not None:
            return Binary(dice.one(["&&", "||"]), test, other)
    return test


def constraint(scope: Scope) -> Constraint | None:
    """One constraint, or None if the dice want one that is not possible."""
    dice = scope.dice
    roll = dice.number(0, 19)
    if roll < 9:
        return relation(scope)
    if roll < 12:
        return Negation(relation(scope, positive=False))
    if roll < 14:
        name = dice.one(list(scope.variables) or ["_"])
        others = [o for o in scope.names(scope.variables[name]) if o != name] if name != "_" else []
        if not others:
            return None
        return Comparison(dice.one(["==", "!=", "!="]), Variable(name), Variable(dice.one(others)))
    if roll < 17:
        made = aggregate(scope)
        if made is None:
            return None
        known = scope.names(made[1])
        return Comparison("==", Variable(dice.one(known) if known and dice.chance(60) else scope.new(made[1])), made[0])
    if roll < 18:
        value = number(scope)
        known = scope.names(Scalar.INT)
        name = dice.one(known) if known and dice.chance(60) else scope.new(Scalar.INT)
        return None if value is None else Comparison("==", Variable(name), Evaluation(value))
    test = condition(scope)
    return None if test is None else Check(test)


def random_tangled_constraints(scope: Scope) -> list[Constraint]:
    """One relation positive, and negated or counted beside it: see `combine_positive_and_negative`."""
    dice = scope.dice
    calls = [each for each in scope.callable if len(each.parameters) > 1]
    if calls and dice.chance(60):
        called = dice.one(calls)
        terms = [Variable("_")] * len(called.parameters)
        return combine_positive_and_negative(
            scope, PatternCall(called.name, tuple(terms)), [type_of(p.type) for p in called.parameters]
        )
    links = [
        (PathConstraint(cls, (feature.name,), Variable("_"), Variable("_")), ObjectType(cls), feature)
        for cls in scope.metamodel.classes
        for feature in scope.metamodel.features(cls).values()
    ]
    if not links:
        return []
    over, source, feature = dice.one(links)
    target = ObjectType(feature.target) if isinstance(feature, Reference) else feature.type
    return combine_positive_and_negative(scope, over, [source, target])


def combine_positive_and_negative(
    scope: Scope, over: PatternCall | PathConstraint, types: Sequence[StaticType]
) -> list[Constraint]:
    """A relation positive, and negated or counted beside it, mostly with a single variable in common.

    A tuple that comes then takes away what others of its relation give, and with a fan-out in many places at once.
    """
    dice = scope.dice

    def made(positive: bool) -> PatternCall | PathConstraint:
        terms = [scope.term(type_, positive) for type_ in types]
        if not positive and dice.chance(60):
            shared = dice.number(0, len(terms) - 1)
            terms = [Variable("_")] * len(types)
            # Of a wrong type, now and then: that never holds.
            known = list(scope.variables) if dice.chance(5) else scope.names(types[shared])
            terms[shared] = Variable(dice.one(known or ["_"]))
        return with_terms(over, terms)

    found: list[Constraint] = [made(True) for _ in range(dice.one([1, 1, 2]))]
    for _ in range(dice.one([1, 1, 2])):
        if dice.chance(60):
            found.append(Negation(made(False)))
        else:
            counted = Aggregate("count", made(False))
            known = scope.names(Scalar.INT)
            number = dice.one(known) if known and dice.chance(50) else scope.new(Scalar.INT)
            found.append(Comparison("==", Variable(number), counted))
    return found


def with_terms(over: PatternCall | PathConstraint, terms: Sequence[Term]) -> PatternCall | PathConstraint:
    """The relation with other arguments."""
    if isinstance(over, PatternCall):
        return replace(over, arguments=tuple(terms))
    return replace(over, source=terms[0], target=terms[1])


def parameters(dice: Dice, metamodel: Metamodel) -> tuple[Parameter, ...]:
    """Typed parameters, seldom none, at most three."""
    types = [*metamodel.classes, *metamodel.classes, "int", dice.one(["Colour", "float"])]
    size = 0 if dice.chance(5) else dice.one([1, 2, 2, 3])
    return tuple(Parameter(f"p{number}", dice.one(types)) for number in range(size))


def body(
    dice: Dice,
    metamodel: Metamodel,
    own: tuple[Parameter, ...],
    callable: Sequence[Pattern],
    partners: Sequence[Pattern],
) -> Body:
    """A random body; a data parameter is always the value of some attribute, so that it can be enumerated."""
    scope = Scope(dice, metamodel, callable, partners, {p.name: type_of(p.type) for p in own})
    constraints: list[Constraint] = []
    for parameter in own:
        if parameter.type not in metamodel.classes:
            owners = [
                (cls, feature.name)
                for cls in metamodel.classes
                for feature in metamodel.features(cls).values()
                if isinstance(feature, Attribute) and feature.type == type_of(parameter.type)
            ]
            if owners:
                cls, name = dice.one(owners)
                source = scope.term(ObjectType(cls))
                constraints.append(PathConstraint(cls, (name,), source, Variable(parameter.name)))
            else:
                kind = type_of(parameter.type)
                assert not isinstance(kind, ObjectType)
                constraints.append(Comparison("==", Variable(parameter.name), scope.literal(kind)))
    if partners and dice.chance(60):
        constraints.append(call(scope, dice.one(partners), positive=True))
    if dice.chance(20):
        constraints.extend(random_tangled_constraints(scope))
    for _ in range(dice.one([1, 1, 2, 3, 4, 5, 6])):  # of one relation alone is what can be inlined everywhere
        made = constraint(scope)
        if made is not None:
            constraints.append(made)
    return Body(tuple(constraints) or (TypeConstraint(dice.one(list(metamodel.classes)), Variable("_")),))


def random_library(dice: Dice, metamodel: Metamodel) -> Library:
    """One to five patterns that call earlier ones, and sometimes each other."""
    library = Library(metamodel)
    wanted = dice.number(1, 4)
    while len(library.patterns) < wanted:
        names = [f"q{len(library.patterns) + offset}" for offset in range(dice.one([1, 1, 2]))]
        heads = [Pattern(name, parameters(dice, metamodel), ()) for name in names]
        partners = heads if dice.chance(35) else []
        group = [
            replace(
                head,
                bodies=tuple(
                    body(dice, metamodel, head.parameters, library.patterns, partners)
                    for _ in range(dice.one([1, 1, 2, 3]))
                ),
            )
            for head in heads
        ]
        add(library, group)
    if dice.chance(20):
        add_closure_patterns(dice, library)
    return library


def add_closure_patterns(dice: Dice, library: Library) -> None:
    """Add a step in which a relation is tangled, its closure, and what counts, sums up and negates that closure."""
    metamodel = library.metamodel
    links = [
        (cls, feature)
        for cls in metamodel.classes
        for feature in metamodel.features(cls).values()
        if isinstance(feature, Reference) and metamodel.may_overlap(cls, feature.target)
    ]
    if not links:
        return
    cls, link = dice.one(links)
    ends = (Parameter("p0", cls), Parameter("p1", link.target))
    types = [type_of(parameter.type) for parameter in ends]

    def grow(heads: tuple[Parameter, ...], *bodies: Sequence[Constraint]) -> Pattern:
        name = f"q{len(library.patterns)}"
        add(library, [Pattern(name, heads, tuple(Body(tuple(each)) for each in bodies))])
        return library.patterns[-1]

    def scope() -> Scope:
        return Scope(dice, metamodel, library.patterns[-3:], (), {p.name: type_of(p.type) for p in ends})

    over = PathConstraint(cls, (link.name,), Variable("p0"), Variable("p1"))
    step = grow(
        ends,
        [over, *combine_positive_and_negative(scope(), over, types)],
        *([[over]] if dice.chance(20) else []),
    )
    followed = PatternCall(step.name, (over.source, over.target), dice.one([Closure.PLUS, Closure.STAR]))
    closed = grow(ends, [followed, *(combine_positive_and_negative(scope(), over, types) if dice.chance(25) else [])])
    near, far = dice.one([(0, 1), (1, 0)])

    def reaching(other: Term) -> PatternCall:
        terms = (Variable("p0"), other)
        return PatternCall(closed.name, (terms[near], terms[far]))

    heads = (Parameter("p0", ends[near].type), Parameter("n", "int"))
    total = Aggregate("count", reaching(Variable("_")))
    numbers = [
        feature.name
        for feature in metamodel.features(types[far].cls).values()  # type: ignore[union-attr]
        if isinstance(feature, Attribute) and feature.type is Scalar.INT
    ]
    if numbers and dice.chance(60):
        value = PathConstraint(str(ends[far].type), (dice.one(numbers),), Variable("x"), Variable("n"))
        valued = grow(heads, [reaching(Variable("x")), value])
        total = Aggregate(dice.one(["sum", "min", "max"]), PatternCall(valued.name, (Variable("p0"), ColumnMark())))
    grow(heads, [Comparison("==", Variable("n"), total)])
    last = scope()
    both = combine_positive_and_negative(last, PatternCall(closed.name, (Variable("p0"), Variable("p1"))), types)
    more = constraint(last)
    grow(ends[:1], both if more is None else [*both, more])


def add(library: Library, group: Sequence[Pattern]) -> None:
    """Add patterns, less the constraints that make them invalid."""
    cls = next(iter(library.metamodel.classes))
    plain = [replace(pattern, bodies=(_plain(pattern, cls),)) for pattern in group]
    for number, pattern in enumerate(group):
        others = [*plain[:number], *plain[number + 1 :]]
        bodies = tuple(_valid(library, others, pattern, body, cls) for body in pattern.bodies)
        plain[number] = replace(pattern, bodies=bodies)
    library.add(*plain)


def _valid(library: Library, others: Sequence[Pattern], pattern: Pattern, body: Body, cls: str) -> Body:
    """The body without the constraints that are wrong."""

    def errors(constraints: Sequence[Constraint]) -> int:
        candidate = replace(pattern, bodies=(Body(tuple(constraints)),))
        found = library.check(candidate, *others)
        return sum(problem.severity is Severity.ERROR for problem in found)

    kept = list(body.constraints)
    wrong = errors(kept)
    while kept and wrong:
        fewest: int | None = None
        best = kept
        for position in range(len(kept)):
            smaller = kept[:position] + kept[position + 1 :]
            left = errors(smaller)
            if fewest is None or left < fewest:
                fewest, best = left, smaller
            if not left:
                break  # each check takes long
        kept, wrong = best, fewest or 0
    return Body(tuple(kept)) if kept else _plain(pattern, cls)


def _plain(pattern: Pattern, cls: str) -> Body:
    """A body that is valid: the types of the parameters; without parameters, that a class has objects."""
    constraints: list[Constraint] = []
    if not pattern.parameters:
        constraints.append(TypeConstraint(cls, Variable("_")))
    for parameter in pattern.parameters:
        kind = type_of(parameter.type)
        if isinstance(kind, ObjectType):
            constraints.append(TypeConstraint(kind.cls, Variable(parameter.name)))
        else:
            literal = EnumLiteral("Colour", "red") if isinstance(kind, EnumType) else Constant(DOMAINS[kind][0])
            constraints.append(Comparison("==", Variable(parameter.name), literal))
    return Body(tuple(constraints))


@dataclass(frozen=True)
class RandomCase:
    """A library, a model of its metamodel, and random edits of it."""

    library: Library
    model: Model
    dice: Dice

    def edit(self, count: int, thin: bool = False) -> None:
        """Make some random changes; thin ones rather take something away."""
        for _ in range(count):
            edit(self.dice, self.model, thin)


def random_case(seed: int, size: int = 1) -> RandomCase:
    """A metamodel with patterns, and a model of a few objects; of so many times more with `size`."""
    dice = Dice(seed)
    metamodel = random_metamodel(dice)
    world = RandomCase(random_library(dice, metamodel), Model(metamodel), dice)
    for cls in metamodel.class_list:
        if not cls.abstract:
            for _ in range(dice.number(0, 3) * size):
                world.model.graph.new(cls.name)
    world.edit(dice.number(0, 25) * size)
    return world


def random_cases() -> st.SearchStrategy[RandomCase]:
    """Random worlds."""
    return st.integers(0, 2**32).map(random_case)
