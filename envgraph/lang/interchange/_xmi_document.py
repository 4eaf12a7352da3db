"""One reading of XMI: the model that comes of it, its documents, and how they name objects."""

from __future__ import annotations

import posixpath
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence

from envgraph.code import dataclass
from envgraph.errors import MOST_ERRORS, Diagnostic, Note, Severity, Source, Span, plural, too_many_errors
from envgraph.graph import Model, usual_value
from envgraph.lang.syntax._once import NAMES
from envgraph.lang.syntax._xml import Stop, XmlPlaces
from envgraph.metamodel import Attribute, Feature, Reference

LOST = -1
"""The place of an object that could not be read: to name it is no mistake."""

Fetch = Callable[[str, str], Source]
"""Reads another document, by its path and the name of the one that names it; raises LoadError."""


@dataclass(slots=True)
class Table:
    """What a class says about the tags of its objects.

    Attributes:
        unset: attributes that have no value where a tag does not mention them, though a fresh object has one.
    """

    name: str
    attributes: Mapping[str, Attribute]
    references: Mapping[str, Reference]
    unset: Sequence[Attribute]
    identifier: str | None


@dataclass(frozen=True, slots=True)
class Link:
    """A reference that waits until all objects are there; `key` is the XML attribute that holds it."""

    node: int
    reference: Reference
    text: str
    byte: int
    key: str


class Reading:
    """One model, from one document and those that it names.

    Attributes:
        allow_unresolved: whether links to what is nowhere are left out with a warning, and are no mistakes.
    """

    def __init__(
        self, model: Model, lost: frozenset[str], fetch: Fetch | None, *, allow_unresolved: bool = False
    ) -> None:
        self.model = model
        self.metamodel = model.metamodel
        self.lost = lost
        self.fetch = fetch
        self.allow_unresolved = allow_unresolved
        self.errors = 0
        self._unresolved = 0
        self._places: dict[str, int] = {}
        """How often something has been said."""
        self.diagnostics: list[Diagnostic] = []
        self.documents: dict[str, Document | None] = {}
        self._tables: dict[str, Table] = {}
        self.packages = {package.uri: package for package in self.metamodel.packages}
        self.foreign: set[str] = set()
        self._omitted: dict[tuple[str, str, str, str], tuple[int, Span]] = {}

    def omit(
        self, noun: str, rest: str, span: Span, hint: str = "no class has this", said: str = "left out"
    ) -> None:
        """Note one of the things that the model does not have, or has in another way."""
        count, first = self._omitted.get((said, noun, rest, hint), (0, span))
        self._omitted[said, noun, rest, hint] = count + 1, first

    def omissions(self) -> Iterator[Diagnostic]:
        """Yield a warning for each kind of things that are left out or rounded, at the first of them."""
        for (said, noun, rest, hint), (count, span) in self._omitted.items():
            code = f"values-{said.replace(' ', '-')}"
            yield Diagnostic(code, f"{said}: {plural(count, noun)} {rest}", span, hint, Severity.WARNING)

    def table(self, cls: str) -> Table:
        """Return what a class says about its tags; worked out for the classes that a file has, and no others."""
        found = self._tables.get(cls)
        if found is None:
            found = self._tables[cls] = self._table(cls)
        return found

    def _table(self, cls: str) -> Table:
        features = self.metamodel.features(cls)
        attributes = {name: one for name, one in features.items() if isinstance(one, Attribute)}
        return Table(
            cls,
            attributes,
            {name: one for name, one in features.items() if isinstance(one, Reference)},
            [one for one in attributes.values() if usual_value(one) is None and not one.many],
            next((name for name, one in attributes.items() if one.identifier), None),
        )

    def enter(self, source: Source) -> Document:
        """Begins with a document."""
        document = Document(self, source)
        self.documents[source.name] = document
        return document

    def add(self, diagnostic: Diagnostic) -> None:
        """Notes a mistake; after a hundred it ends. A name that means nothing is one mistake, wherever it stands.

        Raises:
            Stop: there have been enough.
        """
        places = self._places[diagnostic.message] = self._places.get(diagnostic.message, 0) + 1
        if places > 1 and diagnostic.code in NAMES:
            if places <= MOST_ERRORS:
                self.diagnostics.append(diagnostic)
            return
        self.diagnostics.append(diagnostic)
        self.errors += 1
        if self.errors == MOST_ERRORS:
            self.diagnostics.append(too_many_errors(diagnostic.span))
            raise Stop

    def unresolved(
        self,
        code: str,
        message: str,
        span: Span,
        hint: str | None = None,
        lost: str = "links to it are left out",
    ) -> None:
        """Notes what is named and is nowhere: a mistake, or a warning, of which a hundred are shown."""
        if not self.allow_unresolved:
            self.add(Diagnostic(code, message, span, hint))
            return
        self._unresolved += 1
        if self._unresolved == MOST_ERRORS + 1:
            code, message = "too-many-warnings", "there are more names of what is nowhere"
        if self._unresolved <= MOST_ERRORS + 1:
            self.diagnostics.append(Diagnostic(code, message, span, lost, Severity.WARNING))


class Spans(Mapping[int, Span]):
    """Where each object's tag stands, worked out on demand: objects of a document have ids one after the other."""

    def __init__(self, reading: Reading) -> None:
        documents = [one for one in reading.documents.values() if one]
        self._parts = [(one.first, one.bytes, one.places) for one in dict.fromkeys(documents)]

    def __getitem__(self, node: int) -> Span:
        for first, places, text in self._parts:
            if 0 <= node - first < len(places):
                return text.tag(places[node - first])
        raise KeyError(node)

    def __iter__(self) -> Iterator[int]:
        return (first + index for first, places, _ in self._parts for index in range(len(places)))

    def __len__(self) -> int:
        return sum(len(places) for _, places, _ in self._parts)


class Document:
    """One file.

    Attributes:
        first: the id of the first object.
        bytes: where the tag of each object begins, in the order of the ids.
        roots: the objects at the top, `LOST` for those that could not be read.
        gaps: places in a containment reference whose objects could not be read.
        ids, identified: objects by their `xmi:id`, and by the value of their `iD` attribute.
        links: what waits until all objects are there.
    """

    def __init__(self, reading: Reading, source: Source) -> None:
        self.reading = reading
        self.model = reading.model
        self.source = source
        self.places = XmlPlaces(source)
        self.first = 0
        self.bytes = array("Q")
        self.roots: list[int] = []
        self.gaps: dict[tuple[int, str], list[int]] = {}
        self.ids: dict[str, int] = {}
        self.identified: dict[str, int] = {}
        self.links: list[Link] = []
        self._found: dict[str, int | None] = {}
        self._listed: dict[str, Sequence[int]] = {}
        self._named: dict[int, dict[str, int]] = {}

    def beside(self, path: str) -> str:
        """The name of another document, by its path in this one."""
        return posixpath.normpath(posixpath.join(posixpath.dirname(self.source.name), path))

    def find(self, fragment: str) -> int | None:
        """The object of a fragment (`//@regions.0`, `/1/@a`, an id), `LOST`, or None."""
        if not fragment.startswith("/"):
            found = self.ids.get(fragment)
            return self.identified.get(fragment) if found is None else found
        siblings, _, index = fragment.rpartition(".")
        listed = self._listed.get(siblings)
        if listed is not None and index.isdecimal() and len(index) < 10 and int(index) < len(listed):
            return listed[int(index)]
        return self._look_for(fragment)

    def _look_for(self, fragment: str) -> int | None:
        head, _, last = fragment.rpartition("/")
        if head == "" or fragment == "//":
            return self._root_at(last)
        if head not in self._found:
            self._found[head] = self._walk(head)
        above = self._found[head]
        found = self._step(above, last)
        if found is not None and found != LOST and above is not None and last[:1] == "@" and "." in last:
            name = last[1:].partition(".")[0]
            reference = self.reading.metamodel.feature(self.model.class_of(above), name)
            if isinstance(reference, Reference) and (above, name) not in self.gaps:
                self._listed[fragment.rpartition(".")[0]] = self.model.targets(above, reference)
        return found

    def _walk(self, fragment: str) -> int | None:
        root, *steps = fragment.split("/")[1:] or ["?"]  # `/@a` has no root
        node = self._root_at(root)
        for step in steps:
            node = self._step(node, step)
        return node

    def _root_at(self, text: str) -> int | None:
        place = int(text) if text.isdecimal() and len(text) < 10 else 0 if not text else -1
        return self.roots[place] if 0 <= place < len(self.roots) else None

    def _step(self, node: int | None, step: str) -> int | None:
        """The child at `@feature.3`, `@feature` of a single reference, or of a name, as in models of Ecore."""
        if node is None or node == LOST:
            return node
        if not step.startswith("@"):
            return self._child_named(node, step)
        name, _, index = step[1:].partition(".")
        feature: Feature | None = self.reading.metamodel.feature(self.model.class_of(node), name)
        place = int(index) if index.isdecimal() and len(index) < 10 else 0 if not index else -1
        if not isinstance(feature, Reference) or place < 0:
            left_out = self.reading.metamodel.left_out(self.model.class_of(node), name)
            return LOST if left_out or name in self.reading.lost else None
        gaps = self.gaps.get((node, name), ())
        if place in gaps:
            return LOST
        place -= sum(gap < place for gap in gaps)
        targets = self.model.targets(node, feature)
        return targets[place] if place < len(targets) else None

    def _child_named(self, node: int, name: str) -> int | None:
        """The first child of this `name`; `title.1` is the second `title`."""
        if node not in self._named:
            known = self._named[node] = {}
            counts: dict[object, int] = {}
            features = self.reading.metamodel.features(self.model.class_of(node)).values()
            contained = (one for one in features if isinstance(one, Reference) and one.containment)
            for child in (child for one in contained for child in self.model.targets(node, one)):
                attribute = self.reading.metamodel.feature(self.model.class_of(child), "name")
                value = self.model.value(child, attribute) if isinstance(attribute, Attribute) else None
                count = counts[value] = counts.get(value, -1) + 1
                known.setdefault(f"{value}.{count}" if count else str(value), child)
        return self._named[node].get(name)

    def tag(self, node: int) -> Span:
        """The tag of an object."""
        return self.places.tag(self.bytes[node - self.first])

    def where(self, link: Link, word: str) -> Span:
        """A word in a reference."""
        return self.places.attribute(link.byte, link.key, word)

    def report(
        self, code: str, message: str, span: Span, hint: str | None = None, notes: tuple[Note, ...] = ()
    ) -> None:
        """Notes a mistake; raises `Stop` when there have been enough."""
        self.reading.add(Diagnostic(code, message, span, hint, notes=notes))


def short(text: str) -> str:
    """A text for a message, on one line and not too long."""
    line = " ".join(text.split())
    return line if len(line) <= 80 else f"{line[:77]}..."
