"""Read `.ecore` files as a `Metamodel`; files that refer to each other become one metamodel.

The XML is read directly and not with pyecore. The reader of pyecore stops at the first mistake, reports only lines, and
overlooks many mistakes. Tests compare the results of both.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from envgraph.errors import (
    Note,
    ResolutionError,
    Span,
    count_with_noun,
    has_errors,
)
from envgraph.lang.interchange._ecore_attributes import (
    annotations_of,
    bounds_of,
    data_type_of,
    default_of,
    doc_of,
    foreign_annotations_of,
    marks_of,
    metamodel_name_of,
    name_of,
    preserved_attributes_of,
    typed_attribute_of,
)
from envgraph.lang.interchange._ecore_checker import EcoreChecker
from envgraph.lang.interchange._ecore_document import (
    EcoreDocument,
    ecore_metamodel_document,
    is_computed,
    reason_without_values,
)
from envgraph.lang.interchange._ecore_name_resolution import (
    EcoreTarget,
    SharedEcoreState,
    TooManyMistakes,
    children_named,
)
from envgraph.lang.read._ecore_types import (
    ECORE,
    ECORE_TYPES,
    FEATURE_MAP_REASON,
    XML_TYPES,
    well_known_types,
)
from envgraph.lang.read._metamodel_reader import MetamodelFile
from envgraph.lang.syntax._xml_parser import XmlElement
from envgraph.metamodel import (
    Annotation,
    Attribute,
    Class,
    EnumType,
    Feature,
    Metamodel,
    Package,
    Reference,
    simple_xml_attributes,
)


def read_ecore(
    documents: Sequence[EcoreDocument],
    same_package: Mapping[str, EcoreDocument] = MappingProxyType({}),
    *,
    allow_unresolved: bool = False,
) -> MetamodelFile:
    """Return the metamodel of one or more `.ecore` files with all diagnostics; after errors, the metamodel is None.

    The package of the first file is the metamodel's own package; packages of the other files are nested in it. If
    classes or enums of several packages have the same name, they are named `package::Name`.

    Args:
        documents: the files, at least one.
        same_package: the names of files that repeat the package of one of the documents, each with this document.
        allow_unresolved: if True, features whose types are in missing files are left out with a warning.
    """
    merged = SharedEcoreState(allow_unresolved=allow_unresolved)
    if any(one.needs_ecore() for one in documents) and not any(ECORE in one.uris for one in documents):
        documents = (*documents, ecore_metamodel_document())
    readers = [_EcoreReader(one, merged) for one in documents]
    merged.readers.extend(readers)
    merged.by_file = {one.document.source.name: one for one in readers}
    merged.by_file |= {name: merged.by_file[one.source.name] for name, one in same_package.items()}
    metamodel, stopped = None, False
    try:
        metamodel = _read_metamodel(merged, readers)
    except TooManyMistakes:
        stopped = True
    for (noun, rest), spans in merged.dropped.items():
        message = f"left out: {count_with_noun(len(spans), noun)} {rest}"
        readers[0].report_warning(
            "left-out", message, spans[0], "keep the original: a written `.ecore` file will lack this"
        )
    # A feature that is left out on purpose is not lost: naming it is a mistake, and the class knows the reason.
    lost = merged.lost_names.difference(*merged.left_out.values())
    if stopped:
        lost = {name for reader in readers for name in reader.all_words()}
    return MetamodelFile(metamodel, readers[0].span, tuple(merged.diagnostics), frozenset(lost))


_WITHOUT_VALUES: Mapping[str, str] = {
    "derived": "write a pattern that finds the same values",
    "transient": 'write `transient="false"` to keep it',
    "eType": "use the features that hold its elements; its texts, and the order across these features, are lost",
}


def _read_metamodel(merged: SharedEcoreState, readers: Sequence[_EcoreReader]) -> Metamodel | None:
    sound = [one for one in readers if one.check_package()]
    if not sound:
        return None
    paths: set[str] = set()
    for reader in sound:
        reader.enter_packages(paths)
    packages = [(path, one, reader) for reader in sound for path, one in reader.packages]
    ecore = [(one, reader) for _, one, reader in packages if one.attributes.get("nsURI") == ECORE]
    merged.any_object = next((reader.document.parts_by_name(one).get("EObject") for one, reader in ecore), None)
    named = _package_qualifiers([(path, one) for path, one, _ in packages])
    classifiers = [
        (path, one, reader) for path, package, reader in packages for one in children_named(package, "eClassifiers")
    ]
    homes: dict[str, dict[str, None]] = {}
    for path, one, _ in classifiers:
        if merged.kinds.get(one) in ("EClass", "EEnum"):
            homes.setdefault(one.get("name"), {})[path] = None
    for path, one, _ in classifiers:
        name = one.get("name")
        merged.names[one] = f"{named[path]}::{name}" if name and len(homes.get(name, ())) > 1 else name
    return _build_metamodel(merged, packages, classifiers)


def _build_metamodel(
    merged: SharedEcoreState,
    packages: Sequence[tuple[str, XmlElement, _EcoreReader]],
    classifiers: Sequence[tuple[str, XmlElement, _EcoreReader]],
) -> Metamodel | None:
    _, root, first = packages[0]
    name = first.begin_metamodel(root)
    for path, one, reader in classifiers:
        if merged.kinds.get(one) == "EEnum":
            merged.enums[one] = reader.build_enum(path, one)
        elif merged.kinds.get(one) == "EDataType":
            home = f"#//{path.replace('.', '/')}/" if path else "#//"
            own = name_of(reader, one, "data type")
            merged.data_types[one] = own if merged.owners[one].get("nsURI") == ECORE else home + own
    classes = [reader.build_class(path, one) for path, one, reader in classifiers if merged.kinds.get(one) == "EClass"]
    known = [reader.build_package(path, one) for path, one, reader in packages]
    uri = root.attributes.get("nsURI") or None
    try:
        enums = [one for one in merged.enums.values() if one.literals]
        metamodel = Metamodel(name, classes, enums, uri, known)
    except ResolutionError as error:
        merged.diagnostics.extend(error.diagnostics)
        return None
    return None if has_errors(merged.diagnostics) else metamodel


def _package_qualifiers(packages: Sequence[tuple[str, XmlElement]]) -> dict[str, str]:
    """Return by package path the unique word that is written before `::`.

    The word is the first of the package's name, prefix and path that is an unused identifier; else `package`, with as
    many `_` at its end as make it unique.
    """
    found: dict[str, str] = {}
    taken: set[str] = set()
    for path, one in packages:
        words = (one.get("name"), one.get("nsPrefix"), re.sub(r"\W", "_", path))
        free = [word for word in words if word.isidentifier() and word not in taken]
        word = free[0] if free else "package"
        while word in taken:
            word += "_"
        found[path] = word
        taken.add(word)
    return found


class _EcoreReader(EcoreChecker):
    """A reader of one `.ecore` file that builds its packages, enums, classes and features."""

    def begin_metamodel(self, root: XmlElement) -> str:
        """Return the name of the outermost package, and record its position; report a missing name, and make one."""
        if "name" in root.attributes:
            self.span = self.attribute_span(root, "name")
        return name_of(self, root, "package")

    def build_package(self, path: str, element: XmlElement) -> Package:
        uri, prefix = element.get("nsURI"), element.get("nsPrefix")
        name = element.get("name")
        if not uri:
            where, hint = self.places.tag_span(element.byte), 'write `nsURI="..."`: files refer to it'
            self.report_warning("missing-uri", f"package `{name}` has no `nsURI`", where, hint)
        if path:
            name_of(self, element, "package")
        notes = [*foreign_annotations_of(self, element, with_doc=True)]
        for one in children_named(element, "eClassifiers"):
            if one in self.shared.data_types:
                named = [pair for kept in preserved_attributes_of(one, {}) for pair in kept.named]
                notes.append(Annotation("datatype", (one.get("name"),), tuple(named)))
                notes.extend(foreign_annotations_of(self, one, with_doc=True))
        return Package(path, uri or path or name, prefix or name, tuple(notes))

    # --- enums ---

    def build_enum(self, path: str, element: XmlElement) -> EnumType:
        literals, labels, numbers, places = [], [], [], []
        for index, literal in enumerate(children_named(element, "eLiterals")):
            name = name_of(self, literal, "literal")
            literals.append(name)
            labels.append(literal.attributes.get("literal", name))
            # As in EMF: the author's number, or 0 if none is stated.
            numbers.append(typed_attribute_of(self, literal, "value"))
            places.append((f"literal {index}", self.name_span(literal)))
        if not literals:
            hint = "add a literal: an enum without literals has no values"
            self.report_warning(
                "left-out", f"the enum `{element.get('name')}` is left out", self.name_span(element), hint
            )
        usual = tuple(range(len(literals)))
        return EnumType(
            metamodel_name_of(self, element, "enum"),
            tuple(literals),
            doc=doc_of(element),
            span=self.name_span(element),
            places=tuple(places),
            package=path,
            labels=() if labels == literals else tuple(labels),
            numbers=() if tuple(numbers) == usual else tuple(numbers),
            annotations=(*preserved_attributes_of(element, {}), *foreign_annotations_of(self, element)),
        )

    # --- classes ---

    def build_class(self, path: str, element: XmlElement) -> Class:
        supertypes, places = [], []
        for target in self._supertypes(element):
            name = self.shared.names.get(target.element, "") if target.element else ""
            supertypes.append(name)
            places.append((f"extends {name}", target.span))
        any_object = self.shared.any_object
        if any_object and element is not any_object and not supertypes:
            supertypes.append(self.shared.names[any_object])
        features = [one for one in map(self._build_feature, children_named(element, "eStructuralFeatures")) if one]
        abstract = typed_attribute_of(self, element, "abstract")
        marks = marks_of(self, element, features)
        self._check_class(element)
        abstract = typed_attribute_of(self, element, "interface") or abstract
        kept = preserved_attributes_of(element, {"abstract": "true" if abstract else None})
        return Class(
            metamodel_name_of(self, element, "class"),
            abstract=abstract,
            supertypes=tuple(supertypes),
            features=tuple(features),
            key=marks.key,
            glyph=marks.glyph,
            frozen=marks.frozen,
            doc=doc_of(element),
            annotations=(*annotations_of(self, element), *kept),
            span=self.name_span(element),
            places=(*places, *marks.places),
            package=path,
            left_out=tuple(self.shared.left_out.get(element, {}).items()),
        )

    def _supertypes(self, element: XmlElement) -> Iterator[EcoreTarget]:
        targets = [
            *self._targets(element, "eSuperTypes"),
            *self._generic_targets(element, "eGenericSuperTypes"),
        ]
        for target in targets:
            kind = self._kinds.get(target.element) if target.element else "data type"
            if kind == "EClass":
                yield target
            elif kind is not None:
                hint = "name a class, or remove this"
                self.report_error("wrong-type", "a class can only extend classes", target.span, hint)

    def _check_class(self, element: XmlElement) -> None:
        for parameter in list(children_named(element, "eTypeParameters"))[:1]:
            self._warn_erased(parameter, f"`{element.attributes.get('name', '')}` is read without its type parameters")
        for one in children_named(element, "eOperations"):
            self.record_dropped("operation", "of classes", one)

    # --- features ---

    def _build_feature(self, element: XmlElement) -> Feature | None:
        kind = self._kinds.get(element)
        if kind is None:
            return None
        word = self._reason_without_values(element)
        if word:
            what = "feature map" if word == "eType" else f"{word} feature"
            message = f"the {what} `{element.attributes.get('name', '')}` is left out"
            hint = _WITHOUT_VALUES[word]
            self.report_warning("left-out", message, self.places.attribute_name_span(element.byte, word), hint)
            reason = FEATURE_MAP_REASON if word == "eType" else f"it is {word}, and was left out of the metamodel"
            self._leave_out(element, reason)
            return None
        errors = self.shared.errors
        found = self._build_attribute(element) if kind == "EAttribute" else self._build_reference(element)
        if found is None and self.shared.allow_unresolved and self.shared.errors == errors:
            self._leave_out(element, "its type is in a file that does not exist")
        elif found is None:
            self.shared.lost_names.add(element.get("name"))
        return found

    def _data_type_name(self, target: EcoreTarget) -> str | None:
        """Return the data type of an attribute as `.ecore` files name it; None for an enum or a type parameter."""
        if target.data_type is None:
            return self.shared.data_types.get(target.element) if target.element else None
        document, _, path = target.span.text.rpartition("#")
        own = well_known_types(document) is ECORE_TYPES
        return path.rpartition("/")[2] if own else f"{XML_TYPES}#{path}"

    def _reason_without_values(self, element: XmlElement) -> str | None:
        """Return why files hold no values of a feature, "derived", "transient" or "eType" (a feature map), or None.

        A reference is transient if its opposite is, too. A derived containment beside a feature map has values.
        """
        word = reason_without_values(element)
        beside = children_named(self._owners[element], "eStructuralFeatures")
        if (
            word == "derived"
            and element.get("containment") == "true"
            and any(reason_without_values(one) == "eType" for one in beside)
        ):
            return None  # it belongs to a feature map of the same class, and contained objects cannot be computed
        if word is None and element.get("transient") == "true" and element.get("derived") != "true":
            other = [one.element for one in self.targets_without_reports(element, "eOpposite")]
            word = "transient" if any(one and one.get("transient") == "true" for one in other) else None
        return word

    def _leave_out(self, element: XmlElement, why: str) -> None:
        self.shared.lost_names.add(element.get("name"))
        self.shared.left_out.setdefault(self._owners[element], {})[element.get("name")] = why

    def _feature_type(self, element: XmlElement, noun: str) -> EcoreTarget | None:
        """Return the type of a feature; if it is missing or cannot be read, report this and return None."""
        before = len(self.shared.diagnostics)
        found = [*self._targets(element, "eType")]
        if element.children:
            found += self._generic_targets(element, "eGenericType")
        if found:
            return found[0]
        if len(self.shared.diagnostics) == before and not self._has_attribute_or_child(
            element, ("eType", "eGenericType")
        ):
            name = element.get("name")
            self.report_error(
                "missing-type", f"{noun} `{name}` has no type", self.name_span(element), 'write `eType="..."`'
            )
        return None

    def _build_attribute(self, element: XmlElement) -> Feature | None:
        target = self._feature_type(element, "attribute")
        lower, upper = bounds_of(self, element)
        name = name_of(self, element, "attribute")
        data = data_type_of(self, target) if target else None
        if data is None or target is None:
            return None
        if isinstance(data.type, EnumType) and not data.type.literals:
            self._leave_out(element, f"its enum `{data.type.name}` has no literals, and was left out")
            return None
        many = upper != 1
        default = None if many else default_of(self, element, name, data.type)
        places = [("type", target.span), *self._multiplicity_span(element)]
        if default is not None:
            places.append(("default", self.attribute_span(element, "defaultValueLiteral")))
        found = Attribute(
            name,
            data.type,
            default,
            doc=doc_of(element),
            annotations=annotations_of(self, element),
            span=self.name_span(element),
            places=tuple(places),
            lower=lower if many else 0 if lower == 0 and data.nullable and default is None else 1,
            upper=upper,
            unique=typed_attribute_of(self, element, "unique"),
            identifier=typed_attribute_of(self, element, "iD"),
        )
        return self._with_preserved_attributes(element, found, {"eType": self._data_type_name(target)})

    def _multiplicity_span(self, element: XmlElement) -> list[tuple[str, Span]]:
        """Return `[("multiplicity", span)]`, the position of the stated upper, else lower bound; [] without bounds."""
        bounds = (one for one in ("upperBound", "lowerBound") if one in element.attributes)
        return [("multiplicity", self.attribute_span(element, bound)) for bound in bounds][:1]

    def _build_reference(self, element: XmlElement) -> Feature | None:
        target = self._feature_type(element, "reference")
        lower, upper = bounds_of(self, element)
        name = name_of(self, element, "reference")
        if target is None:
            return None
        kind = self._kinds.get(target.element) if target.element else "EDataType"
        if target.element is None or kind != "EClass":
            data = kind in ("EEnum", "EDataType")
            hint = 'write `xsi:type="ecore:EAttribute"`' if data else "name a class"
            if kind:  # else its kind is unknown, which has been reported
                self.report_error("wrong-type", "the type of a reference must be a class", target.span, hint)
            return None
        if upper != 1 and not typed_attribute_of(self, element, "unique"):
            where = self.places.attribute_name_span(element.byte, "unique")
            hint = "to repeat an object, refer to objects of another class that refer to it"
            self.report_warning("unique", f"`{name}` will contain each object only once", where, hint)
        opposite = self._checked_opposite(element, target.element)
        places = [("target", target.span), *self._multiplicity_span(element)]
        if opposite:
            places.append(("opposite", opposite[1]))
        keys = [one.element.get("name") for one in self._targets(element, "eKeys") if one.element]
        found = Reference(
            name,
            self.shared.names.get(target.element, ""),
            lower,
            upper,
            containment=typed_attribute_of(self, element, "containment"),
            opposite=opposite[0] if opposite else None,
            doc=doc_of(element),
            annotations=annotations_of(self, element),
            span=self.name_span(element),
            places=tuple(places),
        )
        apart = () if opposite else self._targets(element, "eOpposite")
        back = next((one.element.get("name") for one in apart if one.element), None)
        return self._with_preserved_attributes(element, found, {"eKeys": " ".join(keys), "eOpposite": back})

    def _with_preserved_attributes(
        self, element: XmlElement, feature: Attribute | Reference, named: Mapping[str, str | None]
    ) -> Feature:
        """Return the feature, with an annotation for the XML attributes that only other tools use if there are any."""
        kept = preserved_attributes_of(element, simple_xml_attributes(feature, named.get("eType")), named)
        return replace(feature, annotations=(*feature.annotations, *kept)) if kept else feature

    def _checked_opposite(self, element: XmlElement, target_class: XmlElement) -> tuple[str, Span] | None:
        """Return the name and span of a reference's opposite; None if it has none, or a wrong one, which is reported.

        It is also None if the opposite is computed or has no values in files. `target_class` is the class that the
        reference points to. The check is done here, because a message in terms of `.metamodel` files would not help.
        """
        for target in self._targets(element, "eOpposite"):
            other = target.element
            if other is None or other not in self._kinds:
                return None
            if self._kinds[other] != "EReference":
                hint = "name a reference, or remove this"
                self.report_error("opposite-mismatch", "the opposite must be a reference", target.span, hint)
                return None
            there_reader = target.reader
            if reason_without_values(other) or is_computed(other) or is_computed(element):
                return None
            back = {one.element for one in there_reader.targets_without_reports(other, "eOpposite")}
            types = {one.element for one in there_reader.targets_without_reports(other, "eType", "eGenericType")}
            needed = ("eOpposite",), ("eType", "eGenericType")
            if not (back and types) and all(self._has_attribute_or_child(other, names) for names in needed):
                return None  # the opposite's own text cannot be read, which is reported there
            owner = self._owners[element]
            if self._owners[other] is not target_class or owner not in types or element not in back:
                mine, its = self._qualified_name(element), self._qualified_name(other)
                note = Note("the other reference is here", there_reader.name_span(other))
                cls = owner.get("name")
                file = "" if there_reader is self else self.places.source.name.rpartition("/")[2]
                hint = f'write `eOpposite="{file}{self._fragment_of(element)}"` there, and `{cls}` as its type'
                if self._owners[other] is not target_class:
                    hint = f"declare the opposite in `{target_class.get('name')}`, the type of `{mine}`"
                message = f"`{mine}` and `{its}` are not each other's opposites"
                self.report_error("opposite-mismatch", message, target.span, hint, (note,))
                return None
            return other.get("name"), target.span
        return None

    def _fragment_of(self, element: XmlElement) -> str:
        names: list[str] = []
        while element not in self.document.roots:
            names.append(element.get("name"))
            element = self._owners[element]
        place = self.document.roots.index(element)
        return f"#/{place or ''}/" + "/".join(reversed(names))

    def _qualified_name(self, element: XmlElement) -> str:
        return f"{self._owners[element].attributes.get('name', '')}.{element.attributes.get('name', '')}"
