"""Parse an `.ecore` file into a tree with its packages, its named parts, and the other files that it mentions."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files as package_files
from urllib.parse import unquote

from envgraph.errors import LIMITS, Source, Span
from envgraph.lang.read._ecore_types import ECORE, ECORE_TYPES, EXTENDED, FEATURE_MAP, library_types
from envgraph.lang.syntax._files import Files
from envgraph.lang.syntax._xml import XMI, Element, XmlPlaces, read_tree

_NAMING = ("eType", "eSuperTypes", "eOpposite", "eClassifier")
_SKIPPED = ("eOperations", "eAnnotations")
_PARTS = ("eClassifiers", "eSubpackages", "eStructuralFeatures", "eLiterals", "eTypeParameters")
_UP = 12
"""Number of directories above a file that are searched for a project of Eclipse."""


class EcoreDocument:
    """An `.ecore` file as a tree of XML elements.

    Attributes:
        top: the first element of the file; if that is an `xmi:XMI`, the elements in it.
        roots: the packages in `top`.
        packages: the `roots` and all their subpackages.
        root: the first element; None if the text is not XML, then `problem` is the diagnostic.
        paths: by the text before a `#`: the name of the existing file that it refers to; filled in by the loader.
        ids: the elements with an `xmi:id`; filled in by `index`.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.places = XmlPlaces(source)
        self.root, self.problem = read_tree(self.places)
        first = [self.root] if self.root else []
        several = first and first[0].name == "XMI" and "/XMI" in (first[0].namespace or "")
        self.top = first[0].children if several else first
        self.roots = tuple(one for one in self.top if one.name == "EPackage" and one.namespace == ECORE)
        self.packages = self._packages()
        self.paths: dict[str, str] = {}
        self.ids: dict[str, Element] = {}
        self._names: dict[Element, Mapping[str, Element]] = {}
        self._listed: dict[tuple[Element, str], list[Element]] = {}

    @property
    def span(self) -> Span:
        """Return the span of the first package's name, or the start of the file."""
        if not self.roots or "name" not in self.roots[0].attributes:
            return self.source.span(0, 0)
        return self.places.attribute(self.roots[0].byte, "name")

    @property
    def uri(self) -> str | None:
        """Return the nsURI of the first package, or None."""
        return self.roots[0].attributes.get("nsURI") if self.roots else None

    def _packages(self) -> tuple[Element, ...]:
        waiting = [*self.roots]
        for one in waiting:
            waiting += [child for child in one.children if child.name == "eSubpackages"]
        return tuple(waiting)

    @property
    def uris(self) -> tuple[str, ...]:
        """Return the nsURIs of all packages that have one."""
        return tuple(one.attributes["nsURI"] for one in self.packages if one.attributes.get("nsURI"))

    def calls(self) -> Iterator[str]:
        """Yield the names by which other files may import this file: nsURIs of packages, and names of root packages."""
        yield from self.uris
        yield from (one.get("name") for one in self.roots)

    def mentioned(self) -> dict[str, Span]:
        """Return the other documents that references name before `#`, each with its first span; no libraries."""
        found: dict[str, Span] = {}
        known = {""}
        for element, key, word in self._words():
            document = word.rpartition("#")[0]
            if document not in known and len(known) <= LIMITS["Ecore files"]:
                known.add(document)
                if library_types(document) is None:
                    found[document] = self.places.attribute(element.byte, key, word)
        return found

    def needs_ecore(self) -> bool:
        """Return True if the file names a class of Ecore itself, or has a type parameter without a bound."""
        return any(
            word == _ANY
            or (library_types(document) is ECORE_TYPES and part.rpartition("/")[2] not in ECORE_TYPES)
            for _, _, word in self._words()
            for document, _, part in [word.rpartition("#")]
        )

    def _words(self) -> Iterator[tuple[Element, str, str]]:
        """Yield (element, XML attribute, word) for each word that refers to a part of a file.

        Features without values are skipped. A type parameter without a bound refers to Ecore's `EObject`.
        """
        waiting = [*self.roots]
        for element in waiting:
            if without_values(element):
                continue
            waiting += [child for child in element.children if child.name not in _SKIPPED]
            for key in ("href",) if element.name in _NAMING else _NAMING:
                for word in element.get(key).split():
                    yield element, key, word
            if element.name == "eTypeParameters" and not any(
                child.name == "eBounds" for child in element.children
            ):
                yield element, "name", _ANY

    # --- parts ---

    def index(self, owners: dict[Element, Element]) -> None:
        """Record the parent of each element in `owners`, and the first element with each `xmi:id` in `ids`."""
        waiting = [self.root] if self.root else []
        for element in waiting:
            key = element.qualified("id", XMI)
            if key:
                self.ids.setdefault(element.attributes[key], element)
            for child in element.children:
                owners[child] = element
            waiting.extend(element.children)

    def at(self, fragment: str, base: Element) -> Element | None:
        """Return the element of a fragment: `//A/b`, `/1/@eClassifiers.2/@eStructuralFeatures.0`, or an `xmi:id`.

        None means that no such element exists. `base` is the package where paths without a root number start.
        """
        if not fragment.startswith("/"):
            return self.ids.get(fragment)
        root, *steps = fragment.split("/")[1:]
        place = int(root) if root.isdecimal() and len(root) < 10 else 0
        current = self.roots[place] if 0 < place < len(self.roots) else base
        for step in steps:
            found = self._counted(current, step) if step.startswith("@") else self.parts(current).get(step)
            if found is None:
                return None
            current = found
        return current

    def _counted(self, element: Element, step: str) -> Element | None:
        name, _, index = step[1:].partition(".")
        if (element, name) not in self._listed:
            self._listed[element, name] = [child for child in element.children if child.name == name]
        inside = self._listed[element, name]
        place = int(index) if index.isdecimal() and len(index) < 10 else 0
        return inside[place] if place < len(inside) else None

    def parts(self, element: Element) -> Mapping[str, Element]:
        """Return by name the classifiers, packages, features, literals and type parameters directly in an element."""
        if element not in self._names:
            named = {}
            for child in reversed(element.children):
                if child.name in _PARTS:
                    named[child.get("name")] = child
            self._names[element] = named
        return self._names[element]


_ANY = f"{ECORE}#//EObject"


def without_values(element: Element) -> str | None:
    """Return why files hold no values of a feature, "derived", "transient" or "eType" (a feature map), or None.

    It is None, too, if a query can compute the values, or if a transient feature has an opposite that holds them. A
    derived XML element or attribute may belong to a feature map.
    """
    attributes = element.attributes
    if is_computed(element):
        return None
    if attributes.get("derived") == "true":
        return None if extended(element).get("kind") in ("element", "attribute") else "derived"
    if attributes.get("transient") == "true" and "eOpposite" not in attributes:
        return "transient"
    return "eType" if attributes.get("eType", "").endswith(f"#//{FEATURE_MAP}") else None


def is_computed(element: Element) -> bool:
    """Return True if a query can define a feature's values: it is derived, or volatile and transient without opposite.

    Containments, feature maps and their members, and features of type `EObject` are excluded.
    """
    attributes = element.attributes
    is_volatile = attributes.get("volatile") == "true" == attributes.get("transient")
    if attributes.get("derived") != "true" and (not is_volatile or "eOpposite" in attributes):
        return False
    plain = attributes.get("containment") != "true" and "kind" not in extended(element)
    return plain and not element.get("eType").endswith((_ANY, f"#//{FEATURE_MAP}"))


def details_of(element: Element, source: str) -> Iterator[tuple[Element, str, str]]:
    """Yield the details of an element's annotations with this source, each as XML element, key and value."""
    for annotation in (one for one in element.children if one.name == "eAnnotations"):
        if annotation.attributes.get("source") == source:
            for one in (one for one in annotation.children if one.name == "details"):
                yield one, one.get("key"), one.get("value")


def extended(element: Element) -> dict[str, str]:
    """Return the ExtendedMetaData of an element, such as its name and kind in XML documents."""
    return {key: value for _, key, value in details_of(element, EXTENDED)}


@cache
def ecore_itself() -> EcoreDocument:
    """Return the metamodel of Ecore, read from a file in this package."""
    text = package_files("envgraph.lang.interchange").joinpath("ecore.ecore").read_text("utf-8")
    return EcoreDocument(Source(ECORE, text))


def eclipse_path(files: Files, text: str, beside: str) -> str | None:
    """Return the name of the file that a link in the file `beside` refers to; None if no such file exists.

    A path of Eclipse's workspace (`platform:/resource/project/model/a.ecore`) is searched in the directories above,
    with and without the project's directory, and finally beside the file.
    """
    path = unquote(text)
    platform = re.match(r"platform:/(?:resource|plugin)/([^/]+)/(.+)", path)
    if platform:
        project, inside = platform.groups()
        tried = [f"{'../' * up}{one}" for up in range(_UP) for one in (f"{project}/{inside}", inside)]
        tried.append(inside.rpartition("/")[2])
    else:
        tried = [] if re.match(r"[a-zA-Z][\w+.-]+:", path) else [path]
    names = (files.name(one, beside=beside) for one in tried)
    return next((name for name in names if files.exists(name)), None)
