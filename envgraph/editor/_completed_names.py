"""Offer the names that can be written at the cursor.

The parser reads a name at the cursor as a trial. The grammar rules that can then be reduced, and the signs that can
follow, say what the name would stand for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeAlias

from envgraph.editor._cursors import Cursor
from envgraph.editor._mentions import mentions_of
from envgraph.editor._scopes import Definitions, Scope, Signature, attribute_type
from envgraph.editor._wanted_values import WantedValue
from envgraph.lang import Lexeme, TextPart, name_roles
from envgraph.metamodel import Attribute, EnumType, Feature, Reference, Scalar, simple_name
from envgraph.pattern import FUNCTIONS

OfferedName: TypeAlias = tuple[str, str, str, str | None, str, bool]
"""The fields of an `Offer`: label, kind, detail, documentation, inserted text, and whether it is a snippet."""

ANNOTATIONS: Final[Mapping[str, Mapping[str, str]]] = {
    "metamodel": {
        "key": "key(${1:attribute})", "glyph": 'glyph("${1:X}", "${2:#868e96}")', "colour": "colour",
        "frozen": "frozen", "range": "range(${1:0}, ${2:9})", "nonunique": "nonunique", "derived": "derived",
    },
    "query": {
        "Constraint": 'Constraint(key = {${1:x}}, severity = "${2:error}", message = "${3:text}")',
        "QueryBasedFeature": "QueryBasedFeature", "SafeRecursion": "SafeRecursion",
        "FunctionalDependency": "FunctionalDependency(forEach = {${1:x}}, unique = {${2:y}})",
    },
    "rules": {
        "weight": "weight(${1:1.0})", "priority": "priority(${1:1})", "semantics": "semantics(${1|spo,dpo|})",
        "match": "match(${1|homomorphic,injective|})", "hom": "hom(${1:a}, ${2:b})", "cap": "cap(${1:1})",
    },
    "environment": {"key": 'key("${1:ArrowUp}")'},
}  # fmt: skip
"""By language and name: the snippet of an annotation."""
_NOTHING: Final = Signature("nothing", (), "Do nothing.", "nothing")
"""The rule without effect that every environment can call."""
_OBJECT_ACTIONS: Final = ("set", "create", "delete", "retype", "move", "merge", "redirect", "to")
"""The keywords of actions before the name of an object."""
_SUPPRESS: Final = 'suppress("${1:code}")'


def offered_names(cursor: Cursor, states: list[int], definitions: Definitions) -> Iterator[OfferedName]:
    """Yield the names that can be written at the cursor.

    Args:
        cursor: the place.
        states: the states of the parser before the cursor.
        definitions: the definitions that can be named.
    """
    roles = name_roles(cursor.reading.grammar, states)
    if roles is not None:
        yield from _NameOffers(cursor, definitions, *roles).offers()


class _NameOffers:
    """The names for one cursor; `rules` and `signs` are the roles that a name at the cursor can have."""

    def __init__(self, cursor: Cursor, definitions: Definitions, rules: frozenset[str], signs: frozenset[str]) -> None:
        self._cursor = cursor
        self._definitions = definitions
        self._rules = rules
        self._signs = signs
        self._before = cursor.before().value

    @cached_property
    def _scope(self) -> Scope:
        return Scope(self._definitions, self._cursor)

    @cached_property
    def _wanted(self) -> WantedValue:
        return WantedValue(self._cursor, self._definitions, self._scope)

    def offers(self) -> Iterator[OfferedName]:
        if self._before == "@" and "annotation" in self._rules:
            yield from self._annotations()
        elif self._before == ".":
            yield from self._after_dot()
        elif self._before == "::":
            yield from self._after_colons()
        elif self._cursor.language == "metamodel":
            yield from self._in_metamodel()
        elif self._cursor.language == "model":
            yield from self._in_model()
        else:
            yield from self._in_definitions()

    # --- by the sign before the name ---

    def _annotations(self) -> Iterator[OfferedName]:
        for name, snippet in {**ANNOTATIONS.get(self._cursor.language, {}), "suppress": _SUPPRESS}.items():
            is_written = self._cursor.following == "("
            yield name, "function", "", None, name if is_written else snippet, not is_written

    def _after_dot(self) -> Iterator[OfferedName]:
        """Yield the features at the end of a path such as `Class.feature.` or `variable.feature.`."""
        cursor, path = self._cursor, []
        distance = 1
        while cursor.before(distance).value == "." and cursor.before(distance + 1).kind == "NAME":
            path.append(cursor.before(distance + 1).value)
            distance += 2
        if not path:
            return
        base, *names = reversed(path)
        type_ = self._scope.type_of(base) or self._definitions.find_class(base) or ""
        found = self._definitions.features(self._definitions.type_of_path(type_, names))
        wanted = found.values()
        if "move" in self._rules:
            return (yield from _feature_names(one for one in wanted if isinstance(one, Reference) and one.containment))
        yield from _feature_names(wanted)

    def _after_colons(self) -> Iterator[OfferedName]:
        """Yield the literals of the enum before `::`; without an enum, the literals that fit here."""
        named = self._cursor.before(2)
        enum = self._definitions.find_enum(named.value) if named.kind == "NAME" else None
        if self._rules & {"enum_literal", "value", "plain"}:
            feature = self._wanted.feature() if self._cursor.language == "model" else None
            type_ = attribute_type(feature) if isinstance(feature, Attribute) else self._wanted.type()
            wanted = self._definitions.find_enum(type_)
            metamodel = self._definitions.metamodel
            enums = [enum] if enum else [wanted] if wanted else metamodel.enum_types if metamodel else ()
            for one in enums:
                yield from _literals(one)
        elif "type" in self._rules:
            yield from self._classes()

    # --- by language ---

    def _in_metamodel(self) -> Iterator[OfferedName]:
        definitions, rules = self._definitions, self._rules
        metamodel = definitions.metamodel
        if self._before in ("contains", "refers"):
            yield from self._classes()
        elif "extends" in rules:
            own = next((one.value for one in self._names_before() if one.value not in ("extends", ",")), "")
            classes = metamodel.classes if metamodel else {}
            is_below = {name for name in classes if own in classes and metamodel and metamodel.is_a(name, own)}
            yield from self._classes(lambda name: name not in is_below)
        elif "value" in rules:
            for enum in metamodel.enum_types if metamodel else ():
                if any(one.value == simple_name(enum.name) for one in self._cursor.lexemes[: self._cursor.index][-8:]):
                    yield from _literals(enum)
        elif self._before == "opposite":
            yield from self._opposites()
        elif self._signs >= {"["} and not rules:
            for scalar in Scalar:
                yield scalar.value, "type", "", None, "", False
            yield from self._enums()
        elif "annotation_value" in rules:
            yield from self._key_attributes()

    def _in_model(self) -> Iterator[OfferedName]:
        rules, signs = self._rules, self._signs
        metamodel = self._definitions.metamodel
        if self._before == ":" and self._cursor.before(3).value == "model":
            if metamodel:
                yield metamodel.name, "class", "metamodel", None, "", False
        elif rules & {"_object", "entry", "legend_entry"} or ("value" in rules and self._before == ":"):
            yield from self._classes(self._is_concrete)
        elif "part" in rules or self._before == "next":
            yield from _feature_names(self._coordinates(is_next=self._before == "next"))
        elif self._before == "table":
            yield from self._classes(self._is_concrete)
        elif "=" in signs and not rules:
            yield from self._features_of_block()
        elif self._cursor.enclosing("(") is not None:
            opening = self._cursor.enclosing("(")
            cls = self._definitions.find_class(self._cursor.lexemes[(opening or 1) - 1].value)
            yield from _feature_names(self._definitions.features(cls).values())
        elif "plain" in rules:
            yield from self._model_values()

    def _in_definitions(self) -> Iterator[OfferedName]:
        rules, signs = self._rules, self._signs
        if "annotation_value" in rules:
            yield from self._annotated_variables()
        if "type" in rules:
            yield from self._types()
        if "qualified_name" in rules or (
            "{" in signs and self._before in ("if", "neg") and self._cursor.language == "rules"
        ):
            yield from self._calls()
        is_class = "type" in rules and self._cursor.following in ("(", ".")
        is_call = "qualified_name" in rules and self._cursor.following == "("
        if rules & {"variable", "vertex", "chain", "redirect", "merge", "around"} or self._is_action_object():
            yield from () if is_class or is_call else self._variables()
        if "variable" in rules and "::" in signs:
            yield from self._enum_values()
        if "variable" in rules and "(" in signs:
            yield from self._functions()
        if "=" in signs and not rules and self._cursor.enclosing("{") is not None:
            yield from self._features_of_block()
        if self._before in ("-", "<-") and not rules:
            yield from self._arrow_references()
        if self._before == "label" or (self._cursor.enclosing("(") is not None and not rules and signs <= {",", ")"}):
            yield from self._drawn_attributes()

    def _is_action_object(self) -> bool:
        """Return True if the name is the object of an action such as `set`, `retype` and `move`."""
        return self._before in ("set", "retype", "move", "merge", "to", "with") or (
            self._cursor.language == "environment" and self._before == "," and "at" in self._signs
        )

    # --- kinds of names ---

    def _classes(self, allows: Callable[[str], bool] = lambda name: True) -> Iterator[OfferedName]:
        for cls in self._definitions.metamodel.class_list if self._definitions.metamodel else ():
            if allows(cls.name):
                detail = "abstract class" if cls.abstract else "class"
                yield simple_name(cls.name), "class", detail, cls.doc, "", False
        yield from self._unread_types("class")

    def _is_concrete(self, name: str) -> bool:
        metamodel = self._definitions.metamodel
        return metamodel is not None and not metamodel.classes[name].abstract

    def _enums(self) -> Iterator[OfferedName]:
        for enum in self._definitions.metamodel.enum_types if self._definitions.metamodel else ():
            yield simple_name(enum.name), "enum", ", ".join(enum.literals), enum.doc, "", False
        yield from self._unread_types("enum")

    def _unread_types(self, kind: str) -> Iterator[OfferedName]:
        """Yield the types of a metamodel with errors that are not in the last metamodel without errors."""
        metamodel = self._definitions.metamodel
        for name in self._definitions.written_types(kind) if self._cursor.language == "metamodel" else ():
            if metamodel is None or not metamodel.full_names(name):
                yield name, kind, kind, None, "", False

    def _types(self) -> Iterator[OfferedName]:
        """Yield the names of classes; for the type of a parameter, also those of enums and data types."""
        if self._cursor.following in ("-", "<-") and self._before != ":":
            return  # an object is before an arrow
        is_new = self._before == ":" and self._cursor.before(3).value in ("retype", "create")
        yield from self._classes(self._is_concrete if is_new else lambda name: True)
        opening = self._cursor.enclosing("(")
        if opening is not None and self._before == ":" and self._cursor.lexemes[opening - 2].value != "environment":
            yield from self._enums()
            before = self._cursor.lexemes[opening - 2].value if opening > 1 else ""
            for scalar in () if before == "action" else Scalar:
                yield scalar.value, "type", "", None, "", False

    def _calls(self) -> Iterator[OfferedName]:
        if self._before == "find" or self._cursor.before(2).value == "import" or self._before == "import":
            found: Iterable[Signature] = self._definitions.patterns.values()
        elif self._before == "package":
            return
        else:
            found = self._definitions.rules.values()
            if self._cursor.language == "environment":
                found = [*(one for one in found if one.kind != "group"), _NOTHING]
        is_closure = self._cursor.following in ("+", "*")
        for one in found:
            if is_closure and len(one.parameters) != 2:
                continue
            label = one.label if one.parameters else one.kind
            if is_closure or self._cursor.following == "(" or self._before in ("import", "pattern"):
                yield one.name, "function", label, one.doc, "", False
                continue
            holes = ", ".join(f"${{{place}:{name}}}" for place, (name, _) in enumerate(one.parameters, start=1))
            needs_brackets = bool(one.parameters) or one.kind in ("pattern", "nothing")
            inserted = f"{one.name}({holes})" if needs_brackets else one.name
            yield one.name, "function", label, one.doc, inserted, bool(holes)

    def _variables(self) -> Iterator[OfferedName]:
        definitions, wanted = self._definitions, self._wanted.type()
        # In an expression, a feature of the variable may follow, whose value is data.
        may_continue = "(" in self._signs and not definitions.is_class(wanted)
        needs_object = self._before in _OBJECT_ACTIONS
        for name, type_ in self._scope.variables.items():
            is_object = not type_ or definitions.is_class(type_)
            if needs_object and not is_object:
                continue
            if definitions.fits(type_, wanted) or (may_continue and definitions.features(type_)):
                yield name, "variable", type_, None, "", False

    def _enum_values(self) -> Iterator[OfferedName]:
        """Yield the literals of the enum that is wanted here; if the wanted type is unknown, all enums."""
        wanted = self._wanted.type()
        enum = self._definitions.find_enum(wanted)
        if enum is not None:
            yield simple_name(enum.name), "enum", "", enum.doc, f"{simple_name(enum.name)}::", False
            yield from _literals(enum, f"{simple_name(enum.name)}::")
        elif not wanted:
            for label, kind, detail, doc, _, _ in self._enums():
                is_written = self._cursor.following == "::"
                yield label, kind, detail, doc, label if is_written else f"{label}::", False

    def _features_of_block(self) -> Iterator[OfferedName]:
        """Yield the features of the object whose block `{ .. }` the cursor is in, except those written already."""
        features, opening = self._wanted.block_features()
        if opening is None:
            return
        depth = self._cursor.lexemes[opening].brace_depth + 1
        inside = self._cursor.lexemes[opening + 1 : self._cursor.index]
        pairs = pairwise(inside)
        written = {one.value for one, after in pairs if after.value == "=" and one.brace_depth == depth}
        yield from _feature_names(one for name, one in features.items() if name not in written)

    def _functions(self) -> Iterator[OfferedName]:
        """Yield the functions of expressions whose result can be here."""
        wanted, is_written = self._wanted.type(), self._cursor.following == "("
        for one in FUNCTIONS.values():
            if self._definitions.fits(one.result or Scalar.INT, wanted):
                holes = ", ".join(f"${{{place}:{name}}}" for place, name in enumerate(one.parameters, start=1))
                inserted = "" if is_written else f"{one.name}({holes})"
                yield one.name, "function", one.signature, one.doc, inserted, not is_written

    def _arrow_references(self) -> Iterator[OfferedName]:
        """Yield the references of the object before `-`, or those that lead to the object before `<-`."""
        metamodel, name = self._definitions.metamodel, self._cursor.before(2).value
        has_class = self._cursor.before(3).value == ":"
        type_ = self._definitions.find_class(name) or "" if has_class else self._scope.type_of(name)
        if metamodel is None:
            return
        found: list[Feature]
        if self._before == "-":
            found = [*self._definitions.features(type_).values()] if type_ else [*metamodel.references]
        else:
            found = [one for one in metamodel.references if self._definitions.fits(type_, one.target)]
        yield from _feature_names(one for one in found if isinstance(one, Reference))

    def _drawn_attributes(self) -> Iterator[OfferedName]:
        """Yield the attributes of the class that a picture draws."""
        for one in reversed(self._cursor.lexemes[: self._cursor.index]):
            cls = self._definitions.find_class(one.value)
            if cls is not None:
                found = self._definitions.features(cls).values()
                return (yield from _feature_names(feature for feature in found if isinstance(feature, Attribute)))

    def _opposites(self) -> Iterator[OfferedName]:
        """Yield the references of the target class that lead back to the class with the cursor."""
        metamodel = self._definitions.metamodel
        opening = self._cursor.enclosing("{")
        names = [one.value for one in self._names_before()]
        start = next((place for place, name in enumerate(names) if name in ("contains", "refers")), 0)
        target = self._definitions.find_class(names[start - 1]) if start else None
        if metamodel is None or opening is None or target is None:
            return
        header = [one.value for one in self._cursor.lexemes[:opening]]
        own = next((header[i + 1] for i in range(len(header) - 2, -1, -1) if header[i] == "class"), "")
        for one in self._definitions.features(target).values():
            if not isinstance(one, Reference) or one.opposite not in (None, self._cursor.before(2).value):
                continue
            if own not in metamodel.classes or metamodel.is_a(own, one.target):
                yield from _feature_names([one])

    def _key_attributes(self) -> Iterator[OfferedName]:
        """Yield the attributes for `@key(..)`: those of the class that follows the annotation."""
        opening = self._cursor.enclosing("(")
        if opening is None or self._cursor.lexemes[opening - 1].value != "key":
            return
        rest = self._cursor.lexemes[self._cursor.index :]
        names = (after.value for one, after in pairwise(rest) if one.value == "class")
        found = self._definitions.features(next(names, None)).values()
        yield from _feature_names(one for one in found if isinstance(one, Attribute))

    def _annotated_variables(self) -> Iterator[OfferedName]:
        """Yield the parameters and variables of the definition after an annotation."""
        end = self._cursor.lexemes[self._cursor.index].end
        part = TextPart(self._cursor.language, 0, self._cursor.reading.source.text)
        for one in mentions_of(part).all:
            if one.kind == "variable" and one.start >= end:
                yield one.text, "variable", "", None, "", False

    def _coordinates(self, is_next: bool) -> Iterator[Feature]:
        """Yield the whole numbers or, after `next`, the single references of the classes in the legend of a grid.

        Without a legend, the letters are those of the metamodel, so all classes count.
        """
        lexemes = self._cursor.lexemes[: self._cursor.index]
        start = max((place for place, one in enumerate(lexemes) if one.value == "grid"), default=0)
        named = (after.value for one, after in pairwise(lexemes[start:]) if one.value == "=")
        metamodel = self._definitions.metamodel
        known = {cls: None for one in named if (cls := self._definitions.find_class(one))}
        for cls in known or (metamodel.classes if metamodel else ()):
            for one in self._definitions.features(cls).values():
                is_wanted = is_next if isinstance(one, Reference) else not is_next and one.type is Scalar.INT
                if is_wanted and not one.many:
                    yield one

    def _model_values(self) -> Iterator[OfferedName]:
        """Yield the values of the feature before `=` or of the column of a table: objects, literals or classes."""
        feature = self._wanted.feature()
        if isinstance(feature, Attribute):
            if isinstance(feature.type, EnumType):
                yield from _literals(feature.type, "::")
            return
        if isinstance(feature, Reference) and feature.containment and self._definitions.metamodel:
            concrete = self._definitions.metamodel.concrete_classes(feature.target)
            yield from self._classes(lambda name: name in concrete)
        wanted = feature.target if feature is not None else ""
        for name, type_ in self._objects().items():
            if feature is not None and not feature.containment and self._definitions.fits(type_, wanted):
                yield name, "variable", type_, None, "", False

    def _objects(self) -> dict[str, str]:
        """Return the class of each named object of the model by name; "" for a grid."""
        found: dict[str, str] = {}
        lexemes = self._cursor.lexemes
        for before, one, after in zip(lexemes, lexemes[1:], lexemes[2:], strict=False):
            if before.kind == "NAME" and one.value == ":" and after.kind == "NAME" and before.brace_depth:
                found[before.value] = self._definitions.find_class(after.value) or ""
            elif one.kind == "NAME" and (before.value == "grid" or (after.value == ":" and before.value in "{;")):
                found[one.value] = ""
        return found

    def _names_before(self) -> Iterator[Lexeme]:
        for one in reversed(self._cursor.lexemes[: self._cursor.index]):
            if one.kind == "NAME":
                yield one


def _feature_names(features: Iterable[Feature]) -> Iterator[OfferedName]:
    for one in features:
        is_reference = isinstance(one, Reference)
        type_ = one.target if isinstance(one, Reference) else attribute_type(one)
        kind = "reference" if is_reference else "property"
        yield one.name, kind, f"{one.owner}.{one.name} : {type_}[{one.multiplicity}]", one.doc, "", False


def _literals(enum: EnumType, prefix: str = "") -> Iterator[OfferedName]:
    for literal in enum.literals:
        yield f"{prefix}{literal}", "literal", simple_name(enum.name), None, "", False
