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
    has_errors,
    plural,
)
from envgraph.lang.interchange._ecore_document import EcoreDocument, ecore_itself, is_computed, without_values
from envgraph.lang.interchange._ecore_names import Enough, Joint, Target, inside
from envgraph.lang.interchange._ecore_parts import (
    annotations_of,
    bounds_of,
    called,
    data_type_of,
    default_of,
    doc_of,
    kept_of,
    marks_of,
    name_of,
    notes_of,
    said,
)
from envgraph.lang.interchange._ecore_tags import Tags
from envgraph.lang.read._ecore_types import A_MAP, ECORE, ECORE_TYPES, XML_TYPES, library_types
from envgraph.lang.read._metamodel import MetamodelFile
from envgraph.lang.syntax._xml import Element
from envgraph.metamodel import (
    Annotation,
    Attribute,
    Class,
    EnumType,
    Feature,
    Metamodel,
    Package,
    Reference,
    plain_parts,
)


def read_ecore(
    documents: Sequence[EcoreDocument],
    doubles: Mapping[str, EcoreDocument] = MappingProxyType({}),
    *,
    allow_unresolved: bool = False,
) -> MetamodelFile:
    """Return the metamodel of one or more `.ecore` files with all diagnostics; after errors, the metamodel is None.

    The package of the first file is the metamodel's own package; packages of the other files are nested in it. If
    classes or enums of several packages have the same name, they are named `package::Name`.

    Args:
        documents: the files, at least one.
        doubles: the names of files that repeat the package of one of the documents, each with this document.
        allow_unresolved: if True, features whose types are in missing files are left out with a warning.
    """
    joint = Joint(allow_unresolved=allow_unresolved)
    if any(one.needs_ecore() for one in documents) and not any(ECORE in one.uris for one in documents):
        documents = (*documents, ecore_itself())
    readers = [_Reader(one, joint) for one in documents]
    joint.readers.extend(readers)
    joint.by_file = {one.document.source.name: one for one in readers}
    joint.by_file |= {name: joint.by_file[one.source.name] for name, one in doubles.items()}
    metamodel, stopped = None, False
    try:
        metamodel = _read_all(joint, readers)
    except Enough:
        stopped = True
    for (noun, rest), spans in joint.dropped.items():
        message = f"left out: {plural(len(spans), noun)} {rest}"
        readers[0].warn(
            "left-out", message, spans[0], "keep the original: a written `.ecore` file will lack this"
        )
    # A feature that is left out on purpose is not lost: naming it is a mistake, and the class knows the reason.
    lost = joint.lost.difference(*joint.left_out.values())
    if stopped:
        lost = {name for reader in readers for name in reader.names()}
    return MetamodelFile(metamodel, readers[0].span, tuple(joint.diagnostics), frozenset(lost))


_WITHOUT_VALUES: Mapping[str, str] = {
    "derived": "write a pattern that finds the same values",
    "transient": 'write `transient="false"` to keep it',
    "eType": "use the features that hold its elements; its texts, and the order across these features, are lost",
}


def _read_all(joint: Joint, readers: Sequence[_Reader]) -> Metamodel | None:
    sound = [one for one in readers if one.begin()]
    if not sound:
        return None
    paths: set[str] = set()
    for reader in sound:
        reader.enter(paths)
    packages = [(path, one, reader) for reader in sound for path, one in reader.packages]
    ecore = [(one, reader) for _, one, reader in packages if one.attributes.get("nsURI") == ECORE]
    joint.any_object = next((reader.document.parts(one).get("EObject") for one, reader in ecore), None)
    named = _qualifiers([(path, one) for path, one, _ in packages])
    classifiers = [
        (path, one, reader) for path, package, reader in packages for one in inside(package, "eClassifiers")
    ]
    homes: dict[str, dict[str, None]] = {}
    for path, one, _ in classifiers:
        if joint.kinds.get(one) in ("EClass", "EEnum"):
            homes.setdefault(one.get("name"), {})[path] = None
    for path, one, _ in classifiers:
        name = one.get("name")
        joint.names[one] = f"{named[path]}::{name}" if name and len(homes.get(name, ())) > 1 else name
    return _built(joint, packages, classifiers)


def _built(
    joint: Joint,
    packages: Sequence[tuple[str, Element, _Reader]],
    classifiers: Sequence[tuple[str, Element, _Reader]],
) -> Metamodel | None:
    _, root, first = packages[0]
    name = first.begin_metamodel(root)
    for path, one, reader in classifiers:
        if joint.kinds.get(one) == "EEnum":
            joint.enums[one] = reader.enum(path, one)
        elif joint.kinds.get(one) == "EDataType":
            home = f"#//{path.replace('.', '/')}/" if path else "#//"
            own = name_of(reader, one, "data type")
            joint.data_types[one] = own if joint.owners[one].get("nsURI") == ECORE else home + own
    classes = [reader.cls(path, one) for path, one, reader in classifiers if joint.kinds.get(one) == "EClass"]
    known = [reader.package(path, one) for path, one, reader in packages]
    uri = root.attributes.get("nsURI") or None
    try:
        enums = [one for one in joint.enums.values() if one.literals]
        metamodel = Metamodel(name, classes, enums, uri, known)
    except ResolutionError as error:
        joint.diagnostics.extend(error.diagnostics)
        return None
    return None if has_errors(joint.diagnostics) else metamodel


def _qualifiers(packages: Sequence[tuple[str, Element]]) -> dict[str, str]:
    """Return by package path the unique word that is written before `::`.

    The word is the package's name, prefix or path, whichever is first an unused identifier; else `package` with `_`.
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


class _Reader(Tags):
    """A reader of one `.ecore` file that builds its packages, enums, classes and features."""

    def begin_metamodel(self, root: Element) -> str:
        """Return the name of the outermost package, and record its position; report a missing name, and make one."""
        if "name" in root.attributes:
            self.span = self.at(root, "name")
        return name_of(self, root, "package")

    def package(self, path: str, element: Element) -> Package:
        uri, prefix = element.get("nsURI"), element.get("nsPrefix")
        name = element.get("name")
        if not uri:
            where = self.places.tag(element.byte)
            self.warn(
                "missing-uri",
                f"package `{name}` has no `nsURI`",
                where,
                'write `nsURI="..."`: files refer to it',
            )
        if path:
            name_of(self, element, "package")
        notes = [*notes_of(self, element, with_doc=True)]
        for one in inside(element, "eClassifiers"):
            if one in self.joint.data_types:
                named = [pair for kept in kept_of(one, {}) for pair in kept.named]
                notes.append(Annotation("datatype", (one.get("name"),), tuple(named)))
                notes.extend(notes_of(self, one, with_doc=True))
        return Package(path, uri or path or name, prefix or name, tuple(notes))

    # --- enums ---

    def enum(self, path: str, element: Element) -> EnumType:
        literals, labels, numbers, places = [], [], [], []
        for index, literal in enumerate(inside(element, "eLiterals")):
            name = name_of(self, literal, "literal")
            literals.append(name)
            labels.append(literal.attributes.get("literal", name))
            # As in EMF: the author's number, or 0 if none is stated.
            numbers.append(said(self, literal, "value"))
            places.append((f"literal {index}", self.named(literal)))
        if not literals:
            hint = "add a literal: an enum without literals has no values"
            self.warn("left-out", f"the enum `{element.get('name')}` is left out", self.named(element), hint)
        usual = tuple(range(len(literals)))
        return EnumType(
            called(self, element, "enum"),
            tuple(literals),
            doc=doc_of(element),
            span=self.named(element),
            places=tuple(places),
            package=path,
            labels=() if labels == literals else tuple(labels),
            numbers=() if tuple(numbers) == usual else tuple(numbers),
            annotations=(*kept_of(element, {}), *notes_of(self, element)),
        )

    # --- classes ---

    def cls(self, path: str, element: Element) -> Class:
        supertypes, places = [], []
        for target in self._supertypes(element):
            name = self.joint.names.get(target.element, "") if target.element else ""
            supertypes.append(name)
            places.append((f"extends {name}", target.span))
        any_object = self.joint.any_object
        if any_object and element is not any_object and not supertypes:
            supertypes.append(self.joint.names[any_object])
        features = [one for one in map(self._feature, inside(element, "eStructuralFeatures")) if one]
        abstract = said(self, element, "abstract")
        marks = marks_of(self, element, features)
        self._check_class(element)
        abstract = said(self, element, "interface") or abstract
        kept = kept_of(element, {"abstract": "true" if abstract else None})
        return Class(
            called(self, element, "class"),
            abstract=abstract,
            supertypes=tuple(supertypes),
            features=tuple(features),
            key=marks.key,
            glyph=marks.glyph,
            frozen=marks.frozen,
            doc=doc_of(element),
            annotations=(*annotations_of(self, element), *kept),
            span=self.named(element),
            places=(*places, *marks.places),
            package=path,
            left_out=tuple(self.joint.left_out.get(element, {}).items()),
        )

    def _supertypes(self, element: Element) -> Iterator[Target]:
        targets = [*self._targets(element, "eSuperTypes"), *self._generic(element, "eGenericSuperTypes")]
        for target in targets:
            kind = self._kinds.get(target.element) if target.element else "data type"
            if kind == "EClass":
                yield target
            elif kind is not None:
                self.error(
                    "wrong-type",
                    "a class can only extend classes",
                    target.span,
                    "name a class, or remove this",
                )

    def _check_class(self, element: Element) -> None:
        for parameter in list(inside(element, "eTypeParameters"))[:1]:
            self._erase(
                parameter, f"`{element.attributes.get('name', '')}` is read without its type parameters"
            )
        for one in inside(element, "eOperations"):
            self.drop("operation", "of classes", one)

    # --- features ---

    def _feature(self, element: Element) -> Feature | None:
        kind = self._kinds.get(element)
        if kind is None:
            return None
        word = self._without_values(element)
        if word:
            what = "feature map" if word == "eType" else f"{word} feature"
            message = f"the {what} `{element.attributes.get('name', '')}` is left out"
            hint = _WITHOUT_VALUES[word]
            self.warn("left-out", message, self.places.name_of(element.byte, word), hint)
            self._leave_out(
                element, A_MAP if word == "eType" else f"it is {word}, and was left out of the metamodel"
            )
            return None
        errors = self.joint.errors
        found = self._attribute(element) if kind == "EAttribute" else self._reference(element)
        if found is None and self.joint.allow_unresolved and self.joint.errors == errors:
            self._leave_out(element, "its type is in a file that does not exist")
        elif found is None:
            self.joint.lost.add(element.get("name"))
        return found

    def _type_name(self, target: Target) -> str | None:
        """Return the data type of an attribute as `.ecore` files name it; None for an enum or a type parameter."""
        if target.data is None:
            return self.joint.data_types.get(target.element) if target.element else None
        document, _, path = target.span.text.rpartition("#")
        own = library_types(document) is ECORE_TYPES
        return path.rpartition("/")[2] if own else f"{XML_TYPES}#{path}"

    def _without_values(self, element: Element) -> str | None:
        """Return why files hold no values of a feature, "derived", "transient" or "eType" (a feature map), or None.

        A reference is transient if its opposite is, too. A derived containment beside a feature map has values.
        """
        word = without_values(element)
        beside = inside(self._owners[element], "eStructuralFeatures")
        if (
            word == "derived"
            and element.get("containment") == "true"
            and any(without_values(one) == "eType" for one in beside)
        ):
            return None  # it belongs to a feature map of the same class, and contained objects cannot be computed
        if word is None and element.get("transient") == "true" and element.get("derived") != "true":
            other = [one.element for one in self.quietly(element, "eOpposite")]
            word = "transient" if any(one and one.get("transient") == "true" for one in other) else None
        return word

    def _leave_out(self, element: Element, why: str) -> None:
        self.joint.lost.add(element.get("name"))
        self.joint.left_out.setdefault(self._owners[element], {})[element.get("name")] = why

    def _type(self, element: Element, what: str) -> Target | None:
        """Return the type of a feature; if it is missing or cannot be read, report this and return None."""
        before = len(self.joint.diagnostics)
        found = [*self._targets(element, "eType")]
        if element.children:
            found += self._generic(element, "eGenericType")
        if found:
            return found[0]
        if len(self.joint.diagnostics) == before and not self._mentions(element, ("eType", "eGenericType")):
            name = element.get("name")
            self.error(
                "missing-type", f"{what} `{name}` has no type", self.named(element), 'write `eType="..."`'
            )
        return None

    def _attribute(self, element: Element) -> Feature | None:
        target = self._type(element, "attribute")
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
        places = [("type", target.span), *self._multiplicity(element)]
        if default is not None:
            places.append(("default", self.at(element, "defaultValueLiteral")))
        found = Attribute(
            name,
            data.type,
            default,
            doc=doc_of(element),
            annotations=annotations_of(self, element),
            span=self.named(element),
            places=tuple(places),
            lower=lower if many else 0 if lower == 0 and data.nullable and default is None else 1,
            upper=upper,
            unique=said(self, element, "unique"),
            identifier=said(self, element, "iD"),
        )
        return self._with_kept(element, found, {"eType": self._type_name(target)})

    def _multiplicity(self, element: Element) -> list[tuple[str, Span]]:
        """Return `[("multiplicity", span)]`, the position of the stated upper, else lower bound; [] without bounds."""
        bounds = (one for one in ("upperBound", "lowerBound") if one in element.attributes)
        return [("multiplicity", self.at(element, bound)) for bound in bounds][:1]

    def _reference(self, element: Element) -> Feature | None:
        target = self._type(element, "reference")
        lower, upper = bounds_of(self, element)
        name = name_of(self, element, "reference")
        if target is None:
            return None
        kind = self._kinds.get(target.element) if target.element else "EDataType"
        if target.element is None or kind != "EClass":
            data = kind in ("EEnum", "EDataType")
            hint = 'write `xsi:type="ecore:EAttribute"`' if data else "name a class"
            if kind:  # else its kind is unknown, which has been reported
                self.error("wrong-type", "the type of a reference must be a class", target.span, hint)
            return None
        if upper != 1 and not said(self, element, "unique"):
            where = self.places.name_of(element.byte, "unique")
            hint = "to repeat an object, refer to objects of another class that refer to it"
            self.warn("unique", f"`{name}` will contain each object only once", where, hint)
        opposite = self._opposite(element, target.element)
        places = [("target", target.span), *self._multiplicity(element)]
        if opposite:
            places.append(("opposite", opposite[1]))
        keys = [one.element.get("name") for one in self._targets(element, "eKeys") if one.element]
        found = Reference(
            name,
            self.joint.names.get(target.element, ""),
            lower,
            upper,
            containment=said(self, element, "containment"),
            opposite=opposite[0] if opposite else None,
            doc=doc_of(element),
            annotations=annotations_of(self, element),
            span=self.named(element),
            places=tuple(places),
        )
        apart = () if opposite else self._targets(element, "eOpposite")
        back = next((one.element.get("name") for one in apart if one.element), None)
        return self._with_kept(element, found, {"eKeys": " ".join(keys), "eOpposite": back})

    def _with_kept(
        self, element: Element, feature: Attribute | Reference, named: Mapping[str, str | None]
    ) -> Feature:
        """Return the feature, with an annotation for the XML attributes that only other tools use if there are any."""
        kept = kept_of(element, plain_parts(feature, named.get("eType")), named)
        return replace(feature, annotations=(*feature.annotations, *kept)) if kept else feature

    def _opposite(self, element: Element, there: Element) -> tuple[str, Span] | None:
        """Return the name and span of a reference's opposite; None if it has none, or a wrong one, which is reported.

        It is also None if the opposite is computed or has no values in files. `there` is the class that the reference
        points to. The check is done here, because a message in terms of `.metamodel` files would not help.
        """
        for target in self._targets(element, "eOpposite"):
            other = target.element
            if other is None or other not in self._kinds:
                return None
            if self._kinds[other] != "EReference":
                self.error(
                    "opposite-mismatch",
                    "the opposite must be a reference",
                    target.span,
                    "name a reference, or remove this",
                )
                return None
            there_reader = target.reader
            if without_values(other) or is_computed(other) or is_computed(element):
                return None
            back = {one.element for one in there_reader.quietly(other, "eOpposite")}
            types = {one.element for one in there_reader.quietly(other, "eType", "eGenericType")}
            needed = ("eOpposite",), ("eType", "eGenericType")
            if not (back and types) and all(self._mentions(other, names) for names in needed):
                return None  # the opposite's own text cannot be read, which is reported there
            owner = self._owners[element]
            if self._owners[other] is not there or owner not in types or element not in back:
                mine, its = self._path(element), self._path(other)
                note = Note("the other reference is here", there_reader.named(other))
                cls = owner.get("name")
                file = "" if there_reader is self else self.places.source.name.rpartition("/")[2]
                hint = f'write `eOpposite="{file}{self._fragment(element)}"` there, and `{cls}` as its type'
                if self._owners[other] is not there:
                    hint = f"declare the opposite in `{there.get('name')}`, the type of `{mine}`"
                message = f"`{mine}` and `{its}` are not each other's opposites"
                self.error("opposite-mismatch", message, target.span, hint, (note,))
                return None
            return other.get("name"), target.span
        return None

    def _fragment(self, element: Element) -> str:
        names: list[str] = []
        while element not in self.document.roots:
            names.append(element.get("name"))
            element = self._owners[element]
        place = self.document.roots.index(element)
        return f"#/{place or ''}/" + "/".join(reversed(names))

    def _path(self, element: Element) -> str:
        return f"{self._owners[element].attributes.get('name', '')}.{element.attributes.get('name', '')}"
