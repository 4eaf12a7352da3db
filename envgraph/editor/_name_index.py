"""Look up what names refer to, and where a definition is used."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.editor._family_names import family_mentions
from envgraph.editor._mention_data import Holder, Mention, PartNames, Scope
from envgraph.editor._mentions import mentions_of
from envgraph.errors import Source, Span
from envgraph.lang import text_parts
from envgraph.metamodel import Feature, Metamodel, Reference, simple_name, type_name

if TYPE_CHECKING:
    from envgraph.editor._checked_files import CheckResult
    from envgraph.editor._language_service import LanguageService

_MAX_STEPS = 200
"""The most steps of a search for the class of a variable. Without a limit, names in a circle would not end it."""


@dataclass(frozen=True, slots=True)
class Symbol:
    """A definition that names refer to; equal symbols are the same definition.

    Attributes:
        kind: the kind of definition, as in `Mention`.
        name: the name that is written where it is used.
        file: the file that defines it.
        within: of a feature or literal: its class or enum. Of a pattern or rule: its package. Of a variable: its scope.
    """

    kind: str
    name: str
    file: str
    within: object = ""


@dataclass(frozen=True, slots=True)
class Place:
    """A name in a file.

    Attributes:
        source: the text of the file.
        start: the offset at which the part of the text with this name begins.
        mention: the name.
    """

    source: Source
    start: int
    mention: Mention

    @property
    def span(self) -> Span:
        """Return the span of the name."""
        return self.source.span_between(self.start + self.mention.start, self.start + self.mention.end)

    @property
    def definition_span(self) -> Span:
        """Return the span of the whole definition of a name that is defined here."""
        return self.source.span_between(self.start + self.mention.tree_start, self.start + self.mention.tree_end)


class NameIndex:
    """The names in a set of files that belong together.

    Args:
        sources: the texts of the files, by name; of open documents as they are now.
        metamodel: their metamodel, as it was last read without errors.
    """

    def __init__(self, sources: Mapping[str, Source], metamodel: Metamodel | None) -> None:
        self.sources = sources
        self.metamodel = metamodel

    @classmethod
    def of(cls, service: LanguageService, results: Iterable[CheckResult]) -> NameIndex:
        """Return the index of all files that were read in some checks; the first one decides on the metamodel."""
        given = [*results]
        sources = {
            name: service.document_named(name, text).source
            for result in given
            for name, text in result.workspace.sources.items()
        }
        metamodels = [one.metamodel for one in given]
        return cls(sources, next((one for one in metamodels if one is not None), None))

    # --- all names ---

    def parts(self, source: Source) -> Iterator[tuple[int, PartNames]]:
        """Yield the start and the names of each part of a file."""
        if source.name.endswith(".toml"):
            yield 0, family_mentions(source)
            return
        for part in text_parts(source):
            yield part.start, mentions_of(part)

    @cached_property
    def definitions(self) -> Mapping[tuple[str, str], list[Place]]:
        """Return all definitions but variables, by kind and name."""
        found: dict[tuple[str, str], list[Place]] = {}
        for source in self.sources.values():
            for start, names in self.parts(source):
                for one in names.definitions:
                    found.setdefault((one.kind, one.text), []).append(Place(source, start, one))
        return found

    @cached_property
    def _packages(self) -> Mapping[str, str]:
        found = [place for (kind, _), places in self.definitions.items() if kind == "package" for place in places]
        return {
            place.source.name: ".".join(filter(None, (place.mention.qualifier, place.mention.text))) for place in found
        }

    def place_at(self, source: Source, offset: int) -> Place | None:
        """Return the name that contains an offset of a file or ends there; None if there is no name."""
        for start, names in self.parts(source):
            if start <= offset:
                for one in names.all:
                    if start + one.start <= offset <= start + one.end:
                        return Place(source, start, one)
        return None

    def occurrences(self, symbol: Symbol, sources: Iterable[Source] | None = None) -> Iterator[Place]:
        """Yield the names in files that refer to a definition, and the name in the definition; None for all files."""
        local = symbol.kind in ("variable", "object", "alias", "action", "measure")
        for source in self.sources.values() if sources is None else sources:
            if (local and source.name != symbol.file) or symbol.name not in source.text:
                continue
            for start, names in self.parts(source):
                for one in names.by_text.get(symbol.name, ()):
                    place = Place(source, start, one)
                    if self.resolve(place) == symbol:
                        yield place

    def definition_of(self, symbol: Symbol) -> Place | None:
        """Return where a definition is written; None if it is in a file of another format."""
        found = [*self.occurrences(symbol)]
        return next(
            (one for one in found if one.mention.is_definition), found[0] if symbol.kind == "variable" else None
        )

    # --- what a name refers to ---

    def resolve(self, place: Place) -> Symbol | None:
        """Return the definition that a name refers to; None if it is unknown."""
        one, file = place.mention, place.source.name
        match one.kind:
            case "class":
                return (
                    self._class_symbol(one.text) or self._named("rule", one, file) or self._named("pattern", one, file)
                )
            case "feature":
                return self._feature_symbol(one, file)
            case "literal":
                return self._literal_symbol(one, place)
            case "rule":
                return self._named("rule", one, file) or self._named("pattern", one, file)
            case "pattern" | "function" | "metamodel" | "environment" | "model" | "measure":
                return self._named(one.kind, one, file)
            case "object":
                return self._object_symbol(one, place)
            case "step":
                return self._step_symbol(one, file)
            case "variable":
                return Symbol("variable", one.text, file, (place.start, id(one.scope)))
            case "action":
                return Symbol("action", one.text, file, one.scope.name if one.scope else "")
            case "alias":
                return Symbol("alias", one.text, file)
        return None

    def _named(self, kind: str, mention: Mention, file: str) -> Symbol | None:
        """Return the definition that a simple or qualified name means in a file; None if there is none or several."""
        found = self.definitions.get((kind, mention.text), [])
        if kind == "measure":
            found = [one for one in found if one.source.name == file]
        symbols = dict.fromkeys(
            Symbol(kind, mention.text, place.source.name, self._packages.get(place.source.name, "")) for place in found
        )
        if mention.is_definition:
            return Symbol(kind, mention.text, file, self._packages.get(file, ""))
        if mention.qualifier:
            exact = [one for one in symbols if one.within == mention.qualifier]
        else:
            exact = [one for one in symbols if one.within == self._packages.get(file, "")]
        chosen = exact or ([] if mention.qualifier else [*symbols])
        return chosen[0] if chosen else None

    def _class_symbol(self, name: str) -> Symbol | None:
        places = self.definitions.get(("class", name))
        if places:
            return Symbol("class", name, places[0].source.name)
        span = self.span_of_class(name)
        return Symbol("class", name, span.source.name) if span else None

    def span_of_class(self, name: str) -> Span | None:
        """Return the span of the definition of a class or enum by the metamodel, which may be an Ecore file."""
        for full in self.full_names(name):
            assert self.metamodel is not None
            found = self.metamodel.classes.get(full) or self.metamodel.enums.get(full)
            if found is not None and found.span is not None:
                return found.span
        return None

    def full_names(self, name: str) -> Iterable[str]:
        """Return the full names of the classes and enums of this name."""
        return self.metamodel.full_names(name).values() if self.metamodel else ()

    def feature_of(self, mention: Mention) -> Feature | None:
        """Return the feature that a name refers to."""
        if self.metamodel is None:
            return None
        for cls in self.classes_of(mention.holder):
            feature = self.metamodel.feature(cls, mention.text) if cls in self.metamodel.classes else None
            if feature is not None:
                return feature
        features: list[Feature] = [*self.metamodel.attributes, *self.metamodel.references]
        named = [one for one in features if one.name == mention.text]
        return named[0] if len(named) == 1 else None

    def _feature_symbol(self, mention: Mention, file: str) -> Symbol | None:
        if mention.is_definition and mention.holder:
            return Symbol("feature", mention.text, file, mention.holder[1])
        feature = self.feature_of(mention)
        if feature is None:
            return None
        owner = self._class_symbol(simple_name(feature.owner))
        return Symbol("feature", mention.text, owner.file if owner else "", simple_name(feature.owner))

    def _literal_symbol(self, mention: Mention, place: Place) -> Symbol | None:
        if mention.is_definition and mention.holder:
            return Symbol("literal", mention.text, place.source.name, mention.holder[1])
        enums = self.metamodel.enum_types if self.metamodel else ()
        having = [one for one in enums if mention.text in one.literals]
        wanted = set(self.classes_of(mention.holder))
        chosen = [one for one in having if one.name in wanted] or (having if len(having) == 1 else [])
        if not chosen:
            return None
        name = simple_name(chosen[0].name)
        owner = self._class_symbol(name)
        return Symbol("literal", mention.text, owner.file if owner else "", name)

    def _object_symbol(self, mention: Mention, place: Place) -> Symbol | None:
        within = mention.scope.name if mention.scope else ""
        for one in self.definitions.get(("object", mention.text), ()):
            if one.source is place.source and one.mention.scope and one.mention.scope.name == within:
                return Symbol("object", mention.text, place.source.name, within)
        return self._literal_symbol(mention, place)

    def _step_symbol(self, mention: Mention, file: str) -> Symbol | None:
        """Return the reference or pattern that is a step of a path in a family file."""
        return self._feature_symbol(mention, file) or self._named("pattern", mention, file)

    def classes_of(self, holder: Holder | None) -> list[str]:
        """Return the full names of the classes or enums that an object or value may have."""
        found: dict[str, None] = {}
        steps = [0]
        if holder is not None and self.metamodel is not None:
            self._add_classes(holder, found, self.metamodel, set(), steps)
        return [*found]

    def _add_classes(
        self, holder: Holder, found: dict[str, None], metamodel: Metamodel, seen: set[tuple[int, str]], steps: list[int]
    ) -> None:
        steps[0] += 1
        if steps[0] > _MAX_STEPS:
            return
        match holder:
            case ("class", name):
                found.update(dict.fromkeys(metamodel.full_names(name).values()))
            case ("classes", several):
                for one in several:
                    self._add_classes(one, found, metamodel, seen, steps)
            case ("variable", scope, name):
                home = scope.home(name) if scope else None
                if home is not None and (id(home), name) not in seen:
                    seen.add((id(home), name))
                    for one in home.types.get(name, ()):
                        self._add_classes(one, found, metamodel, seen, steps)
            case ("member", of, name):
                above: dict[str, None] = {}
                self._add_classes(of, above, metamodel, seen, steps)
                for cls in above:
                    feature = metamodel.feature(cls, name) if cls in metamodel.classes else None
                    if feature is not None:
                        found[feature.target if isinstance(feature, Reference) else type_name(feature.type)] = None
            case ("argument", pattern, place):
                scope = self._pattern_scope(pattern)
                if scope is not None and place < len(scope.parameters):
                    own = ("variable", scope, scope.parameters[place])
                    self._add_classes(own, found, metamodel, seen, steps)

    def _pattern_scope(self, name: str) -> Scope | None:
        places = self.definitions.get(("pattern", name.rpartition(".")[2]), [])
        return places[0].mention.scope if places else None
