"""`.ecore` files: the XML to a `Metamodel`. Files that name each other become one.

Read from the XML itself and not by pyecore, whose reader ends at the first mistake, knows lines alone, and lets much
pass. The two are compared in the tests.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from urllib.parse import unquote

from envgraph.errors import (
    Diagnostic,
    LoadError,
    Note,
    ResolutionError,
    Severity,
    Source,
    Span,
    did_you_mean,
    has_errors,
    sort_diagnostics,
)
from envgraph.lang._ecore_document import EcoreDocument
from envgraph.lang._ecore_types import (
    ECORE,
    ECORE_TYPES,
    DataType,
    java_type,
    library_types,
    too_large,
    value_of,
)
from envgraph.lang._imports import near_uri, without_consequences
from envgraph.lang._metamodel import MetamodelFile
from envgraph.lang._xml import XMI, XSI, Element
from envgraph.metamodel import (
    Annotation,
    Attribute,
    Class,
    EnumType,
    Feature,
    Glyph,
    Metamodel,
    Package,
    Places,
    Reference,
    Scalar,
    Value,
)

_GENMODEL = "http://www.eclipse.org/emf/2002/GenModel"
_OWN = "envgraph"
_DEEPEST = 50
_MOST = 100
"""After so many mistakes the rest is not read, and after so many warnings the others are not shown."""


class _Enough(Exception):
    """There have been enough mistakes."""


_TYPED = "name ordered unique lowerBound upperBound eType many required"
_FEATURE = (
    f"{_TYPED} changeable volatile transient defaultValueLiteral defaultValue unsettable derived "
    "eContainingClass"
)
_CLASSIFIER = "name instanceClassName instanceTypeName defaultValue ePackage"
_ATTRIBUTES: Mapping[str, str] = {
    "EPackage": "name nsURI nsPrefix eFactoryInstance",
    "EClass": f"{_CLASSIFIER} abstract interface eSuperTypes",
    "EDataType": f"{_CLASSIFIER} serializable",
    "EEnum": f"{_CLASSIFIER} serializable",
    "EEnumLiteral": "name value literal instance",
    "EAttribute": f"{_FEATURE} iD",
    "EReference": f"{_FEATURE} containment container resolveProxies eOpposite eKeys eReferenceType",
}
_CHILDREN: Mapping[str, str] = {
    "EPackage": "eClassifiers eSubpackages",
    "EClass": "eStructuralFeatures eOperations eSuperTypes eGenericSuperTypes eTypeParameters",
    "EDataType": "eTypeParameters",
    "EEnum": "eLiterals eTypeParameters",
    "EEnumLiteral": "",
    "EAttribute": "eType eGenericType",
    "EReference": "eType eGenericType eOpposite eKeys",
}


def read_ecore(
    documents: Sequence[EcoreDocument], doubles: Mapping[str, EcoreDocument] = MappingProxyType({})
) -> MetamodelFile:
    """The one metamodel of some `.ecore` files, and all that is wrong with it.

    The package of the first file is the metamodel's own; those of the others are nested in it. Classes and enums of
    one name in different packages are called after their packages, as `package::Name`.

    Args:
        documents: the files, one at least.
        doubles: by the names of other files: the one of the documents that has the same package.
    """
    joint = _Joint()
    joint.readers = [_Reader(one, joint) for one in documents]
    joint.by_file = {one.document.source.name: one for one in joint.readers}
    joint.by_file |= {name: joint.by_file[one.source.name] for name, one in doubles.items()}
    metamodel, stopped = None, False
    try:
        metamodel = _read_all(joint)
    except _Enough:
        stopped = True
    found = without_consequences(joint.diagnostics, frozenset(joint.lost))
    # What is left out of a class is no gap: to name it is a mistake, of which the class knows the reason.
    lost = joint.lost - joint.left_out.keys()
    if stopped:
        lost = {name for reader in joint.readers for name in reader.names()}
    return MetamodelFile(metamodel, joint.readers[0].span, tuple(found), frozenset(lost))


def parse_ecore(source: Source) -> Metamodel:
    """The metamodel of the text of an `.ecore` file.

    Raises:
        LoadError: all that is wrong with it.
    """
    found = read_ecore([EcoreDocument(source)])
    if found.metamodel is None:
        raise LoadError(sort_diagnostics(found.diagnostics))
    return found.metamodel


@dataclass(frozen=True, slots=True)
class _Target:
    """What a reference between the parts of files names: `span` is where it does, `reader` reads its file."""

    element: Element | None
    data: DataType | None
    span: Span
    reader: _Reader


@dataclass(slots=True)
class _Marks:
    """What annotations say of a class."""

    key: tuple[str, ...] = ()
    glyph: Glyph | None = None
    frozen: bool = False
    places: Places = ()


def _left_out(element: Element) -> str | None:
    """Why a feature holds nothing that a file could say, or None; a transient one may follow from its opposite."""
    words = ["derived", "volatile"]
    if "eOpposite" not in element.attributes:
        words.append("transient")
    return next((word for word in words if element.attributes.get(word) == "true"), None)


@dataclass(slots=True)
class _Joint:
    """What the readings of all files share.

    Attributes:
        lost: names of what is in the files but could not be read: to mention them is no mistake.
        left_out: names of features that are left out, with the features that have them.
        names: what classes and enums are called in the metamodel.
        missing: files that are named and are not there, which has been reported.
    """

    diagnostics: list[Diagnostic] = field(default_factory=list)
    lost: set[str] = field(default_factory=set)
    left_out: dict[str, dict[Element, str]] = field(default_factory=dict)
    readers: list[_Reader] = field(default_factory=list)
    by_file: dict[str, _Reader] = field(default_factory=dict)
    owners: dict[Element, Element] = field(default_factory=dict)
    kinds: dict[Element, str] = field(default_factory=dict)
    names: dict[Element, str] = field(default_factory=dict)
    enums: dict[Element, EnumType] = field(default_factory=dict)
    missing: set[tuple[str, str]] = field(default_factory=set)
    errors: int = 0
    warnings: int = 0
    quiet: bool = False


def _read_all(joint: _Joint) -> Metamodel | None:
    readers = [one for one in joint.readers if one.begin()]
    if not readers:
        return None
    paths: set[str] = set()
    for reader in readers:
        reader.enter(paths)
    packages = [(path, one, reader) for reader in readers for path, one in reader.packages]
    named = _qualifiers([(path, one) for path, one, _ in packages])
    classifiers = [
        (path, one, reader) for path, package, reader in packages for one in _inside(package, "eClassifiers")
    ]
    homes: dict[str, dict[str, None]] = {}
    for path, one, _ in classifiers:
        if joint.kinds.get(one) in ("EClass", "EEnum"):
            homes.setdefault(one.attributes.get("name", ""), {})[path] = None
    for path, one, _ in classifiers:
        name = one.attributes.get("name", "")
        joint.names[one] = f"{named[path]}::{name}" if name and len(homes.get(name, ())) > 1 else name
    return _built(joint, packages, classifiers)


def _built(
    joint: _Joint,
    packages: Sequence[tuple[str, Element, _Reader]],
    classifiers: Sequence[tuple[str, Element, _Reader]],
) -> Metamodel | None:
    _, root, first = packages[0]
    name = first.begin_metamodel(root)
    for path, one, reader in classifiers:
        if joint.kinds.get(one) == "EEnum":
            joint.enums[one] = reader.enum(path, one)
    classes = [reader.cls(path, one) for path, one, reader in classifiers if joint.kinds.get(one) == "EClass"]
    for _, one, reader in classifiers:
        reader.check_instance(one)
    known = [reader.package(path, one) for path, one, reader in packages]
    uri = root.attributes.get("nsURI") or None
    try:
        metamodel = Metamodel(name, classes, joint.enums.values(), uri, known)
    except ResolutionError as error:
        joint.diagnostics.extend(error.diagnostics)
        return None
    return None if has_errors(joint.diagnostics) else metamodel


def _qualifiers(packages: Sequence[tuple[str, Element]]) -> dict[str, str]:
    """What stands before `::` for each package, by path: its name, else its prefix, if none before it has that."""
    found: dict[str, str] = {}
    for path, one in packages:
        words = (one.attributes.get("name", ""), one.attributes.get("nsPrefix", ""), re.sub(r"\W", "_", path))
        free = [word for word in words if word.isidentifier() and word not in found.values()]
        word = free[0] if free else "package"
        while word in found.values():
            word += "_"
        found[path] = word
    return found


def _inside(element: Element, name: str) -> Iterator[Element]:
    return (child for child in element.children if child.name == name)


class _Reader:
    """The reading of one file.

    Attributes:
        packages: with their paths.
    """

    def __init__(self, document: EcoreDocument, joint: _Joint) -> None:
        self.document = document
        self.places = document.places
        self.packages: list[tuple[str, Element]] = []
        self.span = self.places.source.span(0, 0)
        self._others: dict[str, tuple[_Reader | None, Element | None]] = {}
        self._joint = joint
        self._kinds = joint.kinds
        self._owners = joint.owners

    def begin(self) -> bool:
        """Whether the file has a package."""
        root, problem = self.document.root, self.document.problem
        if problem or root is None:
            self._joint.diagnostics.extend([problem] if problem else [])
            self._joint.lost |= self.names()
            return False
        return self._is_package(root)

    def enter(self, paths: set[str]) -> None:
        """Notes the packages and what is in them; those of a second file are inside of the first one's."""
        self.document.index(self._owners)
        root = self._root
        path = root.attributes.get("name") or "package" if paths else ""
        while path in paths:
            path += "_"
        self._enter_package(path, root)
        paths |= {path for path, _ in self.packages}

    @property
    def _root(self) -> Element:
        assert self.document.root is not None
        return self.document.root

    def names(self) -> set[str]:
        """All words of the text: each may be a name of something that was not read."""
        return set(re.findall(r"[^\W\d]\w*", self.places.source.text))

    def begin_metamodel(self, root: Element) -> str:
        """The name of the outermost package."""
        if "name" in root.attributes:
            self.span = self._at(root, "name")
        return self._name(root, "package")

    # --- packages and what is in them ---

    def _is_package(self, root: Element) -> bool:
        if root.name == "EPackage" and root.namespace == ECORE:
            return True
        where = self.places.tag(root.byte)
        hint: str | None
        if root.name == "XMI" and "/XMI" in (root.namespace or ""):
            message = f"the file holds {len(root.children)} packages"
            hint = "put them into one package, as `eSubpackages`"
        elif root.name == "EPackage":
            message = "this is an `EPackage` of another language than Ecore"
            hint = f'write `xmlns:ecore="{ECORE}"` and `ecore:EPackage`'
        else:
            message = f"a metamodel is an `ecore:EPackage`, and this is a `{root.tag}`"
            hint = "a model has the ending `.xmi`" if root.namespace else None
        self._error("not-ecore", message, where, hint)
        return False

    def _enter_package(self, path: str, element: Element, depth: int = 0) -> None:
        self.packages.append((path, element))
        self._kinds[element] = "EPackage"
        self._check_parts(element, "EPackage")
        if depth > _DEEPEST:
            self._error("nested-too-deeply", "packages are nested too deeply", self.places.tag(element.byte))
            return
        for classifier in _inside(element, "eClassifiers"):
            self._enter_classifier(classifier)
        for inner in _inside(element, "eSubpackages"):
            name = inner.attributes.get("name", "")
            self._enter_package(f"{path}.{name}" if path else name, inner, depth + 1)

    def _enter_classifier(self, element: Element) -> None:
        kind = self._kind(element, ("EClass", "EEnum", "EDataType"), "a classifier")
        if kind is None:
            self._joint.lost.add(element.attributes.get("name", ""))
            return
        self._kinds[element] = kind
        self._check_parts(element, kind)
        features = ("EAttribute", "EReference")
        for member in _inside(element, "eStructuralFeatures") if kind == "EClass" else ():
            found = self._kind(member, features, "a feature")
            if found is None:
                self._joint.lost.add(member.attributes.get("name", ""))
            else:
                self._kinds[member] = found
                self._check_parts(member, found)
        for literal in _inside(element, "eLiterals") if kind == "EEnum" else ():
            self._check_parts(literal, "EEnumLiteral")

    def _kind(self, element: Element, known: Sequence[str], what: str) -> str | None:
        """The `xsi:type` of an element."""
        key = element.qualified("type", XSI, XMI)
        if key is None:
            wrong = next((one for one in element.attributes if one.endswith(":type")), None)
            if wrong:
                where, prefix = self.places.name_of(element.byte, wrong), wrong.rpartition(":")[0]
                message, hint = (
                    f"the prefix `{prefix}` is not declared",
                    f'write `xmlns:xsi="{XSI}"` in the first tag',
                )
                self._error("unknown-prefix", message, where, hint)
                return None
            hint = f'write `xsi:type="ecore:{known[0]}"`'
            self._error("missing-type", f"{what} needs an `xsi:type`", self.places.tag(element.byte), hint)
            return None
        value = element.attributes[key]
        prefix, _, name = value.rpartition(":")
        if name in known and element.scope.get(prefix) == ECORE:
            return name
        where = self._at(element, key)
        if name in known:
            hint = did_you_mean(prefix, element.scope) or f'write `xmlns:{prefix}="{ECORE}"` in the first tag'
            self._error("unknown-prefix", f"the prefix `{prefix}` does not stand for Ecore", where, hint)
        else:
            hint = did_you_mean(name, known) or "there are " + ", ".join(f"`ecore:{one}`" for one in known)
            self._error("unknown-type", f"{what} cannot be `{value}`", where, hint)
        return None

    def _check_parts(self, element: Element, kind: str) -> None:
        """Attributes and tags that Ecore does not know here are typing mistakes, and would be overlooked."""
        attributes, children = _ATTRIBUTES[kind].split(), _CHILDREN[kind].split()
        for key in element.attributes:
            if ":" not in key and key != "xmlns" and key not in attributes:
                where = self.places.name_of(element.byte, key)
                message = f"`{kind}` has no attribute `{key}`"
                self._error("unknown-attribute", message, where, did_you_mean(key, attributes))
        for child in element.children:
            if child.name not in (*children, "eAnnotations", "Extension"):
                message = f"`{kind}` has nothing called `{child.name}`"
                hint = did_you_mean(child.name, (*children, "eAnnotations"))
                self._error("unknown-element", message, self.places.tag(child.byte), hint)

    def package(self, path: str, element: Element) -> Package:
        uri, prefix = element.attributes.get("nsURI", ""), element.attributes.get("nsPrefix", "")
        name = element.attributes.get("name", "")
        if not uri:
            where = self.places.tag(element.byte)
            self._warn(
                "missing-uri", f"package `{name}` has no `nsURI`", where, "other files name it by that"
            )
        if path:
            self._name(element, "package")
        return Package(path, uri or path or name, prefix or name)

    # --- enums ---

    def enum(self, path: str, element: Element) -> EnumType:
        literals, labels, numbers, places = [], [], [], []
        for index, literal in enumerate(_inside(element, "eLiterals")):
            name = self._name(literal, "literal")
            literals.append(name)
            labels.append(literal.attributes.get("literal", name))
            # As in EMF, where the number is that of the enumeration's author, and 0 if nothing is said.
            numbers.append(self._integer(literal, "value", 0))
            places.append((f"literal {index}", self.named(literal)))
        usual = tuple(range(len(literals)))
        return EnumType(
            self._called(element, "enum"),
            tuple(literals),
            doc=self._doc(element),
            span=self.named(element),
            places=tuple(places),
            package=path,
            labels=() if labels == literals else tuple(labels),
            numbers=() if tuple(numbers) == usual else tuple(numbers),
        )

    # --- classes ---

    def cls(self, path: str, element: Element) -> Class:
        supertypes, places = [], []
        for target in self._supertypes(element):
            name = self._joint.names.get(target.element, "") if target.element else ""
            supertypes.append(name)
            places.append((f"extends {name}", target.span))
        features = [one for one in map(self._feature, _inside(element, "eStructuralFeatures")) if one]
        abstract = self._boolean(element, "abstract", False)
        marks = self._marks(element, features)
        self._check_class(element)
        return Class(
            self._called(element, "class"),
            abstract=self._boolean(element, "interface", False) or abstract,
            supertypes=tuple(supertypes),
            features=tuple(features),
            key=marks.key,
            glyph=marks.glyph,
            frozen=marks.frozen,
            doc=self._doc(element),
            annotations=self._annotations(element),
            span=self.named(element),
            places=(*places, *marks.places),
            package=path,
            left_out=self._left_out_of(element),
        )

    def _left_out_of(self, element: Element) -> tuple[tuple[str, str], ...]:
        members = [(one.attributes.get("name", ""), one) for one in _inside(element, "eStructuralFeatures")]
        known = self._joint.left_out
        return tuple((name, known[name][one]) for name, one in members if one in known.get(name, ()))

    def _supertypes(self, element: Element) -> Iterator[_Target]:
        targets = [*self._targets(element, "eSuperTypes"), *self._generic(element, "eGenericSuperTypes")]
        for target in targets:
            kind = self._kinds.get(target.element) if target.element else "data type"
            if kind == "EClass":
                yield target
            elif kind is not None:
                self._error("wrong-type", "a class extends classes only", target.span)

    def _check_class(self, element: Element) -> None:
        for part in _inside(element, "eTypeParameters"):
            self._no_generics(self.places.tag(part.byte))
        operations = list(_inside(element, "eOperations"))
        if operations:
            name = element.attributes.get("name", "")
            message = f"the operations of `{name}` are left out"
            self._warn("left-out", message, self.places.tag(operations[0].byte))

    def _marks(self, element: Element, features: Sequence[Feature]) -> _Marks:
        """Key, glyph and `frozen`: from an annotation of ours; an `iD` attribute is a key too."""
        marks = _Marks()
        for one, name, value in self._details(element):
            match name:
                case "key":
                    marks.key = tuple(value.split())
                    marks.places += tuple(
                        (f"key {part}", self.places.attribute(one.byte, "value", part)) for part in marks.key
                    )
                case "glyph":
                    letter, colour = value[:1], value[2:]
                    marks.glyph = Glyph(letter, colour) if colour else Glyph(letter)
                    span = self._at(one, "value")
                    marks.places += (("letter", span), ("colour", span))
                case "frozen":
                    marks.frozen = True
        identifiers = tuple(one.name for one in features if isinstance(one, Attribute) and one.identifier)
        marks.key = marks.key or identifiers
        return marks

    def _annotations(self, element: Element) -> tuple[Annotation, ...]:
        """What `metamodel_to_ecore` keeps of the annotations of a `.metamodel` file."""
        found = []
        for one, name, value in self._details(element):
            values = (value[:1], *value[2:].split()) if name == "glyph" else tuple(value.split())
            found.append(Annotation(name, values, span=self._at(one, "key")))
        return tuple(found)

    def _details(self, element: Element) -> Iterator[tuple[Element, str, str]]:
        for annotation in _inside(element, "eAnnotations"):
            if annotation.attributes.get("source") == _OWN:
                for one in _inside(annotation, "details"):
                    yield one, one.attributes.get("key", ""), one.attributes.get("value", "")

    # --- features ---

    def _feature(self, element: Element) -> Feature | None:
        kind = self._kinds.get(element)
        if kind is None:
            return None
        word = _left_out(element)
        if word:
            message = f"the {word} feature `{element.attributes.get('name', '')}` is left out"
            self._warn("left-out", message, self.places.name_of(element.byte, word))
            self._leave_out(element, f"it is {word}, and was left out of the metamodel")
            return None
        found = self._attribute(element) if kind == "EAttribute" else self._reference(element)
        if found is None:
            self._joint.lost.add(element.attributes.get("name", ""))
        return found

    def _leave_out(self, element: Element, why: str) -> None:
        name = element.attributes.get("name", "")
        self._joint.lost.add(name)
        self._joint.left_out.setdefault(name, {})[element] = why

    def _type(self, element: Element, what: str) -> _Target | None:
        """The one type of a feature; None if it has none or it cannot be read, which has been reported."""
        before = len(self._joint.diagnostics)
        found = [*self._targets(element, "eType"), *self._generic(element, "eGenericType")]
        if found:
            return found[0]
        if len(self._joint.diagnostics) == before and not self._mentions(element, ("eType", "eGenericType")):
            name = element.attributes.get("name", "")
            self._error(
                "missing-type", f"{what} `{name}` has no type", self.named(element), 'write `eType="..."`'
            )
        return None

    def _attribute(self, element: Element) -> Attribute | None:
        target = self._type(element, "attribute")
        lower, upper = self._bounds(element)
        name = self._name(element, "attribute")
        data = self._data_type(target, name) if target else None
        if upper != 1 and (data or target is None):
            message = f"`{name}` has many values and is left out: an attribute holds one"
            hint = "make a class with this attribute, and contain its objects"
            self._warn("left-out", message, self._at(element, "upperBound"), hint)
            self._leave_out(element, "it has many values, and was left out of the metamodel")
            return None
        if data is None or target is None:
            return None
        default = self._default(element, name, data.type)
        return Attribute(
            name,
            data.type,
            default,
            doc=self._doc(element),
            annotations=self._annotations(element),
            span=self.named(element),
            places=(("type", target.span), ("default", self._at(element, "defaultValueLiteral"))),
            optional=lower == 0 and data.nullable and default is None,
            identifier=self._boolean(element, "iD", False),
        )

    def _data_type(self, target: _Target, name: str) -> DataType | None:
        if target.data is not None:
            self._check_exact(target.data, name, target.span)
            return target.data
        if target.element is None:
            return None
        kind = self._kinds.get(target.element)
        if kind == "EEnum":
            return DataType(self._joint.enums[target.element])
        type_name = target.element.attributes.get("name", "")
        if kind == "EDataType":
            java = target.element.attributes
            data = java_type(java.get("instanceTypeName", java.get("instanceClassName", "")))
            self._check_exact(data, name, target.span)
            return data
        if kind == "EClass":
            hint = 'write `xsi:type="ecore:EReference"`'
            self._error("wrong-type", f"`{type_name}` is a class, not a data type", target.span, hint)
        elif kind is not None:
            self._error("wrong-type", f"`{type_name}` is no data type", target.span)
        return None

    def _check_exact(self, data: DataType, name: str, span: Span) -> None:
        if not data.exact:
            self._warn("read-as-string", f"values of `{name}` are read as strings", span)

    def _default(self, element: Element, name: str, type_: Scalar | EnumType) -> Value | None:
        text = element.attributes.get("defaultValueLiteral")
        if text is None:
            return None
        value = value_of(text, type_)
        if value is None:
            wanted = type_.name if isinstance(type_, EnumType) else str(type_)
            words = type_.labels or type_.literals if isinstance(type_, EnumType) else ("true", "false")
            numeric = type_ in (Scalar.INT, Scalar.FLOAT)
            hint = too_large(text, type_) if numeric else did_you_mean(text, words)
            message = f"default of `{name}` is not of type `{wanted}`"
            self._error("wrong-type", message, self._at(element, "defaultValueLiteral"), hint)
        return value

    def _reference(self, element: Element) -> Reference | None:
        target = self._type(element, "reference")
        lower, upper = self._bounds(element)
        name = self._name(element, "reference")
        if target is None:
            return None
        if target.element is None or self._kinds.get(target.element) in ("EEnum", "EDataType"):
            self._error(
                "wrong-type",
                "a reference leads to a class",
                target.span,
                'write `xsi:type="ecore:EAttribute"`',
            )
            return None
        if (
            self._kinds.get(target.element) != "EClass"
        ):  # else not even the kind is known, which has been reported
            if target.element in self._kinds:
                self._error("wrong-type", "a reference leads to a class", target.span)
            return None
        if upper != 1 and not self._boolean(element, "unique", True):
            where = self.places.name_of(element.byte, "unique")
            self._warn("unique", f"`{name}` holds an object once, and not several times", where)
        opposite = self._opposite(element, target.element)
        places = [("target", target.span)]
        bound = next((one for one in ("upperBound", "lowerBound") if one in element.attributes), None)
        if bound:
            places.append(("multiplicity", self._at(element, bound)))
        if opposite:
            places.append(("opposite", opposite[1]))
        return Reference(
            name,
            self._joint.names.get(target.element, ""),
            lower,
            upper,
            containment=self._boolean(element, "containment", False),
            opposite=opposite[0] if opposite else None,
            doc=self._doc(element),
            annotations=self._annotations(element),
            span=self.named(element),
            places=tuple(places),
        )

    def _opposite(self, element: Element, there: Element) -> tuple[str, Span] | None:
        """The name of the opposite, checked here: what a `.metamodel` file would say about it does not help."""
        for target in self._targets(element, "eOpposite"):
            other = target.element
            if other is None or other not in self._kinds:
                return None
            if self._kinds[other] != "EReference":
                self._error("opposite-mismatch", "an opposite is a reference", target.span)
                return None
            if _left_out(other):
                return None
            there_reader = target.reader
            back = {one.element for one in there_reader.quietly(other, "eOpposite")}
            types = {one.element for one in there_reader.quietly(other, "eType", "eGenericType")}
            told = ("eOpposite",), ("eType", "eGenericType")
            if not (back and types) and all(self._mentions(other, names) for names in told):
                return None  # what it says of itself cannot be read, which is reported there
            owner = self._owners[element]
            if self._owners[other] is not there or owner not in types or element not in back:
                mine, its = self._path(element), self._path(other)
                note = Note("the other reference is here", there_reader.named(other))
                cls = owner.attributes.get("name", "")
                file = "" if there_reader is self else self.places.source.name.rpartition("/")[2]
                hint = f'write `eOpposite="{file}{self._fragment(element)}"` there, and `{cls}` as its type'
                if self._owners[other] is not there:
                    hint = (
                        f"declare the opposite in `{there.attributes.get('name')}`, to which `{mine}` leads"
                    )
                message = f"`{mine}` and `{its}` are not each other's opposites"
                self._error("opposite-mismatch", message, target.span, hint, (note,))
                return None
            return other.attributes.get("name", ""), target.span
        return None

    def quietly(self, element: Element, *names: str) -> list[_Target]:
        """The targets, without another word on what is wrong with them."""
        self._joint.quiet = True
        found = [one for name in names for one in self._targets(element, name)]
        self._joint.quiet = False
        return found

    def _fragment(self, element: Element) -> str:
        names: list[str] = []
        while element is not self._root:
            names.append(element.attributes.get("name", ""))
            element = self._owners[element]
        return "#//" + "/".join(reversed(names))

    def _path(self, element: Element) -> str:
        return f"{self._owners[element].attributes.get('name', '')}.{element.attributes.get('name', '')}"

    # --- what names something else ---

    def _mentions(self, element: Element, names: Sequence[str]) -> bool:
        return any(name in element.attributes for name in names) or any(
            child.name in names for child in element.children
        )

    def _generic(self, element: Element, tag: str) -> Iterator[_Target]:
        """Types that are written as generic ones; without arguments they are plain types."""
        for child in _inside(element, tag):
            if "eTypeParameter" in child.attributes or child.children:
                self._no_generics(self.places.tag(child.byte))
                continue
            yield from self._targets(child, "eClassifier")

    def _no_generics(self, where: Span) -> None:
        hint = "write a class for each type that you need"
        self._error("generic-type", "generic types cannot be represented", where, hint)

    def _targets(self, element: Element, name: str) -> Iterator[_Target]:
        """What an attribute names (`#//A ecore:EClass other.ecore#//B`), and tags of that name with an `href`."""
        words = element.attributes.get(name, "").split()
        for index, word in enumerate(words):
            after = words[index + 1] if index + 1 < len(words) else ""
            if "#" not in word and ":" in word and "#" in after:
                continue  # the type of what comes next
            target = self._find(word, self.places.attribute(element.byte, name, word))
            if target:
                yield target
        for child in _inside(element, name):
            if "href" in child.attributes:
                target = self._find(child.attributes["href"], self._at(child, "href"))
                if target:
                    yield target

    def _find(self, text: str, span: Span) -> _Target | None:
        document, mark, fragment = text.rpartition("#")
        if not mark:
            document = ""
        last = fragment.rpartition("/")[2]
        types = library_types(document)
        if types is not None:
            if last in types:
                return _Target(None, types[last], span, self)
            self._unknown_library_type(last, types, span)
            return None
        reader, base = self._reader_of(document)
        if reader is None:
            self._no_file(document, last, span)
            return None
        if base is None:
            return None  # the file is no metamodel, which has been reported
        element = reader.document.at(fragment, base)
        if element is None:
            self._unknown_part(fragment, span, reader, base)
            return None
        return _Target(element, None, span, reader)

    def _reader_of(self, text: str) -> tuple[_Reader | None, Element | None]:
        """Who reads the file that is called so, and the package in it that is meant."""
        if text not in self._others:
            self._others[text] = self._look_for(text)
        return self._others[text]

    def _look_for(self, text: str) -> tuple[_Reader | None, Element | None]:
        if not text:
            return self, self._root
        for reader in self._joint.readers:
            for package in reader.document.packages:
                if package.attributes.get("nsURI") == text:
                    return reader, package
        known = self._joint.by_file
        path = unquote(text)
        here = self.places.source.name.rpartition("/")[0]
        exact = self.document.paths.get(text) or posixpath.normpath(posixpath.join(here, path))
        found = known.get(exact)
        # Files that were given, but not where this one says.
        last = path.rpartition("/")[2]
        near = [name for name in known if name.rpartition("/")[2] == last]
        if found is None and near and "://" not in path:
            near.sort(key=lambda name: len(posixpath.commonprefix([name[::-1], path[::-1]])))
            found = known[near[-1]]
        return found, found.document.root if found and found.document.is_package else None

    def _no_file(self, text: str, part: str, span: Span) -> None:
        key = (self.places.source.name, text)
        if self._joint.quiet or key in self._joint.missing:
            return
        self._joint.missing.add(key)
        if "://" in text:
            known = [uri for one in self._joint.readers for uri in one.document.calls()]
            message, file = f"none of the files has the package `{text}`", "its file"
            hint = near_uri(text, known)
        else:
            last = unquote(text).rpartition("/")[2]
            message, file, hint = f"`{text}`: there is no such file", f"`{last}`", None
        hint = hint or f"name {file}, which has `{part}`, too: for example with `--metamodel`"
        self._error("missing-file", message, span, hint)

    def _unknown_library_type(self, name: str, types: Mapping[str, DataType], span: Span) -> None:
        if self._joint.quiet:
            return
        if name == "EObject":
            message, hint = (
                "`EObject` is any object, which cannot be represented",
                "name a class, such as a common supertype",
            )
        elif name in ("EFeatureMapEntry", "EStringToStringMapEntry", "EMap", "EEList"):
            message, hint = f"`{name}` cannot be represented: there are no feature maps", "use references"
        else:
            message = (
                f"Ecore has no type `{name}` that could be read"
                if types is ECORE_TYPES
                else f"unknown type `{name}`"
            )
            hint = did_you_mean(name, types) or ""
        self._error("unknown-type", message, span, hint or None)

    def _unknown_part(self, fragment: str, span: Span, reader: _Reader, base: Element) -> None:
        if self._joint.quiet:
            return
        document = reader.document
        steps = [step for step in fragment.split("/") if step]
        name = steps[-1] if steps else fragment
        if name in self._joint.lost:
            return
        around = document.at("/" + "/".join(["", *steps[:-1]]), base) if len(steps) > 1 else base
        if around is None:  # the class is unknown, and not only its feature
            name, around = steps[0], base
        known = list(document.parts(around))
        hint = did_you_mean(name, known)
        if self._kinds.get(around) == "EClass":
            message = f"`{around.attributes.get('name')}` has no feature `{name}`"
            self._error("unknown-reference", message, span, hint)
            return
        file = "" if reader is self else f" in {document.source.name.rpartition('/')[2]}"
        if hint is None and name in ECORE_TYPES:
            hint = f"write `ecore:EDataType {ECORE}#//{name}` for the data type"
        elif hint is None and not fragment.startswith("/"):
            hint = f"write `#//{name}` for a class of this file" if name in known and not file else None
        self._error("unknown-class", f"unknown class or data type `{name}`{file}", span, hint)

    # --- parts of an element ---

    def _name(self, element: Element, what: str) -> str:
        name = element.attributes.get("name", "")
        if not name:
            where = self.places.tag(element.byte)
            self._error("missing-name", f"the {what} has no name", where, 'write `name="..."`')
            return f"unnamed_{element.byte}"
        return name

    def _called(self, element: Element, what: str) -> str:
        """What a class or an enum is called in the metamodel."""
        return self._name(element, what) and (self._joint.names[element] or f"unnamed_{element.byte}")

    def named(self, element: Element) -> Span:
        return self._at(element, "name")

    def _at(self, element: Element, attribute: str) -> Span:
        return self.places.attribute(element.byte, attribute)

    def _doc(self, element: Element) -> str | None:
        for annotation in _inside(element, "eAnnotations"):
            if annotation.attributes.get("source") == _GENMODEL:
                for one in _inside(annotation, "details"):
                    if one.attributes.get("key") == "documentation":
                        return one.attributes.get("value")
        return None

    def _boolean(self, element: Element, name: str, otherwise: bool) -> bool:
        text = element.attributes.get(name)
        if text not in (None, "true", "false"):
            hint = did_you_mean(text, ("true", "false")) or "write `true` or `false`"
            self._error(
                "wrong-type", f"`{name}` is true or false, not `{text}`", self._at(element, name), hint
            )
            return otherwise
        return otherwise if text is None else text == "true"

    def _integer(self, element: Element, name: str, otherwise: int) -> int:
        text = element.attributes.get(name)
        if text is None:
            return otherwise
        if not re.fullmatch(r"[+-]?[0-9]{1,10}", text):
            hint = "write `-1` for any number" if name == "upperBound" else None
            self._error("wrong-type", f"`{name}` is a number, not `{text}`", self._at(element, name), hint)
            return otherwise
        return int(text)

    def _bounds(self, element: Element) -> tuple[int, int | None]:
        lower, upper = self._integer(element, "lowerBound", 0), self._integer(element, "upperBound", 1)
        return lower, None if upper < 0 else upper

    def check_instance(self, element: Element) -> None:
        if self._kinds.get(element) == "EDataType":
            self._name(element, "data type")

    # --- messages ---

    def _error(
        self, code: str, message: str, where: Span, hint: str | None = None, notes: tuple[Note, ...] = ()
    ) -> None:
        if self._joint.quiet:
            return
        self._joint.diagnostics.append(Diagnostic(code, message, where, hint, notes=notes))
        self._joint.errors += 1
        if self._joint.errors == _MOST:
            message = "too many mistakes: the rest of the file is not read"
            self._joint.diagnostics.append(Diagnostic("too-many-errors", message, where))
            raise _Enough

    def _warn(self, code: str, message: str, where: Span, hint: str | None = None) -> None:
        self._joint.warnings += 1
        if self._joint.warnings > _MOST + 1:
            return
        if self._joint.warnings > _MOST:
            code, message, hint = "too-many-warnings", "too many warnings: the others are not shown", None
        self._joint.diagnostics.append(Diagnostic(code, message, where, hint, Severity.WARNING))
