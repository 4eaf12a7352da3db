"""Write models as `.xmi` files, which the tools of Eclipse and pyecore can read."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from envgraph.errors import InvalidArgument
from envgraph.graph.model._model import Model
from envgraph.metamodel import (
    Attribute,
    Class,
    Feature,
    Reference,
    Scalar,
    Value,
    default_value,
    escape_xml,
    format_xml_value,
    simple_name,
)

_XMI = "http://www.omg.org/XMI"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_FORBIDDEN_CHARACTERS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_ID_SYNTAX = re.compile(r"[^\W\d][\w.-]*")
_VALUE_SYNTAX = re.compile(r"[\w.-]+")


def model_to_xmi(model: Model, folder: Path | None = None) -> str:
    """Return the text of an `.xmi` file with the current state. Equal states give equal texts.

    Objects are nested in their containers, in the order of the links. The name of an object is its `xmi:id`, which
    references use. An object without a name is referred to by the value of its `iD` attribute if that is unique, else
    by its path, as in `//@regions.0/@sensors.3`. Values equal to the default of Ecore are omitted. Ids are not
    written; `model_to_json` writes everything.

    Args:
        model: the model.
        folder: the folder of the file. If the model was read from a file with an `xsi:schemaLocation`, the new file
            gets one too, with paths relative to this folder. Without a folder, it has none.

    Raises:
        InvalidArgument: a string has a character that XML does not allow.
    """
    return "\n".join(_XmiModelWriter(model).lines(folder)) + "\n"


def _relative_place(place: str, folder: Path | None) -> str:
    """Return a path as a URI relative to a folder; return a URL unchanged."""
    return place if "://" in place else quote(Path(os.path.relpath(place, folder or ".")).as_posix(), safe="/#")


class _XmiModelWriter:
    """A writer of the `.xmi` text of one model."""

    def __init__(self, model: Model) -> None:
        self.model = model
        metamodel = model.metamodel
        self._uris = {package.path: package.uri for package in metamodel.packages}
        self._prefixes = _distinct_prefixes({package.path: package.prefix for package in metamodel.packages})
        self._features: Mapping[str, list[Feature]] = {
            cls.name: [one for one in metamodel.features(cls.name).values() if not self._is_implied_by_nesting(one)]
            for cls in metamodel.class_list
        }
        everyone = sorted(model.graph.store.nodes())
        self._roots = [node for node in everyone if model.graph.container(node) is None]
        self._root_indexes = {root: index for index, root in enumerate(self._roots)}
        self._target_indexes: dict[int, dict[int, int]] = {}
        self._identifier_by_node = self._unique_identifiers(everyone)

    def lines(self, folder: Path | None) -> Iterator[str]:
        """Yield the lines of the file; see `model_to_xmi`."""
        yield '<?xml version="1.0" encoding="UTF-8"?>'
        head = f'xmi:version="2.0" xmlns:xmi="{_XMI}" xmlns:xsi="{_XSI}"'
        for path, uri in self._uris.items():
            head += f' xmlns:{self._prefixes[path]}="{escape_xml(uri)}"'
        places = self.model.graph.schema_locations if folder is not None else {}
        words = [f"{uri} {_relative_place(places[uri], folder)}" for uri in self._uris.values() if uri in places]
        if words:
            head += f' xsi:schemaLocation="{escape_xml(" ".join(words))}"'
        if len(self._roots) == 1:
            yield from self._tree_lines(self._roots[0], head, 0)
            return
        yield f"<xmi:XMI {head}" + (">" if self._roots else "/>")
        for root in self._roots:
            yield from self._tree_lines(root, "", 1)
        if self._roots:
            yield "</xmi:XMI>"

    def _tree_lines(self, root: int, root_attributes: str, depth: int) -> Iterator[str]:
        """Yield the lines of an object and everything that it contains. `root_attributes` is added to the first tag."""
        tag = self._qualified_tag(self.model.graph.class_of(root))
        waiting: list[tuple[int, str, str, int]] = [(root, tag, root_attributes, depth)]
        while waiting:
            node, tag, extra, level = waiting.pop()
            indent = "  " * level
            if node < 0:
                yield f"{indent}</{tag}>"
                continue
            graph = self.model.graph
            attributes = [one for one in self._features[graph.class_of(node)] if isinstance(one, Attribute)]
            references = [one for one in self._features[graph.class_of(node)] if isinstance(one, Reference)]
            inside = [(one, inner) for one in references if one.containment for inner in graph.targets(node, one)]
            # An omitted attribute would have its default.
            empty = [one for one in attributes if not graph.values(node, one) and ecore_default(one) is not None]
            parts = f" {extra}" * bool(extra) + self._tag_attributes(node)
            lists = [
                (one.name, escape_xml(self._check_text(self._format_value(node, one, value), node)))
                for one in attributes
                if one.many
                for value in graph.values(node, one)
            ]
            if not inside and not empty and not lists:
                yield f"{indent}<{tag}{parts}/>"
                continue
            yield f"{indent}<{tag}{parts}>"
            for attribute in empty:
                yield f'{indent}  <{attribute.name} xsi:nil="true"/>'
            for name, text in lists:
                yield f"{indent}  <{name}>{text}</{name}>"
            waiting.append((-1, tag, "", level))
            for reference, target in reversed(inside):
                cls = self.model.graph.class_of(target)
                exact = "" if cls == reference.target else f'xsi:type="{self._qualified_tag(cls)}"'
                waiting.append((target, reference.name, exact, level + 1))

    def _tag_attributes(self, node: int) -> str:
        """Return the XML attributes of an object's tag, as one text with a space before each."""
        model, written = self.model, []
        name = model.graph.object_name(node)
        if name is not None:
            written.append(f" xmi:id={self._quote(name, node)}")
        for feature in self._features[model.graph.class_of(node)]:
            if isinstance(feature, Attribute):
                value = None if feature.many else model.graph.value(node, feature)
                if value is not None and value != ecore_default(feature):
                    written.append(f" {feature.name}={self._quote(self._format_value(node, feature, value), node)}")
            elif not feature.containment:
                targets = " ".join(map(self._reference_text, model.graph.targets(node, feature)))
                if targets:
                    written.append(f' {feature.name}="{targets}"')
        return "".join(written)

    def _format_value(self, node: int, attribute: Attribute, value: Value) -> str:
        return self.model.graph.decimal_texts.get((node, attribute.index, value)) or format_xml_value(attribute, value)

    def _is_implied_by_nesting(self, feature: Feature) -> bool:
        """Return True if the nesting of tags implies the feature, because the feature is the link to the container."""
        return isinstance(feature, Reference) and self.model.graph.store.relations[feature.index].is_contained

    def _reference_text(self, node: int) -> str:
        name = self.model.graph.object_name(node)
        if name is not None and _ID_SYNTAX.fullmatch(name):
            return name
        if node in self._identifier_by_node:
            return self._identifier_by_node[node]
        steps: list[str] = []
        while found := self.model.graph.container(node):
            container, reference = found
            place = f".{self._index_in_container(container, reference, node)}" if reference.many else ""
            steps.append(f"@{reference.name}{place}")
            node = container
        root = f"/{self._root_indexes[node]}" if len(self._roots) > 1 else "/"
        return "/".join([root, *reversed(steps)])

    def _unique_identifiers(self, nodes: Sequence[int]) -> Mapping[int, str]:
        """Return by object the value of its `iD` attribute, by which references name the object.

        Objects whose value is omitted as the default, is not unique, or is not a valid identifier are left out.
        """
        found: dict[int, str] = {}
        for cls, features in self._features.items():
            own = next((one for one in features if isinstance(one, Attribute) and one.identifier), None)
            if own is None or own.many:
                continue
            for node in self.model.graph.exact_extent(cls):
                value = self.model.graph.value(node, own)
                if value is not None and value != ecore_default(own):
                    found[node] = format_xml_value(own, value)
        if not found:
            return found
        names = map(self.model.graph.object_name, nodes)
        counts = Counter([*found.values(), *(name for name in names if name is not None)])
        return {node: text for node, text in found.items() if counts[text] == 1 and _VALUE_SYNTAX.fullmatch(text)}

    def _index_in_container(self, container: int, reference: Reference, node: int) -> int:
        """Return the index of an object among the targets of its container."""
        if node not in self._target_indexes.setdefault(reference.index, {}):
            targets = self.model.graph.targets(container, reference)
            self._target_indexes[reference.index].update((target, index) for index, target in enumerate(targets))
        return self._target_indexes[reference.index][node]

    def _qualified_tag(self, name: str) -> str:
        cls: Class = self.model.metamodel.classes[name]
        return f"{self._prefixes[cls.package]}:{simple_name(name)}"

    def _quote(self, text: str, node: int) -> str:
        return f'"{escape_xml(self._check_text(text, node))}"'

    def _check_text(self, text: str, node: int) -> str:
        if _FORBIDDEN_CHARACTERS.search(text):
            raise InvalidArgument(
                f"{self.model.graph.describe(node)} has a string with a character that XML does not allow: {text!r}"
            )
        return text


def arrange_targets(model: Model, node: int, reference: Reference, targets: Sequence[int]) -> None:
    """Reorder the targets of an object while a model is loading. `targets` must be its current targets."""
    column = model.graph.store.forward[reference.index]
    column[node] = model.graph.store.as_adjacency(targets)


def ecore_default(attribute: Attribute) -> Value | None:
    """Return the value that Ecore gives an attribute that a tag omits. It is None for a string without a default.

    >>> ecore_default(Attribute("a", Scalar.INT)), ecore_default(Attribute("a", Scalar.STRING))
    (0, None)
    """
    if attribute.default is not None:
        return float(attribute.default) if attribute.type is Scalar.FLOAT else attribute.default
    if attribute.many or attribute.optional or attribute.type is Scalar.STRING:
        return None
    return default_value(attribute.type)


def _distinct_prefixes(wanted: Mapping[str, str]) -> dict[str, str]:
    """Return distinct XML prefixes of packages: a valid wanted prefix or `model`, lengthened by `_` if it is in use."""
    found: dict[str, str] = {}
    for path, prefix in wanted.items():
        is_valid = _ID_SYNTAX.fullmatch(prefix) and prefix not in ("xmi", "xsi", "xml")
        unused_prefix = prefix if is_valid else "model"
        while unused_prefix in found.values():
            unused_prefix += "_"
        found[path] = unused_prefix
    return found
