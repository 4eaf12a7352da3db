"""Resolve names in the tags of an `.xmi` file: prefixes, classes, and the attributes of XMI itself."""

from __future__ import annotations

import re

from envgraph.errors import Span, did_you_mean, quote_names
from envgraph.lang.interchange._xmi_document import XmiDocument
from envgraph.lang.read._imports import similar_uri_hint
from envgraph.lang.read._object_features import check_concrete
from envgraph.lang.syntax._xml_parser import XSI, declared_namespaces
from envgraph.metamodel import Package, Reference, simple_name

XMI_NAMESPACES = re.compile(r"http://(www\.omg\.org|schema\.omg\.org/spec)/(spec/)?XMI(/\d+(\.\d+)*)?")


class NamespaceScope:
    """The XML namespaces in scope at the position being read.

    Attributes:
        scope: the namespace of each prefix.
        id_key: the name of the XML attribute for the identifier of a tag, such as `xmi:id`; None if XMI is not
            declared.
    """

    def __init__(self, document: XmiDocument) -> None:
        self._document = document
        self._reading = document.reading
        self.scope: dict[str, str] = {}
        self.id_key: str | None = None
        self._scopes: list[tuple[int, dict[str, str]]] = []
        self._types: dict[str, str | None] = {}
        self._type_keys: tuple[str, ...] = ()

    def enter_tag(self, attributes: dict[str, str], depth: int) -> None:
        """Remove the namespace declarations from a tag's attributes, and put them in scope inside the tag."""
        own = declared_namespaces(attributes)
        for key in [key for key in attributes if key[:5] == "xmlns"]:
            del attributes[key]
        self._scopes.append((depth, self.scope))
        self._enter_scope({**self.scope, **own})

    def leave_tags(self, depth: int) -> None:
        """Remove the namespaces declared by tags deeper than `depth` from the scope."""
        while self._scopes and self._scopes[-1][0] > depth:
            self._enter_scope(self._scopes.pop()[1])

    def is_xmi_prefix(self, prefix: str) -> bool:
        """Return True if the prefix stands for the namespace of XMI."""
        return XMI_NAMESPACES.fullmatch(self.scope.get(prefix, "")) is not None

    def resolve_tag(self, name: str) -> tuple[str, str]:
        """Return the namespace and name of a tag; the name keeps its prefix if the metamodel lacks the namespace."""
        prefix, _, simple = name.rpartition(":")
        uri = self.scope.get(prefix, "")
        return uri, simple if uri in self._reading.packages else name

    def _enter_scope(self, scope: dict[str, str]) -> None:
        self.scope = scope
        self._types = {}
        spaces = [prefix for prefix, uri in scope.items() if uri == XSI or XMI_NAMESPACES.fullmatch(uri)]
        self._type_keys = tuple(f"{prefix}:type" for prefix in spaces)
        self.id_key = next((f"{one}:id" for one in spaces if scope[one] != XSI), None)

    def resolve_class(self, name: str, tag_byte: int, attribute_key: str | None) -> str | None:
        """Return the class of a tag or `xsi:type` like `railway:Region`; if it is unknown or abstract, return None.

        The mistake is reported at the first call: at `attribute_key`, the XML attribute, or at the tag itself if
        `attribute_key` is None.
        """
        if name in self._types:
            return self._types[name]
        found = self._look_up(name, tag_byte, attribute_key)
        self._types[name] = found
        return found

    def _look_up(self, name: str, at: int, key: str | None) -> str | None:
        span = self._document.places.attribute_span(at, key) if key else self._document.places.tag_span(at)
        prefix, _, simple = name.rpartition(":")
        metamodel, package = self._reading.metamodel, None
        if prefix and prefix not in self.scope:
            hint = f'write `xmlns:{prefix}="{metamodel.uri or metamodel.name}"`'
            self.report_undeclared(prefix, span, hint)
        elif prefix or "" in self.scope:
            package = self._package(self.scope[prefix], span)
            if package is None and not similar_uri_hint(self.scope[prefix], self._reading.packages):
                return None
        cls = self._find_class(simple, package, span)
        if cls is None or not check_concrete(metamodel, cls, simple, self._document.report, span):
            return None
        return cls

    def report_undeclared(self, prefix: str, span: Span, hint: str) -> None:
        """Report an undeclared prefix; the hint is a similar declared prefix, or else `hint`."""
        hint = did_you_mean(prefix, self.scope) or hint
        self._document.report("unknown-prefix", f"the prefix `{prefix}` is not declared", span, hint)

    def _find_class(self, simple: str, package: Package | None, span: Span) -> str | None:
        """Return the class of this name in a package; without a package, the name must belong to exactly one class.

        If there is no such class, return None, and report this unless a file with errors may define the name.
        """
        metamodel = self._reading.metamodel
        homes = {path: one for path, one in metamodel.full_names(simple).items() if one in metamodel.classes}
        homes |= self._reading.names.classes.get(simple, {})
        if package and package.path in homes:
            return homes[package.path]
        if not package and len(homes) == 1:
            return next(iter(homes.values()))
        if simple in self._reading.lost_names:
            return None
        message = f"unknown class `{simple}`"
        hint = did_you_mean(simple, (simple_name(one) for one in metamodel.classes))
        if not self.scope and not self._document.roots:
            uri = metamodel.uri or metamodel.name
            hint = f'the document declares no namespace: write `xmlns:m="{uri}"` in the first tag'
        if homes:
            uris = [f"`{one.uri}`" for one in metamodel.packages if one.path in homes]
            hint = "write the prefix of its package, " + " or ".join(uris)
            message = f"`{simple}` is in several packages"
            if package:
                message = f"`{simple}` is not in the package `{package.uri}`"
        self._document.report("unknown-class", message, span, hint)
        return None

    def _package(self, uri: str, span: Span) -> Package | None:
        packages = self._reading.packages
        if uri not in packages and uri not in self._reading.foreign:
            self._reading.foreign.add(uri)
            message = f"the metamodel `{self._reading.metamodel.name}` has no namespace `{uri}`"
            near = similar_uri_hint(uri, packages)
            if near:  # continue: classes are then looked up by name only
                self._document.report("unknown-uri", message, span, near)
            else:
                hint = f"give a metamodel with this namespace too; the given one has {quote_names(packages)}"
                self._reading.report_unresolved("unknown-uri", message, span, hint, "objects of it are left out")
        return packages.get(uri)

    def take_type(self, attributes: dict[str, str]) -> tuple[str | None, str | None]:
        """Remove the `xsi:type` from a tag's attributes, and return its value and key, or (None, None)."""
        for key in self._type_keys:
            if key in attributes:
                return attributes.pop(key), key
        return None, None

    def declared_class(self, reference: Reference, at: int) -> str | None:
        """Return the target class of a reference, or report that it is abstract and return None.

        This is the class of a tag without `xsi:type`.
        """
        metamodel = self._reading.metamodel
        if not metamodel.classes[reference.target].abstract:
            return reference.target
        kinds = metamodel.concrete_classes(reference.target)
        prefix = next((one for one, uri in self.scope.items() if uri in self._reading.packages), "")
        if kinds:
            home = metamodel.classes[kinds[0]].package
            uris = [one.uri for one in metamodel.packages if one.path == home]
            prefix = next((one for one, uri in self.scope.items() if uri in uris), prefix)
        hint = f'write `xsi:type="{prefix}:{simple_name(kinds[0])}"` for example' if kinds else None
        message = f"`{reference.target}` is abstract: the tag needs an `xsi:type`"
        self._document.report("abstract-class", message, self._document.places.tag_span(at), hint)
        return None

    def is_nil(self, attributes: dict[str, str]) -> bool:
        """Return True if a tag has `xsi:nil="true"`, so that it stands for no object."""
        return any(
            value == "true" and key.rpartition(":")[2] == "nil" and self.scope.get(key.rpartition(":")[0]) == XSI
            for key, value in attributes.items()
        )
