"""The patterns that an engine knows."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import copy
from typing import NamedTuple

from envgraph.errors import Diagnostic, InvalidArgument, ResolutionError, Severity, did_you_mean, has_errors
from envgraph.metamodel import Attribute, AttributeType, Feature, Metamodel, Reference, type_name
from envgraph.pattern._analysis import Analysis, Entry, Names, UnknownNames, definitions
from envgraph.pattern._bodies import Data, Reading
from envgraph.pattern._functions import FunctionDeclaration, Functions, declared, resolved
from envgraph.pattern._inference import BodyTypes, Signature
from envgraph.pattern._lowered import LoweredPattern, StaticType
from envgraph.pattern._paths import ResolvedPath
from envgraph.pattern._queries import Body, Parameter, PathConstraint, Pattern, Relation
from envgraph.pattern._terms import Variable
from envgraph.pattern._types import type_text
from envgraph.pattern.check._check import check_patterns
from envgraph.pattern.lowering._normal import lower_body

PATHS = "#path"
"""Package of the patterns that are generated for paths; no text spells it."""
VALUES = "#values"
"""Package of those that are generated for the values of data types and enums."""


class Checked(NamedTuple):
    """New patterns as they have been looked at, and what is wrong with them.

    Attributes:
        problems: all errors and warnings, in the order of the text.
        unsound: those, by qualified name, that have errors, or call one with some or something unknown.
    """

    given: Sequence[Pattern]
    analysis: Analysis
    problems: tuple[Diagnostic, ...]
    unsound: frozenset[str]

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The patterns as `add` would register them, for libraries that know the same others."""
        return tuple(self.analysis.entries[one.qualified_name] for one in self.analysis.new_patterns)


class Library:
    """Patterns over one metamodel, checked together, with their types and their normal forms.

    What a name in a registered pattern means never changes: a pattern is removed together with those that call it.

    Args:
        metamodel: what the names of classes and features mean.

    Attributes:
        functions: that are declared, by name; `declare` gives others, and never changes these.
        unknown: names that patterns and rules may mention although nothing is known about them.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.functions: Functions = {}
        self.unknown = UnknownNames()
        self._entries: dict[str, Entry] = {}
        self._names = Names(())
        self._generated: dict[str, Entry] = {}
        self._lowered: dict[str, LoweredPattern] = {}
        self._checked: Checked | None = None
        self._definitions: tuple[dict[str, Entry], dict[Feature, str]] = {}, {}

    @property
    def patterns(self) -> tuple[Pattern, ...]:
        """The registered patterns, in the order they were added."""
        return tuple(entry.written or entry.pattern for entry in self._entries.values())

    def names(self) -> tuple[str, ...]:
        """Qualified names of the registered patterns, in the order they were added."""
        return tuple(self._entries)

    def declare(self, *declarations: FunctionDeclaration) -> list[Diagnostic]:
        """Declare functions for expressions to call; returns what is wrong with the declarations."""
        if not declarations:
            return []
        self.functions, problems = declared(declarations, self.functions, self.metamodel)
        self._checked = None  # what was unknown then may be known now
        return problems

    def resolved(self, data: Data) -> Data:
        """The same definition, in which calls of declared functions know what they call."""
        return resolved(data, self.functions) if self.functions else data

    def check(self, *patterns: Pattern) -> list[Diagnostic]:
        """All errors and warnings that adding these patterns would bring, in the order of their text."""
        return list(self.checked(*patterns).problems)

    def add(self, *patterns: Pattern) -> None:
        """Register patterns, which may call each other and those that are registered already.

        Raises:
            ResolutionError: at least one of them has an error; all errors together. Nothing is added.
        """
        checked = self.checked(*patterns)
        if has_errors(checked.problems) or checked.unsound:
            raise ResolutionError([one for one in checked.problems if one.severity is Severity.ERROR])
        self._entries = checked.analysis.entries
        self._names = checked.analysis.names
        self._checked = None

    def with_sound(self, *patterns: Pattern) -> Library:
        """A library that has also those of the patterns that can be added; what the others are is unknown to it."""
        twin = copy(self)
        new = {
            one.qualified_name: one for one in reversed(patterns) if one.qualified_name not in self._entries
        }
        left = [one for one in patterns if new.get(one.qualified_name) is one]
        while unsound := twin.checked(*left).unsound:
            twin.unknown |= unsound
            left = [one for one in left if one.qualified_name not in unsound]
        twin.add(*left)
        return twin

    def take(self, entries: Iterable[Entry]) -> None:
        """Register patterns that were checked already."""
        self._entries = {**self._entries, **{entry.pattern.qualified_name: entry for entry in entries}}
        self._names = Names([entry.pattern for entry in self._entries.values()])
        self._checked = None

    def update(self, grown: Library) -> None:
        """Know all that a copy of this library has come to know."""
        self._entries, self._names = grown._entries, grown._names
        self.functions, self.unknown = grown.functions, grown.unknown
        self._generated.update(grown._generated)
        self._lowered.update(grown._lowered)
        self._checked = None

    def remove(self, names: Collection[str]) -> None:
        """Forget patterns (qualified names), which no others call."""
        self._entries = {name: entry for name, entry in self._entries.items() if name not in names}
        self._names = Names([entry.pattern for entry in self._entries.values()])
        self._lowered = {name: lowered for name, lowered in self._lowered.items() if name not in names}
        self._checked = None

    def called(self, qualified_name: str) -> tuple[str, ...]:
        """Qualified names of the patterns that a registered one calls.

        Raises:
            InvalidArgument: there is no such pattern.
        """
        entry, defined = self._entry(qualified_name), self.definitions
        read = (defined[one.feature] for one in entry.reads if one.feature in defined)
        return tuple(dict.fromkeys((*entry.calls.values(), *read)))

    @property
    def definitions(self) -> Mapping[Feature, str]:
        """The derived features that patterns define, each with the qualified name of its pattern."""
        if self._definitions[0] is not self._entries:
            self._definitions = self._entries, definitions(self._entries)
        return self._definitions[1]

    def checked(self, *patterns: Pattern) -> Checked:
        """Return what is known about new patterns; nothing is worked out again if they are those of the last time."""
        last = self._checked
        if (
            last is None
            or last.analysis.known is not self._entries
            or last.analysis.unknown is not self.unknown
            or len(last.given) != len(patterns)
            or any(one is not other for one, other in zip(last.given, patterns, strict=True))
        ):
            resolved = [self.resolved(one) for one in patterns]
            analysis = Analysis(self.metamodel, self._entries, resolved, self.unknown)
            problems, unsound = check_patterns(analysis)
            last = Checked(patterns, analysis, tuple(problems), unsound)
            if patterns:
                self._checked = last
        return last

    def resolve(self, name: str, package: str = "") -> Pattern | None:
        """The pattern that a name means in a package, or None if it means none or several.

        First a pattern of the package, then a qualified name, then a simple name that only one visible pattern has.
        """
        found, _ = self._names.candidates(name, package)
        return found[0] if len(found) == 1 else None

    def callee(self, caller: str, name: str) -> Pattern:
        """The pattern that a name means in the calls of a registered pattern (qualified name).

        Raises:
            InvalidArgument: there is no such caller, or it calls nothing by that name.
        """
        calls = self._entry(caller).calls
        if name not in calls:
            raise InvalidArgument(f"pattern `{caller}` does not call `{name}`")
        return self._entries[calls[name]].pattern

    def get(self, qualified_name: str) -> Pattern:
        """A registered pattern, or one generated for a path.

        Raises:
            InvalidArgument: there is none of that name.
        """
        return self._entry(qualified_name).pattern

    def parameter_types(self, qualified_name: str) -> tuple[StaticType, ...]:
        """Types of the parameters, declared or else inferred.

        Raises:
            InvalidArgument: there is no such pattern.
        """
        return self._entry(qualified_name).known_types

    def inputs(self, qualified_name: str) -> tuple[int, ...]:
        """Positions of the `in` parameters that nothing enumerates: whoever asks has to bind them.

        Raises:
            InvalidArgument: there is no such pattern.
        """
        return self._entry(qualified_name).inputs

    def may_hold(self, qualified_name: str, body: Body) -> Callable[[Relation], bool]:
        """Return the test whether the types of a body allow a tuple of a relation under `neg` or in an aggregate.

        Raises:
            InvalidArgument: there is no such pattern.
        """
        entry = self._entry(qualified_name)
        return entry.bodies[entry.pattern.bodies.index(body)].may_hold

    def lowered(self, qualified_name: str) -> LoweredPattern:
        """The normal form of a pattern. Its calls may name generated patterns, which are found here, too.

        Raises:
            InvalidArgument: there is no such pattern.
        """
        if qualified_name not in self._lowered:
            self._lowered[qualified_name] = self._lower(self._entry(qualified_name))
        return self._lowered[qualified_name]

    def __copy__(self) -> Library:
        """An independent library with the same patterns: what is added to one is unknown to the other."""
        twin = Library(self.metamodel)
        twin._entries = self._entries  # which is replaced, and never changed
        twin._names = self._names
        twin._generated = dict(self._generated)
        twin._lowered = dict(self._lowered)
        twin._checked = self._checked
        twin.functions = self.functions
        twin.unknown = self.unknown
        return twin

    def _entry(self, name: str) -> Entry:
        entry = self._entries.get(name) or self._generated.get(name)
        if entry is None:
            hint = did_you_mean(name, self._entries)
            raise InvalidArgument(f"unknown pattern `{name}`", hint)
        return entry

    def _lower(self, entry: Entry) -> LoweredPattern:
        pattern = entry.pattern
        bodies = (
            lower_body(pattern.parameters, types, self._generate, self.parameter_types)
            for types in entry.bodies
        )
        return LoweredPattern(
            pattern.qualified_name,
            tuple(parameter.name for parameter in pattern.parameters),
            entry.known_types,
            tuple(body for body in bodies if body is not None),
            entry.inputs,
        )

    def variable_types(self, pattern: Pattern) -> Mapping[str, StaticType | None]:
        """Types of the variables of a new pattern with one body, as far as it tells, whatever is wrong with it."""
        (body,) = self.resolved(pattern).bodies

        def callee(name: str) -> Signature | None:
            called = self.resolve(name, pattern.package)
            return Signature(called, self.parameter_types(called.qualified_name)) if called else None

        reading = Reading(body, pattern.parameters)
        return BodyTypes(reading, pattern.parameters, self.metamodel, callee).types

    def _generate(self, wanted: ResolvedPath | AttributeType | Feature) -> str:
        """Register the pattern of a path or of the values of a type; the same one always has the same name."""
        if isinstance(wanted, ResolvedPath):
            return self._path_pattern(wanted)
        if isinstance(wanted, Attribute | Reference):
            return self.definitions.get(wanted, "")
        return self._values_pattern(wanted)

    def _values_pattern(self, type_: AttributeType) -> str:
        name = f"{VALUES}.{type_name(type_)}"
        if name not in self._generated:
            value = Variable("value")
            bodies = tuple(
                Body((PathConstraint(attribute.owner, (attribute.name,), Variable("_"), value),))
                for attribute in self.metamodel.attributes
                if attribute.type == type_
            )
            parameter = Parameter("value", type_name(type_))
            pattern = Pattern(type_name(type_), (parameter,), bodies, VALUES, private=True)
            self._generated[name] = self._made(pattern, type_)
        return name

    def _made(self, pattern: Pattern, *types: StaticType) -> Entry:
        """A pattern that calls no other."""
        bodies = (
            BodyTypes(
                Reading(body, pattern.parameters), pattern.parameters, self.metamodel, lambda name: None
            )
            for body in pattern.bodies
        )
        return Entry(pattern, {}, types, bodies=tuple(bodies))

    def _path_pattern(self, path: ResolvedPath) -> str:
        name = f"{PATHS}.{path}"
        if name not in self._generated:
            features = tuple(step.name for step in path.steps)
            constraint = PathConstraint(path.cls, features, Variable("source"), Variable("target"))
            parameters = (Parameter("source", path.cls), Parameter("target", type_text(path.target)))
            pattern = Pattern(str(path), parameters, (Body((constraint,)),), PATHS, private=True)
            self._generated[name] = self._made(pattern, path.source, path.target)
        return name
