"""An `.ecore` file as a tree: its packages, its parts, and the other files that it names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files as package_files
from urllib.parse import unquote

from envgraph.errors import Source, Span
from envgraph.lang.read._ecore_types import ECORE, ECORE_TYPES, FEATURE_MAP, library_types
from envgraph.lang.syntax._files import Files
from envgraph.lang.syntax._xml import XMI, Element, XmlPlaces, read_tree

_NAMING = ("eType", "eSuperTypes", "eOpposite", "eClassifier")
_SKIPPED = ("eOperations", "eAnnotations")
_PARTS = ("eClassifiers", "eSubpackages", "eStructuralFeatures", "eLiterals", "eTypeParameters")
_MOST = 1000
"""So many other files are looked for; that there are more is reported where they are named."""
_UP = 12
"""So many directories above a file are looked through for a project of Eclipse."""


class EcoreDocument:
    """One file.

    Attributes:
        packages: the outermost one and those in it; () where the first tag is none.
        root: the first tag, or None where the text is no XML, which `problem` tells.
        paths: the names of the files that words before a `#` lead to, as far as there are such files.
        ids: the elements with an `xmi:id`; filled in by `index`.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.places = XmlPlaces(source)
        self.root, self.problem = read_tree(self.places)
        self.packages = self._packages()
        self.paths: dict[str, str] = {}
        self.ids: dict[str, Element] = {}
        self._names: dict[Element, Mapping[str, Element]] = {}
        self._listed: dict[tuple[Element, str], list[Element]] = {}

    @property
    def span(self) -> Span:
        """The name of the package, or the start of the file."""
        if self.root is None or "name" not in self.root.attributes:
            return self.source.span(0, 0)
        return self.places.attribute(self.root.byte, "name")

    @property
    def is_package(self) -> bool:
        """Whether the first tag is a package of Ecore."""
        return self.root is not None and self.root.name == "EPackage" and self.root.namespace == ECORE

    @property
    def uri(self) -> str | None:
        """The nsURI of the outermost package."""
        return self.root.attributes.get("nsURI") if self.root else None

    def _packages(self) -> tuple[Element, ...]:
        waiting = [self.root] if self.root and self.is_package else []
        for one in waiting:
            waiting += [child for child in one.children if child.name == "eSubpackages"]
        return tuple(waiting)

    @property
    def uris(self) -> tuple[str, ...]:
        """The nsURIs of the packages."""
        return tuple(one.attributes["nsURI"] for one in self.packages if one.attributes.get("nsURI"))

    def calls(self) -> Iterator[str]:
        """Yield what other files may call the file by: the nsURIs of its packages, and the name of the outermost."""
        yield from self.uris
        yield from (one.get("name") for one in self.packages[:1])

    def mentioned(self) -> dict[str, Span]:
        """Return what stands before `#` where something of another file is named, with the first place of each."""
        found: dict[str, Span] = {}
        known = {""}
        for element, key, word in self._words():
            document = word.rpartition("#")[0]
            if document not in known and len(known) <= _MOST:
                known.add(document)
                if library_types(document) is None:
                    found[document] = self.places.attribute(element.byte, key, word)
        return found

    def needs_ecore(self) -> bool:
        """Return whether a class of Ecore itself is named, or a type parameter stands for any object."""
        return any(
            word == _ANY
            or (library_types(document) is ECORE_TYPES and part.rpartition("/")[2] not in ECORE_TYPES)
            for _, _, word in self._words()
            for document, _, part in [word.rpartition("#")]
        )

    def _words(self) -> Iterator[tuple[Element, str, str]]:
        """Each word that names something, with the element and the attribute that have it."""
        waiting = [self.root] if self.root and self.is_package else []
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
        """Notes which element each is in, and those with an id."""
        waiting = [self.root] if self.root else []
        for element in waiting:
            key = element.qualified("id", XMI)
            if key:
                self.ids.setdefault(element.attributes[key], element)
            for child in element.children:
                owners[child] = element
            waiting.extend(element.children)

    def at(self, fragment: str, base: Element) -> Element | None:
        """`//A/b`, `//@eClassifiers.2/@eStructuralFeatures.0`, or an `xmi:id`; paths begin at a package."""
        if not fragment.startswith("/"):
            return self.ids.get(fragment)
        current = base
        for step in fragment.split("/")[2:]:
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
        """Return what is in an element, by name."""
        if element not in self._names:
            named = {}
            for child in reversed(element.children):
                if child.name in _PARTS:
                    named[child.get("name")] = child
            self._names[element] = named
        return self._names[element]


_ANY = f"{ECORE}#//EObject"


def without_values(element: Element) -> str | None:
    """The word that says why a feature holds nothing that a file could say, or None.

    A transient one may follow from its opposite.
    """
    attributes = element.attributes
    if attributes.get("derived") == "true":
        return "derived"
    if attributes.get("transient") == "true" and "eOpposite" not in attributes:
        return "transient"
    return "eType" if attributes.get("eType", "").endswith(f"#//{FEATURE_MAP}") else None


@cache
def ecore_itself() -> EcoreDocument:
    """The classes of Ecore, as a file that comes with the package."""
    text = package_files("envgraph.lang.interchange").joinpath("ecore.ecore").read_text("utf-8")
    return EcoreDocument(Source(ECORE, text))


def ecore_path(files: Files, text: str, beside: str) -> str | None:
    """The file that an `.ecore` file calls so, if there is one.

    A path of Eclipse's workspace (`platform:/resource/project/model/a.ecore`) is looked for in the directories above,
    with the directory of the project and without, and at last beside the file.
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
    return next((name for name in names if name.endswith(".ecore") and files.exists(name)), None)
