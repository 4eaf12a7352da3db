"""Look up classes and features by their XML names: their own names, or those in ExtendedMetaData."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from envgraph.code import dataclass
from envgraph.errors import MAX_NESTING
from envgraph.graph import ecore_default
from envgraph.lang.read._ecore_types import EXTENDED_METADATA, FEATURE_MAP_REASON
from envgraph.metamodel import Annotation, Attribute, Feature, Metamodel, Reference


@dataclass(slots=True)
class XmlClassNames:
    """A description of how the objects of a class are written in XML.

    Attributes:
        name: the class.
        tags, keys: the features by the name of their XML element, and by the name of their XML attribute.
        unset_attributes: by key: the attributes that have no value if the tag lacks them, although a new object has
            one.
        identifiers: the keys of the `iD` attribute.
        text_attribute: the attribute that holds the text of a tag, or None.
        feature_map: the feature map, or "" if the class has none.
        map_members: the features that hold the elements of the map, each with its position; the order across them
            is lost.
    """

    name: str
    tags: Mapping[str, Feature]
    keys: Mapping[str, Feature]
    unset_attributes: Mapping[str, Attribute]
    identifiers: Sequence[str]
    text_attribute: Attribute | None
    feature_map: str
    map_members: Mapping[str, int]


class XmlNames:
    """A lookup of the classes and features of a metamodel by their XML names.

    Attributes:
        classes: the classes by XML name, then by package.
        elements: by URI and name: the elements that can be the root of a document. Each has its class, its feature, and
            the name of the element that it may substitute, or "".
    """

    def __init__(self, metamodel: Metamodel) -> None:
        self._metamodel = metamodel
        self._tables: dict[str, XmlClassNames] = {}
        self.classes: dict[str, dict[str, str]] = {}
        self.elements: dict[tuple[str, str], tuple[str, Reference, str]] = {}
        uris = {one.path: one.uri for one in metamodel.packages}
        for cls in metamodel.class_list:
            name = _extended_metadata(cls.annotations).get("name")
            if name:
                self.classes.setdefault(name, {})[cls.package] = cls.name
            for one in cls.features if name == "" else ():
                if isinstance(one, Reference) and one.containment:
                    said = _extended_metadata(one.annotations)
                    head = said.get("affiliation", "").rpartition("#")[2]
                    self.elements[uris[cls.package], said.get("name", one.name)] = cls.name, one, head

    def substitution_head(self, uri: str, tag: str, known: Mapping[str, Feature]) -> str:
        """Return the name in `known` that a tag has or may replace by substitution groups, else an unknown name."""
        for _ in range(MAX_NESTING):
            if tag in known or (uri, tag) not in self.elements:
                break
            tag = self.elements[uri, tag][2]
        return tag

    def names_of(self, cls: str) -> XmlClassNames:
        """Return the XML description of a class; it is computed at the first call."""
        found = self._tables.get(cls)
        if found is None:
            found = self._tables[cls] = self._compute_names(cls)
        return found

    def _compute_names(self, cls: str) -> XmlClassNames:
        features = self._metamodel.features(cls)
        above = [self._metamodel.classes[one] for one in self._metamodel.supertypes(cls)]
        mixed = any(_extended_metadata(one.annotations).get("kind") == "mixed" for one in above)
        maps = [name for one in above for name, why in one.left_out if why == FEATURE_MAP_REASON]
        tags, keys, members, text = dict(features), dict(features), {}, None
        for place, (name, feature) in enumerate(features.items()):
            said = _extended_metadata(feature.annotations)
            kind, called = said.get("kind"), said.get("name", name)
            if kind == "simple" and isinstance(feature, Attribute):
                text = feature
                continue
            if kind != "element":
                keys[called] = feature
            if kind != "attribute":
                tags[called] = feature
            if "group" in said or (mixed and kind == "element"):
                members[name] = place
        values = {key: one for key, one in keys.items() if isinstance(one, Attribute)}
        unset = {key: one for key, one in values.items() if ecore_default(one) is None and not one.many}
        identifiers = [key for key, one in values.items() if one.identifier]
        return XmlClassNames(cls, tags, keys, unset, identifiers, text, maps[-1] if maps else "", members)


def _extended_metadata(annotations: Iterable[Annotation]) -> dict[str, str]:
    """Return the details of the ExtendedMetaData annotations, by key."""
    return {key: value for one in annotations if one.is_from(EXTENDED_METADATA) for key, value in one.details}
