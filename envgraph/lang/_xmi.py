"""`.xmi` files: the XML to objects.

A file is read as it streams by: each tag becomes an object at once, and only references wait until all objects are
there. pyecore ends at the first mistake, knows lines alone, lets some mistakes pass, and is many times slower; the two
are compared in the tests.

A document may name objects of others; those are read into the same model.
"""

from __future__ import annotations

import posixpath
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import unquote

from envgraph.errors import (
    Diagnostic,
    LoadError,
    Note,
    RuleError,
    Source,
    Span,
    TypeMismatch,
    did_you_mean,
    has_errors,
    sort_diagnostics,
    with_article,
)
from envgraph.graph import Model, arrange_targets, usual_value
from envgraph.lang._ecore_types import value_of
from envgraph.lang._imports import without_consequences
from envgraph.lang._model import ModelText
from envgraph.lang._xml import XMI, XSI, Handlers, Reader, Stop, XmlPlaces, namespaces
from envgraph.metamodel import Attribute, EnumType, Feature, Metamodel, Package, Reference, type_name

MOST_ERRORS = 100
_MANY = 1000
"""Among more names than this, nobody looks for the nearest."""
_HEAD = 100_000
"""The first tag of a file ends before this character."""
_XMI_SPACES = re.compile(r"http://(www\.omg\.org|schema\.omg\.org/spec)/(spec/)?XMI(/\d+(\.\d+)*)?")
_LOST = -1
"""The place of an object that could not be read: to name it is no mistake."""

Fetch = Callable[[str], Source]
"""Reads another document by its path beside the one that names it; raises LoadError."""


@dataclass(frozen=True, slots=True)
class XmiFile:
    """What an `.xmi` file says, with the files that it refers to.

    Attributes:
        documents: the names of all files that were read.
    """

    text: ModelText
    documents: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]


def read_xmi(
    source: Source,
    metamodel: Metamodel | None,
    lost: frozenset[str] = frozenset(),
    fetch: Callable[[str, str], Source] | None = None,
) -> XmiFile:
    """The model of an `.xmi` file, and all that is wrong with it.

    Args:
        source: the file.
        metamodel: what its objects are instances of; None when that could not be loaded: then only the XML is checked.
        lost: names that errors elsewhere may have taken away.
        fetch: reads another file, by its path and the name of the file that names it; None when there are no others.
    """
    name = posixpath.basename(source.name).rpartition(".")[0] or source.name
    reading = _Reading(Model(metamodel or Metamodel("", ()), name), lost, fetch)
    with reading.model.loading():
        first = reading.enter(source)
        if metamodel is None:
            first.check_syntax()
        else:
            reading.read_all()
    complete = metamodel is not None and not has_errors(reading.diagnostics)
    text = ModelText(
        name,
        source.span(0, 0),
        metamodel.name if metamodel else "",
        reading.model if complete else None,
        _Spans(reading),
    )
    kept = without_consequences(reading.diagnostics, lost)
    return XmiFile(text, tuple(reading.documents), tuple(kept))


def parse_xmi(source: Source, metamodel: Metamodel) -> Model:
    """The model of the text of an `.xmi` file; it may not name other files.

    Raises:
        LoadError: all that is wrong with it.
    """
    found = read_xmi(source, metamodel)
    if found.text.model is None:
        raise LoadError(sort_diagnostics(found.diagnostics))
    return found.text.model


def schema_paths(source: Source) -> list[str]:
    """The paths in the `xsi:schemaLocation` of the first tag of a file: where its metamodel may be."""
    found: list[str] = []

    def start(_: str, attributes: dict[str, str]) -> None:
        scope = namespaces(attributes)
        for key, value in attributes.items():
            prefix, _, local = key.rpartition(":")
            if local == "schemaLocation" and scope.get(prefix) == XSI:
                found.extend(value.split()[1::2])
        raise Stop

    def nothing(_: str) -> None:
        return

    head = Source(source.name, source.text[:_HEAD])
    Reader(XmlPlaces(head)).read(Handlers(start, nothing, nothing))
    paths = dict.fromkeys(unquote(one.partition("#")[0]) for one in found)
    return [path for path in paths if path.endswith((".ecore", ".metamodel")) and "://" not in path]


@dataclass(slots=True)
class _Table:
    """What a class says about the tags of its objects.

    Attributes:
        unset: attributes that have no value where a tag does not mention them, though a fresh object has one.
    """

    name: str
    attributes: Mapping[str, Attribute]
    references: Mapping[str, Reference]
    unset: Sequence[Attribute]
    identifier: str | None


class _Reading:
    """One model, from one document and those that it names."""

    def __init__(
        self, model: Model, lost: frozenset[str], fetch: Callable[[str, str], Source] | None
    ) -> None:
        self.model = model
        self.metamodel = model.metamodel
        self.lost = lost
        self.fetch = fetch
        self.diagnostics: list[Diagnostic] = []
        self.documents: dict[str, _Document | None] = {}
        self.tables = {
            cls.name: self._table(cls.name) for cls in self.metamodel.class_list if not cls.abstract
        }
        self.packages = {package.uri: package for package in self.metamodel.packages}
        self.foreign: set[str] = set()

    def _table(self, cls: str) -> _Table:
        features = self.metamodel.features(cls)
        attributes = {name: one for name, one in features.items() if isinstance(one, Attribute)}
        return _Table(
            cls,
            attributes,
            {name: one for name, one in features.items() if isinstance(one, Reference)},
            [one for one in attributes.values() if usual_value(one) is None],
            next((name for name, one in attributes.items() if one.identifier), None),
        )

    def enter(self, source: Source) -> _Document:
        """Takes part in the reading of a document."""
        document = _Document(self, source)
        self.documents[source.name] = document
        return document

    def read_all(self) -> None:
        """Reads the documents, those that they name, and then their references."""
        try:
            waiting = list(self.documents.values())
            for document in waiting:
                assert document is not None
                waiting.extend(document.read_objects())
            for document in waiting:
                if document:
                    document.link()
            for document in waiting:
                if document:
                    document.reorder()
                    document.places.forget()
        except Stop:
            pass

    def add(self, diagnostic: Diagnostic) -> None:
        """Notes a mistake; after a hundred it ends.

        Raises:
            Stop: there have been enough.
        """
        self.diagnostics.append(diagnostic)
        if len(self.diagnostics) == MOST_ERRORS:
            message = "too many mistakes: the rest of the file is not read"
            self.diagnostics.append(Diagnostic("too-many-errors", message, diagnostic.span))
            raise Stop


class _Spans(Mapping[int, Span]):
    """Where each object's tag stands, worked out on demand: objects of a document have ids one after the other."""

    def __init__(self, reading: _Reading) -> None:
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


@dataclass(slots=True)
class _Frame:
    """A tag that is open: an object, or an attribute that stands as a tag.

    Attributes:
        node: the object, or the one whose attribute it is.
        table: None where nothing inside can be understood.
        parent: the container, to which the object is linked by `reference` at the end.
        text: what stands in an attribute's tag; None for objects.
    """

    node: int
    table: _Table | None = None
    parent: int = _LOST
    reference: Reference | None = None
    attribute: Attribute | None = None
    text: list[str] | None = None


@dataclass(frozen=True, slots=True)
class _Link:
    """A reference that waits until all objects are there; `key` is the XML attribute that holds it."""

    node: int
    reference: Reference
    text: str
    byte: int
    key: str


class _Document:
    """One file.

    Attributes:
        first: the id of the first object.
        bytes: where the tag of each object begins, in the order of the ids.
        roots: the objects at the top, `_LOST` for those that could not be read.
        gaps: places in a containment reference whose objects could not be read.
    """

    def __init__(self, reading: _Reading, source: Source) -> None:
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
        self.links: list[_Link] = []
        self._lists: list[tuple[int, Reference, list[int]]] = []
        self._found: dict[str, int | None] = {}
        self._listed: dict[str, Sequence[int]] = {}
        self._xml = Reader(self.places)
        self._stack: list[_Frame] = []
        self._skipped = 0
        self._top = False
        self._scope: dict[str, str] = {}
        self._scopes: list[tuple[int, dict[str, str]]] = []
        self._types: dict[str, str | None] = {}
        self._type_keys: tuple[str, ...] = ()
        self._id_key: str | None = None

    # --- reading ---

    def check_syntax(self) -> None:
        """Only whether the file is XML."""
        self._top = True
        self._skipped = 1
        problem = self._xml.read(Handlers(self._open_only, self._close_only, lambda _: None))
        if problem:
            self.reading.diagnostics.append(problem)

    def _open_only(self, tag: str, _: dict[str, str]) -> None:
        self._xml.open.append((tag, self._xml.at))

    def _close_only(self, _: str) -> None:
        self._xml.open.pop()

    def read_objects(self) -> list[_Document]:
        """Creates the objects; returns the documents that are named here and not read yet."""
        self.first = self.model.store.next_id
        problem = self._xml.read(Handlers(self._start, self._end, self._text))
        if problem:
            # What stands in a tag that is not closed may not belong there, and references may lead to what comes later.
            opened = [note.span.start for note in problem.notes if note.span]
            found = self.reading.diagnostics
            found[:] = [one for one in found if not (opened and one.span and one.span.start > opened[0])]
            self.reading.add(problem)
            raise Stop
        if len(self.reading.diagnostics) > MOST_ERRORS:
            raise Stop
        return list(self._others())

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        xml = self._xml
        at = xml.at
        xml.open.append((tag, at))
        for key in attributes:
            if key[:5] == "xmlns":
                self._declare(attributes)
                break
        if self._skipped:
            self._skipped += 1
        elif self._stack:
            self._inner(tag, attributes, at)
        else:
            self._root(tag, attributes, at)

    def _end(self, _: str) -> None:
        self._xml.open.pop()
        while self._scopes and self._scopes[-1][0] > len(self._xml.open):
            self._enter_scope(self._scopes.pop()[1])
        if self._skipped:
            self._skipped -= 1
            return
        if not self._stack:
            return
        frame = self._stack.pop()
        if frame.text is not None:
            self._close_attribute(frame)
        elif frame.reference is not None:
            self._contain(frame)

    def _text(self, text: str) -> None:
        if self._skipped:
            return
        if self._stack and self._stack[-1].text is not None:
            self._stack[-1].text.append(text)
        elif not text.isspace():
            # It is told when the next tag begins.
            line = text.strip().split("\n")[0]
            start = max(self.source.text.rfind(line, 0, self.places.offset(self._xml.at)), 0)
            span = self.source.span(start, start + len(line))
            self._report("stray-text", "a text stands here, where only tags can stand", span)

    # --- namespaces ---

    def _declare(self, attributes: dict[str, str]) -> None:
        own = namespaces(attributes)
        for key in [key for key in attributes if key[:5] == "xmlns"]:
            del attributes[key]
        self._scopes.append((len(self._xml.open), self._scope))
        self._enter_scope({**self._scope, **own})

    def _enter_scope(self, scope: dict[str, str]) -> None:
        self._scope = scope
        self._types = {}
        spaces = [prefix for prefix, uri in scope.items() if uri == XSI or _XMI_SPACES.fullmatch(uri)]
        self._type_keys = tuple(f"{prefix}:type" for prefix in spaces)
        self._id_key = next((f"{one}:id" for one in spaces if scope[one] != XSI), None)

    def _class_named(self, name: str, at: int, key: str | None) -> str | None:
        """The class of a tag or an `xsi:type`, such as `railway:Region`; None, reported, if there is none."""
        if name in self._types:
            return self._types[name]
        found = self._look_up(name, at, key)
        self._types[name] = found
        return found

    def _look_up(self, name: str, at: int, key: str | None) -> str | None:
        span = self.places.attribute(at, key) if key else self.places.tag(at)
        prefix, _, simple = name.rpartition(":")
        metamodel, package = self.reading.metamodel, None
        if prefix and prefix not in self._scope:
            hint = (
                did_you_mean(prefix, self._scope)
                or f'write `xmlns:{prefix}="{metamodel.uri or metamodel.name}"`'
            )
            self._report("unknown-prefix", f"the prefix `{prefix}` is not declared", span, hint)
        elif prefix or "" in self._scope:
            package = self._package(self._scope[prefix], span)
        cls = metamodel.classes.get(simple)
        if cls is None:
            self._report(
                "unknown-class", f"unknown class `{simple}`", span, did_you_mean(simple, metamodel.classes)
            )
        elif package and cls.package != package.path:
            where = next(one for one in metamodel.packages if one.path == cls.package)
            message = f"`{simple}` is not in the package `{package.uri}`"
            self._report("unknown-class", message, span, f"it is in `{where.uri}`")
        elif cls.abstract:
            kinds = metamodel.concrete(simple)
            names = ", ".join(f"`{one}`" for one in kinds)
            hint = f"its concrete classes are {names}" if kinds else "it has no concrete subclass"
            self._report("abstract-class", f"`{simple}` is abstract", span, hint)
        else:
            return simple
        return None

    def _package(self, uri: str, span: Span) -> Package | None:
        packages = self.reading.packages
        if uri not in packages and uri not in self.reading.foreign:
            self.reading.foreign.add(uri)
            message = f"the metamodel `{self.reading.metamodel.name}` has no namespace `{uri}`"
            hint = did_you_mean(uri, packages) or "it has " + ", ".join(f"`{one}`" for one in packages)
            self._report("unknown-uri", message, span, hint)
        return packages.get(uri)

    # --- tags ---

    def _root(self, tag: str, attributes: dict[str, str], at: int) -> None:
        prefix, _, simple = tag.rpartition(":")
        if not self._top and simple == "XMI" and _XMI_SPACES.fullmatch(self._scope.get(prefix, "")):
            self._top = True
            return
        self._top = True
        if prefix and _XMI_SPACES.fullmatch(self._scope.get(prefix, "")):
            self._skipped = 1  # what other tools note
            return
        cls = self._class_named(tag, at, None)
        if cls is None:
            self.roots.append(_LOST)
            self._skipped = 1
            return
        table = self.reading.tables[cls]
        self._type_of(attributes)
        node = self._create(table, attributes, at)
        self.roots.append(node)
        self._stack.append(_Frame(node, table))

    def _type_of(self, attributes: dict[str, str]) -> tuple[str | None, str | None]:
        for key in self._type_keys:
            if key in attributes:
                return attributes.pop(key), key
        return None, None

    def _inner(self, tag: str, attributes: dict[str, str], at: int) -> None:
        frame = self._stack[-1]
        table = frame.table
        if table is None:
            self._skipped = 1
            return
        reference = table.references.get(tag)
        if reference is None:
            self._other_tag(frame, table, tag, attributes, at)
            return
        if "href" in attributes or any(key.rpartition(":")[2] == "idref" for key in attributes):
            self._href(frame.node, reference, attributes, at)
            self._skipped = 1
            return
        if self._is_nil(attributes):
            self._skipped = 1
            return
        if not reference.containment:
            message = f"`{reference}` does not contain its targets"
            hint = f'write `{reference.name}="..."`, or `<{reference.name} href="..."/>`'
            self._report("wrong-type", message, self.places.tag(at), hint)
            self._skipped = 1
            return
        self._child(frame, reference, attributes, at)

    def _child(self, frame: _Frame, reference: Reference, attributes: dict[str, str], at: int) -> None:
        type_, key = self._type_of(attributes)
        # The name alone would be looked up in the namespace of the tag, and a reference has none.
        cls = self._class_named(type_, at, key) if type_ else self._declared(reference, at)
        if cls is not None and not self.reading.metamodel.is_a(cls, reference.target):
            message = f"`{reference}` takes objects of class `{reference.target}`, not {with_article(cls)}"
            self._report(
                "wrong-type", message, self.places.attribute(at, key) if key else self.places.tag(at)
            )
            cls = None
        if cls is None:
            place = len(self.model.targets(frame.node, reference))
            gaps = self.gaps.setdefault((frame.node, reference.name), [])
            gaps.append(place + len(gaps))
            self._skipped = 1
            return
        table = self.reading.tables[cls]
        node = self._create(table, attributes, at)
        self._stack.append(_Frame(node, table, frame.node, reference))

    def _declared(self, reference: Reference, at: int) -> str | None:
        """The class that a reference leads to, where a tag has no `xsi:type`."""
        metamodel = self.reading.metamodel
        if not metamodel.classes[reference.target].abstract:
            return reference.target
        kinds = metamodel.concrete(reference.target)
        prefix = next((one for one, uri in self._scope.items() if uri in self.reading.packages), "")
        hint = f'write `xsi:type="{prefix}:{kinds[0]}"` for example' if kinds else None
        message = f"`{reference.target}` is abstract: the tag needs an `xsi:type`"
        self._report("abstract-class", message, self.places.tag(at), hint)
        return None

    def _other_tag(self, frame: _Frame, table: _Table, tag: str, attributes: dict[str, str], at: int) -> None:
        """A tag that is no reference: an attribute, an extension of a tool, or a mistake."""
        attribute = table.attributes.get(tag)
        if attribute is not None:
            nil = self._is_nil(attributes)
            if nil:
                self.model.set_value(frame.node, attribute, None)
                self._skipped = 1
            else:
                self._stack.append(_Frame(frame.node, attribute=attribute, text=[]))
            return
        self._skipped = 1
        prefix = tag.rpartition(":")[0]
        if prefix and _XMI_SPACES.fullmatch(self._scope.get(prefix, "")):
            return
        known = [*table.references, *table.attributes]
        self._unknown_feature(table, tag, self.places.tag(at), known)

    def _unknown_feature(self, table: _Table, name: str, span: Span, known: Sequence[str]) -> None:
        if name in self.reading.lost:
            return
        hint = did_you_mean(name, known)
        if hint is None:
            hint = "it has " + ", ".join(f"`{one}`" for one in known) if known else "it has no features"
        self._report("unknown-feature", f"`{table.name}` has no feature `{name}`", span, hint)

    def _is_nil(self, attributes: dict[str, str]) -> bool:
        return any(
            value == "true"
            and key.rpartition(":")[2] == "nil"
            and self._scope.get(key.rpartition(":")[0]) == XSI
            for key, value in attributes.items()
        )

    # --- objects ---

    def _create(self, table: _Table, attributes: dict[str, str], at: int) -> int:
        """The object of a tag, with the values of its attributes."""
        model = self.model
        name = attributes.pop(self._id_key, None) if self._id_key else None
        if name is not None and name in model:
            self._duplicate(name, at)
            name = None
        node = model.new(table.name, name)
        self.bytes.append(at)
        if name is not None:
            self.ids[name] = node
        known, references = table.attributes, table.references
        for key, value in attributes.items():
            if key in known:
                self._set(node, known[key], value, at)
            elif key in references:
                self.links.append(_Link(node, references[key], value, at, key))
            else:
                self._other_attribute(table, key, at)
        for attribute in table.unset:
            if attribute.name not in attributes:
                model.set_value(node, attribute, None)
        if table.identifier and table.identifier in attributes:
            self.identified.setdefault(attributes[table.identifier], node)
        return node

    def _duplicate(self, name: str, at: int) -> None:
        first = self.ids.get(name)
        notes = (Note("the first one is here", self._tag(first)),) if first is not None else ()
        key = self._id_key or ""
        message = f"there are two objects `{name}`"
        self._report("duplicate-object", message, self.places.attribute(at, key), notes=notes)

    def _set(self, node: int, attribute: Attribute, text: str, at: int, span: Span | None = None) -> None:
        value = value_of(text, attribute.type)
        if value is not None:
            self.model.set_value(node, attribute, value)
            return
        type_, hint = attribute.type, None
        span = span or self.places.attribute(at, attribute.name)
        if isinstance(type_, EnumType):
            names = type_.labels or type_.literals
            hint = did_you_mean(text, names) or "its literals are " + ", ".join(f"`{one}`" for one in names)
            self._report("unknown-literal", f"`{type_.name}` has no literal `{_short(text)}`", span, hint)
            return
        message = f"`{attribute}` takes {with_article(type_name(type_))}, not `{_short(text)}`"
        if type_name(type_) == "bool":
            hint = did_you_mean(text, ("true", "false")) or "write `true` or `false`"
        self._report("wrong-type", message, span, hint)

    def _other_attribute(self, table: _Table, key: str, at: int) -> None:
        prefix, _, simple = key.rpartition(":")
        if prefix:
            uri = self._scope.get(prefix)
            if uri is None and prefix != "xml":
                space = XSI if prefix == "xsi" else XMI if prefix == "xmi" else "..."
                hint = (
                    did_you_mean(prefix, self._scope) or f'write `xmlns:{prefix}="{space}"` in the first tag'
                )
                span = self.places.name_of(at, key)
                self._report("unknown-prefix", f"the prefix `{prefix}` is not declared", span, hint)
            return  # what other tools note
        known = [*table.attributes, *table.references]
        self._unknown_feature(table, simple, self.places.name_of(at, key), known)

    def _close_attribute(self, frame: _Frame) -> None:
        assert frame.attribute is not None and frame.text is not None
        at = self._xml.at
        # Positions of texts are not kept: the tag that ends it stands for the value.
        self._set(frame.node, frame.attribute, "".join(frame.text), at, self.places.tag(at))

    def _contain(self, frame: _Frame) -> None:
        """Links an object that is complete to its container: then no chain of containers is walked."""
        assert frame.reference is not None
        upper = frame.reference.upper
        count = len(self.model.targets(frame.parent, frame.reference))
        if upper is not None and count >= upper:
            if count == upper and (frame.parent, frame.reference.name) not in self.gaps:
                message = f"`{frame.reference}` takes {_plural(upper, 'object')} at most"
                self._report("too-many-targets", message, self._tag(frame.node))
            self.gaps.setdefault((frame.parent, frame.reference.name), []).append(count)
            return
        self.model.link(frame.parent, frame.reference, frame.node)

    # --- references ---

    def _href(self, node: int, reference: Reference, attributes: dict[str, str], at: int) -> None:
        key = next(key for key in attributes if key == "href" or key.rpartition(":")[2] == "idref")
        self.links.append(_Link(node, reference, attributes[key], at, key))

    def _others(self) -> Iterator[_Document]:
        """The documents that links name, read now."""
        for link in self.links:
            if "#" not in link.text:
                continue
            for word in (one for one in link.text.split() if "#" in one):
                path = unquote(word.partition("#")[0])
                name = self._document_name(path)
                if not path or name in self.reading.documents:
                    continue
                self.reading.documents[name] = None
                found = self._fetch(path, link)
                if found:
                    yield found

    def _document_name(self, path: str) -> str:
        return posixpath.normpath(posixpath.join(posixpath.dirname(self.source.name), path))

    def _fetch(self, path: str, link: _Link) -> _Document | None:
        span = self._where(link, next(one for one in link.text.split() if unquote(one).startswith(path)))
        if re.match(r"[a-zA-Z][a-zA-Z0-9+.-]+:", path):
            message = f"`{_short(path)}` is not read: only files beside this one are"
            self._report("other-file", message, span)
            return None
        if self.reading.fetch is None:
            self._report("missing-file", f"`{_short(path)}`: there is no such file", span)
            return None
        try:
            source = self.reading.fetch(path, self.source.name)
        except LoadError as error:
            for problem in error.diagnostics:
                inside = problem.span is not None and problem.span.source.text
                self.reading.add(
                    problem
                    if inside
                    else Diagnostic(problem.code, f"`{path}`: {problem.message}", span, problem.hint)
                )
            return None
        known = self.reading.documents.get(source.name)  # by another path
        document = known or self.reading.enter(source)
        self.reading.documents[self._document_name(path)] = document
        return None if known else document

    def link(self) -> None:
        """Makes the links of all references."""
        for link in self.links:
            self._resolve_link(link)

    def _resolve_link(self, link: _Link) -> None:
        model, reference = self.model, link.reference
        words = link.text.split()
        targets: list[int] = []
        for index, word in enumerate(words):
            if ":" in word and "#" not in word and index + 1 < len(words) and "#" in words[index + 1]:
                continue  # the type of the object that comes next
            target = self._target(link, word)
            if target is None or target == _LOST:
                continue
            if not self.reading.metamodel.is_a(model.class_of(target), reference.target):
                self._wrong_class(link, word, target)
            elif reference.upper is not None and len(targets) >= reference.upper:
                message = f"`{reference}` takes {_plural(reference.upper, 'object')} at most"
                self._report("too-many-targets", message, self._where(link, word))
                break
            else:
                targets.append(target)
                self._add(link, word, target)
        if len(targets) > 1 and reference.opposite is not None:
            self._lists.append((link.node, reference, targets))

    def _add(self, link: _Link, word: str, target: int) -> None:
        model, reference = self.model, link.reference
        if model.has_link(link.node, reference, target):
            return  # the opposite has said so
        relation = model.store.relations[reference.index]
        child = target if relation.containment else link.node if relation.contained else None
        if child is not None and model.container(child) is not None:
            message = f"{model.describe(child)} is in another container already"
            self._report(
                "two-containers", message, self._where(link, word), "an object has one container at most"
            )
            return
        try:
            model.link(link.node, reference, target)
        except (RuleError, TypeMismatch) as error:
            self._report("impossible-link", str(error).split("\n", maxsplit=1)[0], self._where(link, word))

    def reorder(self) -> None:
        """Gives many-valued references the order of the text, which making links from the other end has changed."""
        for node, reference, targets in self._lists:
            ends = self.model.targets(node, reference)
            if list(ends) != targets and sorted(ends) == sorted(targets):
                arrange_targets(self.model, node, reference, targets)

    def _wrong_class(self, link: _Link, word: str, target: int) -> None:
        cls = self.model.class_of(target)
        message = (
            f"`{link.reference}` takes objects of class `{link.reference.target}`, "
            f"and {self.model.describe(target)} is {with_article(cls)}"
        )
        self._report("wrong-type", message, self._where(link, word), notes=self._note(target))

    def _note(self, target: int) -> tuple[Note, ...]:
        span = _Spans(self.reading).get(target)
        return (Note("it is here", span),) if span else ()

    def _target(self, link: _Link, word: str) -> int | None:
        """The object that a word names; None, reported, if there is none."""
        path, mark, fragment = word.rpartition("#")
        if not mark:
            fragment = word
        document: _Document | None = self
        if path:
            document = self.reading.documents.get(self._document_name(unquote(path)))
            if document is None:
                return _LOST  # which was reported
        assert document is not None
        found = document.find(fragment)
        if found is None:
            known = (*document.ids, *document.identified)
            hint = did_you_mean(fragment, known) if len(known) <= _MANY else None
            if not known and not fragment.startswith("/"):
                hint = "objects are named by `xmi:id`, by an `iD` attribute of the metamodel, or by place: `//@...`"
            self._report(
                "unknown-object", f"there is no object `{_short(word)}`", self._where(link, word), hint
            )
        return found

    def find(self, fragment: str) -> int | None:
        """The object of a fragment (`//@regions.0`, `/1/@a`, an id), `_LOST`, or None."""
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
        if not last.startswith("@"):
            return self._root_at(last) if head == "" or fragment == "//" else None
        if head not in self._found:
            self._found[head] = self._walk(head)
        above = self._found[head]
        found = self._step(above, last)
        if found is not None and found != _LOST and above is not None and "." in last:
            name = last[1:].partition(".")[0]
            reference = self.reading.metamodel.feature(self.model.class_of(above), name)
            if isinstance(reference, Reference) and (above, name) not in self.gaps:
                self._listed[fragment.rpartition(".")[0]] = self.model.targets(above, reference)
        return found

    def _walk(self, fragment: str) -> int | None:
        root, *steps = fragment.split("/")[1:]
        node = self._root_at(root)
        for step in steps:
            node = self._step(node, step)
        return node

    def _root_at(self, text: str) -> int | None:
        place = int(text) if text.isdecimal() and len(text) < 10 else 0 if not text else -1
        return self.roots[place] if 0 <= place < len(self.roots) else None

    def _step(self, node: int | None, step: str) -> int | None:
        """The child at `@feature.3`, or `@feature` of a single reference."""
        if node is None or node == _LOST:
            return node
        name, _, index = step[1:].partition(".")
        feature: Feature | None = self.reading.metamodel.feature(self.model.class_of(node), name)
        place = int(index) if index.isdecimal() and len(index) < 10 else 0 if not index else -1
        if not isinstance(feature, Reference) or place < 0:
            return _LOST if name in self.reading.lost else None
        gaps = self.gaps.get((node, name), ())
        if place in gaps:
            return _LOST
        place -= sum(gap < place for gap in gaps)
        targets = self.model.targets(node, feature)
        return targets[place] if place < len(targets) else None

    # --- messages ---

    def _tag(self, node: int) -> Span:
        return self.places.tag(self.bytes[node - self.first])

    def _where(self, link: _Link, word: str) -> Span:
        return self.places.attribute(link.byte, link.key, word)

    def _report(
        self, code: str, message: str, span: Span, hint: str | None = None, notes: tuple[Note, ...] = ()
    ) -> None:
        self.reading.add(Diagnostic(code, message, span, hint, notes=notes))


def _short(text: str) -> str:
    """A text for a message."""
    line = " ".join(text.split())
    return line if len(line) <= 80 else f"{line[:77]}..."


def _plural(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"
