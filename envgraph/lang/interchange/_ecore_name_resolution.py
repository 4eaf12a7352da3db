"""Resolve names in `.ecore` files: parts of the same file, parts of other files, and data types.

The module also defines the state that the readers of several files share.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from urllib.parse import unquote

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_ERRORS,
    Diagnostic,
    Note,
    Severity,
    Span,
    did_you_mean,
    too_many_errors_diagnostic,
)
from envgraph.lang.interchange._ecore_document import EcoreDocument
from envgraph.lang.read._ecore_types import ECORE, ECORE_TYPES, DataType, well_known_types
from envgraph.lang.read._imports import similar_uri_hint
from envgraph.lang.syntax._xml_parser import XmlElement
from envgraph.metamodel import EnumType

_MEANT = {"EInteger": "EInt"}
"""By likely mistake for the name of a data type of Ecore: the name that was meant."""


class TooManyMistakes(Exception):
    """An exception raised to stop reading after too many mistakes."""


@dataclass(frozen=True, slots=True)
class EcoreTarget:
    """The part of a file, or the library data type, that a name in an `.ecore` file refers to.

    Attributes:
        element: the part, or None for a data type.
        data_type: the data type, or None.
        span: the position of the name.
        reader: the reader of the file that contains the part.
    """

    element: XmlElement | None
    data_type: DataType | None
    span: Span
    reader: EcoreNameResolver


@dataclass(slots=True)
class SharedEcoreState:
    """The state that the readers of all `.ecore` files of one metamodel share.

    Attributes:
        lost_names: names of parts that could not be read. Uses of these names are not reported.
        left_out: by class, the names of the features left out of it, each with the reason.
        names: the names of classes and enums in the metamodel.
        missing: missing files that have been reported, as pairs of the naming file and the missing one.
        any_object: Ecore's class EObject, which every class then extends; None if no file needs it.
        data_types: the data types defined by the files, with their names in a written file.
        dropped: by kind, the positions of parts that are not preserved.
        is_quiet: if True, problems are not reported.
    """

    diagnostics: list[Diagnostic] = field(default_factory=list)
    lost_names: set[str] = field(default_factory=set)
    left_out: dict[XmlElement, dict[str, str]] = field(default_factory=dict)
    readers: list[EcoreNameResolver] = field(default_factory=list)
    by_file: dict[str, EcoreNameResolver] = field(default_factory=dict)
    owners: dict[XmlElement, XmlElement] = field(default_factory=dict)
    kinds: dict[XmlElement, str] = field(default_factory=dict)
    names: dict[XmlElement, str] = field(default_factory=dict)
    enums: dict[XmlElement, EnumType] = field(default_factory=dict)
    missing: set[tuple[str, str]] = field(default_factory=set)
    any_object: XmlElement | None = None
    data_types: dict[XmlElement, str] = field(default_factory=dict)
    dropped: dict[tuple[str, str], list[Span]] = field(default_factory=dict)
    allow_unresolved: bool = False
    errors: int = 0
    warnings: int = 0
    is_quiet: bool = False


def children_named(element: XmlElement, name: str) -> Iterator[XmlElement]:
    """Yield the child elements with this name."""
    return (child for child in element.children if child.name == name)


class EcoreNameResolver:
    """A resolver of the names in one `.ecore` file, with the methods that report problems.

    Attributes:
        packages: the packages with their paths.
        span: the name of the outermost package; the start of the file until it is known.
    """

    def __init__(self, document: EcoreDocument, merged: SharedEcoreState) -> None:
        self.document = document
        self.places = document.places
        self.packages: list[tuple[str, XmlElement]] = []
        self.span = self.places.source.span_between(0, 0)
        self._others: dict[str, tuple[EcoreNameResolver | None, XmlElement | None]] = {}
        self.shared = merged
        self._kinds = merged.kinds
        self._owners = merged.owners

    @property
    def _root(self) -> XmlElement:
        return self.document.roots[0]

    def _has_attribute_or_child(self, element: XmlElement, names: Sequence[str]) -> bool:
        return any(name in element.attributes for name in names) or any(
            child.name in names for child in element.children
        )

    def _generic_targets(self, element: XmlElement, tag: str) -> Iterator[EcoreTarget]:
        """Yield the targets of generic types without their type arguments, with a warning if there are any.

        A type parameter is replaced by its first bound.
        """
        for child in children_named(element, tag):
            if "eTypeParameter" in child.attributes or child.children:
                self._warn_erased(child, f"`{element.attributes.get('name', '')}` is read without its type arguments")
            yield from self._targets(child, "eClassifier")
            for parameter in self._targets(child, "eTypeParameter"):
                yield from self._upper_bound_targets(parameter)

    def _warn_erased(self, element: XmlElement, message: str) -> None:
        where = self.places.tag_span(element.byte)
        self.report_warning("generic-type", message, where, "check the models: more objects are allowed than in Ecore")

    def _upper_bound_targets(self, parameter: EcoreTarget) -> Iterator[EcoreTarget]:
        """Yield the bound of a type parameter, found through other type parameters if necessary; a circle is reported.

        Without a bound, it is Ecore's `EObject`.
        """
        span, seen = parameter.span, set()
        while parameter.element is not None and parameter.element not in seen:
            seen.add(parameter.element)
            bounds = list(children_named(parameter.element, "eBounds"))[:1]
            above = [one for bound in bounds for one in parameter.reader._targets(bound, "eTypeParameter")]
            if not above:
                found = [one for bound in bounds for one in parameter.reader._targets(bound, "eClassifier")]
                yield from (EcoreTarget(one.element, one.data_type, span, one.reader) for one in found)
                if not bounds:
                    yield EcoreTarget(self.shared.any_object, None, span, self)
                return
            parameter = above[0]
        message = "the bounds of this type parameter refer to each other"
        self.report_error("generic-type", message, span, "give it a class as its bound")

    def _targets(self, element: XmlElement, name: str) -> Iterator[EcoreTarget]:
        """Yield what the XML attribute `name` (`#//A b.ecore#//B`) and child tags `name` with `href` refer to.

        Unknown targets are reported and skipped.
        """
        if not element.children and name not in element.attributes:
            return
        words = element.get(name).split()
        for index, word in enumerate(words):
            after = words[index + 1] if index + 1 < len(words) else ""
            if "#" not in word and ":" in word and "#" in after:
                continue  # the type of the next word's target
            target = self._find_target(word, self.attribute_span(element, name, word))
            if target:
                yield target
        for child in element.children:
            if child.name == name and "href" in child.attributes:
                target = self._find_target(child.attributes["href"], self.attribute_span(child, "href"))
                if target:
                    yield target

    def _find_target(self, text: str, span: Span) -> EcoreTarget | None:
        document, mark, fragment = text.rpartition("#")
        if not mark:
            document = ""
        last = fragment.rpartition("/")[2]
        types = well_known_types(document)
        if types is not None and last in types:
            return EcoreTarget(None, types[last], span, self)
        reader, base = self._reader_of(ECORE if types is ECORE_TYPES else document)
        if types is not None and (base is None or reader is None or not reader.document.element_at(fragment, base)):
            self._report_unknown_library_type(last, types, span)
            return None
        if reader is None:
            self._report_missing_file(document, last, span)
            return None
        if base is None:
            return None  # the file is not a metamodel, which has been reported
        element = reader.document.element_at(fragment, base)
        if element is None:
            self._report_unknown_part(fragment, span, reader, base)
            return None
        return EcoreTarget(element, None, span, reader)

    def _reader_of(self, document_name: str) -> tuple[EcoreNameResolver | None, XmlElement | None]:
        """Return the reader and the package of the file named `document_name` ("" for this file), each None if it is
        unknown.
        """
        if document_name not in self._others:
            self._others[document_name] = self._find_reader(document_name)
        return self._others[document_name]

    def _find_reader(self, text: str) -> tuple[EcoreNameResolver | None, XmlElement | None]:
        if not text:
            return self, self._root
        for reader in self.shared.readers:
            for package in reader.document.packages:
                if package.attributes.get("nsURI") == text:
                    return reader, package
        known = self.shared.by_file
        path = unquote(text)
        here = self.places.source.name.rpartition("/")[0]
        exact = self.document.paths.get(text) or posixpath.normpath(posixpath.join(here, path))
        found = known.get(exact)
        # Use a given file with the same name, although it is in another directory.
        last = path.rpartition("/")[2]
        near = [name for name, one in known.items() if name.rpartition("/")[2] == last and one is not self]
        if found is None and near and "://" not in path:
            near.sort(key=lambda name: len(posixpath.commonprefix([name[::-1], path[::-1]])))
            found = known[near[-1]]
        return found, found.document.roots[0] if found and found.document.roots else None

    def _report_missing_file(self, text: str, part: str, span: Span) -> None:
        key = (self.places.source.name, text)
        if self.shared.is_quiet or key in self.shared.missing:
            return
        self.shared.missing.add(key)
        if "://" in text:
            known = [uri for one in self.shared.readers for uri in one.document.import_names()]
            message, file = f"none of the files has the package `{text}`", "its file"
            hint = similar_uri_hint(text, known)
        else:
            last = unquote(text).rpartition("/")[2]
            message, file, hint = f"`{text}`: there is no such file", f"`{last}`", None
        name = f"give {file}, which contains `{part}`, too, for example with `--metamodel`"
        hint = hint or f"{name}; or leave out the features that need it with `--allow-unresolved`"
        if self.shared.allow_unresolved:
            self.report_warning("missing-file", message, span, "features that need it are left out")
        else:
            self.report_error("missing-file", message, span, hint)

    def _report_unknown_library_type(self, name: str, types: Mapping[str, DataType], span: Span) -> None:
        if self.shared.is_quiet:
            return
        message = f"Ecore has no type `{name}`" if types is ECORE_TYPES else f"unknown type `{name}`"
        self.report_error("unknown-type", message, span, did_you_mean(_MEANT.get(name, name), types))

    def _report_unknown_part(self, fragment: str, span: Span, reader: EcoreNameResolver, base: XmlElement) -> None:
        if self.shared.is_quiet:
            return
        document = reader.document
        steps = [step for step in fragment.split("/") if step]
        name = steps[-1] if steps else fragment
        if name in self.shared.lost_names:
            return
        around = document.element_at("/" + "/".join(["", *steps[:-1]]), base) if len(steps) > 1 else base
        if around is None:  # the class is unknown, not only its feature
            name, around = steps[0], base
        known = list(document.parts_by_name(around))
        hint = did_you_mean(name, known)
        if self._kinds.get(around) == "EClass":
            message = f"`{around.attributes.get('name')}` has no feature `{name}`"
            self.report_error("unknown-reference", message, span, hint)
            return
        file = "" if reader is self else f" in {document.source.name.rpartition('/')[2]}"
        if hint is None and name in ECORE_TYPES:
            hint = f"write `ecore:EDataType {ECORE}#//{name}` for the data type"
        elif hint is None and not fragment.startswith("/"):
            hint = f"write `#//{name}` for a class of this file" if name in known and not file else None
        self.report_error("unknown-class", f"unknown class or data type `{name}`{file}", span, hint)

    def targets_without_reports(self, element: XmlElement, *names: str) -> list[EcoreTarget]:
        """Return the targets of these XML attributes of an element; unknown targets are not reported."""
        self.shared.is_quiet = True
        found = [one for name in names for one in self._targets(element, name)]
        self.shared.is_quiet = False
        return found

    # --- messages ---

    def name_span(self, element: XmlElement) -> Span:
        return self.attribute_span(element, "name")

    def attribute_span(self, element: XmlElement, attribute: str, word: str | None = None) -> Span:
        return self.span if self.shared.is_quiet else self.places.attribute_span(element.byte, attribute, word)

    def report_error(
        self, code: str, message: str, where: Span, hint: str | None = None, notes: tuple[Note, ...] = ()
    ) -> None:
        if self.shared.is_quiet:
            return
        self.shared.diagnostics.append(Diagnostic(code, message, where, hint, notes=notes))
        self.shared.errors += 1
        if self.shared.errors == MAX_ERRORS:
            self.shared.diagnostics.append(too_many_errors_diagnostic(where))
            raise TooManyMistakes

    def record_dropped(self, noun: str, description: str, element: XmlElement) -> None:
        """Record a part that is not preserved. Parts with the same noun and rest are later reported in one warning."""
        self.shared.dropped.setdefault((noun, description), []).append(self.places.tag_span(element.byte))

    def report_warning(self, code: str, message: str, where: Span, hint: str | None = None) -> None:
        if self.shared.is_quiet:
            return
        self.shared.warnings += 1
        if self.shared.warnings > MAX_ERRORS + 1:
            return
        if self.shared.warnings > MAX_ERRORS:
            code, message, hint = "too-many-warnings", "too many warnings: the others are not shown", None
        self.shared.diagnostics.append(Diagnostic(code, message, where, hint, Severity.WARNING))
