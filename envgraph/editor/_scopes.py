"""The names that a definition can use, with the types of its variables, also while the text is half-written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property

from envgraph.code import dataclass
from envgraph.editor._checked_files import CheckResult
from envgraph.editor._cursors import Cursor, split_arguments
from envgraph.editor._mentions import mentions_of
from envgraph.errors import Source
from envgraph.lang import Lexeme, PartReading, TextPart, text_parts
from envgraph.metamodel import Attribute, EnumType, Feature, Reference, Scalar, simple_name, type_name
from envgraph.pattern import Derivation, Pattern, Rule, Unit, type_text

_HEADERS = ("pattern", "rule", "unit", "environment", "function")
_INNER_BLOCKS = ("not", "require", "forall", "optional")
_CLAUSES = ("action", "each", "on", "observe", "agent", "agents", "limit", "draw")


@dataclass(frozen=True, slots=True)
class Signature:
    """A definition that can be called.

    Attributes:
        name: the shortest name that means it, with its package if another definition has the same name.
        parameters: the names of the parameters that a call has arguments for, and the name of each type or "".
        doc: the comment before the definition, or None.
        kind: "pattern", "rule", "unit" or "group".
    """

    name: str
    parameters: Sequence[tuple[str, str]]
    doc: str | None
    kind: str

    @property
    def label(self) -> str:
        """Return the signature as text, such as `near(a : Cell, b : Cell)`."""
        return f"{self.name}({', '.join(self.parameter_labels)})"

    @property
    def parameter_labels(self) -> list[str]:
        """Return each parameter as text, such as `a : Cell`."""
        return [f"{name} : {type_}" if type_ else name for name, type_ in self.parameters]


class Definitions:
    """The definitions that a file can use, as they were found in its last check.

    Attributes:
        metamodel: the last metamodel without errors; None if there was none.
    """

    def __init__(self, checked: CheckResult, file: str) -> None:
        self.workspace = checked.workspace
        self.metamodel = checked.metamodel
        self._file = file

    def written_types(self, kind: str) -> Iterator[str]:
        """Yield the classes ("class") or enums ("enum") that the text of the file defines, also if it has errors."""
        source = Source(self._file, self.workspace.sources.get(self._file, ""))
        for one in (one for part in text_parts(source) for one in mentions_of(part).definitions):
            if one.kind == "class" and one.scope is not None and one.scope.name == f"{kind} {one.text}":
                yield one.text

    @cached_property
    def patterns(self) -> Mapping[str, Signature]:
        """Return the patterns that the file may call, by the name in the call."""
        visible = [
            one
            for one in self.workspace.patterns
            if not one.private or (one.span is not None and one.span.source.name == self._file)
        ]
        return _by_name((one, "pattern", self._parameters(one)) for one in visible)

    @cached_property
    def rules(self) -> Mapping[str, Signature]:
        """Return the rules, units and derived groups, by the name in a call."""
        workspace = self.workspace
        rules = [(one, "rule", self._parameters(one)) for one in workspace.rules]
        units = [(one, "unit", self._parameters(one)) for one in workspace.units]
        return _by_name([*rules, *units, *((one, "group", []) for one in workspace.derivations)])

    @cached_property
    def _checked_patterns(self) -> frozenset[str]:
        registration = self.workspace.registration
        return frozenset(registration.library.names() if registration else ())

    def _parameters(self, one: Pattern | Rule | Unit) -> list[tuple[str, str]]:
        registration = self.workspace.registration
        types: Sequence[str] = [parameter.type or "" for parameter in one.parameters]
        if registration is not None and isinstance(one, Pattern) and one.qualified_name in self._checked_patterns:
            types = [type_text(known) for known in registration.library.parameter_types(one.qualified_name)]
        given = zip(one.parameters, types, strict=True)
        return [(each.name, kind) for each, kind in given if isinstance(one, Pattern) or each.direction != "out"]

    def find_class(self, name: str) -> str | None:
        """Return the full name of the class that a name means; None if it means none, or several."""
        found = list(self.metamodel.full_names(name).values()) if self.metamodel else []
        known = [one for one in found if self.metamodel and one in self.metamodel.classes]
        return known[0] if len(known) == 1 else None

    def find_enum(self, name: str) -> EnumType | None:
        """Return the enum that a name means."""
        enums = self.metamodel.enum_types if self.metamodel else ()
        return next((one for one in enums if simple_name(one.name) == name), None)

    def features(self, cls: str | None) -> Mapping[str, Feature]:
        """Return the features of a class by name, inherited ones too; none for an unknown class."""
        if self.metamodel is None or cls is None or cls not in self.metamodel.classes:
            return {}
        return self.metamodel.features(cls)

    def type_of_path(self, base: str, path: Sequence[str]) -> str:
        """Return the name of the type at the end of a path of features from a class; "" if it is unknown."""
        for name in path:
            feature = self.features(base).get(name)
            if feature is None:
                return ""
            base = feature.target if isinstance(feature, Reference) else attribute_type(feature)
        return base

    def is_class(self, type_: str) -> bool:
        """Return True if this is the full name of a class."""
        return self.metamodel is not None and type_ in self.metamodel.classes

    def fits(self, type_: str, wanted: str) -> bool:
        """Return True if a value of a type can be where another type is wanted; an unknown type ("") always can."""
        if not type_ or not wanted or type_ == wanted:
            return True
        classes = self.metamodel.classes if self.metamodel else {}
        if type_ in classes and wanted in classes:
            assert self.metamodel is not None
            return self.metamodel.may_overlap(type_, wanted)
        return {type_, wanted} == {Scalar.INT, Scalar.FLOAT}


def _by_name(
    found: Iterable[tuple[Pattern | Rule | Unit | Derivation, str, list[tuple[str, str]]]],
) -> Mapping[str, Signature]:
    """Return the signatures of definitions by their simple names, or by the qualified names of those that share one."""
    given = [*found]
    counts = Counter(one.name for one, _, _ in given)
    names = [one.name if counts[one.name] == 1 else one.qualified_name for one, _, _ in given]
    return {
        name: Signature(name, parameters, one.doc, kind)
        for name, (one, kind, parameters) in zip(names, given, strict=True)
    }


def attribute_type(feature: Feature) -> str:
    """Return the name of the type of an attribute's values."""
    assert isinstance(feature, Attribute)
    return str(type_name(feature.type))


class Scope:
    """The variables that can be used at the cursor, with their types as far as the text shows them.

    Attributes:
        variables: by name: the name of a class, enum or scalar type, or "" for an unknown type. If the text gives
            several classes, it is the first of them, and `type_of` returns the smallest.
    """

    def __init__(self, definitions: Definitions, cursor: Cursor) -> None:
        self._definitions = definitions
        self._types: dict[str, str] = {}
        self._declared: dict[str, str] = {}
        reading, place = cursor.completed(), cursor.index
        first, last = _definition_around(reading.lexemes, place)
        whole = reading.lexemes[first:last]
        ranges = [
            (whole[start].start, whole[min(end, len(whole)) - 1].end)
            for start, end in _visible_regions(cursor.language, whole, place - first)
            if start < len(whole)
        ]
        spans = [(0, len(whole))] if cursor.language != "query" else [*_visible_regions("query", whole, place - first)]
        for start, end in (*spans, *spans):  # the type of a link's end may be known only after all text was read
            self._read_types(whole[start:end])
        self.variables = {
            name: self._declared.get(name, "")
            for name, offset in (*_variables(cursor, reading), *self._declared_in(reading))
            if any(start <= offset < end for start, end in ranges)
        }

    def _declared_in(self, reading: PartReading) -> Iterator[tuple[str, int]]:
        """Yield the variables with known types, with their offsets, in a text that could not be parsed."""
        for one in reading.lexemes if reading.tree is None else ():
            if one.kind == "NAME" and one.value in self._declared:
                yield one.value, one.start

    def type_of(self, name: str) -> str:
        """Return the type of a variable of the definition; "" if it is unknown."""
        return self._types.get(name, "")

    def _read_types(self, lexemes: Sequence[Lexeme]) -> None:
        for index, one in enumerate(lexemes):
            if one.kind != "NAME":
                continue
            values = [each.value for each in lexemes[max(0, index - 1) : index + 5]]
            before, values = (values[0], values[1:]) if index else ("", values)
            if values[1:2] == [":"] and before not in (".", "?", "retype") and len(values) > 2:
                self._add(one.value, values[4] if values[3:4] == ["::"] and len(values) > 4 else values[2])
            elif values[1:2] == ["("] and before == "find":
                self._read_call(one.value, lexemes[index + 2 :])
            elif values[1:2] in (["("], ["."]) and before not in (".", "neg"):
                self._read_relation(lexemes[index:])
            elif values[1:2] in (["-"], ["<-"]):
                self._read_arrow(lexemes[index : index + 6])

    def _add(self, variable: str, type_: str) -> None:
        """Record a type of a variable; of two classes, the smaller one counts."""
        definitions = self._definitions
        full = definitions.find_class(type_) or type_
        metamodel, known = definitions.metamodel, self._types.get(variable)
        if variable == "_" or not type_:
            return
        self._declared.setdefault(variable, full)
        classes = metamodel.classes if metamodel else {}
        if known in classes and full in classes:
            assert metamodel is not None
            assert known is not None
            if not metamodel.is_a(full, known):
                return
        self._types[variable] = full

    def _read_call(self, name: str, arguments: Sequence[Lexeme]) -> None:
        pattern = self._definitions.patterns.get(name)
        parameters = pattern.parameters if pattern else ()
        for argument, (_, type_) in zip(split_arguments(arguments), parameters, strict=False):
            if len(argument) == 1 and argument[0].kind == "NAME":
                self._add(argument[0].value, type_)

    def _read_relation(self, lexemes: Sequence[Lexeme]) -> None:
        """Read the types of `Class(x)` and `Class.feature(x, y)`."""
        cls = self._definitions.find_class(lexemes[0].value)
        opening = next((i for i, one in enumerate(lexemes) if one.value in ("(", ";", "{", "}")), None)
        if cls is None or opening is None or lexemes[opening].value != "(":
            return
        path = [one.value for one in lexemes[1:opening] if one.kind == "NAME"]
        types = [cls, self._definitions.type_of_path(cls, path)] if path else [cls]
        for argument, type_ in zip(split_arguments(lexemes[opening + 1 :]), types, strict=False):
            if len(argument) == 1 and argument[0].kind == "NAME":
                self._add(argument[0].value, type_)

    def _read_arrow(self, lexemes: Sequence[Lexeme]) -> None:
        """Read the types of `x -reference-> y` and `x <-reference- y`."""
        left, first, *rest = [one.value for one in lexemes if one.value not in ("+", "*")]
        if len(rest) < 3 or (first, rest[1]) not in (("-", "->"), ("<-", "-")):
            return
        source, target = (left, rest[2]) if first == "-" else (rest[2], left)
        reference = self._definitions.features(self._types.get(source)).get(rest[0])
        if isinstance(reference, Reference) and target not in self._types:
            self._add(target, reference.target)


def _definition_around(lexemes: Sequence[Lexeme], index: int) -> tuple[int, int]:
    """Return the range of indices (first, last + 1) of the lexemes of the definition that contains an index."""
    starts = [place for place, one in enumerate(lexemes) if one.value in _HEADERS and not one.brace_depth]
    first = max((place for place in starts if place < index), default=0)
    return first, min((place for place in starts if place >= max(index, first + 1)), default=len(lexemes))


def _variables(cursor: Cursor, completed: PartReading) -> Iterator[tuple[str, int]]:
    """Yield the variables of a part, but for the word at the cursor, with their offsets in the completed part.

    A statement with the cursor may be readable only without a name there, so both readings count.
    """
    place = completed.lexemes[cursor.index].start
    added = len(completed.source.text) - len(cursor.reading.source.text)
    for reading in dict.fromkeys((completed, cursor.reading)):
        for one in mentions_of(TextPart(cursor.language, 0, reading.source.text)).all:
            offset = one.start + added if reading is not completed and one.start >= place else one.start
            if one.kind == "variable" and offset != place:
                yield one.text, offset


def _visible_regions(language: str, lexemes: Sequence[Lexeme], index: int) -> Iterator[tuple[int, int]]:
    """Yield first and last index (excluded) of the texts of a definition whose variables can be used at a place."""
    opening = next((place for place, one in enumerate(lexemes) if one.value == "{"), len(lexemes))
    yield 0, opening
    if language == "rules":
        yield from _blocks_around(lexemes, opening, index)
    elif index > opening:
        yield _clause_around(language, lexemes, index)
    for place, one in enumerate(lexemes[:index]):
        if one.terminal == "AGENT":
            inside = (i for i in range(place, len(lexemes)) if lexemes[i].brace_depth == one.brace_depth + 1)
            end = next((i for i in inside if lexemes[i].value == "}"), len(lexemes))
            if index <= end:
                yield place, place + 2


def _blocks_around(lexemes: Sequence[Lexeme], start: int, index: int) -> Iterator[tuple[int, int]]:
    """Yield the ranges of a rule without its inner blocks, such as `not { .. }`, that do not contain a place."""
    place = start
    while place < len(lexemes):
        if lexemes[place].value in _INNER_BLOCKS and lexemes[place].terminal != "NAME":
            depth = lexemes[place].brace_depth
            inside = (i for i in range(place + 2, len(lexemes)) if lexemes[i].brace_depth == depth + 1)
            end = next((i for i in inside if lexemes[i].value == "}"), len(lexemes))
            if not place < index <= end:
                yield start, place
                start = place = end
        place += 1
    yield start, len(lexemes)


def _clause_around(language: str, lexemes: Sequence[Lexeme], index: int) -> tuple[int, int]:
    """Return the range of the body of a pattern, or of the clause of an environment, around a place."""
    depth = lexemes[min(index, len(lexemes) - 1)].brace_depth
    if language == "query":
        starts = [place for place, one in enumerate(lexemes) if one.value == "{"]
        ends = [place for place, one in enumerate(lexemes) if one.value == "}"]
    else:
        starts = [i for i, one in enumerate(lexemes) if one.value in _CLAUSES and one.brace_depth <= depth]
        ends = starts
    first = max((place for place in starts if place < index), default=0)
    return first, min((place for place in ends if place >= index and place > first), default=len(lexemes))
