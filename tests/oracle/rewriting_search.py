"""Graphs as plain sets, and the matches of left sides, found by trying: the first half of what rules mean.

Written from the description of the language; shares nothing with the engine but the data of rules.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from envgraph.metamodel import Attribute, Metamodel, Reference, Scalar
from envgraph.pattern import (
    Aggregate,
    Binary,
    Check,
    Closure,
    Comparison,
    Conditional,
    Constant,
    Constraint,
    CreateAction,
    EnumLiteral,
    Evaluation,
    Expression,
    LeftSide,
    Navigation,
    Negation,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    RightSide,
    Rule,
    RuleBlock,
    Term,
    TypeConstraint,
    Variable,
)


class Thing(int):
    """An object of the graph, to be told from numbers."""

    __slots__ = ()


Item = Thing | int | float | bool | str
Env = dict[str, Item]
Link = tuple[str, Thing, Thing]
Arrow = tuple[str, str, str]


def several(attribute: Attribute, values: Iterable[Item]) -> tuple[Item, ...]:
    """What an attribute with many values holds, whatever their order."""
    found = [float(value) if attribute.type is Scalar.FLOAT else value for value in values]
    return tuple(sorted(dict.fromkeys(found) if attribute.unique else found, key=str))


class NoValue(Exception):
    """An expression reads a feature that has no value."""


@dataclass
class State:
    """A graph. Features have names that no other class uses; links stand in both directions where they have two."""

    metamodel: Metamodel
    classes: dict[Thing, str]
    values: dict[tuple[Thing, str], Item | tuple[Item, ...] | None]
    links: set[Link]

    def copy(self) -> State:
        return State(self.metamodel, dict(self.classes), dict(self.values), set(self.links))

    def is_a(self, thing: Thing, cls: str) -> bool:
        return self.metamodel.is_a(self.classes[thing], cls)

    def targets(self, source: Thing, reference: str) -> list[Thing]:
        return sorted(t for r, s, t in self.links if r == reference and s == source)

    def sources(self, target: Thing, reference: str) -> list[Thing]:
        return sorted(s for r, s, t in self.links if r == reference and t == target)

    def reference(self, name: str) -> Reference:
        return next(one for one in self.metamodel.references if one.name == name)

    def several(self, name: str) -> Attribute | None:
        """The attribute of this name if it has many values."""
        found = self.attribute(name)
        return found if found is not None and found.many else None

    def attribute(self, name: str) -> Attribute | None:
        return next((one for one in self.metamodel.attributes if one.name == name), None)

    def both(self, link: Link) -> set[Link]:
        """The link and its opposite."""
        name, source, target = link
        opposite = self.reference(name).opposite
        return {link, (opposite, target, source)} if opposite else {link}

    def container(self, thing: Thing) -> Link | None:
        return next((one for one in sorted(self.links) if one[2] == thing and self.contains(one)), None)

    def contains(self, link: Link) -> bool:
        return self.reference(link[0]).containment

    def tree(self, root: Thing) -> set[Thing]:
        """A thing and all that it contains."""
        found, todo = {root}, [root]
        while todo:
            source = todo.pop()
            for link in self.links:
                if link[1] == source and self.contains(link) and link[2] not in found:
                    found.add(link[2])
                    todo.append(link[2])
        return found

    def has_feature(self, cls: str, name: str) -> bool:
        return self.metamodel.feature(cls, name) is not None

    def allows(self, link: Link) -> bool:
        """Whether the classes of the ends may have the link."""
        name, source, target = link
        return self.has_feature(self.classes[source], name) and self.is_a(target, self.reference(name).target)


# --- expressions


def evaluated(state: State, expression: Expression, env: Env) -> Item | None:
    """The value of an expression; None is `none`. `NoValue` where one is needed."""
    match expression:
        case Constant(value):
            return value
        case EnumLiteral(_, literal):
            return literal
        case Variable(name):
            return env[name]
        case Navigation(inner, feature):
            source = evaluated(state, inner, env)
            if source is None:
                return None
            assert isinstance(source, Thing)
            if state.attribute(feature):
                return state.values.get((source, feature))
            ends = state.targets(source, feature)
            return ends[0] if ends else None
        case Binary(("&&" | "||") as operator, left, right):
            first = needed(state, left, env)
            return needed(state, right, env) if first == (operator == "&&") else first
        case Binary(("==" | "!=") as operator, left, right):
            same = evaluated(state, left, env) == evaluated(state, right, env)
            return same == (operator == "==")
        case Binary(operator, left, right):
            return arithmetic(operator, needed(state, left, env), needed(state, right, env))
        case Conditional(test, then, otherwise):
            return evaluated(state, then if needed(state, test, env) else otherwise, env)
    raise AssertionError(expression)


def read_in(expression: Expression) -> Iterator[Expression]:
    """The features that an expression reads, but for those that are compared with `none`."""
    match expression:
        case Binary(_, left, right) if Constant(None) in (left, right):
            return
        case Binary(_, left, right):
            yield from read_in(left)
            yield from read_in(right)
        case Conditional(test, then, otherwise):
            yield from (*read_in(test), *read_in(then), *read_in(otherwise))
        case Navigation():
            yield expression


def needed(state: State, expression: Expression, env: Env) -> Item:
    value = evaluated(state, expression, env)
    if value is None:
        raise NoValue
    return value


def arithmetic(operator: str, left: Item, right: Item) -> Item:
    operations: dict[str, Callable[[Item, Item], Item]] = {
        "+": lambda a, b: a + b,  # type: ignore[operator]
        "-": lambda a, b: a - b,  # type: ignore[operator]
        "*": lambda a, b: a * b,  # type: ignore[operator]
        "<": lambda a, b: a < b,  # type: ignore[operator]
        "<=": lambda a, b: a <= b,  # type: ignore[operator]
        ">": lambda a, b: a > b,  # type: ignore[operator]
    }
    return operations[operator](left, right)


# --- matching


@dataclass
class Search:
    """Finds the assignments for which all constraints of a body hold."""

    state: State
    patterns: Mapping[str, Pattern]
    found: dict[str, list[tuple[Item, ...]]] = field(default_factory=dict)

    def solutions(self, body: Sequence[Constraint], env: Env) -> Iterator[Env]:
        """The extensions of `env` for which the body holds."""
        return self._solve(list(body), env, names_that_bind(body) | set(env))

    def _solve(self, body: list[Constraint], env: Env, outer: set[str]) -> Iterator[Env]:
        if not body:
            yield env
            return
        one = min(body, key=lambda each: unbound(each, outer - set(env)))
        rest = [each for each in body if each is not one]
        for more in self.rows(one, env):
            yield from self._solve(rest, more, outer)

    def rows(self, one: Constraint, env: Env) -> Iterator[Env]:
        state = self.state
        match one:
            case TypeConstraint(cls, term):
                yield from bound((term,), ((t,) for t in state.classes if state.is_a(t, cls)), env, self)
            case PathConstraint():
                yield from bound((one.source, one.target), self.pairs(one), env, self)
            case PatternCall():
                yield from bound(one.arguments, self.called(one), env, self)
            case Negation(relation):
                if not any(True for _ in self.rows(relation, env)):
                    yield env
            case Check(expression):
                if self.holds(expression, env):
                    yield env
            case Comparison("!=", left, right):
                values = self.value(left, env), self.value(right, env)
                if None not in values and values[0] != values[1]:
                    yield env
            case Comparison("==", left, right):
                if isinstance(left, Variable) and left.name not in env:
                    left, right = right, left
                value = self.value(left, env)
                if value is not None:
                    yield from bound((right,), [(value,)], env, self)

    def holds(self, expression: Expression, env: Env) -> bool:
        """Whether a condition is true; all that it reads has to have a value, also what is not needed."""
        try:
            return evaluated(self.state, expression, env) is True and all(
                needed(self.state, one, env) is not None for one in read_in(expression)
            )
        except NoValue:
            return False

    def value(self, term: Term, env: Env) -> Item | None:
        match term:
            case Variable(name):
                return env[name]
            case Constant(value):
                return value
            case EnumLiteral(_, literal):
                return literal
            case Evaluation(expression):
                try:
                    for one in read_in(expression):
                        needed(self.state, one, env)
                    return evaluated(self.state, expression, env)
                except NoValue:
                    return None
            case Aggregate("count", over):
                # Distinct tuples: an anonymous variable counts as a column.
                named = numbered(over)
                return len({tuple(sorted(row.items())) for row in self.rows(named, env)})
        raise AssertionError(term)

    def pairs(self, path: PathConstraint) -> list[tuple[Item, Item]]:
        state = self.state
        step: set[tuple[Item, Item]] = {(t, t) for t in state.classes if not path.type or state.is_a(t, path.type)}
        for name in path.features:
            edges = self.edges(name)
            step = {(a, d) for a, b in step for c, d in edges if b == c}
        objects = [t for t in state.classes if not path.type or state.is_a(t, path.type)]
        return sorted(closed(step, path.closure, objects), key=str)

    def edges(self, feature: str) -> set[tuple[Item, Item]]:
        state = self.state
        if state.attribute(feature):
            held = {(t, v) for (t, name), v in state.values.items() if name == feature and v is not None}
            return {(t, one) for t, v in held for one in (v if isinstance(v, tuple) else (v,))}
        return {(s, t) for r, s, t in state.links if r == feature}

    def called(self, call: PatternCall) -> list[tuple[Item, ...]]:
        pattern = self.patterns[call.pattern]
        if pattern.name not in self.found:
            rows = set()
            for body in pattern.bodies:
                types = [TypeConstraint(p.type, Variable(p.name)) for p in pattern.parameters
                         if p.type in self.state.metamodel.classes]  # fmt: skip
                for env in self.solutions([*types, *body.constraints], {}):
                    rows.add(tuple(env[p.name] for p in pattern.parameters))
            self.found[pattern.name] = sorted(rows, key=str)
        rows = self.found[pattern.name]
        if call.closure is Closure.ONCE:
            return rows
        cls = pattern.parameters[0].type or ""
        objects = [t for t in self.state.classes if self.state.is_a(t, cls)]
        return sorted(closed({(a, b) for a, b in rows}, call.closure, objects), key=str)


def closed(step: set[tuple[Item, Item]], closure: str, things: Sequence[Thing]) -> set[tuple[Item, Item]]:
    """A relation followed once, once or more, or any number of times."""
    if closure == "":
        return step
    found = set(step)
    while more := {(a, d) for a, b in found for c, d in step if b == c} - found:
        found |= more
    return found | {(t, t) for t in things} if closure == "*" else found


def numbered(relation: Relation) -> Relation:
    """With a name for each `_`."""
    match relation:
        case TypeConstraint(cls, term):
            return TypeConstraint(cls, _numbered(term, 0))
        case PathConstraint(cls, features, source, target, closure):
            return PathConstraint(cls, features, _numbered(source, 0), _numbered(target, 1), closure)
        case PatternCall(pattern, arguments, closure):
            return PatternCall(pattern, tuple(_numbered(a, i) for i, a in enumerate(arguments)), closure)


def _numbered(term: Term, place: int) -> Term:
    return Variable(f"#{place}") if term == Variable("_") else term


def bound(
    terms: Sequence[Term],
    rows: Sequence[tuple[Item, ...]] | Iterator[tuple[Item, ...]],
    env: Env,
    search: Search,
) -> Iterator[Env]:
    """The extensions of `env` that make the terms a row."""
    for row in rows:
        more = dict(env)
        for term, value in zip(terms, row, strict=True):
            if isinstance(term, Variable):
                if term.name != "_" and more.setdefault(term.name, value) != value:
                    break
            elif search.value(term, env) != value:
                break
        else:
            yield more


def terms_of(one: Constraint | Aggregate) -> tuple[Term, ...]:
    match one:
        case TypeConstraint(_, term):
            return (term,)
        case PathConstraint():
            return (one.source, one.target)
        case PatternCall():
            return one.arguments
        case Comparison(_, left, right):
            return (left, right)
        case Negation(relation) | Aggregate(_, relation):
            return terms_of(relation)
        case Check(expression):
            return (Evaluation(expression),)


def variables_of(term: Term | Expression) -> set[str]:
    match term:
        case Variable(name):
            return {name} - {"_"}
        case Evaluation(inner) | Navigation(inner, _):
            return variables_of(inner)
        case Aggregate():
            return {name for one in terms_of(term) for name in variables_of(one)}
        case Binary(_, left, right):
            return variables_of(left) | variables_of(right)
        case Conditional(test, then, otherwise):
            return variables_of(test) | variables_of(then) | variables_of(otherwise)
    return set()


def names_that_bind(body: Sequence[Constraint]) -> set[str]:
    """Variables with a positive reference."""
    found: set[str] = set()
    for one in body:
        if isinstance(one, Relation) or (isinstance(one, Comparison) and one.operator == "=="):
            found |= {term.name for term in terms_of(one) if isinstance(term, Variable)}
    return found - {"_"}


def unbound(one: Constraint, unknown: set[str]) -> int:
    """How early a constraint should be looked at: what tests waits until all is bound that something else can bind."""
    if isinstance(one, Relation):
        return len({name for term in terms_of(one) for name in variables_of(term)} & unknown)
    sides = [len(variables_of(term) & unknown) for term in terms_of(one)]
    if isinstance(one, Comparison) and one.operator == "==":
        plain = [isinstance(term, Variable) for term in terms_of(one)]
        known = any(not count for count in sides) and all(p or not c for p, c in zip(plain, sides, strict=True))
        return 0 if known else 1000
    return 1000 if any(sides) else 0


# --- matches of rules


@dataclass
class Matching:
    """Matches of one rule in one state."""

    state: State
    rule: Rule
    search: Search

    def matches(self, given: Env) -> list[Env]:
        """Parameters and named variables, as dicts; each once."""
        types: list[Constraint] = [
            TypeConstraint(p.type, Variable(p.name))
            for p in self.rule.parameters
            if p.type in self.state.metamodel.classes and p.name not in created_by(self.rule)
        ]
        return self.of(self.rule.left, self.rule.blocks, given, types, ())

    def of(
        self,
        left: LeftSide,
        blocks: Sequence[RuleBlock],
        env: Env,
        types: Sequence[Constraint] = (),
        outside: Sequence[str] = (),
    ) -> list[Env]:
        body = [*types, *constraints_of(left)]
        names = names_that_bind(body) | set(env)
        found: dict[tuple[tuple[str, Item], ...], Env] = {}
        for solution in self.search.solutions(body, env):
            match = {name: value for name, value in solution.items() if name in names}
            if self.injective(match, left, outside) and self.conditions(blocks, match):
                found[tuple(sorted(match.items()))] = match
        return list(found.values())

    def injective(self, env: Env, left: LeftSide, outside: Sequence[str]) -> bool:
        if not self.rule.injective:
            return True
        things = [name for name, value in env.items() if isinstance(value, Thing)]
        pairs = [(a, b) for i, a in enumerate(things) for b in things[:i]]
        new = [(a, b) for a, b in pairs if not (a in outside and b in outside)]
        return all(env[a] != env[b] or self.may_coincide(a, b, left) for a, b in new)

    def may_coincide(self, one: str, other: str, left: LeftSide) -> bool:
        """What `==` makes one counts as one for `@hom`, too."""
        first, second = self.aliases(one, left), self.aliases(other, left)
        listed = any(first & set(group) and second & set(group) for group in self.rule.homomorphic)
        return listed or other in first

    def aliases(self, name: str, left: LeftSide) -> set[str]:
        found = {name}
        equations = [names_in(c) for c in (*self.rule.left.constraints, *left.constraints) if is_equation(c)]
        for _ in equations:
            found = found.union(*(names for names in equations if names & found and len(names) == 2))
        return found

    def conditions(self, blocks: Sequence[RuleBlock], env: Env) -> bool:
        return all(self.holds(block, env) for block in blocks)

    def holds(self, block: RuleBlock, env: Env) -> bool:
        match block.kind:
            case "not":
                return not self.inside(block, env)
            case "require" | "forall+":
                return bool(self.inside(block, env))
            case _:
                return True

    def inside(self, block: RuleBlock, env: Env) -> list[Env]:
        """The matches of a block that extend one of what encloses it."""
        return self.of(block.left, block.blocks, env, (), tuple(env))


def is_equation(one: Constraint) -> bool:
    return isinstance(one, Comparison) and one.operator == "=="


def names_in(one: Constraint) -> set[str]:
    return {name for term in terms_of(one) for name in variables_of(term)}


def types_in(left: LeftSide) -> dict[str, str]:
    """The classes that a left side gives its names."""
    said = [c for c in left.constraints if isinstance(c, TypeConstraint) and isinstance(c.term, Variable)]
    types = {one.term.name: one.type for one in said if isinstance(one.term, Variable)}
    return types | {node.name: node.type for node in left.nodes if node.type}


def constraints_of(left: LeftSide) -> list[Constraint]:
    types = [TypeConstraint(node.type, Variable(node.name)) for node in left.nodes if node.type]
    arrows = [
        PathConstraint("", (e.reference,), Variable(e.source), Variable(e.target), Closure(e.closure))
        for e in left.edges
    ]
    return [*types, *arrows, *left.constraints]


def created_by(rule: Rule) -> set[str]:
    """Names of `out` parameters that the right side makes."""
    right = rule.right
    if right is None:
        return set()
    made = [right] if isinstance(right, RightSide) else [a for a in right.actions if isinstance(a, CreateAction)]
    known = {node.name for node in rule.left.nodes}
    outputs = {p.name for p in rule.parameters if p.direction == "out"}
    return {node.name for one in made for node in one.nodes if node.type and node.name not in known} & outputs
