"""The elements of a metamodel as frozen data: classes, attributes, references, enums and annotations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from enum import StrEnum
from math import isnan
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import LARGEST_INT, Span, parse_float, parse_int

PartSpans = tuple[tuple[str, Span], ...]
"""The spans of the parts of a definition in its text: ("extends A", span), ("target", span) ..."""

Value = int | float | bool | str
"""A data value. An enum literal is stored as its name, a `str`; the static type determines its enum."""

Values = tuple[Value, ...]
"""The values of an attribute with many values."""


SUPPRESS: Final = "suppress"
"""The annotation that hides warnings in the annotated definition; it is allowed on all definitions."""


class Scalar(StrEnum):
    """The four built-in data types: int (64 bits), float, bool and string."""

    INT = "int"
    FLOAT = "float"
    BOOL = "bool"
    STRING = "string"


@dataclass(frozen=True, slots=True)
class EnumType:
    """An enumeration; a literal's index is its position in `literals`.

    Attributes:
        package: path of the nested package of the enum, see `Package`.
        labels, numbers: text and number that other tools write for each literal; () if these are the literal itself
            and its index.
        places: spans of the parts "literal 0", "literal 1" ...
    """

    name: str
    literals: tuple[str, ...]
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    places: PartSpans = field(default=(), compare=False, repr=False)
    package: str = ""
    labels: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()
    annotations: tuple[Annotation, ...] = ()


AttributeType = Scalar | EnumType


@dataclass(frozen=True, slots=True)
class Annotation:
    """An annotation `@name(1, key = "v")`: positional values, then named ones in the order of the text.

    Names as arguments (`@key(y, x)`, `@hom(a, b)`) are stored as positional strings. Three annotations are settings
    for other tools: `@ecore(changeable = "false")` for XML attributes of Ecore, `@annotation("source", key = "value")`,
    and `@datatype("Money", instanceClassName = "java.math.BigDecimal")`.

    Attributes:
        places: spans of the name ("@") and of each `named` value (its key), in the order of the text.
    """

    name: str
    arguments: tuple[Value, ...] = ()
    named: tuple[tuple[str, Value], ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    places: PartSpans = field(default=(), compare=False, repr=False)

    def is_from(self, source: str) -> bool:
        """Return True if this is an `@annotation` with the given source."""
        return self.name == "annotation" and self.arguments[:1] == (source,)

    @property
    def details(self) -> Sequence[tuple[str, str]]:
        """Return the keys and texts of an `@annotation`; in `arguments`, keys and texts alternate."""
        words = self.arguments[1:]
        pairs = (*zip(words[::2], words[1::2], strict=True), *self.named)
        return [(str(key), str(text)) for key, text in pairs]


@dataclass(frozen=True, slots=True)
class Glyph:
    """The display of an object of a class: one letter, and a colour as "#rrggbb"."""

    letter: str
    colour: str = "#adb5bd"


class _FeatureBase:
    """The base class of features, which have a multiplicity."""

    __slots__ = ()

    lower: int
    upper: int | None

    @property
    def many(self) -> bool:
        """Return True if an object may have more than one target or value."""
        return self.upper is None or self.upper > 1

    @property
    def multiplicity(self) -> str:
        """Return the multiplicity as a `.metamodel` file writes it, without the brackets."""
        if self.upper == self.lower:
            return str(self.lower)
        return f"{self.lower}..{'*' if self.upper is None else self.upper}"


@dataclass(frozen=True, slots=True)
class Attribute(_FeatureBase):
    """A data feature of a class.

    An attribute with many values is a list in the order of insertion. Patterns treat it as a relation between objects
    and values, in which each value occurs once.

    Attributes:
        default: the declared default; None means 0, 0.0, False, "" or the first literal. None for many values.
        owner: name of the declaring class; filled in by `Metamodel`.
        index: position in `Metamodel.attributes`; filled in by `Metamodel`.
        lower, upper: multiplicity; `upper` None is `*`. With 0..1 an object may have no value.
        unique: True if the values of one object must differ; False with `@nonunique`.
        identifier: True if no two objects of a file have the same value, so that links can use it (Ecore's `iD`).
        places: spans of the parts "type", "multiplicity", "default".
    """

    name: str
    type: AttributeType
    default: Value | None = None
    owner: str = ""
    index: int = field(default=-1, compare=False, repr=False)
    doc: str | None = None
    annotations: tuple[Annotation, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    places: PartSpans = field(default=(), compare=False, repr=False)
    lower: int = 1
    upper: int | None = 1
    unique: bool = True
    identifier: bool = False

    @property
    def optional(self) -> bool:
        """Return True if an object may have no value."""
        return self.lower == 0

    @property
    def initial(self) -> Value | Values:
        """Return the value in a new object; () for an attribute with many values."""
        if self.many:
            return ()
        if self.default is None:
            return default_value(self.type)
        return float(self.default) if self.type is Scalar.FLOAT else self.default

    @property
    def is_decimal(self) -> bool:
        """Return True if the attribute's type in `@ecore` is a decimal number of any precision."""
        named = dict(pair for one in self.annotations if one.name == "ecore" for pair in one.named)
        name = str(named.get("eType", "EDouble")).rpartition("/")[2]
        return self.type is Scalar.FLOAT and not name.removesuffix("Object").endswith(("Double", "Float"))

    @property
    def range(self) -> tuple[int | float, int | float, int | float] | None:
        """Return lowest value, highest value and step according to `@range`; None without this annotation.

        The default step is 1, or for a float a tenth of the range.
        """
        found = next((one for one in self.annotations if one.name == "range"), None)
        if found is None:
            return None
        steps = [value for key, value in found.named if key == "step" and isinstance(value, int | float)]
        lowest, highest = (float(v) if self.type is Scalar.FLOAT else v for v in found.arguments)
        assert isinstance(lowest, int | float) and isinstance(highest, int | float)
        return lowest, highest, (*steps, 1 if self.type is Scalar.INT else (highest - lowest) / 10)[0]

    def __str__(self) -> str:
        return f"{self.owner}.{self.name}"


@dataclass(frozen=True, slots=True)
class Reference(_FeatureBase):
    """Directed links to objects of class `target`.

    Attributes:
        lower, upper: multiplicity; `upper` None is `*`. `[1]` is 1, 1.
        containment: True if the source owns the target.
        opposite: name of the reference of `target` that holds the same links in the other direction.
        owner: name of the declaring class; filled in by `Metamodel`.
        index: position in `Metamodel.references`; filled in by `Metamodel`.
        places: spans of the parts "target", "multiplicity", "opposite".
    """

    name: str
    target: str
    lower: int = 1
    upper: int | None = 1
    containment: bool = False
    opposite: str | None = None
    owner: str = ""
    index: int = field(default=-1, compare=False, repr=False)
    doc: str | None = None
    annotations: tuple[Annotation, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    places: PartSpans = field(default=(), compare=False, repr=False)

    def __str__(self) -> str:
        return f"{self.owner}.{self.name}"


Feature = Attribute | Reference


@dataclass(frozen=True, slots=True)
class Class:
    """A class; `features` are the features that it declares itself, in the order of the text.

    Attributes:
        supertypes: names of the direct supertypes.
        key: names of the attributes that identify an object in every member of a family (`@key`), or ().
        glyph: letter and colour (`@glyph`), or None; not inherited.
        frozen: True if derived operators must not change its objects (`@frozen`).
        package: path of the nested package of the class, see `Package`.
        left_out: names of features that are in the file but were not read, each with the reason.
        places: spans of the parts "extends A" (each supertype), "key a" (each key attribute), "letter", "colour".
    """

    name: str
    abstract: bool = False
    supertypes: tuple[str, ...] = ()
    features: tuple[Feature, ...] = ()
    key: tuple[str, ...] = ()
    glyph: Glyph | None = None
    frozen: bool = False
    doc: str | None = None
    annotations: tuple[Annotation, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    places: PartSpans = field(default=(), compare=False, repr=False)
    package: str = ""
    left_out: tuple[tuple[str, str], ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Package:
    """A namespace of classes and enums, for the formats of other tools; names are unique in the whole metamodel.

    If two packages have a class or an enum of the same name, both are named after their packages: `city::State` and
    `machine::State`.

    Attributes:
        path: "" for the metamodel itself, "a.b" for a package `b` in a package `a` in it.
        uri: the URI by which files refer to the package.
        prefix: the short form of the URI in files.
        annotations: those of the package, then each `@datatype`, followed by the annotations of that type.
    """

    path: str
    uri: str
    prefix: str
    annotations: tuple[Annotation, ...] = ()


def simple_name(name: str) -> str:
    """Return the name of a class or an enum without the name of its package.

    >>> simple_name("city::State"), simple_name("Street")
    ('State', 'Street')
    """
    return name.rpartition("::")[2]


def part_span(item: EnumType | Attribute | Reference | Class, part: str) -> Span | None:
    """Return the span of a part of a definition; the definition's own span if that of the part is unknown."""
    return dict(item.places).get(part, item.span)


def default_value(type_: AttributeType) -> Value:
    """Return the value of an attribute without a declared default.

    >>> default_value(Scalar.FLOAT), default_value(EnumType("Way", ("west", "east")))
    (0.0, 'west')
    """
    if isinstance(type_, EnumType):
        return type_.literals[0]
    match type_:
        case Scalar.INT:
            return 0
        case Scalar.FLOAT:
            return 0.0
        case Scalar.BOOL:
            return False
        case Scalar.STRING:
            return ""


def parse_value(text: str, type_: Scalar) -> Value | None:
    """Parse a text as a value of a scalar type; return None if it is invalid. A float may be `inf` or `-inf`."""
    match type_:
        case Scalar.INT:
            return parse_int(text)
        case Scalar.FLOAT:
            return float(text) if text in ("inf", "-inf") else parse_float(text)
        case Scalar.BOOL:
            return {"true": True, "false": False}.get(text)
        case Scalar.STRING:
            return text


def accepts(type_: AttributeType, value: object) -> bool:
    """Return True if an attribute of this type can store the value; for a float also an int, which is converted.

    >>> accepts(Scalar.FLOAT, 1), accepts(Scalar.INT, True), accepts(Scalar.FLOAT, float("nan"))
    (True, False, False)
    >>> accepts(Scalar.INT, 2**63 - 1), accepts(Scalar.INT, 2**63)
    (True, False)
    """
    if isinstance(type_, EnumType):
        return isinstance(value, str) and value in type_.literals
    match type_:
        case Scalar.INT:
            return type(value) is int and -LARGEST_INT - 1 <= value <= LARGEST_INT
        case Scalar.FLOAT:
            # NaN is not equal to itself, so no query could find it again.
            return _fits_float(value) if type(value) is int else type(value) is float and not isnan(value)
        case Scalar.BOOL:
            return type(value) is bool
        case Scalar.STRING:
            return type(value) is str


def _fits_float(value: int) -> bool:
    try:
        float(value)
    except OverflowError:
        return False
    return True


def type_name(type_: AttributeType) -> str:
    """Return the name of the type in files."""
    return type_.name if isinstance(type_, EnumType) else str(type_)
