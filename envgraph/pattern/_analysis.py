"""Analyse patterns together: resolve their calls, and infer the types and inputs that callers use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from itertools import zip_longest

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Feature, Metamodel
from envgraph.pattern._enumerable_variables import Binding
from envgraph.pattern._expression_data import Expression, FunctionCall, Navigation, Variable
from envgraph.pattern._feature_paths import ResolvedPath, is_derived, resolve_path
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import (
    BodyVariables,
    base_of,
    children,
    expressions_of,
    none_test_path,
    relations_of,
    rewrite_expressions,
)
from envgraph.pattern._query_data import Body, PathConstraint, Pattern, PatternCall
from envgraph.pattern._type_inference import BodyTypes, CalleeLookup, PatternSignature
from envgraph.pattern._types import least_common_supertypes, static_type
from envgraph.pattern.check._pattern_header import is_too_long
from envgraph.pattern.expressions._builtin_functions import FUNCTIONS
from envgraph.pattern.expressions._expression_types import ExpressionChecker, is_method


def calls_of(body: Body) -> Iterator[tuple[PatternCall, str]]:
    """Yield the pattern calls of a body, each with its context: "neg", the name of an aggregate, or "" if positive."""
    return ((one, word) for one, word in relations_of(body) if isinstance(one, PatternCall))


@dataclass(frozen=True, slots=True)
class UnknownNames:
    """Names whose definitions could not be read or have errors. Checks report nothing about these names.

    Only the last part of a qualified name counts.

    Attributes:
        names: the unknown names.
        all: True if any name may be unknown, for example because a file is missing.
    """

    names: frozenset[str] = frozenset()
    all: bool = False

    def __contains__(self, name: str) -> bool:
        return self.all or name.rpartition(".")[2] in self.names

    def __bool__(self) -> bool:
        return self.all or bool(self.names)

    def __or__(self, names: Iterable[str]) -> UnknownNames:
        return UnknownNames(self.names.union(name.rpartition(".")[2] for name in names), self.all)


class PatternNames:
    """A lookup of patterns by the names that calls use.

    A name is looked up as a simple name in the caller's package, then as a qualified name, then as a simple name that
    is unique among all visible patterns. A private pattern is visible only in its own package, and only in its own file
    if it was read from a file. Patterns made in Python have no file.
    """

    def __init__(self, patterns: Iterable[Pattern]) -> None:
        self._qualified: dict[str, Pattern] = {}
        self._simple: dict[str, list[Pattern]] = {}
        for pattern in patterns:
            if self._qualified.setdefault(pattern.qualified_name, pattern) is pattern:
                self._simple.setdefault(pattern.name, []).append(pattern)

    def find_candidates(
        self, name: str, package: str, caller: Pattern | None = None
    ) -> tuple[list[Pattern], list[Pattern]]:
        """Return the visible patterns that a name may denote, and patterns of that name hidden from the caller."""
        qualified = f"{package}.{name}" if package else name
        found = [self._qualified[key] for key in dict.fromkeys((qualified, name)) if key in self._qualified]
        hidden: list[Pattern] = []
        for pattern in found:
            if is_visible(pattern, package, caller):
                return [pattern], hidden
            hidden.append(pattern)
        others = [pattern for pattern in self._simple.get(name, ()) if pattern not in hidden]
        hidden.extend(pattern for pattern in others if not is_visible(pattern, package, caller))
        return [pattern for pattern in others if is_visible(pattern, package, caller)], hidden

    def visible_names(self, package: str, caller: Pattern | None = None) -> list[str]:
        """Return the names that a call may use, for hints: simple names, and qualified names of other packages."""
        names = []
        for qualified, pattern in self._qualified.items():
            if "#" not in qualified and is_visible(pattern, package, caller):
                names.append(pattern.name)
                if pattern.package != package:
                    names.append(qualified)
        return names


def is_visible(pattern: Pattern, package: str, caller: Pattern | None) -> bool:
    """Return True if a pattern may be called from a package. This is always so if the pattern is not private.

    A private pattern may be called from its own package, and only from its own file if both files are known.
    """
    if not pattern.private:
        return True
    if pattern.package != package:
        return False
    if caller is None or caller.span is None or pattern.span is None:
        return True
    return caller.span.source.name == pattern.span.source.name


@dataclass(frozen=True, slots=True)
class DerivedRead:
    """A place that reads a derived feature. `word` is its context: "neg", an aggregate, a closure ("+", "*") or ""."""

    feature: Feature
    word: str
    span: Span | None


def defined_feature_name(pattern: Pattern) -> tuple[str, Span | None] | None:
    """Return the name of the feature that the annotation `@QueryBasedFeature` of a pattern defines, with its span.

    Without `feature = ".."` in the annotation, the pattern's own name is returned. Return None without the annotation.
    """
    found = next((one for one in pattern.annotations if one.name == "QueryBasedFeature"), None)
    if found is None:
        return None
    return str(dict(found.named).get("feature", pattern.name)), dict(found.places).get("feature", found.span)


def defined_feature(pattern: Pattern, source: StaticType | None, metamodel: Metamodel) -> Feature | None:
    """Return the feature that a pattern's annotation defines for the class `source`, or None.

    `source` is the type of the first of two parameters. The class must have a feature of that name.
    """
    found = defined_feature_name(pattern)
    if found is None or len(pattern.parameters) != 2 or not isinstance(source, ObjectType):
        return None
    return metamodel.feature(source.cls, found[0])


def derived_reads(types: BodyTypes) -> Iterator[DerivedRead]:
    """Yield a `DerivedRead` for each place of a body that reads a derived feature, in relations and in expressions."""
    body = types.reading.body
    for relation, word in relations_of(body):
        if isinstance(relation, PathConstraint) and (path := types.resolved_path(relation)) is not None:
            for step, span in zip_longest(path.steps, relation.feature_spans):
                if is_derived(step):
                    yield DerivedRead(step, word or str(relation.closure), span or relation.span)
    for expression, _ in expressions_of(body):
        yield from derived_reads_in(expression, types.types, types.metamodel)


def derived_reads_in(
    expression: Expression, scope: Mapping[str, StaticType | None], metamodel: Metamodel, word: str = ""
) -> Iterator[DerivedRead]:
    """Yield a `DerivedRead` for each derived feature in an expression, with the context `word`, or "neg" in a `none`
    test.
    """
    if isinstance(expression, Navigation):
        start, features = base_of(expression)
        type_ = scope.get(start.name) if isinstance(start, Variable) else None
        path = resolve_path(type_.cls, features, metamodel) if isinstance(type_, ObjectType) else None
        if isinstance(path, ResolvedPath) and is_derived(path.steps[-1]):
            yield DerivedRead(path.steps[-1], word, expression.feature_span or expression.span)
    inner = "neg" if none_test_path(expression) else word
    for child in children(expression):
        yield from derived_reads_in(child, scope, metamodel, inner)


@dataclass(frozen=True, slots=True)
class LibraryEntry:
    """A pattern of a library, with its calls resolved.

    Attributes:
        calls: the qualified name for each name in a call. They are stored, because patterns added later must not change
            the meaning.
        types: the types of the parameters, declared or inferred; None where unknown.
        inputs: numbers of the `in` parameters that callers have to bind.
        written: the pattern as it was added, if `pattern` differs from it, else None.
        bodies: types of the variables for each body; () if the pattern has errors.
        defines: the derived feature whose values are the matches, or None.
        reads: the places that read derived features.
    """

    pattern: Pattern
    calls: Mapping[str, str]
    types: tuple[StaticType | None, ...] = ()
    inputs: tuple[int, ...] = ()
    written: Pattern | None = None
    bodies: tuple[BodyTypes, ...] = field(default=(), compare=False, repr=False)
    defines: Feature | None = field(default=None, compare=False)
    reads: tuple[DerivedRead, ...] = field(default=(), compare=False, repr=False)

    @property
    def signature(self) -> PatternSignature:
        """Return the pattern with the types and inputs of its parameters, which callers use."""
        return PatternSignature(self.pattern, self.types, self.inputs)

    @property
    def known_types(self) -> tuple[StaticType, ...]:
        """Return `types`, for a pattern without errors. Then all types are known."""
        types = tuple([type_ for type_ in self.types if type_ is not None])
        assert len(types) == len(self.types)
        return types


@dataclass(slots=True)
class PatternAnalysis:
    """New patterns together with the patterns of a library: resolved calls, types of parameters, inputs.

    Attributes:
        unknown: names of patterns whose definitions are unknown.
        entries: the known and the new patterns, by qualified name.
    """

    metamodel: Metamodel
    known: Mapping[str, LibraryEntry]
    patterns: Sequence[Pattern]
    unknown: UnknownNames = UnknownNames()
    names: PatternNames = field(init=False)
    entries: dict[str, LibraryEntry] = field(init=False)
    _new_by_name: dict[str, Pattern] = field(init=False)
    _analysed_names: tuple[str, ...] = field(init=False)
    """Names of the new patterns whose bodies are analysed, because none of their bodies is too long."""
    _type_cache: dict[tuple[str, int], tuple[Sequence[object], BodyTypes]] = field(default_factory=dict, init=False)
    """A cache by pattern name and id of a body: the types of callees, and the types inferred from them."""

    def __post_init__(self) -> None:
        self.names = PatternNames([*(entry.pattern for entry in self.known.values()), *self.patterns])
        self._new_by_name = {}
        for pattern in self.patterns:
            if pattern.qualified_name not in self.known:
                self._new_by_name.setdefault(pattern.qualified_name, pattern)
        self.entries = dict(self.known)
        for name, pattern in self._new_by_name.items():
            declared = tuple(static_type(one.type, self.metamodel) for one in pattern.parameters)
            self.entries[name] = LibraryEntry(pattern, self._resolve_calls(pattern), declared)
        self._analysed_names = tuple(n for n, new in self._new_by_name.items() if not any(map(is_too_long, new.bodies)))
        self._infer_types()
        self._replace_methods()
        self._find_inputs()
        self._store_types()

    @property
    def new_patterns(self) -> list[Pattern]:
        """Return the patterns to add, without those whose qualified name a known or an earlier pattern has."""
        return list(self._new_by_name.values())

    def _resolve_calls(self, pattern: Pattern) -> dict[str, str]:
        calls: dict[str, str] = {}
        for body in pattern.bodies:
            for call, _ in calls_of(body):
                found, _ = self.names.find_candidates(call.pattern, pattern.package, pattern)
                if len(found) == 1:
                    calls[call.pattern] = found[0].qualified_name
        return calls

    def callee_lookup(self, caller: Pattern) -> CalleeLookup:
        """Return a function that maps a name in the calls of `caller` to the called pattern's signature, or None."""
        calls = self.entries[caller.qualified_name].calls

        def find(name: str) -> PatternSignature | None:
            return self.entries[calls[name]].signature if name in calls else None

        return find

    def with_callers(self, names: Iterable[str]) -> frozenset[str]:
        """Return `names`, and the names of all new patterns that call them, directly or not, or call unknown names."""
        found = {
            name
            for name, pattern in self._new_by_name.items()
            if any(
                call.pattern not in self.entries[name].calls for body in pattern.bodies for call, _ in calls_of(body)
            )
        }.union(names)
        size = 0
        while size < len(found):
            size = len(found)
            found |= {name for name in self._new_by_name if not found.isdisjoint(self.entries[name].calls.values())}
        return frozenset(found)

    def body_types(self, pattern: Pattern, body: Body) -> BodyTypes:
        """Return the types of the variables of one body. The result is cached until the types of callees change."""
        calls = self.entries[pattern.qualified_name].calls
        given = [self.entries[called].types for called in calls.values()]
        known = self._type_cache.get((pattern.qualified_name, id(body)))
        if known is not None and known[0] == given:
            return known[1]
        reading = BodyVariables(body, pattern.parameters)
        found = BodyTypes(reading, pattern.parameters, self.metamodel, self.callee_lookup(pattern))
        self._type_cache[pattern.qualified_name, id(body)] = given, found
        return found

    def _store_types(self) -> None:
        """Store the inferred types, defined features and derived reads. Types then use final signatures of callees."""
        for name in self._analysed_names:
            pattern = self._new_by_name[name]
            bodies = tuple(self.body_types(pattern, body) for body in pattern.bodies)
            entry = self.entries[name]
            defines = defined_feature(pattern, entry.types[0] if entry.types else None, self.metamodel)
            reads = tuple(read for types in bodies for read in derived_reads(types))
            self.entries[name] = replace(entry, bodies=bodies, defines=defines, reads=reads)
        for name in self._analysed_names:
            entry = self.entries[name]
            callees = {call: self.entries[called].signature for call, called in entry.calls.items()}
            for types in entry.bodies:
                types.callee = callees.get

    def _infer_types(self) -> None:
        """Infer undeclared parameter types from the bodies. Recursive patterns need several rounds."""
        pending = [
            name for name in self._analysed_names if any(one.type is None for one in self._new_by_name[name].parameters)
        ]
        for _ in range(len(pending) * (len(self.metamodel.class_list) + 1) + 1):
            changed = False
            for name in pending:
                entry = self.entries[name]
                types = tuple(self._inferred_types(self._new_by_name[name], entry))
                if types != entry.types:
                    self.entries[name] = replace(entry, types=types)
                    changed = True
            if not changed:
                break

    def _inferred_types(self, pattern: Pattern, entry: LibraryEntry) -> Iterator[StaticType | None]:
        bodies = [self.body_types(pattern, body) for body in pattern.bodies]
        for position, parameter in enumerate(pattern.parameters):
            if parameter.type is not None:
                yield entry.types[position]
                continue
            known = [type_ for type_ in (body.type_of(parameter.name) for body in bodies) if type_ is not None]
            above = least_common_supertypes(known, self.metamodel) if known else []
            yield above[0] if above else None

    def _replace_methods(self) -> None:
        """Replace `text.length` by the call `length(text)`, if types show that `length` is not a feature."""
        for name in self._analysed_names:
            pattern = self._new_by_name[name]
            bodies = tuple(self._with_methods_replaced(pattern, body) for body in pattern.bodies)
            if any(new is not old for new, old in zip(bodies, pattern.bodies, strict=True)):
                self._new_by_name[name] = replace(pattern, bodies=bodies)
                self.entries[name] = replace(self.entries[name], pattern=self._new_by_name[name], written=pattern)

    def _with_methods_replaced(self, pattern: Pattern, body: Body) -> Body:
        if not any(_may_be_method(each) for each, _ in expressions_of(body)):
            return body
        checker = ExpressionChecker(self.body_types(pattern, body).types, self.metamodel, True)

        def call(node: Expression) -> Expression:
            if isinstance(node, Navigation) and is_method(node, checker.type_of(node.object)):
                return FunctionCall(node.feature, (node.object,), node.span, node.feature_span)
            return node

        return rewrite_expressions(body, call)

    def _find_inputs(self) -> None:
        """Find the inputs of each pattern: the `in` parameters of data types that some body cannot enumerate.

        All of them are inputs at first. Parameters that all bodies enumerate, given the other inputs, are removed.
        """
        pending: list[str] = []
        for name in self._analysed_names:
            places = enumerate(self._new_by_name[name].parameters)
            given = tuple(i for i, p in places if p.direction == "in" and p.type not in self.metamodel.classes)
            if given:
                self.entries[name] = replace(self.entries[name], inputs=given)
                pending.append(name)
        changed = bool(pending)
        while changed:
            changed = False
            for name in pending:
                entry = self.entries[name]
                inputs = tuple(i for i in entry.inputs if not self._is_enumerable(self._new_by_name[name], i))
                if inputs != entry.inputs:
                    self.entries[name] = replace(entry, inputs=inputs)
                    changed = True

    def _is_enumerable(self, pattern: Pattern, position: int) -> bool:
        name = pattern.parameters[position].name
        others = [pattern.parameters[i].name for i in self.entries[pattern.qualified_name].inputs if i != position]
        return all(
            Binding(self.body_types(pattern, body), pattern.parameters, others).binds(name) for body in pattern.bodies
        )


def _may_be_method(expression: Expression) -> bool:
    """Return True if a path step in an expression has the name of a function. No recursion is used, as in `depth`."""
    waiting = [expression]
    for one in waiting:
        if isinstance(one, Navigation) and one.feature in FUNCTIONS:
            return True
        waiting += children(one)
    return False


def defined_features(entries: Mapping[str, LibraryEntry]) -> dict[Feature, str]:
    """Return the features that patterns define, each with the qualified name of the first pattern that defines it."""
    return {one.defines: name for name, one in reversed([*entries.items()]) if one.defines is not None}
