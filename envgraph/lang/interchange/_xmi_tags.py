"""Create objects from the tags of an `.xmi` file while it is parsed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from decimal import Decimal
from functools import partial

from envgraph.code import dataclass
from envgraph.errors import (
    MAX_ERRORS,
    Note,
    Span,
    count_with_noun,
    did_you_mean,
    quote_names,
    quote_with_article,
)
from envgraph.lang.interchange._xmi_document import UNREAD_OBJECT, PendingLink, XmiDocument, shortened
from envgraph.lang.interchange._xmi_names import XmlClassNames
from envgraph.lang.interchange._xmi_namespaces import NamespaceScope
from envgraph.lang.read._ecore_types import number_range_hint, parse_xml_value
from envgraph.lang.read._object_features import check_values, report_unknown_literal
from envgraph.lang.syntax._xml_parser import XMI, XSI, StopParsing, XmlReader
from envgraph.metamodel import Attribute, EnumType, Reference, Scalar, Value, type_name
from envgraph.pattern import value_hint

_OF_XMI = ("version", "type", "schemaLocation")
_OF_OTHER_TOOLS = "of other tools"


@dataclass(slots=True)
class _OpenTag:
    """An open tag: an object, an attribute written as a tag, or a reference whose targets the text names.

    Attributes:
        node: the object, or the object that has the attribute or reference.
        table: the XML names that may occur inside; None if everything inside is skipped.
        parent: the container, to which `reference` links the object when the tag ends. For a tag whose text names the
            targets of a reference: the byte at which the tag begins.
        text: the pieces of text in the tag, if its attribute, reference or object needs them; else None.
        values: the values of many-valued attributes, each with the position of its tag.
        last_member_position: the greatest position so far among the `map_members` of a feature map.
    """

    node: int
    table: XmlClassNames | None = None
    parent: int = UNREAD_OBJECT
    reference: Reference | None = None
    attribute: Attribute | None = None
    text: list[str] | None = None
    values: dict[Attribute, list[tuple[Value, int]]] = field(default_factory=dict)
    last_member_position: int = -1


class TagReader:
    """A reader of one document that creates an object for each tag."""

    def __init__(self, document: XmiDocument) -> None:
        self._document = document
        self._reading = document.reading
        self._model = document.model
        self._xml = XmlReader(document.places)
        self._stack: list[_OpenTag] = []
        self._skipped_depth = 0
        self._has_root = False
        self._namespaces = NamespaceScope(document)

    def check_syntax(self) -> None:
        """Check only that the file is valid XML, and report the first error."""
        xml = self._xml
        problem = xml.parse(lambda tag, _: xml.record_open_tag(tag), lambda _: xml.open_tags.pop())
        if problem:
            self._reading.diagnostics.append(problem)

    def read(self) -> None:
        """Create the objects of the document, and record their references, to be linked later.

        Raises:
            Stop: the file is not XML, or has too many mistakes.
        """
        self._document.first_id = self._model.graph.store.next_id
        problem = self._xml.parse(self._on_start_tag, self._on_end_tag, self._on_text)
        found = self._reading.diagnostics
        if problem:
            # Text inside an unclosed tag may not belong there, and references may refer to text that is missing.
            opened = [note.span.start for note in problem.notes if note.span]
            found[:] = [one for one in found if not (opened and one.span and one.span.start > opened[0])]
            self._reading.report_error(problem)
        if problem or self._reading.errors >= MAX_ERRORS:
            raise StopParsing

    def _on_start_tag(self, tag: str, attributes: dict[str, str]) -> None:
        at = self._xml.record_open_tag(tag)
        for key in attributes:
            if key[:5] == "xmlns":
                self._namespaces.enter_tag(attributes, len(self._xml.open_tags))
                break
        if self._skipped_depth:
            self._skipped_depth += 1
        elif self._stack:
            self._read_inner_tag(tag, attributes, at)
        else:
            self._read_root_tag(tag, attributes, at)

    def _on_end_tag(self, _: str) -> None:
        self._xml.open_tags.pop()
        self._namespaces.leave_tags(len(self._xml.open_tags))
        if self._skipped_depth:
            self._skipped_depth -= 1
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
        if frame.text and frame.table is not None and frame.table.text_attribute is not None:
            self._close_attribute(frame, frame.table.text_attribute)
        for attribute, values in frame.values.items():
            found = [(value, partial(self._document.places.tag_span, at)) for value, at in values]
            self._append_values(frame.node, attribute, found)
        if frame.reference is not None:
            self._link_to_container(frame)

    def _on_text(self, text: str) -> None:
        if self._skipped_depth:
            return
        if self._stack and self._stack[-1].text is not None:
            self._stack[-1].text.append(text)
        elif not text.isspace():
            # The position is found by searching back, since the parser reports text only at the next tag.
            line, source = text.strip().split("\n")[0], self._document.source
            end = self._document.places.character_offset(self._xml.current_byte)
            start = max(source.text.rfind(line, 0, end), 0)
            span = source.span_between(start, start + len(line))
            table = self._stack[-1].table if self._stack else None
            if table is not None and table.feature_map:
                self._reading.count_if_left_out(table.name, table.feature_map, span, "text")
                return
            hint = "remove the text, or write it as an attribute"
            self._document.report("stray-text", "text is not allowed here, only tags", span, hint)

    # --- tags ---

    def _read_root_tag(self, tag: str, attributes: dict[str, str], at: int) -> None:
        prefix, _, simple = tag.rpartition(":")
        if not self._has_root and simple == "XMI" and self._namespaces.is_xmi_prefix(prefix):
            self._has_root = True
            return
        self._has_root = True
        if prefix and self._namespaces.is_xmi_prefix(prefix):
            self._skipped_depth = 1
            self._reading.count_omitted("tag", f"`{tag}` {_OF_OTHER_TOOLS}", self._document.places.tag_span(at))
            return
        element = self._reading.names.elements.get((self._namespaces.scope.get(prefix, ""), simple))
        if element is not None:  # create the document root, then the object of this tag inside it
            table = self._reading.names.names_of(element[0])
            self._document.roots.append(self._create_object(table, {}, at))
            self._open_child(_OpenTag(self._document.roots[-1], table), element[1], attributes, at, element[1])
            return
        cls = self._namespaces.resolve_class(tag, at, None)
        if cls is None:
            self._document.roots.append(UNREAD_OBJECT)
            self._skipped_depth = 1
            return
        table = self._reading.names.names_of(cls)
        self._namespaces.take_type(attributes)
        node = self._create_object(table, attributes, at)
        self._document.roots.append(node)
        self._stack.append(_OpenTag(node, table, text=[] if table.text_attribute else None))

    def _read_inner_tag(self, tag: str, attributes: dict[str, str], at: int) -> None:
        frame = self._stack[-1]
        table = frame.table
        if table is None:
            self._skipped_depth = 1
            return
        reference, typed = table.tags.get(tag), None
        if reference is None:
            uri, tag = self._namespaces.resolve_tag(tag)
            reference = table.tags.get(self._reading.names.substitution_head(uri, tag, table.tags))
            if tag not in table.tags and reference is not None:
                typed = self._reading.names.elements[uri, tag][1]
        if reference is not None and reference.name in table.map_members:
            place = table.map_members[reference.name]
            if place < frame.last_member_position:
                self._reading.count_if_left_out(
                    table.name, table.feature_map, self._document.places.tag_span(at), "place"
                )
            frame.last_member_position = max(place, frame.last_member_position)
        if not isinstance(reference, Reference):
            self._read_other_tag(frame, table, tag, attributes, at)
            return
        for key, value in attributes.items():
            if key in ("href", "idref") or key[-6:] == ":idref":
                self._record_href(PendingLink(frame.node, reference, value.strip(), at, key))
                self._skipped_depth = 1
                return
        if attributes and self._namespaces.is_nil(attributes):
            self._skipped_depth = 1
            return
        if not reference.containment:
            self._stack.append(_OpenTag(frame.node, reference=reference, parent=at, text=[]))
            return
        self._open_child(frame, reference, attributes, at, typed or reference)

    def _open_child(
        self,
        frame: _OpenTag,
        reference: Reference,
        attributes: dict[str, str],
        at: int,
        class_reference: Reference,
    ) -> None:
        """Create and open a contained object; its class is its `xsi:type`, else the target of the reference
        `class_reference`.

        If the class is unknown or not allowed, the tag is skipped, and this is reported.
        """
        type_, key = self._namespaces.take_type(attributes)
        # Use the reference's target, since the tag's own name is a reference and not a class.
        cls = (
            self._namespaces.resolve_class(type_, at, key)
            if type_
            else self._namespaces.declared_class(class_reference, at)
        )
        if cls is not None and not self._reading.metamodel.is_a(cls, reference.target):
            message = f"`{reference}` takes objects of class `{reference.target}`, not {quote_with_article(cls)}"
            where = self._document.places.attribute_span(at, key) if key else self._document.places.tag_span(at)
            known = [f"`{one}`" for one in self._reading.metamodel.concrete_classes(reference.target)]
            self._document.report("wrong-type", message, where, f"write {' or '.join(known[:5])}")
            cls = None
        if cls is None:
            self._reading.append_unlinked_child(frame.node, reference, UNREAD_OBJECT)
            self._skipped_depth = 1
            return
        table = self._reading.names.names_of(cls)
        node = self._create_object(table, attributes, at)
        text: list[str] | None = [] if table.text_attribute else None
        self._stack.append(_OpenTag(node, table, frame.node, reference, text=text))

    def _read_other_tag(
        self, frame: _OpenTag, table: XmlClassNames, tag: str, attributes: dict[str, str], at: int
    ) -> None:
        """Handle a tag that is no reference: open an attribute, count a tag of another tool, or report the tag."""
        attribute = table.tags.get(tag)
        if isinstance(attribute, Attribute):
            nil = self._namespaces.is_nil(attributes)
            if nil and attribute.many:
                message, span = f"a value of `{attribute}` is missing", self._document.places.tag_span(at)
                self._document.report("missing-value", message, span, "write it, or leave the tag out")
                self._skipped_depth = 1
            elif nil:
                self._model.graph.set_value(frame.node, attribute, None)
                self._skipped_depth = 1
            else:
                self._stack.append(_OpenTag(frame.node, attribute=attribute, text=[]))
            return
        self._skipped_depth = 1
        prefix = tag.rpartition(":")[0]
        if prefix and self._namespaces.is_xmi_prefix(prefix):
            self._reading.count_omitted("tag", f"`{tag}` {_OF_OTHER_TOOLS}", self._document.places.tag_span(at))
            return
        if prefix and table.feature_map:
            self._reading.count_if_left_out(table.name, table.feature_map, self._document.places.tag_span(at))
            return
        self._report_unknown_feature(table, tag, self._document.places.tag_span(at), [*table.tags])

    def _report_unknown_feature(self, table: XmlClassNames, name: str, span: Span, known: Sequence[str]) -> None:
        if self._reading.count_if_left_out(table.name, name, span) or name in self._reading.lost_names:
            return
        hint = did_you_mean(name, known)
        if hint is None:
            hint = f"use one of {quote_names(known)}" if known else "remove it: the class has no features"
        self._document.report("unknown-feature", f"`{table.name}` has no feature `{name}`", span, hint)

    # --- objects ---

    def _create_object(self, table: XmlClassNames, attributes: dict[str, str], at: int) -> int:
        """Create the object of a tag with its attribute values, record its references, and return its id."""
        model = self._model
        name = attributes.pop(self._namespaces.id_key, None) if self._namespaces.id_key else None
        own = name
        if name is not None and name in model:  # perhaps the id of an object in another document
            if name in self._document.ids:
                self._report_duplicate(name, at)
            name = None
        node = model.graph.new(table.name, name)
        self._document.tag_bytes.append(at)
        if own is not None:
            self._document.ids.setdefault(own, node)
        for key, attribute in table.unset_attributes.items():
            if key not in attributes:
                model.graph.set_value(node, attribute, None)
        for key, value in attributes.items():
            feature = table.keys.get(key)
            if feature is None and ":" in key:
                feature = table.keys.get(self._namespaces.resolve_tag(key)[1])
            if isinstance(feature, Attribute):
                self._set_attribute(node, feature, value, at, key)
            elif feature is not None:
                self._document.links.append(PendingLink(node, feature, value, at, key))
            else:
                self._read_other_attribute(table, key, at)
        for key in table.identifiers:
            if key in attributes:
                self._document.objects_by_identifier.setdefault(attributes[key], node)
        return node

    def _report_duplicate(self, name: str, at: int) -> None:
        first = self._document.ids.get(name)
        notes = (Note("the first one is here", self._document.tag_span(first)),) if first is not None else ()
        key = self._namespaces.id_key or ""
        message = f"there are two objects `{name}`"
        where, hint = self._document.places.attribute_span(at, key), "give each object an id of its own"
        self._document.report("duplicate-object", message, where, hint, notes=notes)

    def _set_attribute(self, node: int, attribute: Attribute, text: str, at: int, key: str) -> None:
        """Set an attribute from an XML attribute; white space separates several values, as in EMF."""

        def span() -> Span:
            return self._document.places.attribute_span(at, key)

        if attribute.many:
            found = [self._parse_value(node, attribute, one, span) for one in text.split()]
            self._append_values(node, attribute, [(one, span) for one in found if one is not None])
            return
        value = self._parse_value(node, attribute, text, span)
        if value is not None:
            self._model.graph.set_value(node, attribute, value)

    def _append_values(
        self, node: int, attribute: Attribute, found: Sequence[tuple[Value, Callable[[], Span]]]
    ) -> None:
        """Append values to a many-valued attribute, and report values that are not allowed."""
        kept, mark = self._model.graph.values(node, attribute), '`unique="false"` in the metamodel'
        values = check_values(attribute, found, self._document.report, setting=mark, existing=kept)
        self._model.graph.set_value(node, attribute, values)

    def _parse_value(self, node: int, attribute: Attribute, text: str, where: Callable[[], Span]) -> Value | None:
        """Return the value of a text; if the text does not fit the attribute's type, report this and return None.

        For a decimal number, the model also keeps the text, and a rounded number is counted for a later warning.
        """
        value = parse_xml_value(text, attribute.type)
        if value is not None:
            if isinstance(value, float) and attribute.is_decimal and (repr(value) != text or attribute.many):
                kept = self._model.graph.decimal_texts.setdefault((node, attribute.index, value), text)
                same = Decimal(kept) == Decimal(text)
                if not same or Decimal(text) != Decimal(repr(value)):
                    why = "write `.xmi` to keep all digits: a float has 64 bits"
                    said = "rounded" if same else "left out"
                    self._reading.count_omitted("value", f"of `{attribute}`", where(), why, said)
            return value
        type_, span = attribute.type, where()
        if isinstance(type_, EnumType):
            names = type_.labels or type_.literals
            report_unknown_literal(type_, shortened(text), names, self._document.report, span)
            return None
        message = f"`{attribute}` takes {quote_with_article(type_name(type_))}, not `{shortened(text)}`"
        like = did_you_mean(text, ("true", "false")) if type_ is Scalar.BOOL else None
        hint = like or number_range_hint(text, type_) or value_hint(type_)
        if text == "NaN":
            self._reading.report_unresolved("values-left-out", message, span, hint, f"the value is left out: {hint}")
        else:
            self._document.report("wrong-type", message, span, hint)
        return None

    def _read_other_attribute(self, table: XmlClassNames, key: str, at: int) -> None:
        (prefix, _, simple), places = key.rpartition(":"), self._document.places
        if prefix:
            uri = self._namespaces.scope.get(prefix)
            if uri is None and prefix != "xml":
                space = XSI if prefix == "xsi" else XMI if prefix == "xmi" else "..."
                hint = f'write `xmlns:{prefix}="{space}"` in the first tag'
                self._namespaces.report_undeclared(prefix, places.attribute_name_span(at, key), hint)
            elif simple not in _OF_XMI and prefix not in ("xmlns", "xml"):
                where = places.attribute_name_span(at, key)
                self._reading.count_omitted("attribute", f"`{key}` {_OF_OTHER_TOOLS}", where)
            return
        self._report_unknown_feature(table, simple, places.attribute_name_span(at, key), [*table.keys])

    def _close_attribute(self, frame: _OpenTag, attribute: Attribute) -> None:
        assert frame.text is not None
        at = self._xml.current_byte
        # The parser has no positions of texts, so mistakes are reported at the end tag.
        value = self._parse_value(
            frame.node, attribute, "".join(frame.text), lambda: self._document.places.tag_span(at)
        )
        if value is not None and attribute.many:
            self._stack[-1].values.setdefault(attribute, []).append((value, at))
        elif value is not None:
            self._model.graph.set_value(frame.node, attribute, value)

    def _close_reference(self, frame: _OpenTag, reference: Reference) -> None:
        """Record the targets that the text of a tag names, as in `<incoming>Flow_1</incoming>`; report an empty tag."""
        words, at = "".join(frame.text or ()).strip(), frame.parent
        if words:
            self._document.links.append(PendingLink(frame.node, reference, words, at, ""))
            return
        hint = f'write `{reference.name}="..."`, or `<{reference.name} href="..."/>`'
        message = f"`{reference}` is not a containment, so its targets cannot be tags inside it"
        self._document.report("wrong-type", message, self._document.places.tag_span(at), hint)

    def _link_to_container(self, frame: _OpenTag) -> None:
        """Link a complete object to its container, or report that the container has too many objects.

        Linking it last avoids walking up a chain of containers.
        """
        assert frame.reference is not None
        upper, children = frame.reference.upper, None
        if self._reading.children:
            children = self._reading.children.get((frame.parent, frame.reference.name))
        if upper is not None and len(self._model.graph.targets(frame.parent, frame.reference)) >= upper:
            if children is None or children[-1] != UNREAD_OBJECT:
                message = f"`{frame.reference}` takes {count_with_noun(upper, 'object')} at most"
                hint = "leave this one out"
                self._document.report("too-many-targets", message, self._document.tag_span(frame.node), hint)
            self._reading.append_unlinked_child(frame.parent, frame.reference, UNREAD_OBJECT)
            return
        self._model.graph.link(frame.parent, frame.reference, frame.node)
        if children is not None:
            children.append(frame.node)

    def _record_href(self, link: PendingLink) -> None:
        """Record the link of a tag with `href` or `idref`; in a containment reference it keeps its position."""
        if link.reference.containment:
            children = self._reading.append_unlinked_child(link.node, link.reference, UNREAD_OBJECT)
            link = replace(link, child_index=len(children) - 1)
            children[-1] = self._document, link
        self._document.links.append(link)
