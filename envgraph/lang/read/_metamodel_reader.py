"""Convert the syntax trees of `.metamodel` files to a `Metamodel`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import field

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import (
    Diagnostic,
    Note,
    ResolutionError,
    Severity,
    Span,
    has_errors,
    name_hint,
    quote_with_article,
)
from envgraph.lang.read._file_reading import FileReading
from envgraph.lang.syntax._parser import (
    ParseResult,
    annotation_of,
    select_tokens,
    select_trees,
    signed_number_of,
)
from envgraph.metamodel import (
    SUPPRESS,
    Annotation,
    Attribute,
    AttributeType,
    Class,
    EnumType,
    Glyph,
    Metamodel,
    Package,
    PartSpans,
    Reference,
    Scalar,
    Value,
    check_classes,
    type_name,
)
from envgraph.pattern import data_type_hint

_TOOL_ANNOTATIONS = {
    "annotation": 'write `@annotation("source", key = "value")`',
    "ecore": 'write `@ecore(changeable = "false")`',
    "datatype": 'write `@datatype("Money", instanceClassName = "java.math.BigDecimal")`',
}
"""The annotations that only other tools use, each with a hint that shows its syntax."""
_ECORE_PROPERTIES = (
    "changeable volatile transient unsettable ordered resolveProxies eKeys eOpposite eType lowerBound upperBound "
    "unique defaultValueLiteral derived interface abstract instanceClassName instanceTypeName serializable"
)
_REFERENCE_ANNOTATIONS = ("derived", "frozen", "annotation", "ecore")
_ATTRIBUTE_ANNOTATIONS = (*_REFERENCE_ANNOTATIONS, "range", "glyph", "colour", "nonunique")
_ANNOTATION_TARGETS = {
    "key": "classes",
    "glyph": "classes and attributes",
    "colour": "attributes",
    "derived": "features",
    "frozen": "classes and features",
    "range": "attributes",
    "nonunique": "attributes",
    "datatype": "the header",
}


@dataclass(frozen=True, slots=True)
class MetamodelFile:
    """The metamodel and the diagnostics of a `.metamodel` file.

    Attributes:
        metamodel: None when there are errors.
        span: the name of the metamodel, or the start of the file if there is none.
        lost: names that may be defined in text that could not be read.
    """

    metamodel: Metamodel | None
    span: Span
    diagnostics: tuple[Diagnostic, ...]
    lost: frozenset[str] = frozenset()


def read_metamodel(parsed: ParseResult) -> MetamodelFile:
    """Return the metamodel of a parsed file, with all diagnostics; syntax errors are included."""
    reader = _MetamodelReader(parsed, list(parsed.diagnostics))
    metamodel = reader.read()
    return MetamodelFile(metamodel, reader.name_span, tuple(reader.diagnostics), reader.all_lost())


@dataclass(slots=True)
class ClassMarks:
    """The values of a class's annotations `@key`, `@glyph` and `@frozen`, with their spans."""

    key: tuple[str, ...] = ()
    glyph: Glyph | None = None
    frozen: bool = False
    places: PartSpans = ()


@dataclass(slots=True)
class _MetamodelReader(FileReading):
    name_span: Span = field(init=False)
    _enums: dict[str, EnumType] = field(default_factory=dict)
    _class_names: list[str] = field(default_factory=list)

    def read(self) -> Metamodel | None:
        self.name_span = self.parsed.source.span_between(0, 0)
        if self.parsed.tree is None:
            return None
        definitions = select_trees(self.parsed.tree.children)
        name, uri = self._parse_header(definitions)
        notes = [
            one
            for header in select_trees(definitions, "header")
            for one in self._parse_annotations(header, _TOOL_ANNOTATIONS)
        ]
        enums = [self._parse_enum(tree) for tree in select_trees(definitions, "enum")]
        self._enums = {enum.name: enum for enum in reversed(enums)}
        class_trees = select_trees(definitions, "class")
        self._class_names = [str(select_tokens(tree.children, "NAME")[0]) for tree in class_trees]
        classes = [self._parse_class(tree) for tree in class_trees]
        if has_errors(self.diagnostics):
            self.diagnostics += check_classes(classes, enums, self.all_lost())
            return None
        try:
            package = Package("", uri or name, name, tuple(notes))
            return Metamodel(name, classes, enums, uri, (package,))
        except ResolutionError as error:
            self.diagnostics.extend(error.diagnostics)
            return None

    # --- definitions ---

    def _parse_header(self, definitions: list[Tree[Token]]) -> tuple[str, str | None]:
        headers = select_trees(definitions, "header")
        for header in headers[1:]:
            first = self.span(select_tokens(headers[0].children)[0])
            self.error(
                "duplicate-definition",
                "a file can define only one metamodel",
                select_tokens(header.children)[0],
                "move it to a file of its own, or leave it out",
                notes=(Note("the first definition is here", first),),
            )
        if not headers:
            if not self.parsed.diagnostics:
                hint = "start the file with `metamodel` and a name"
                self.error("missing-header", "the metamodel has no name", self.name_span, hint)
            return "metamodel", None
        if headers[0] is not definitions[0]:
            hint, message = (
                "move this line to the top",
                "the line with the name of the metamodel must come first",
            )
            self.error("misplaced-header", message, select_tokens(headers[0].children)[0], hint)
        name, uri = (
            select_tokens(headers[0].children, "NAME", "STRING")[0],
            select_tokens(headers[0].children, "STRING"),
        )
        self.name_span = self.span(name)
        following = self.parsed.source.text[self.name_span.end :].split(maxsplit=1)
        if self.name_span.text == "abstract" and following[:1] == ["class"]:
            self.error("unexpected-token", "unexpected `abstract`", name, "expected a name")
        return str(name), str(uri[0]) if uri else None

    def _parse_enum(self, tree: Tree[Token]) -> EnumType:
        name = select_tokens(tree.children, "NAME")[0]
        literals = [select_tokens(literal.children)[0] for literal in select_trees(tree.children, "literal")]
        return EnumType(
            str(name),
            tuple(str(literal) for literal in literals),
            doc=self.parsed.doc_comment(tree),
            span=self.span(name),
            places=tuple((f"literal {i}", self.span(literal)) for i, literal in enumerate(literals)),
            annotations=self._parse_annotations(tree, ("annotation", "ecore")),
        )

    def _parse_class(self, tree: Tree[Token]) -> Class:
        name = select_tokens(tree.children, "NAME")[0]
        annotations, marks = self._parse_marks(tree)
        above = [token for part in select_trees(tree.children, "extends") for token in select_tokens(part.children)]
        members = [member for body in select_trees(tree.children, "body") for member in select_trees(body.children)]
        return Class(
            name=str(name),
            abstract=bool(select_tokens(tree.children, "ABSTRACT")),
            supertypes=tuple(str(token) for token in above),
            features=tuple(
                found
                for one in members
                if (found := self._parse_reference(one) if one.data == "reference" else self._parse_attribute(one))
            ),
            key=marks.key,
            glyph=marks.glyph,
            frozen=marks.frozen,
            doc=self.parsed.doc_comment(tree),
            annotations=annotations,
            span=self.span(name),
            places=(*((f"extends {token}", self.span(token)) for token in above), *marks.places),
        )

    # --- features ---

    def _parse_attribute(self, tree: Tree[Token]) -> Attribute | None:
        type_token, name = select_tokens(tree.children, "NAME")
        annotations = self._parse_annotations(tree, _ATTRIBUTE_ANNOTATIONS)
        multiplicity = select_trees(tree.children, "multiplicity")
        bounds = self.span(multiplicity[0]).text if multiplicity else ""
        type_ = self._parse_type(type_token, bounds, name)
        if type_ is None:
            self.lost.add(str(name))
            return None
        lower, upper = self._parse_bounds(multiplicity[0]) if multiplicity else (1, 1)
        defaults = [part for part in select_trees(tree.children) if part.data not in ("annotation", "multiplicity")]
        places = [("type", self.span(type_token))]
        places.extend(("multiplicity", self.span(part)) for part in multiplicity)
        single = next((one for one in annotations if one.name == "nonunique" and upper == 1), None)
        if single is not None:
            message = f"`@nonunique` needs an attribute with many values, but `{name}` has at most one"
            self.add(Diagnostic("unknown-annotation", message, single.span, "leave it out", Severity.WARNING))
        value = None
        if defaults:
            places.append(("default", self.span(defaults[0])))
            value = self._parse_default(defaults[0], type_, str(name))
        return Attribute(
            str(name),
            type_,
            value,
            doc=self.parsed.doc_comment(tree),
            annotations=annotations,
            span=self.span(name),
            places=tuple(places),
            lower=lower,
            upper=upper,
            unique=not any(annotation.name == "nonunique" for annotation in annotations),
        )

    def _parse_type(self, token: Token, bounds: str, name: Token) -> AttributeType | None:
        if token in set(Scalar):
            return Scalar(token)
        if token in self._enums:
            return self._enums[token]
        if token in self.parsed.lost_names:
            return None
        if token in self._class_names:
            rest = f"{token}{bounds} {name}"
            hint = f"write `refers {rest}` or `contains {rest}`"
            self.error("wrong-type", f"`{token}` is a class, not a data type", token, hint)
            return None
        known = [*Scalar, *self._enums, "contains", "refers"]
        # The next line may begin with a keyword that was read as the name of an unfinished attribute.
        is_turned = name in known and "\n" not in self.parsed.source.text[token.end_pos : name.start_pos]
        turned = f"write the type first: `{name}{bounds} {token}`" if is_turned else None
        advice = turned or data_type_hint(token) or name_hint(token, known)
        self.error("unknown-type", f"unknown type `{token}`", token, advice)
        return None

    def _parse_default(self, tree: Tree[Token], type_: AttributeType, name: str) -> Value | None:
        parts = select_tokens(tree.children)
        match tree.data:
            case "true":
                return True
            case "false":
                return False
            case "number":
                return float(signed_number_of(tree)) if type_ is Scalar.FLOAT else signed_number_of(tree)
            case "string":
                if isinstance(type_, EnumType):
                    self._report_wrong_default(tree, type_, name, f"write `::{parts[0]}` for a literal")
                    return None
                return str(parts[0])
        return self._parse_enum_default(tree, type_, name)

    def _parse_enum_default(self, tree: Tree[Token], type_: AttributeType, name: str) -> Value | None:
        *enum, literal = select_tokens(tree.children)
        if not isinstance(type_, EnumType):
            hint = f'write `"{literal}"` for a string' if type_ is Scalar.STRING else None
            self._report_wrong_default(tree, type_, name, hint)
            return None
        if enum and enum[0] != type_.name:
            hint = f"write `{type_.name}::` or `::`"
            self.error(
                "wrong-type",
                f"`{name}` must be {quote_with_article(type_.name)}, not {quote_with_article(enum[0])}",
                enum[0],
                hint,
            )
            return None
        return str(literal)

    def _report_wrong_default(self, tree: Tree[Token], type_: AttributeType, name: str, hint: str | None) -> None:
        hint = hint or "write a value of that type, or no default"
        self.error("wrong-type", f"default of `{name}` is not of type `{type_name(type_)}`", tree, hint)

    def _parse_reference(self, tree: Tree[Token]) -> Reference:
        annotations = self._parse_annotations(tree, _REFERENCE_ANNOTATIONS)
        target, name, *opposite = select_tokens(tree.children, "NAME")
        multiplicity = select_trees(tree.children, "multiplicity")
        lower, upper = self._parse_bounds(multiplicity[0]) if multiplicity else (1, 1)
        places = [("target", self.span(target))]
        places.extend(("multiplicity", self.span(part)) for part in multiplicity)
        places.extend(("opposite", self.span(part)) for part in opposite)
        return Reference(
            str(name),
            str(target),
            lower,
            upper,
            containment=bool(select_tokens(tree.children, "CONTAINS")),
            opposite=str(opposite[0]) if opposite else None,
            doc=self.parsed.doc_comment(tree),
            annotations=annotations,
            span=self.span(name),
            places=tuple(places),
        )

    def _parse_bounds(self, tree: Tree[Token]) -> tuple[int, int | None]:
        """Parse a multiplicity: `[2]` is 2..2, `[*]` is 0..*, `[]` is 0..* as in Xcore. The upper bound `*` is None."""
        bounds = [self._parse_bound(part) for part in select_trees(tree.children)]
        if not bounds:
            return 0, None
        first, last = bounds[0], bounds[-1]
        if first is None and len(bounds) == 2:
            self.error(
                "bad-multiplicity",
                "the lower bound must be a number",
                tree,
                "write `[*]`, `[1..*]` or `[0..3]`",
            )
            return 0, None
        return first or 0, last

    def _parse_bound(self, tree: Tree[Token]) -> int | None:
        return None if select_tokens(tree.children)[-1].type == "STAR" else int(signed_number_of(tree))

    # --- annotations ---

    def _parse_marks(self, tree: Tree[Token]) -> tuple[tuple[Annotation, ...], ClassMarks]:
        readers: dict[str, Callable[[Tree[Token], Annotation, ClassMarks], None]] = {
            "key": self._parse_key,
            "glyph": self._parse_glyph,
            "frozen": self._parse_frozen,
        }
        annotations = self._parse_annotations(tree, (*readers, "annotation", "ecore"))
        marks = ClassMarks()
        seen: dict[str, Span | None] = {}
        for part, annotation in zip(select_trees(tree.children, "annotation"), annotations, strict=True):
            if annotation.name in seen and annotation.name not in _TOOL_ANNOTATIONS:
                self.error(
                    "duplicate-annotation",
                    f"`@{annotation.name}` occurs twice",
                    part,
                    "leave one out",
                    notes=(Note("the first one is here", seen[annotation.name]),),
                )
            elif annotation.name in readers:
                readers[annotation.name](part, annotation, marks)
            seen.setdefault(annotation.name, annotation.span)
        return annotations, marks

    def _parse_annotations(self, tree: Tree[Token], known: Iterable[str]) -> tuple[Annotation, ...]:
        found = tuple(annotation_of(self.parsed.source, part) for part in select_trees(tree.children, "annotation"))
        for part, annotation in zip(select_trees(tree.children, "annotation"), found, strict=True):
            if annotation.name not in (*known, SUPPRESS):
                name = select_tokens(part.children)[0]
                place = _ANNOTATION_TARGETS.get(annotation.name)
                message = f"`@{name}` is allowed only on {place}" if place else f"unknown annotation `@{name}`"
                self.warn("unknown-annotation", message, name, name_hint(name, known))
            elif annotation.name in _TOOL_ANNOTATIONS:
                self._check_foreign(part, annotation)
        return found

    def _check_foreign(self, part: Tree[Token], one: Annotation) -> None:
        """Report an annotation for other tools with arguments that cannot be written to an `.ecore` file."""
        number, known = len(one.arguments), _ECORE_PROPERTIES.split()
        unknown = [key for key, _ in one.named if one.name != "annotation" and key not in known]
        right = number % 2 if one.name == "annotation" else number == (one.name == "datatype")
        texts = all(isinstance(value, str) for value in (*one.arguments, *dict(one.named).values()))
        if unknown:
            self.error("bad-annotation", f"Ecore has no property `{unknown[0]}`", part, name_hint(unknown[0], known))
        elif not right or not texts:
            message = f"`@{one.name}` takes only strings in quotes, in a fixed order"
            self.error("bad-annotation", message, part, _TOOL_ANNOTATIONS[one.name])

    def _parse_key(self, tree: Tree[Token], annotation: Annotation, marks: ClassMarks) -> None:
        names = self._unnamed_arguments(tree, "annotation_name")
        if not names:
            self.error("bad-annotation", "`@key` takes the names of attributes", tree, "write `@key(y, x)`")
            return
        marks.key = tuple(str(name) for name in names)
        marks.places = (*marks.places, *((f"key {name}", self.span(name)) for name in names))

    def _unnamed_arguments(self, tree: Tree[Token], kind: str) -> list[Token]:
        """Return the arguments of an annotation if all are of the given kind and have no keys; else an empty list."""
        arguments = select_trees(tree.children)
        values = [value for argument in arguments for value in select_trees(argument.children)]
        is_positional = all(one.data == "annotation_argument" for one in arguments)
        return [
            select_tokens(value.children)[0]
            for value in values
            if is_positional and all(v.data == kind for v in values)
        ]

    def _parse_glyph(self, tree: Tree[Token], annotation: Annotation, marks: ClassMarks) -> None:
        strings = self._unnamed_arguments(tree, "annotation_string")
        if self.parsed.has_mistake(tree):
            return
        if not 1 <= len(strings) <= 2:
            hint = 'write `@glyph("B", "#e8590c")`'
            self.error("bad-annotation", "`@glyph` takes a letter and a colour, both in quotes", tree, hint)
            return
        marks.glyph = Glyph(*(str(string) for string in strings))
        places = zip(("letter", "colour"), (self.span(string) for string in strings), strict=False)
        marks.places = (*marks.places, *places)

    def _parse_frozen(self, tree: Tree[Token], annotation: Annotation, marks: ClassMarks) -> None:
        marks.frozen = True
        if annotation.arguments or annotation.named:
            self.error("bad-annotation", "`@frozen` takes no arguments", tree, "write `@frozen`")
