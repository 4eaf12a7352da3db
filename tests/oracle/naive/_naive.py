"""The naive matcher: what the constraints of a pattern say, one after another.

It is the oracle for the other matchers, so it reads the pattern as it was written, not its lowered form, and looks
features up in the class of each object that it meets. A body is solved by backtracking; recursive patterns are
computed again until nothing is added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from envgraph.graph import Model
from envgraph.match import FREE, Matcher, Row
from envgraph.match._aggregate_values import aggregate
from envgraph.match._matcher import check_arguments, check_bound
from envgraph.metamodel import Attribute, AttributeType, Value, reachable_nodes
from envgraph.pattern import (
    Closure,
    Library,
    ObjectType,
    PathConstraint,
    Pattern,
    PatternCall,
    Relation,
    TypeConstraint,
    check_holds,
    value_of,
)
from tests.oracle.naive._naive_body import (
    Equal,
    FlatBody,
    Fold,
    Item,
    Negative,
    Positive,
    Test,
    Unequal,
    Valuation,
    Values,
    flatten,
    mentioned,
    resolved,
)

Environment = Mapping[str, Value]
Arguments = tuple[object, ...]


class NaiveMatcher(Matcher):
    """A `Matcher` that is slow and simple; rows come in ascending order.

    Args:
        model: the model to search; it may change between calls.
        library: the patterns; more may be added later.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self.model = model
        self.library = library
        self._flat: dict[str, tuple[FlatBody, ...]] = {}
        self._reached: dict[str, frozenset[str]] = {}
        # Rows found so far for every call met, while a recursive component is being solved.
        self._open: dict[frozenset[str], dict[tuple[str, Arguments], dict[Row, None]]] = {}

    def discard_caches(self) -> None:
        """Names of patterns may mean something else from now on."""
        self._flat.clear()
        self._reached.clear()

    def rows(self, pattern: str, arguments: tuple[object, ...]) -> list[Row]:
        """All matches that agree with the arguments, in ascending order."""
        types = self.library.parameter_types(pattern)
        check_bound(self.library, pattern, [p for p, argument in enumerate(arguments) if argument is not FREE])
        checked = check_arguments(self.model, self.library, pattern, types, arguments)
        return [] if checked is None else sorted(self._matches(pattern, checked))

    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """`rows` as a function of the values at the bound positions."""
        size = len(self.library.parameter_types(pattern))
        check_bound(self.library, pattern, bound)

        def rows(*values: object) -> list[Row]:
            given = dict(zip(bound, values, strict=True))
            return self.rows(pattern, tuple(given.get(position, FREE) for position in range(size)))

        return rows

    # --- patterns

    def _matches(self, pattern: str, arguments: Arguments) -> list[Row]:
        component = self._component(pattern)
        if not component:
            return list(self._evaluate(pattern, arguments))
        if component in self._open:
            return list(self._open[component].setdefault((pattern, arguments), {}))
        return self._fixed_point(component, (pattern, arguments))

    def _fixed_point(self, component: frozenset[str], goal: tuple[str, Arguments]) -> list[Row]:
        """Compute every call within a recursive component again until none gains a row."""
        tables = self._open[component] = {goal: {}}
        before = -1
        try:
            while before != (before := len(tables) + sum(map(len, tables.values()))):
                for call in list(tables):
                    tables[call].update(self._evaluate(*call))
        finally:
            del self._open[component]
        return list(tables[goal])

    def _evaluate(self, pattern: str, arguments: Arguments) -> dict[Row, None]:
        """Union over the bodies, projected to the parameters."""
        definition = self.library.get(pattern)
        names = [parameter.name for parameter in definition.parameters]
        given = {name: value for name, value in zip(names, arguments, strict=True) if value is not FREE}
        found: dict[Row, None] = {}
        for body in self._bodies(pattern):
            start: dict[str, Value] = {**body.constants, **given}  # type: ignore[dict-item]
            found |= dict.fromkeys(self._solve(definition, body.items, start, names))
        return found

    def _bodies(self, pattern: str) -> tuple[FlatBody, ...]:
        if pattern not in self._flat:
            definition = self.library.get(pattern)
            self._flat[pattern] = tuple(flatten(definition, body, self.library) for body in definition.bodies)
        return self._flat[pattern]

    def _component(self, pattern: str) -> frozenset[str]:
        """The patterns that call each other with this one; empty if it is not recursive."""
        reached = self._reach(pattern)
        if pattern not in reached:
            return frozenset()
        return frozenset(name for name in reached if pattern in self._reach(name))

    def _reach(self, pattern: str) -> frozenset[str]:
        if pattern not in self._reached:
            self._reached[pattern] = frozenset(reachable_nodes(self.library.callees(pattern), self.library.callees))
        return self._reached[pattern]

    # --- bodies

    def _solve(self, pattern: Pattern, items: tuple[Item, ...], start: Environment, wanted: list[str]) -> list[Row]:
        """Values of the wanted variables in every solution.

        Items are joined one after another, those that are linked to known variables first; variables that nothing
        asks for any more are projected away at once, or independent ones would multiply.
        """
        found, remaining = [start], list(items)
        while remaining and found:
            chosen = self._next(pattern, remaining, found[0])
            remaining = [item for item in remaining if item is not chosen]
            needed = {*wanted, *(name for item in remaining for name in mentioned(item))}
            kept: dict[Row, Environment] = {}
            for known in found:
                for extended in self._extend(pattern, chosen, known):
                    smaller = {name: value for name, value in extended.items() if name in needed}
                    kept[tuple(smaller.values())] = smaller
            found = list(kept.values())
        return [tuple(solution[name] for name in wanted) for solution in found]

    def _next(self, pattern: Pattern, items: list[Item], known: Environment) -> Item:
        ready = [item for item in items if self._ready(pattern, item, known)]
        assert ready, "the library has checked that every variable can be enumerated"

        def unknown(item: Item) -> tuple[bool, int]:
            missing = sum(name not in known for name in item.terms)
            return 0 < missing == len(item.terms), missing

        return min(ready, key=unknown)

    def _ready(self, pattern: Pattern, item: Item, known: Environment) -> bool:
        match item:
            case Positive(PatternCall() as call, terms):
                called = resolved(self.library, pattern, call).qualified_name
                return all(terms[position] in known for position in self.library.inputs(called))
            case Positive(TypeConstraint(name), terms) if name not in self.library.metamodel.classes:
                return terms[0] in known
            case Positive() | Values():
                return True
            case Negative() | Fold():
                return all(t in known or t in item.local for t in item.terms)
            case Equal(terms):
                return any(t in known for t in terms)
            case Unequal(terms) | Test(_, terms) | Valuation(_, terms):
                return all(t in known for t in terms)

    def _extend(self, pattern: Pattern, item: Item, known: Environment) -> Iterator[Environment]:
        match item:
            case Positive(relation, terms):
                for row in self._tuples(pattern, relation, terms, known):
                    yield {**known, **dict(zip(terms, row, strict=True))}
            case Values(type_, (name,)):
                for value in self._values(type_):
                    yield from _with(known, name, value)
            case Negative():
                if not any(True for _ in self._group(pattern, item, known)):
                    yield known
            case Fold(function, column=column, result=result):
                rows = dict.fromkeys(self._group(pattern, item, known))
                numbers = [0 if column is None else row[column] for row in rows]  # `count` takes any
                yield from _with(known, result, aggregate(function, numbers))  # type: ignore[arg-type]
            case Equal((left, right)):
                yield from (_with(known, left, known[right]) if right in known else _with(known, right, known[left]))
            case Unequal((left, right)):
                if known[left] != known[right]:
                    yield known
            case Test(expression, _):
                if check_holds(expression, known, self._read):
                    yield known
            case Valuation(expression, _, result):
                yield from _with(known, result, value_of(expression, known, self._read))

    # --- relations

    def _group(self, pattern: Pattern, item: Negative | Fold, known: Environment) -> Iterator[Row]:
        """The tuples under a negation or in an aggregate."""
        return iter(()) if item.empty else self._tuples(pattern, item.relation, item.terms, known)

    def _tuples(
        self, pattern: Pattern, relation: Relation, terms: tuple[str, ...], known: Environment
    ) -> Iterator[Row]:
        """The tuples of a relation that agree with what is known, and with themselves where a term repeats."""
        arguments = tuple(known.get(name, FREE) for name in terms)
        for row in self._relation(pattern, relation, arguments):
            chosen = dict(zip(terms, row, strict=True))
            if all(chosen[t] == v and known.get(t, v) == v for t, v in zip(terms, row, strict=True)):
                yield row

    def _relation(self, pattern: Pattern, relation: Relation, arguments: Arguments) -> Iterable[Row]:
        match relation:
            case TypeConstraint(name, _, exact):
                return ((node,) for node in self._instances(name, exact, arguments[0]))
            case PathConstraint(name, features, _, _, closure):

                def follow(start: object) -> Iterable[tuple[Value, Value]]:
                    sources = self._instances(name, False, start)
                    return ((s, t) for s in sources for t in self._follow(s, features))

                if closure is Closure.ONCE:
                    return follow(arguments[0])
                return _closure(follow, self._instances(name, False, FREE), arguments[0], closure)
            case PatternCall(_, _, closure):
                called = resolved(self.library, pattern, relation).qualified_name
                if closure is Closure.ONCE:
                    return self._matches(called, arguments)

                def step(start: object) -> Iterable[tuple[Value, Value]]:
                    return ((row[0], row[1]) for row in self._matches(called, (start, FREE)))

                type_ = self.library.parameter_types(called)[0]
                objects = self._instances(type_.cls, False, FREE) if isinstance(type_, ObjectType) else []
                return _closure(step, objects, arguments[0], closure)

    def _instances(self, name: str, exact: bool, argument: object) -> Sequence[Value]:
        """Objects of a class; all that have any class for the name "". An enum's values are all accepted."""
        metamodel = self.library.metamodel
        if name and name not in metamodel.classes:
            return [argument]  # type: ignore[list-item]
        if argument is FREE:
            return [
                n for cls in metamodel.classes for n in self.model.graph.exact_extent(cls) if self._is(n, name, exact)
            ]
        return [argument] if self._is(argument, name, exact) else []  # type: ignore[arg-type, list-item]

    def _values(self, type_: AttributeType) -> list[Value]:
        """Those that occur in the model, each once."""
        attributes = [one for one in self.library.metamodel.attributes if one.type == type_]
        return list(
            dict.fromkeys(
                value
                for attribute in attributes
                for node in self.model.graph.store.nodes()
                if self._is(node, attribute.owner, False)
                for value in self.model.graph.values(node, attribute)
            )
        )

    def _is(self, node: int, name: str, exact: bool) -> bool:
        cls = self.model.graph.class_of(node)
        return cls == name if exact else not name or self.library.metamodel.is_a(cls, name)

    def _follow(self, node: Value, features: tuple[str, ...]) -> list[Value]:
        """Return what a path leads to from an object, each once."""
        reached = [node]
        for name in features:
            reached = list(dict.fromkeys(value for n in reached for value in self._feature(n, name)))
        return reached

    def _feature(self, node: Value, name: str) -> list[Value]:
        assert isinstance(node, int)
        feature = self.library.metamodel.feature(self.model.graph.class_of(node), name)
        if feature is None:
            return []
        query = self.library.definitions.get(feature)
        if query is not None:
            return [row[1] for row in self._matches(query, (node, FREE))]
        if isinstance(feature, Attribute):
            return list(dict.fromkeys(self.model.graph.values(node, feature)))
        return list(self.model.graph.targets(node, feature))

    def _read(self, node: int, name: str) -> Value | None:
        return next(iter(self._feature(node, name)), None)


def _with(known: Environment, name: str, value: Value | None) -> Iterator[Environment]:
    """Yield what is known and one value more; nothing if there is none, or another one is known."""
    if value is not None and known.get(name, value) == value:
        yield {**known, name: value}


def _closure(
    step: Callable[[object], Iterable[tuple[Value, Value]]],
    objects: Iterable[Value],
    source: object,
    closure: Closure,
) -> Iterator[Row]:
    """Pairs of a closure with a given source, or all of them; `objects` are related to themselves under `*`."""
    reflexive = dict.fromkeys(objects) if closure is Closure.STAR else {}
    sources: dict[Any, None] = {source: None}
    if source is FREE:
        sources = {start: None for start, _ in step(FREE)} | reflexive
    for start in sources:
        reached: dict[Value, None] = {}
        queue = [start]
        for node in queue:
            for _, target in step(node):
                if target not in reached:
                    reached[target] = None
                    queue.append(target)
        if start in reflexive:
            reached[start] = None
        yield from ((start, target) for target in reached)
