"""Create objects from the tags of an `.xmi` file while it is parsed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from decimal import Decimal
from functools import partial

from envgraph.code import dataclass
from envgraph.errors import MOST_ERRORS, Note, Span, did_you_mean, plural, quoted, with_article
from envgraph.lang.interchange._xmi_document import LOST, Document, Link, short
from envgraph.lang.interchange._xmi_names import Table
from envgraph.lang.interchange._xmi_namespaces import Namespaces
from envgraph.lang.read._ecore_types import value_of, why_unfit
from envgraph.lang.read._features import allowed_values, unknown_literal
from envgraph.lang.syntax._xml import XMI, XSI, Reader, Stop
from envgraph.metamodel import Attribute, EnumType, Reference, Scalar, Value, type_name
from envgraph.pattern import value_hint

_OF_XMI = ("version", "type", "schemaLocation")
_FOREIGN = "of other tools"


@dataclass(slots=True)
class _Frame:
    """An open tag: an object, an attribute written as a tag, or a reference whose targets the text names.

    Attributes:
        node: the object, or the object that has the attribute or reference.
        table: the XML names that may occur inside; None if everything inside is skipped.
        parent: the container, to which `reference` links the object when the tag ends. For a tag whose text names the
            targets of a reference: the byte at which the tag begins.
        text: the pieces of text in the tag, if its attribute, reference or object needs them; else None.
        values: the values of many-valued attributes, each with the position of its tag.
        last: the greatest position so far among the `members` of a feature map.
    """

    node: int
    table: Table | None = None
    parent: int = LOST
    reference: Reference | None = None
    attribute: Attribute | None = None
    text: list[str] | None = None
    values: dict[Attribute, list[tuple[Value, int]]] = field(default_factory=dict)
    last: int = -1


class TagReader:
    """A reader of one document that creates an object for each tag."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._reading = document.reading
        self._model = document.model
        self._xml = Reader(document.places)
        self._stack: list[_Frame] = []
        self._skipped = 0
        self._top = False
        self._spaces = Namespaces(document)

    def check_syntax(self) -> None:
        """Check only that the file is valid XML, and report the first error."""
        problem = self._xml.read(
            lambda tag, _: self._xml.begin(tag), lambda _: self._xml.open.pop(), lambda _: None
        )
        if problem:
            self._reading.diagnostics.append(problem)

    def read(self) -> None:
        """Create the objects of the document, and record their references, to be linked later.

        Raises:
            Stop: the file is not XML, or has too many mistakes.
        """
        self._document.first = self._model.graph.store.next_id
        problem = self._xml.read(self._start, self._end, self._text)
        found = self._reading.diagnostics
        if problem:
            # Text inside an unclosed tag may not belong there, and references may refer to text that is missing.
            opened = [note.span.start for note in problem.notes if note.span]
            found[:] = [one for one in found if not (opened and one.span and one.span.start > opened[0])]
            self._reading.add(problem)
        if problem or self._reading.errors >= MOST_ERRORS:
            raise Stop

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        at = self._xml.begin(tag)
        for key in attributes:
            if key[:5] == "xmlns":
                self._spaces.declare(attributes, len(self._xml.open))
                break
        if self._skipped:
            self._skipped += 1
        elif self._stack:
            self._inner(tag, attributes, at)
        else:
            self._root(tag, attributes, at)

    def _end(self, _: str) -> None:
        self._xml.open.pop()
        self._spaces.leave(len(self._xml.open))
        if self._skipped:
            self._skipped -= 1
            return
        if not self._stack:
            return
        frame = self._stack.pop()
        if frame.table is None and frame.reference is not None:
            self._close_reference(frame, frame.reference)
            return
        if frame.attribute is not None:
            self._close_attribute(frame, frame.attribute)
            return
        if frame.text and frame.table is not None and frame.table.text is not None:
            self._close_attribute(frame, frame.table.text)
        for attribute, values in frame.values.items():
            found = [(value, partial(self._document.places.tag, at)) for value, at in values]
            self._set_many(frame.node, attribute, found)
        if frame.reference is not None:
            self._contain(frame)

    def _text(self, text: str) -> None:
        if self._skipped:
            return
        if self._stack and self._stack[-1].text is not None:
            self._stack[-1].text.append(text)
        elif not text.isspace():
            # The position is found by searching back, since the parser reports text only at the next tag.
            line = text.strip().split("\n")[0]
            start = max(
                self._document.source.text.rfind(line, 0, self._document.places.offset(self._xml.at)), 0
            )
            span = self._document.source.span(start, start + len(line))
            table = self._stack[-1].table if self._stack else None
            if table is not None and table.map:
                self._reading.lose(table.name, table.map, span, "text")
                return
            self._document.report(
                "stray-text",
                "text is not allowed here, only tags",
                span,
                "remove the text, or write it as an attribute",
            )

    # --- tags ---

    def _root(self, tag: str, attributes: dict[str, str], at: int) -> None:
        prefix, _, simple = tag.rpartition(":")
        if not self._top and simple == "XMI" and self._spaces.is_space(prefix):
            self._top = True
            return
        self._top = True
        if prefix and self._spaces.is_space(prefix):
            self._skipped = 1
            self._reading.omit("tag", f"`{tag}` {_FOREIGN}", self._document.places.tag(at))
            return
        element = self._reading.names.elements.get((self._spaces.scope.get(prefix, ""), simple))
        if element is not None:  # create the document root, then the object of this tag inside it
            table = self._reading.names.table(element[0])
            self._document.roots.append(self._create(table, {}, at))
            self._child(_Frame(self._document.roots[-1], table), element[1], attributes, at, element[1])
            return
        cls = self._spaces.class_named(tag, at, None)
        if cls is None:
            self._document.roots.append(LOST)
            self._skipped = 1
            return
        table = self._reading.names.table(cls)
        self._spaces.type_of(attributes)
        node = self._create(table, attributes, at)
        self._document.roots.append(node)
        self._stack.append(_Frame(node, table, text=[] if table.text else None))

    def _inner(self, tag: str, attributes: dict[str, str], at: int) -> None:
        frame = self._stack[-1]
        table = frame.table
        if table is None:
            self._skipped = 1
            return
        reference, typed = table.tags.get(tag), None
        if reference is None:
            uri, tag = self._spaces.local(tag)
            reference = table.tags.get(self._reading.names.head(uri, tag, table.tags))
            if tag not in table.tags and reference is not None:
                typed = self._reading.names.elements[uri, tag][1]
        if reference is not None and reference.name in table.members:
            place = table.members[reference.name]
            if place < frame.last:
                self._reading.lose(table.name, table.map, self._document.places.tag(at), "place")
            frame.last = max(place, frame.last)
        if not isinstance(reference, Reference):
            self._other_tag(frame, table, tag, attributes, at)
            return
        for key, value in attributes.items():
            if key in ("href", "idref") or key[-6:] == ":idref":
                self._href(Link(frame.node, reference, value.strip(), at, key))
                self._skipped = 1
                return
        if attributes and self._spaces.is_nil(attributes):
            self._skipped = 1
            return
        if not reference.containment:
            self._stack.append(_Frame(frame.node, reference=reference, parent=at, text=[]))
            return
        self._child(frame, reference, attributes, at, typed or reference)

    def _child(
        self, frame: _Frame, reference: Reference, attributes: dict[str, str], at: int, typed: Reference
    ) -> None:
        """Create and open a contained object; its class is its `xsi:type`, else the target of the reference `typed`.

        If the class is unknown or not allowed, the tag is skipped, and this is reported.
        """
        type_, key = self._spaces.type_of(attributes)
        # Use the reference's target, since the tag's own name is a reference and not a class.
        cls = self._spaces.class_named(type_, at, key) if type_ else self._spaces.declared(typed, at)
        if cls is not None and not self._reading.metamodel.is_a(cls, reference.target):
            message = f"`{reference}` takes objects of class `{reference.target}`, not {with_article(cls)}"
            where = self._document.places.attribute(at, key) if key else self._document.places.tag(at)
            known = [f"`{one}`" for one in self._reading.metamodel.concrete(reference.target)]
            self._document.report("wrong-type", message, where, f"write {' or '.join(known[:5])}")
            cls = None
        if cls is None:
            self._reading.hold(frame.node, reference, LOST)
            self._skipped = 1
            return
        table = self._reading.names.table(cls)
        node = self._create(table, attributes, at)
        text: list[str] | None = [] if table.text else None
        self._stack.append(_Frame(node, table, frame.node, reference, text=text))

    def _other_tag(self, frame: _Frame, table: Table, tag: str, attributes: dict[str, str], at: int) -> None:
        """Handle a tag that is no reference: open an attribute, count a tag of another tool, or report the tag."""
        attribute = table.tags.get(tag)
        if isinstance(attribute, Attribute):
            nil = self._spaces.is_nil(attributes)
            if nil and attribute.many:
                message, span = f"a value of `{attribute}` is missing", self._document.places.tag(at)
                self._document.report("missing-value", message, span, "write it, or leave the tag out")
                self._skipped = 1
            elif nil:
                self._model.graph.set_value(frame.node, attribute, None)
                self._skipped = 1
            else:
                self._stack.append(_Frame(frame.node, attribute=attribute, text=[]))
            return
        self._skipped = 1
        prefix = tag.rpartition(":")[0]
        if prefix and self._spaces.is_space(prefix):
            self._reading.omit("tag", f"`{tag}` {_FOREIGN}", self._document.places.tag(at))
            return
        if prefix and table.map:
            self._reading.lose(table.name, table.map, self._document.places.tag(at))
            return
        known = [*table.tags]
        self._unknown_feature(table, tag, self._document.places.tag(at), known)

    def _unknown_feature(self, table: Table, name: str, span: Span, known: Sequence[str]) -> None:
        if self._reading.lose(table.name, name, span) or name in self._reading.lost:
            return
        hint = did_you_mean(name, known)
        if hint is None:
            hint = f"use one of {quoted(known)}" if known else "remove it: the class has no features"
        self._document.report("unknown-feature", f"`{table.name}` has no feature `{name}`", span, hint)

    # --- objects ---

    def _create(self, table: Table, attributes: dict[str, str], at: int) -> int:
        """Create the object of a tag with its attribute values, record its references, and return its id."""
        model = self._model
        name = attributes.pop(self._spaces.id_key, None) if self._spaces.id_key else None
        own = name
        if name is not None and name in model:  # perhaps the id of an object in another document
            if name in self._document.ids:
                self._duplicate(name, at)
            name = None
        node = model.graph.new(table.name, name)
        self._document.bytes.append(at)
        if own is not None:
            self._document.ids.setdefault(own, node)
        for key, attribute in table.unset.items():
            if key not in attributes:
                model.graph.set_value(node, attribute, None)
        for key, value in attributes.items():
            feature = table.keys.get(key)
            if feature is None and ":" in key:
                feature = table.keys.get(self._spaces.local(key)[1])
            if isinstance(feature, Attribute):
                self._set(node, feature, value, at, key)
            elif feature is not None:
                self._document.links.append(Link(node, feature, value, at, key))
            else:
                self._other_attribute(table, key, at)
        for key in table.identifiers:
            if key in attributes:
                self._document.identified.setdefault(attributes[key], node)
        return node

    def _duplicate(self, name: str, at: int) -> None:
        first = self._document.ids.get(name)
        notes = (Note("the first one is here", self._document.tag(first)),) if first is not None else ()
        key = self._spaces.id_key or ""
        message = f"there are two objects `{name}`"
        where, hint = self._document.places.attribute(at, key), "give each object an id of its own"
        self._document.report("duplicate-object", message, where, hint, notes=notes)

    def _set(self, node: int, attribute: Attribute, text: str, at: int, key: str) -> None:
        """Set an attribute from an XML attribute; white space separates several values, as in EMF."""

        def span() -> Span:
            return self._document.places.attribute(at, key)

        if attribute.many:
            found = [self._value(node, attribute, one, span) for one in text.split()]
            self._set_many(node, attribute, [(one, span) for one in found if one is not None])
            return
        value = self._value(node, attribute, text, span)
        if value is not None:
            self._model.graph.set_value(node, attribute, value)

    def _set_many(
        self, node: int, attribute: Attribute, found: Sequence[tuple[Value, Callable[[], Span]]]
    ) -> None:
        """Append values to a many-valued attribute, and report values that are not allowed."""
        kept, mark = self._model.graph.values(node, attribute), '`unique="false"` in the metamodel'
        values = allowed_values(attribute, found, self._document.report, mark=mark, kept=kept)
        self._model.graph.set_value(node, attribute, values)

    def _value(self, node: int, attribute: Attribute, text: str, where: Callable[[], Span]) -> Value | None:
        """Return the value of a text; if the text does not fit the attribute's type, report this and return None.

        For a decimal number, the model also keeps the text, and a rounded number is counted for a later warning.
        """
        value = value_of(text, attribute.type)
        if value is not None:
            if isinstance(value, float) and attribute.is_decimal and (repr(value) != text or attribute.many):
                kept = self._model.graph.digits.setdefault((node, attribute.index, value), text)
                same = Decimal(kept) == Decimal(text)
                if not same or Decimal(text) != Decimal(repr(value)):
                    why = "write `.xmi` to keep all digits: a float has 64 bits"
                    said = "rounded" if same else "left out"
                    self._reading.omit("value", f"of `{attribute}`", where(), why, said)
            return value
        type_, span = attribute.type, where()
        if isinstance(type_, EnumType):
            names = type_.labels or type_.literals
            unknown_literal(type_, short(text), names, self._document.report, span)
            return None
        message = f"`{attribute}` takes {with_article(type_name(type_))}, not `{short(text)}`"
        like = did_you_mean(text, ("true", "false")) if type_ is Scalar.BOOL else None
        hint = like or why_unfit(text, type_) or value_hint(type_)
        if text == "NaN":
            self._reading.unresolved("values-left-out", message, span, hint, f"the value is left out: {hint}")
        else:
            self._document.report("wrong-type", message, span, hint)
        return None

    def _other_attribute(self, table: Table, key: str, at: int) -> None:
        prefix, _, simple = key.rpartition(":")
        if prefix:
            uri = self._spaces.scope.get(prefix)
            if uri is None and prefix != "xml":
                space = XSI if prefix == "xsi" else XMI if prefix == "xmi" else "..."
                hint = f'write `xmlns:{prefix}="{space}"` in the first tag'
                self._spaces.undeclared(prefix, self._document.places.name_of(at, key), hint)
            elif simple not in _OF_XMI and prefix not in ("xmlns", "xml"):
                self._reading.omit("attribute", f"`{key}` {_FOREIGN}", self._document.places.name_of(at, key))
            return
        known = [*table.keys]
        self._unknown_feature(table, simple, self._document.places.name_of(at, key), known)

    def _close_attribute(self, frame: _Frame, attribute: Attribute) -> None:
        assert frame.text is not None
        at = self._xml.at
        # The parser has no positions of texts, so mistakes are reported at the end tag.
        value = self._value(frame.node, attribute, "".join(frame.text), lambda: self._document.places.tag(at))
        if value is not None and attribute.many:
            self._stack[-1].values.setdefault(attribute, []).append((value, at))
        elif value is not None:
            self._model.graph.set_value(frame.node, attribute, value)

    def _close_reference(self, frame: _Frame, reference: Reference) -> None:
        """Record the targets that the text of a tag names, as in `<incoming>Flow_1</incoming>`; report an empty tag."""
        words, at = "".join(frame.text or ()).strip(), frame.parent
        if words:
            self._document.links.append(Link(frame.node, reference, words, at, ""))
            return
        hint = f'write `{reference.name}="..."`, or `<{reference.name} href="..."/>`'
        message = f"`{reference}` is not a containment, so its targets cannot be tags inside it"
        self._document.report("wrong-type", message, self._document.places.tag(at), hint)

    def _contain(self, frame: _Frame) -> None:
        """Link a complete object to its container, or report that the container has too many objects.

        Linking it last avoids walking up a chain of containers.
        """
        assert frame.reference is not None
        upper, children = frame.reference.upper, None
        if self._reading.children:
            children = self._reading.children.get((frame.parent, frame.reference.name))
        if upper is not None and len(self._model.graph.targets(frame.parent, frame.reference)) >= upper:
            if children is None or children[-1] != LOST:
                message = f"`{frame.reference}` takes {plural(upper, 'object')} at most"
                hint = "leave this one out"
                self._document.report("too-many-targets", message, self._document.tag(frame.node), hint)
            self._reading.hold(frame.parent, frame.reference, LOST)
            return
        self._model.graph.link(frame.parent, frame.reference, frame.node)
        if children is not None:
            children.append(frame.node)

    def _href(self, link: Link) -> None:
        """Record the link of a tag with `href` or `idref`; in a containment reference it keeps its position."""
        if link.reference.containment:
            children = self._reading.hold(link.node, link.reference, LOST)
            link = replace(link, place=len(children) - 1)
            children[-1] = self._document, link
        self._document.links.append(link)
