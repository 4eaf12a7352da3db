"""The state of reading an `.xmi` file: the model, the documents, and the lookup of objects by their names."""

from __future__ import annotations

import posixpath
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from urllib.parse import unquote

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_ERRORS,
    MAX_NESTING,
    SHOWN,
    Diagnostic,
    Note,
    Severity,
    Source,
    Span,
    count_with_noun,
    name_hint,
    too_many_errors_diagnostic,
)
from envgraph.graph import Model
from envgraph.lang.interchange._ecore_document import ecore_metamodel_document
from envgraph.lang.interchange._xmi_names import XmlNames
from envgraph.lang.read._ecore_types import ECORE, parse_xml_value, well_known_types
from envgraph.lang.syntax._merge_diagnostics import FILE_WIDE_NAME_CODES
from envgraph.lang.syntax._xml_parser import XSI, StopParsing, XmlPositions
from envgraph.metamodel import Attribute, Feature, Reference

UNREAD_OBJECT = -1
"""The id that stands for an object that could not be read. Links to such an object are not reported as mistakes."""

FetchDocument = Callable[[str, str], Source | None]
"""Returns a document, given its path and the name of the document that links to it. None means that it is missing."""

_NAMING_HINT = "refer to an object by its `xmi:id`, by an `iD` attribute of the metamodel, or by its path: `//@...`"
LEAVE_OUT_HINT = "add `--allow-unresolved` to leave out links to missing objects"

_KEYED = re.compile(r"@([^\[]+)\[(.*)\]")
_KEY = re.compile(r"([^=,]+)=(null|'[^']*'|\"[^\"]*\"|\[[^\]]*\])(?:,|$)")
_QUOTED = re.compile(r"'([^']*)'|\"([^\"]*)\"")


@dataclass(frozen=True, slots=True)
class PendingLink:
    """A reference of the object `node`, to be linked after all objects have been read.

    Attributes:
        text: the names of the targets.
        tag_byte, attribute_key: the byte offset of the tag, and the XML attribute that holds the text.
        child_index: for an `href` in a containment reference, its index in `XmiReading.children`; else -1.
    """

    node: int
    reference: Reference
    text: str
    tag_byte: int
    attribute_key: str
    child_index: int = -1


class XmiReading:
    """The state of reading one model from a document and the documents that it links to.

    Attributes:
        allow_unresolved: whether links to missing files and objects are warnings instead of errors.
        children: by container and reference: the children in the order of the text. An entry exists only if a child
            could not be read (`UNREAD_OBJECT`) or is given by an `href` (document and link). None stands for an `href`
            being resolved.
    """

    def __init__(
        self,
        model: Model,
        lost: frozenset[str],
        fetch: FetchDocument | None,
        *,
        allow_unresolved: bool = False,
    ) -> None:
        self.model = model
        self.metamodel = model.metamodel
        self.lost_names = lost
        self.fetch = fetch
        self.allow_unresolved = allow_unresolved
        self.errors = 0
        self._unresolved = 0
        self._places: dict[str, int] = {}
        """Number of reports of each problem."""
        self.diagnostics: list[Diagnostic] = []
        self.documents: dict[str, XmiDocument | None] = {}
        self.children: dict[tuple[int, str], list[int | tuple[XmiDocument, PendingLink] | None]] = {}
        self._looking = 0
        self.names = XmlNames(self.metamodel)
        self.packages = {package.uri: package for package in self.metamodel.packages}
        self.foreign: set[str] = set()
        self._omitted: dict[tuple[str, str, str, str], tuple[int, Span]] = {}

    def count_omitted(
        self,
        noun: str,
        description: str,
        span: Span,
        hint: str = "no class has this",
        change: str = "left out",
    ) -> None:
        """Count a part that the model lacks or changes; all such parts with the same words give one later warning."""
        count, first = self._omitted.get((change, noun, description, hint), (0, span))
        self._omitted[change, noun, description, hint] = count + 1, first

    def count_if_left_out(self, cls: str, feature: str, span: Span, noun: str = "value") -> bool:
        """Return True if the metamodel left out a feature; if so, count the lost `noun` for a later warning."""
        reason = self.metamodel.left_out_reason(cls, feature)
        if reason:
            self.count_omitted(noun, f"of `{cls}.{feature}`", span, f"the metamodel lacks this: {reason}")
        return bool(reason)

    def omission_warnings(self) -> Iterator[Diagnostic]:
        """Yield one warning for each kind of part that was left out or rounded, with the position of the first."""
        for (said, noun, rest, hint), (count, span) in self._omitted.items():
            code = f"values-{said.replace(' ', '-')}"
            yield Diagnostic(code, f"{said}: {count_with_noun(count, noun)} {rest}", span, hint, Severity.WARNING)

    def append_unlinked_child(
        self, node: int, reference: Reference, child: int
    ) -> list[int | tuple[XmiDocument, PendingLink] | None]:
        """Append a child that is not in the model but counts in paths such as `//@goods.1`; return all children."""
        key = node, reference.name
        if key not in self.children:
            self.children[key] = [*self.model.graph.targets(node, reference)]
        self.children[key].append(child)
        return self.children[key]

    def child_at(self, node: int, name: str, index: int) -> int | None:
        """Return the object at an index of a containment reference: `UNREAD_OBJECT` if it was not read, None if
        missing.

        An `href` is resolved at the first call. If it leads back to itself, the object counts as missing.
        """
        children = self.children[node, name]
        child = children[index] if index < len(children) else None
        if isinstance(child, tuple):
            (document, link), children[index] = child, None
            self._looking += 1
            child = document.resolve_target(link, link.text) if self._looking < MAX_NESTING else None
            children[index], self._looking = child, self._looking - 1
        return child

    def children_in(self, node: int, reference: Reference) -> Sequence[int]:
        """Return the objects that could be read in a containment reference, in the order of the text."""
        listed = self.children.get((node, reference.name))
        if listed is None:
            return self.model.graph.targets(node, reference)
        found = (self.child_at(node, reference.name, place) for place in range(len(listed)))
        return [child for child in found if child is not None and child != UNREAD_OBJECT]

    def add_document(self, source: Source) -> XmiDocument:
        """Create a document for a source, register it by the source's name, and return it; nothing is read yet."""
        document = XmiDocument(self, source)
        self.documents[source.name] = document
        return document

    def report_error(self, diagnostic: Diagnostic) -> None:
        """Record an error. Further uses of an unknown name are recorded, up to a hundred, but do not count as errors.

        Raises:
            Stop: the limit of errors is reached.
        """
        places = self._places[diagnostic.message] = self._places.get(diagnostic.message, 0) + 1
        if places > 1 and diagnostic.code in FILE_WIDE_NAME_CODES:
            if places <= MAX_ERRORS:
                self.diagnostics.append(diagnostic)
            return
        self.diagnostics.append(diagnostic)
        self.errors += 1
        if self.errors == MAX_ERRORS:
            self.diagnostics.append(too_many_errors_diagnostic(diagnostic.span))
            raise StopParsing

    def report_unresolved(
        self,
        code: str,
        message: str,
        span: Span,
        hint: str | None = None,
        warning_hint: str = "links to it are left out",
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Report a missing object or file: an error, or with `allow_unresolved` a warning with `warning_hint` as its
        hint.

        At most a hundred warnings are recorded.
        """
        if not self.allow_unresolved:
            self.report_error(Diagnostic(code, message, span, hint, notes=notes))
            return
        self._unresolved += 1
        if self._unresolved == MAX_ERRORS + 1:
            code, message = "too-many-warnings", "too many names of missing objects: the others are not shown"
        if self._unresolved <= MAX_ERRORS + 1:
            self.diagnostics.append(Diagnostic(code, message, span, warning_hint, Severity.WARNING, notes))


class ObjectSpans(Mapping[int, Span]):
    """A mapping from the objects to the spans of their tags, which are computed at each access.

    The objects of a document have consecutive ids.
    """

    def __init__(self, reading: XmiReading) -> None:
        documents = [one for one in reading.documents.values() if one]
        self._parts = [(one.first_id, one.tag_bytes, one.places) for one in dict.fromkeys(documents)]

    def __getitem__(self, node: int) -> Span:
        for first, places, text in self._parts:
            if 0 <= node - first < len(places):
                return text.tag_span(places[node - first])
        raise KeyError(node)

    def __iter__(self) -> Iterator[int]:
        return (first + index for first, places, _ in self._parts for index in range(len(places)))

    def __len__(self) -> int:
        return sum(len(places) for _, places, _ in self._parts)


class XmiDocument:
    """An `.xmi` file that is being read.

    Attributes:
        first_id: the id of the first object.
        tag_bytes: the byte offset of each object's tag, in the order of the ids.
        roots: the objects at the top, `UNREAD_OBJECT` for those that could not be read.
        ids, objects_by_identifier: the objects by their `xmi:id`, and by the value of their `iD` attribute.
        links: the references to be linked after all objects exist.
    """

    def __init__(self, reading: XmiReading, source: Source) -> None:
        self.reading = reading
        self.model = reading.model
        self.source = source
        self.places = XmlPositions(source)
        self.first_id = 0
        self.tag_bytes = array("Q")
        self.roots: list[int] = []
        self.ids: dict[str, int] = {}
        self.objects_by_identifier: dict[str, int] = {}
        self.links: list[PendingLink] = []
        self._found: dict[str, int | None] = {}
        self._named: dict[int, dict[str, int]] = {}
        self._keyed: dict[tuple[int, str, tuple[Attribute, ...]], dict[object, int]] = {}

    def name_beside(self, path: str) -> str:
        """Return the name of another document that this document refers to by a path."""
        return posixpath.normpath(posixpath.join(posixpath.dirname(self.source.name), path))

    def find_object(self, fragment: str) -> int | None:
        """Return the object of a fragment (`//@regions.0`, `/1/@a`, an id), None if missing, `UNREAD_OBJECT` if not
        readable.
        """
        if not fragment.startswith("/"):
            found = self.ids.get(fragment)
            return self.objects_by_identifier.get(fragment) if found is None else found
        head, _, last = fragment.rpartition("/")
        if not head or fragment == "//":
            return self._root_by_index(last)
        if head not in self._found:
            self._found[head] = self._follow_path(head)
        return self._follow_step(self._found[head], last)

    def _follow_path(self, fragment: str) -> int | None:
        root, *steps = fragment.split("/")[1:] or ["?"]  # `/@a` has no root
        node = self._root_by_index(root)
        for step in steps:
            node = self._follow_step(node, step)
        return node

    def _root_by_index(self, text: str) -> int | None:
        place = int(text) if text.isdecimal() and len(text) < 10 else 0 if not text else -1
        return self.roots[place] if 0 <= place < len(self.roots) else None

    def _follow_step(self, node: int | None, step: str) -> int | None:
        """Return the child for a step: `@feature.3`, `@feature`, `@feature[key='a']` or a name. None if it is missing.

        The result is `UNREAD_OBJECT` if the child, or its feature, could not be read.
        """
        if node is None or node == UNREAD_OBJECT:
            return node
        if not step.startswith("@"):
            return self._child_named(node, step)
        keyed = _KEYED.fullmatch(step) if step[-1] == "]" else None
        name, _, index = (keyed[1], "", "") if keyed else step[1:].partition(".")
        feature: Feature | None = self.reading.metamodel.feature(self.model.graph.class_of(node), name)
        place = int(index) if index.isdecimal() and len(index) < 10 else 0 if not index else -1
        if not isinstance(feature, Reference) or place < 0:
            left_out = self.reading.metamodel.left_out_reason(self.model.graph.class_of(node), name)
            return UNREAD_OBJECT if left_out or name in self.reading.lost_names else None
        if keyed:
            return self._child_with(node, feature, keyed[2])
        if (node, name) in self.reading.children:
            return self.reading.child_at(node, name, place)
        targets = self.model.graph.targets(node, feature)
        return targets[place] if place < len(targets) else None

    def _child_named(self, node: int, name: str) -> int | None:
        """Return the first child with this `name`, or None; `title.1` is the second child named `title`."""
        if node not in self._named:
            known = self._named[node] = {}
            counts: dict[object, int] = {}
            features = self.reading.metamodel.features(self.model.graph.class_of(node)).values()
            contained = (one for one in features if isinstance(one, Reference) and one.containment)
            for child in (child for one in contained for child in self.reading.children_in(node, one)):
                attribute = self.reading.metamodel.feature(self.model.graph.class_of(child), "name")
                value = self.model.graph.value(child, attribute) if isinstance(attribute, Attribute) else None
                count = counts[value] = counts.get(value, -1) + 1
                known.setdefault(f"{value}.{count}" if count else str(value), child)
        return self._named[node].get(name)

    def _child_with(self, node: int, reference: Reference, predicate: str) -> int | None:
        """Return the first child with these values, written as EMF does (`ID='a%20b',version='3'`), or None."""
        keys = {name: _QUOTED.findall(text) for name, text in _KEY.findall(predicate)}
        features = [self.reading.metamodel.feature(reference.target, name) for name in keys]
        attributes = tuple(one for one in features if isinstance(one, Attribute))
        if not keys or len(attributes) < len(keys) or _KEY.sub("", predicate):
            return None
        wanted = tuple(
            tuple(parse_xml_value(unquote(single or double), attribute.type) for single, double in texts)
            for attribute, texts in zip(attributes, keys.values(), strict=True)
        )
        if (node, reference.name, attributes) not in self._keyed:
            known = self._keyed[node, reference.name, attributes] = {}
            for child in self.reading.children_in(node, reference):
                known.setdefault(tuple(self.model.graph.values(child, one) for one in attributes), child)
        return self._keyed[node, reference.name, attributes].get(wanted)

    def resolve_target(self, link: PendingLink, word: str) -> int | None:
        """Return the object that a word names, or `UNREAD_OBJECT`; if it is missing, report this and return None."""
        path, _, fragment = word.rpartition("#")
        document = self.reading.documents.get(self.name_beside(unquote(path))) if path else self
        if document is None:
            return UNREAD_OBJECT  # this has been reported
        found = document.find_object(fragment)
        if found is None:
            known = (*document.ids, *document.objects_by_identifier)
            hint = name_hint(fragment, known) if len(known) <= SHOWN.similar and fragment[:1] != "/" else None
            if not known and fragment[:1] != "/":
                hint = _NAMING_HINT
            if "[" in fragment:
                hint = "change the values: a path `//@reference[key='value']` needs an object with these values"
            elif fragment[:1] == "/":
                hint = "write the path from the root, with numbers that count from 0: `//@reference.0`"
            message = f"there is no object `{shortened(word)}`"
            self.reading.report_unresolved(
                "unknown-object", message, self.word_span(link, word), hint or LEAVE_OUT_HINT
            )
        return found

    def tag_span(self, node: int) -> Span:
        """Return the span of an object's tag."""
        return self.places.tag_span(self.tag_bytes[node - self.first_id])

    def word_span(self, link: PendingLink, word: str) -> Span:
        """Return the span of a word in the XML attribute of a reference."""
        return self.places.attribute_span(link.tag_byte, link.attribute_key, word)

    def report(
        self, code: str, message: str, span: Span, hint: str | None = None, notes: tuple[Note, ...] = ()
    ) -> None:
        """Record an error; raise `StopParsing` if the limit of errors is reached.

        Opposites that differ are only a warning with `allow_unresolved`.
        """
        if code == "opposites-differ":
            hint = f"{hint}; `--allow-unresolved` keeps the first"
            self.reading.report_unresolved(code, message, span, hint, "this is left out: the first is kept", notes)
        else:
            self.reading.report_error(Diagnostic(code, message, span, hint, notes=notes))


class TypeLibrary(XmiDocument):
    """The package of Ecore or of XML Schema as a document; it contains only those types that links refer to."""

    def find_object(self, fragment: str) -> int | None:
        """Return the data type or class of a fragment such as `//EString`, created at the first call, or None."""
        name, model = fragment.rpartition("/")[2], self.model
        classes = ecore_metamodel_document().parts_by_name(ecore_metamodel_document().roots[0])
        if name not in self.ids and (name in (well_known_types(self.source.name) or ()) or name in classes):
            key = classes[name].qualified_key("type", XSI) if name in classes else None
            kind = classes[name].attributes[key].partition(":")[2] if key else "EDataType"
            cls = self.reading.metamodel.full_names(kind).get(self.reading.packages[ECORE].path)
            if cls is None:
                return None
            self.ids[name] = model.graph.new(cls, None)
            for attribute in self.reading.names.names_of(cls).unset_attributes.values():
                model.graph.set_value(self.ids[name], attribute, name if attribute.name == "name" else None)
        return self.ids.get(name)


def shortened(text: str) -> str:
    """Return a text for a message, on one line and with at most 80 characters."""
    line = " ".join(text.split())
    return line if len(line) <= 80 else f"{line[:77]}..."
