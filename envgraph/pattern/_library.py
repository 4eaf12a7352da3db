"""The library of patterns that an engine knows, with their types and lowered forms."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from copy import copy
from typing import NamedTuple

from envgraph.errors import Diagnostic, InvalidArgument, ResolutionError, Severity, did_you_mean, has_errors
from envgraph.metamodel import Attribute, AttributeType, Feature, Metamodel, Reference, type_name
from envgraph.pattern._analysis import (
    LibraryEntry,
    PatternAnalysis,
    PatternNames,
    UnknownNames,
    defined_features,
)
from envgraph.pattern._declared_functions import (
    FunctionDeclaration,
    Functions,
    declare_functions,
    resolve_functions,
)
from envgraph.pattern._expression_data import Variable
from envgraph.pattern._feature_paths import ResolvedPath
from envgraph.pattern._goals import LoweredPattern, StaticType
from envgraph.pattern._occurrences import BodyVariables, Data
from envgraph.pattern._query_data import Body, Parameter, PathConstraint, Pattern, Relation
from envgraph.pattern._type_inference import BodyTypes, PatternSignature
from envgraph.pattern._types import type_text
from envgraph.pattern.check._patterns import check_patterns
from envgraph.pattern.lowering._normal_form import lower_body

PATHS = "#path"
"""The package of patterns generated for paths. The name cannot be written in a file."""
VALUES = "#values"
"""The package of patterns generated for the values of data types and enums."""


class CheckedPatterns(NamedTuple):
    """New patterns with their analysis and diagnostics.

    Attributes:
        problems: all errors and warnings, in the order of the text.
        invalid_names: qualified names of patterns that have errors, or that call such a pattern or an unknown name.
        clean_names: qualified names of patterns without problems whose check needs only them and their callees.
    """

    given: Sequence[Pattern]
    analysis: PatternAnalysis
    problems: tuple[Diagnostic, ...]
    invalid_names: frozenset[str]
    clean_names: frozenset[str]

    @property
    def entries(self) -> tuple[LibraryEntry, ...]:
        """Return the entries of the new patterns, which `Library.register_checked` can register in a copy of the
        library.
        """
        return tuple(self.analysis.entries[one.qualified_name] for one in self.analysis.new_patterns)


class Library:
    """Patterns over one metamodel, checked together, with their types and their lowered forms.

    The meaning of a name in a registered pattern never changes: a pattern is removed together with its callers.
    Methods that take a qualified name raise `InvalidArgument` if no pattern has it.

    Args:
        metamodel: the metamodel that defines classes and features.

    Attributes:
        functions: the declared functions by name. `declare` replaces this mapping and never changes it.
        unknown: names that patterns and rules may mention although their definitions are unknown.
        earlier: the patterns of an earlier check with the same declared functions; equal patterns without problems are
            not checked again. None if there was no such check.
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self.metamodel = metamodel
        self.functions: Functions = {}
        self.unknown = UnknownNames()
        self.earlier: CheckedPatterns | None = None
        self._entries: dict[str, LibraryEntry] = {}
        self._names = PatternNames(())
        self._generated: dict[str, LibraryEntry] = {}
        self._lowered: dict[str, LoweredPattern] = {}
        self._checked: CheckedPatterns | None = None
        self._definitions: tuple[dict[str, LibraryEntry], dict[Feature, str]] = {}, {}

    @property
    def patterns(self) -> tuple[Pattern, ...]:
        """Return the registered patterns as they were added, in the order of registration."""
        return tuple(entry.written or entry.pattern for entry in self._entries.values())

    def names(self) -> tuple[str, ...]:
        """Return the qualified names of the registered patterns, in the order of registration."""
        return tuple(self._entries)

    def declare(self, *declarations: FunctionDeclaration) -> list[Diagnostic]:
        """Declare functions for expressions to call, and return the diagnostics of the declarations."""
        if not declarations:
            return []
        self.functions, problems = declare_functions(declarations, self.functions, self.metamodel)
        self._checked = None  # names that were unknown may be known now
        return problems

    def with_functions_resolved(self, data: Data) -> Data:
        """Return the same definition, in which function calls refer to the functions that `declare` has declared."""
        return resolve_functions(data, self.functions) if self.functions else data

    def check(self, *patterns: Pattern) -> list[Diagnostic]:
        """Return all errors and warnings of adding these patterns, in the order of their text. Nothing is added."""
        return list(self.analyse(*patterns).problems)

    def add(self, *patterns: Pattern) -> None:
        """Register patterns, which may call each other and registered patterns.

        Raises:
            ResolutionError: at least one pattern has an error. It contains all errors, and nothing is added.
        """
        checked = self.analyse(*patterns)
        if has_errors(checked.problems) or checked.invalid_names:
            raise ResolutionError([one for one in checked.problems if one.severity is Severity.ERROR])
        self._entries = checked.analysis.entries
        self._names = checked.analysis.names
        self._checked = None

    def with_valid_patterns(self, *patterns: Pattern) -> Library:
        """Return a copy of the library with the given patterns added, except patterns with errors and their callers.

        The names of the other patterns become unknown names of the copy.
        """
        copied = copy(self)
        new = {one.qualified_name: one for one in reversed(patterns) if one.qualified_name not in self._entries}
        left = [one for one in patterns if new.get(one.qualified_name) is one]
        while unsound := copied.analyse(*left).invalid_names:
            copied.unknown |= unsound
            left = [one for one in left if one.qualified_name not in unsound]
        copied.add(*left)
        return copied

    def register_checked(self, entries: Iterable[LibraryEntry]) -> None:
        """Register entries of patterns that have been checked already. An entry replaces a pattern of the same name."""
        self._entries = {**self._entries, **{entry.pattern.qualified_name: entry for entry in entries}}
        self._names = PatternNames([entry.pattern for entry in self._entries.values()])
        self._checked = None

    def update_from(self, grown: Library) -> None:
        """Replace the contents of this library by the contents of `grown`, a copy of it that has been extended."""
        self._entries, self._names = grown._entries, grown._names
        self.functions, self.unknown = grown.functions, grown.unknown
        self._generated.update(grown._generated)
        self._lowered.update(grown._lowered)
        self._checked = None

    def remove(self, names: Collection[str]) -> None:
        """Remove patterns by their qualified names. No remaining pattern may call them."""
        self._entries = {name: entry for name, entry in self._entries.items() if name not in names}
        self._names = PatternNames([entry.pattern for entry in self._entries.values()])
        self._lowered = {name: lowered for name, lowered in self._lowered.items() if name not in names}
        self._checked = None

    def callees(self, qualified_name: str) -> tuple[str, ...]:
        """Return the qualified names of the patterns that a pattern calls, or that define derived features it reads."""
        entry, defined = self._entry_of(qualified_name), self.definitions
        read = (defined[one.feature] for one in entry.reads if one.feature in defined)
        return tuple(dict.fromkeys((*entry.calls.values(), *read)))

    @property
    def definitions(self) -> Mapping[Feature, str]:
        """Return the derived features that patterns define, each with the qualified name of its pattern."""
        if self._definitions[0] is not self._entries:
            self._definitions = self._entries, defined_features(self._entries)
        return self._definitions[1]

    def analyse(self, *patterns: Pattern) -> CheckedPatterns:
        """Return the analysis and diagnostics of new patterns. The last result is cached until the library changes."""
        last = self._checked
        if (
            last is None
            or last.analysis.known is not self._entries
            or last.analysis.unknown is not self.unknown
            or len(last.given) != len(patterns)
            or any(one is not other for one, other in zip(last.given, patterns, strict=True))
        ):
            resolved = [self.with_functions_resolved(one) for one in patterns]
            analysis = PatternAnalysis(self.metamodel, self._entries, resolved, self.unknown)
            unchanged = self._unchanged_names(analysis)
            problems, unsound, clean = check_patterns(analysis, unchanged)
            last = CheckedPatterns(patterns, analysis, tuple(problems), unsound, clean)
            if patterns:
                self._checked = last
        return last

    def _unchanged_names(self, analysis: PatternAnalysis) -> Collection[str]:
        """Return the patterns that were without problems in the earlier check and are equal, as are their callees."""
        if self.earlier is None or analysis.known or self.earlier.analysis.metamodel is not analysis.metamodel:
            return ()
        if self.earlier.analysis.unknown not in (UnknownNames(), analysis.unknown):
            return ()
        before = self.earlier.analysis.entries
        equal = {name for name, entry in analysis.entries.items() if entry == before.get(name)}
        return [
            name for name in self.earlier.clean_names & equal if equal.issuperset(analysis.entries[name].calls.values())
        ]

    def resolve(self, name: str, package: str = "") -> Pattern | None:
        """Return the pattern that a name denotes in a package, or None if no pattern or several patterns match.

        The order is: a pattern of the package, a qualified name, a simple name that only one visible pattern has.
        """
        found, _ = self._names.find_candidates(name, package)
        return found[0] if len(found) == 1 else None

    def callee(self, caller: str, name: str) -> Pattern:
        """Return the pattern that a name denotes in the calls of a registered pattern.

        Args:
            caller: the qualified name of the calling pattern.
            name: the name in the call.

        Raises:
            InvalidArgument: the caller does not exist, or calls no pattern by that name.
        """
        calls = self._entry_of(caller).calls
        if name not in calls:
            raise InvalidArgument(f"pattern `{caller}` does not call `{name}`")
        return self._entries[calls[name]].pattern

    def get(self, qualified_name: str) -> Pattern:
        """Return a registered or generated pattern."""
        return self._entry_of(qualified_name).pattern

    def parameter_types(self, qualified_name: str) -> tuple[StaticType, ...]:
        """Return the types of the parameters, declared or inferred."""
        return self._entry_of(qualified_name).known_types

    def inputs(self, qualified_name: str) -> tuple[int, ...]:
        """Return the positions of `in` parameters that callers must bind: the pattern does not enumerate them."""
        return self._entry_of(qualified_name).inputs

    def relation_test(self, qualified_name: str, body: Body) -> Callable[[Relation], bool]:
        """Return the method `BodyTypes.may_hold` of the given body of a registered pattern."""
        entry = self._entry_of(qualified_name)
        return entry.bodies[entry.pattern.bodies.index(body)].allows_tuple

    def lowered_pattern(self, qualified_name: str) -> LoweredPattern:
        """Return the lowered form of a registered or generated pattern. Its calls may name generated patterns."""
        if qualified_name not in self._lowered:
            self._lowered[qualified_name] = self._lower(self._entry_of(qualified_name))
        return self._lowered[qualified_name]

    def __copy__(self) -> Library:
        """Return an independent library with the same patterns. Additions to one library do not affect the other."""
        copied = Library(self.metamodel)
        copied._entries = self._entries  # entries are replaced as a whole and never changed
        copied._names = self._names
        copied._generated = dict(self._generated)
        copied._lowered = dict(self._lowered)
        copied._checked = self._checked
        copied.functions = self.functions
        copied.unknown = self.unknown
        copied.earlier = self.earlier
        return copied

    def _entry_of(self, name: str) -> LibraryEntry:
        entry = self._entries.get(name) or self._generated.get(name)
        if entry is None:
            hint = did_you_mean(name, self._entries)
            raise InvalidArgument(f"unknown pattern `{name}`", hint)
        return entry

    def _lower(self, entry: LibraryEntry) -> LoweredPattern:
        pattern = entry.pattern
        bodies = (
            lower_body(pattern.parameters, types, self._generated_name, self.parameter_types) for types in entry.bodies
        )
        return LoweredPattern(
            pattern.qualified_name,
            tuple(parameter.name for parameter in pattern.parameters),
            entry.known_types,
            tuple(body for body in bodies if body is not None),
            entry.inputs,
        )

    def variable_types(self, pattern: Pattern) -> Mapping[str, StaticType | None]:
        """Return the types of the variables of a new pattern with one body, None where unknown. Errors are ignored."""
        (body,) = self.with_functions_resolved(pattern).bodies

        def callee(name: str) -> PatternSignature | None:
            called = self.resolve(name, pattern.package)
            return PatternSignature(called, self.parameter_types(called.qualified_name)) if called else None

        reading = BodyVariables(body, pattern.parameters)
        return BodyTypes(reading, pattern.parameters, self.metamodel, callee).types

    def _generated_name(self, wanted: ResolvedPath | AttributeType | Feature) -> str:
        """Return the name of the generated pattern for a path or for the values of a type. Register it if it is new.

        For a derived feature return the name of the pattern that defines it, or "".
        """
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
            self._generated[name] = self._generated_entry(pattern, type_)
        return name

    def _generated_entry(self, pattern: Pattern, *types: StaticType) -> LibraryEntry:
        """Return the entry of a generated pattern, which calls no other pattern. `types` are its parameter types."""
        bodies = (
            BodyTypes(BodyVariables(body, pattern.parameters), pattern.parameters, self.metamodel, lambda name: None)
            for body in pattern.bodies
        )
        return LibraryEntry(pattern, {}, types, bodies=tuple(bodies))

    def _path_pattern(self, path: ResolvedPath) -> str:
        name = f"{PATHS}.{path}"
        if name not in self._generated:
            features = tuple(step.name for step in path.steps)
            constraint = PathConstraint(path.cls, features, Variable("source"), Variable("target"))
            parameters = (Parameter("source", path.cls), Parameter("target", type_text(path.target)))
            pattern = Pattern(str(path), parameters, (Body((constraint,)),), PATHS, private=True)
            self._generated[name] = self._generated_entry(pattern, path.source, path.target)
        return name
