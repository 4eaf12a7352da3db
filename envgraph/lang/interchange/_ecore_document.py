"""Parse an `.ecore` file into a tree with its packages, its named parts, and the other files that it mentions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files as package_files
from urllib.parse import unquote

from envgraph.errors import LIMITS, Source, Span
from envgraph.lang.read._ecore_types import (
    ECORE,
    ECORE_TYPES,
    EXTENDED_METADATA,
    FEATURE_MAP,
    well_known_types,
)
from envgraph.lang.syntax._source_files import Files
from envgraph.lang.syntax._xml_parser import XMI, XmlElement, XmlPositions, read_tree

_NAMING = ("eType", "eSuperTypes", "eOpposite", "eClassifier")
_SKIPPED_TAGS = ("eOperations", "eAnnotations")
_PARTS = ("eClassifiers", "eSubpackages", "eStructuralFeatures", "eLiterals", "eTypeParameters")
_MAX_PARENT_DIRECTORIES = 12
"""Number of directories above a file that are searched for a project of Eclipse."""


class EcoreDocument:
    """An `.ecore` file as a tree of XML elements.

    Attributes:
        top_elements: the first element of the file; if that is an `xmi:XMI`, the elements in it.
        roots: the packages in `top_elements`.
        packages: the `roots` and all their subpackages.
        root: the first element; None if the text is not XML, then `problem` is the diagnostic.
        paths: by the text before a `#`: the name of the existing file that it refers to; filled in by the loader.
        ids: the elements with an `xmi:id`; filled in by `index_elements`.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.places = XmlPositions(source)
        self.root, self.problem = read_tree(self.places)
        first = [self.root] if self.root else []
        several = first and first[0].name == "XMI" and "/XMI" in (first[0].namespace or "")
        self.top_elements = first[0].children if several else first
        self.roots = tuple(one for one in self.top_elements if one.name == "EPackage" and one.namespace == ECORE)
        self.packages = self._packages()
        self.paths: dict[str, str] = {}
        self.ids: dict[str, XmlElement] = {}
        self._names: dict[XmlElement, Mapping[str, XmlElement]] = {}
        self._listed: dict[tuple[XmlElement, str], list[XmlElement]] = {}

    @property
    def span(self) -> Span:
        """Return the span of the first package's name, or the start of the file."""
        if not self.roots or "name" not in self.roots[0].attributes:
            return self.source.span_between(0, 0)
        return self.places.attribute_span(self.roots[0].byte, "name")

    @property
    def uri(self) -> str | None:
        """Return the nsURI of the first package, or None."""
        return self.roots[0].attributes.get("nsURI") if self.roots else None

    def _packages(self) -> tuple[XmlElement, ...]:
        waiting = [*self.roots]
        for one in waiting:
            waiting += [child for child in one.children if child.name == "eSubpackages"]
        return tuple(waiting)

    @property
    def uris(self) -> tuple[str, ...]:
        """Return the nsURIs of all packages that have one."""
        return tuple(one.attributes["nsURI"] for one in self.packages if one.attributes.get("nsURI"))

    def import_names(self) -> Iterator[str]:
        """Yield the names by which other files may import this file: nsURIs of packages, and names of root packages."""
        yield from self.uris
        yield from (one.get("name") for one in self.roots)

    def mentioned_documents(self) -> dict[str, Span]:
        """Return the other documents that references name before `#`, each with its first span; no libraries."""
        found: dict[str, Span] = {}
        known = {""}
        for element, key, word in self._reference_words():
            document = word.rpartition("#")[0]
            if document not in known and len(known) <= LIMITS["Ecore files"]:
                known.add(document)
                if well_known_types(document) is None:
                    found[document] = self.places.attribute_span(element.byte, key, word)
        return found

    def needs_ecore(self) -> bool:
        """Return True if the file names a class of Ecore itself, or has a type parameter without a bound."""
        return any(
            word == _ANY_OBJECT
            or (well_known_types(document) is ECORE_TYPES and part.rpartition("/")[2] not in ECORE_TYPES)
            for _, _, word in self._reference_words()
            for document, _, part in [word.rpartition("#")]
        )

    def _reference_words(self) -> Iterator[tuple[XmlElement, str, str]]:
        """Yield (element, XML attribute, word) for each word that refers to a part of a file.

        Features without values are skipped. A type parameter without a bound refers to Ecore's `EObject`.
        """
        waiting = [*self.roots]
        for element in waiting:
            if reason_without_values(element):
                continue
            waiting += [child for child in element.children if child.name not in _SKIPPED_TAGS]
            for key in ("href",) if element.name in _NAMING else _NAMING:
                for word in element.get(key).split():
                    yield element, key, word
            if element.name == "eTypeParameters" and not any(child.name == "eBounds" for child in element.children):
                yield element, "name", _ANY_OBJECT

    # --- parts ---

    def index_elements(self, owners: dict[XmlElement, XmlElement]) -> None:
        """Record the parent of each element in `owners`, and the first element with each `xmi:id` in `ids`."""
        waiting = [self.root] if self.root else []
        for element in waiting:
            key = element.qualified_key("id", XMI)
            if key:
                self.ids.setdefault(element.attributes[key], element)
            for child in element.children:
                owners[child] = element
            waiting.extend(element.children)

    def element_at(self, fragment: str, base: XmlElement) -> XmlElement | None:
        """Return the element of a fragment: `//A/b`, `/1/@eClassifiers.2/@eStructuralFeatures.0`, or an `xmi:id`.

        None means that no such element exists. `base` is the package where paths without a root number start.
        """
        if not fragment.startswith("/"):
            return self.ids.get(fragment)
        root, *steps = fragment.split("/")[1:]
        place = int(root) if root.isdecimal() and len(root) < 10 else 0
        current = self.roots[place] if 0 < place < len(self.roots) else base
        for step in steps:
            found = (
                self._element_by_index(current, step) if step.startswith("@") else self.parts_by_name(current).get(step)
            )
            if found is None:
                return None
            current = found
        return current

    def _element_by_index(self, element: XmlElement, step: str) -> XmlElement | None:
        name, _, index = step[1:].partition(".")
        if (element, name) not in self._listed:
            self._listed[element, name] = [child for child in element.children if child.name == name]
        inside = self._listed[element, name]
        place = int(index) if index.isdecimal() and len(index) < 10 else 0
        return inside[place] if place < len(inside) else None

    def parts_by_name(self, element: XmlElement) -> Mapping[str, XmlElement]:
        """Return by name the classifiers, packages, features, literals and type parameters directly in an element."""
        if element not in self._names:
            named = {}
            for child in reversed(element.children):
                if child.name in _PARTS:
                    named[child.get("name")] = child
            self._names[element] = named
        return self._names[element]


_ANY_OBJECT = f"{ECORE}#//EObject"


def reason_without_values(element: XmlElement) -> str | None:
    """Return why files hold no values of a feature, "derived", "transient" or "eType" (a feature map), or None.

    It is None, too, if a query can compute the values, or if a transient feature has an opposite that holds them. A
    derived XML element or attribute may belong to a feature map.
    """
    attributes = element.attributes
    if is_computed(element):
        return None
    if attributes.get("derived") == "true":
        return None if extended_metadata(element).get("kind") in ("element", "attribute") else "derived"
    if attributes.get("transient") == "true" and "eOpposite" not in attributes:
        return "transient"
    return "eType" if attributes.get("eType", "").endswith(f"#//{FEATURE_MAP}") else None


def is_computed(element: XmlElement) -> bool:
    """Return True if a query can define a feature's values: it is derived, or volatile and transient without opposite.

    Containments, feature maps and their members, and features of type `EObject` are excluded.
    """
    attributes = element.attributes
    is_volatile = attributes.get("volatile") == "true" == attributes.get("transient")
    if attributes.get("derived") != "true" and (not is_volatile or "eOpposite" in attributes):
        return False
    is_ordinary = attributes.get("containment") != "true" and "kind" not in extended_metadata(element)
    return is_ordinary and not element.get("eType").endswith((_ANY_OBJECT, f"#//{FEATURE_MAP}"))


def details_of(element: XmlElement, source: str) -> Iterator[tuple[XmlElement, str, str]]:
    """Yield the details of an element's annotations with this source, each as XML element, key and value."""
    for annotation in (one for one in element.children if one.name == "eAnnotations"):
        if annotation.attributes.get("source") == source:
            for one in (one for one in annotation.children if one.name == "details"):
                yield one, one.get("key"), one.get("value")


def extended_metadata(element: XmlElement) -> dict[str, str]:
    """Return the ExtendedMetaData of an element, such as its name and kind in XML documents."""
    return {key: value for _, key, value in details_of(element, EXTENDED_METADATA)}


@cache
def ecore_metamodel_document() -> EcoreDocument:
    """Return the metamodel of Ecore, read from a file in this package."""
    text = package_files("envgraph.lang.interchange").joinpath("ecore.ecore").read_text("utf-8")
    return EcoreDocument(Source(ECORE, text))


def find_linked_file(files: Files, text: str, beside: str) -> str | None:
    """Return the name of the file that a link in the file `beside` refers to; None if no such file exists.

    A path of Eclipse's workspace (`platform:/resource/project/model/a.ecore`) is searched in the directories above,
    with and without the project's directory, and finally beside the file.
    """
    path = unquote(text)
    platform = re.match(r"platform:/(?:resource|plugin)/([^/]+)/(.+)", path)
    if platform:
        project, inside = platform.groups()
        tried = [
            f"{'../' * up}{one}" for up in range(_MAX_PARENT_DIRECTORIES) for one in (f"{project}/{inside}", inside)
        ]
        tried.append(inside.rpartition("/")[2])
    else:
        tried = [] if re.match(r"[a-zA-Z][\w+.-]+:", path) else [path]
    names = (files.name(one, beside=beside) for one in tried)
    return next((name for name in names if files.exists(name)), None)
