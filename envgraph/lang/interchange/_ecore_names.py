"""Resolve names in `.ecore` files: parts of the same file, parts of other files, and data types.

The module also defines the state that the readers of several files share.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from urllib.parse import unquote

from envgraph.code import dataclass
from envgraph.errors import MOST_ERRORS, Diagnostic, Note, Severity, Span, did_you_mean, too_many_errors
from envgraph.lang.interchange._ecore_document import EcoreDocument
from envgraph.lang.read._ecore_types import ECORE, ECORE_TYPES, DataType, library_types
from envgraph.lang.read._imports import near_uri
from envgraph.lang.syntax._xml import Element
from envgraph.metamodel import EnumType


class Enough(Exception):
    """An exception raised to stop reading after too many mistakes."""


@dataclass(frozen=True, slots=True)
class Target:
    """The part of a file, or the library data type, that a name in an `.ecore` file refers to.

    Attributes:
        element: the part, or None for a data type.
        data: the data type, or None.
        span: the position of the name.
        reader: the reader of the file that contains the part.
    """

    element: Element | None
    data: DataType | None
    span: Span
    reader: Names


@dataclass(slots=True)
class Joint:
    """The state that the readers of all `.ecore` files of one metamodel share.

    Attributes:
        lost: names of parts that could not be read. Uses of these names are not reported.
        left_out: by class, the names of the features left out of it, each with the reason.
        names: the names of classes and enums in the metamodel.
        missing: missing files that have been reported, as pairs of the naming file and the missing one.
        any_object: Ecore's class EObject, which every class then extends; None if no file needs it.
        data_types: the data types defined by the files, with their names in a written file.
        dropped: by kind, the positions of parts that are not preserved.
        quiet: if True, problems are not reported.
    """

    diagnostics: list[Diagnostic] = field(default_factory=list)
    lost: set[str] = field(default_factory=set)
    left_out: dict[Element, dict[str, str]] = field(default_factory=dict)
    readers: list[Names] = field(default_factory=list)
    by_file: dict[str, Names] = field(default_factory=dict)
    owners: dict[Element, Element] = field(default_factory=dict)
    kinds: dict[Element, str] = field(default_factory=dict)
    names: dict[Element, str] = field(default_factory=dict)
    enums: dict[Element, EnumType] = field(default_factory=dict)
    missing: set[tuple[str, str]] = field(default_factory=set)
    any_object: Element | None = None
    data_types: dict[Element, str] = field(default_factory=dict)
    dropped: dict[tuple[str, str], list[Span]] = field(default_factory=dict)
    allow_unresolved: bool = False
    errors: int = 0
    warnings: int = 0
    quiet: bool = False


def inside(element: Element, name: str) -> Iterator[Element]:
    """Yield the child elements with this name."""
    return (child for child in element.children if child.name == name)


class Names:
    """A resolver of the names in one `.ecore` file, with the methods that report problems.

    Attributes:
        packages: the packages with their paths.
        span: the name of the outermost package; the start of the file until it is known.
    """

    def __init__(self, document: EcoreDocument, joint: Joint) -> None:
        self.document = document
        self.places = document.places
        self.packages: list[tuple[str, Element]] = []
        self.span = self.places.source.span(0, 0)
        self._others: dict[str, tuple[Names | None, Element | None]] = {}
        self.joint = joint
        self._kinds = joint.kinds
        self._owners = joint.owners

    @property
    def _root(self) -> Element:
        return self.document.roots[0]

    def _mentions(self, element: Element, names: Sequence[str]) -> bool:
        return any(name in element.attributes for name in names) or any(
            child.name in names for child in element.children
        )

    def _generic(self, element: Element, tag: str) -> Iterator[Target]:
        """Yield the targets of generic types without their type arguments, with a warning if there are any.

        A type parameter is replaced by its first bound.
        """
        for child in inside(element, tag):
            if "eTypeParameter" in child.attributes or child.children:
                self._erase(
                    child, f"`{element.attributes.get('name', '')}` is read without its type arguments"
                )
            yield from self._targets(child, "eClassifier")
            for parameter in self._targets(child, "eTypeParameter"):
                yield from self._erased(parameter)

    def _erase(self, element: Element, message: str) -> None:
        where = self.places.tag(element.byte)
        self.warn("generic-type", message, where, "check the models: more objects are allowed than in Ecore")

    def _erased(self, parameter: Target) -> Iterator[Target]:
        """Yield the bound of a type parameter, found through other type parameters if necessary; a circle is reported.

        Without a bound, it is Ecore's `EObject`.
        """
        span, seen = parameter.span, set()
        while parameter.element is not None and parameter.element not in seen:
            seen.add(parameter.element)
            bounds = list(inside(parameter.element, "eBounds"))[:1]
            above = [one for bound in bounds for one in parameter.reader._targets(bound, "eTypeParameter")]
            if not above:
                found = [one for bound in bounds for one in parameter.reader._targets(bound, "eClassifier")]
                yield from (Target(one.element, one.data, span, one.reader) for one in found)
                if not bounds:
                    yield Target(self.joint.any_object, None, span, self)
                return
            parameter = above[0]
        message = "the bounds of this type parameter refer to each other"
        self.error("generic-type", message, span, "give it a class as its bound")

    def _targets(self, element: Element, name: str) -> Iterator[Target]:
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
            target = self._find(word, self.at(element, name, word))
            if target:
                yield target
        for child in element.children:
            if child.name == name and "href" in child.attributes:
                target = self._find(child.attributes["href"], self.at(child, "href"))
                if target:
                    yield target

    def _find(self, text: str, span: Span) -> Target | None:
        document, mark, fragment = text.rpartition("#")
        if not mark:
            document = ""
        last = fragment.rpartition("/")[2]
        types = library_types(document)
        if types is not None and last in types:
            return Target(None, types[last], span, self)
        reader, base = self._reader_of(ECORE if types is ECORE_TYPES else document)
        if types is not None and (base is None or reader is None or not reader.document.at(fragment, base)):
            self._unknown_library_type(last, types, span)
            return None
        if reader is None:
            self._no_file(document, last, span)
            return None
        if base is None:
            return None  # the file is not a metamodel, which has been reported
        element = reader.document.at(fragment, base)
        if element is None:
            self._unknown_part(fragment, span, reader, base)
            return None
        return Target(element, None, span, reader)

    def _reader_of(self, text: str) -> tuple[Names | None, Element | None]:
        """Return the reader and the package of the file named `text` ("" for this file), each None if it is unknown."""
        if text not in self._others:
            self._others[text] = self._look_for(text)
        return self._others[text]

    def _look_for(self, text: str) -> tuple[Names | None, Element | None]:
        if not text:
            return self, self._root
        for reader in self.joint.readers:
            for package in reader.document.packages:
                if package.attributes.get("nsURI") == text:
                    return reader, package
        known = self.joint.by_file
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

    def _no_file(self, text: str, part: str, span: Span) -> None:
        key = (self.places.source.name, text)
        if self.joint.quiet or key in self.joint.missing:
            return
        self.joint.missing.add(key)
        if "://" in text:
            known = [uri for one in self.joint.readers for uri in one.document.calls()]
            message, file = f"none of the files has the package `{text}`", "its file"
            hint = near_uri(text, known)
        else:
            last = unquote(text).rpartition("/")[2]
            message, file, hint = f"`{text}`: there is no such file", f"`{last}`", None
        name = f"give {file}, which contains `{part}`, too, for example with `--metamodel`"
        hint = hint or f"{name}; or leave out the features that need it with `--allow-unresolved`"
        if self.joint.allow_unresolved:
            self.warn("missing-file", message, span, "features that need it are left out")
        else:
            self.error("missing-file", message, span, hint)

    def _unknown_library_type(self, name: str, types: Mapping[str, DataType], span: Span) -> None:
        if self.joint.quiet:
            return
        message = f"Ecore has no type `{name}`" if types is ECORE_TYPES else f"unknown type `{name}`"
        self.error("unknown-type", message, span, did_you_mean(name, types))

    def _unknown_part(self, fragment: str, span: Span, reader: Names, base: Element) -> None:
        if self.joint.quiet:
            return
        document = reader.document
        steps = [step for step in fragment.split("/") if step]
        name = steps[-1] if steps else fragment
        if name in self.joint.lost:
            return
        around = document.at("/" + "/".join(["", *steps[:-1]]), base) if len(steps) > 1 else base
        if around is None:  # the class is unknown, not only its feature
            name, around = steps[0], base
        known = list(document.parts(around))
        hint = did_you_mean(name, known)
        if self._kinds.get(around) == "EClass":
            message = f"`{around.attributes.get('name')}` has no feature `{name}`"
            self.error("unknown-reference", message, span, hint)
            return
        file = "" if reader is self else f" in {document.source.name.rpartition('/')[2]}"
        if hint is None and name in ECORE_TYPES:
            hint = f"write `ecore:EDataType {ECORE}#//{name}` for the data type"
        elif hint is None and not fragment.startswith("/"):
            hint = f"write `#//{name}` for a class of this file" if name in known and not file else None
        self.error("unknown-class", f"unknown class or data type `{name}`{file}", span, hint)

    def quietly(self, element: Element, *names: str) -> list[Target]:
        """Return the targets of these XML attributes of an element; unknown targets are not reported."""
        self.joint.quiet = True
        found = [one for name in names for one in self._targets(element, name)]
        self.joint.quiet = False
        return found

    # --- messages ---

    def named(self, element: Element) -> Span:
        return self.at(element, "name")

    def at(self, element: Element, attribute: str, word: str | None = None) -> Span:
        return self.span if self.joint.quiet else self.places.attribute(element.byte, attribute, word)

    def error(
        self, code: str, message: str, where: Span, hint: str | None = None, notes: tuple[Note, ...] = ()
    ) -> None:
        if self.joint.quiet:
            return
        self.joint.diagnostics.append(Diagnostic(code, message, where, hint, notes=notes))
        self.joint.errors += 1
        if self.joint.errors == MOST_ERRORS:
            self.joint.diagnostics.append(too_many_errors(where))
            raise Enough

    def drop(self, noun: str, rest: str, element: Element) -> None:
        """Record a part that is not preserved. Parts with the same noun and rest are later reported in one warning."""
        self.joint.dropped.setdefault((noun, rest), []).append(self.places.tag(element.byte))

    def warn(self, code: str, message: str, where: Span, hint: str | None = None) -> None:
        if self.joint.quiet:
            return
        self.joint.warnings += 1
        if self.joint.warnings > MOST_ERRORS + 1:
            return
        if self.joint.warnings > MOST_ERRORS:
            code, message, hint = "too-many-warnings", "too many warnings: the others are not shown", None
        self.joint.diagnostics.append(Diagnostic(code, message, where, hint, Severity.WARNING))
