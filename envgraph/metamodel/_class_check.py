"""Check a set of classes and enums for errors."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice

from envgraph.errors import (
    MAX_ERRORS,
    SHOWN,
    Diagnostic,
    Note,
    Span,
    did_you_mean,
    duplicate_diagnostics,
    name_hint,
    quote_names,
    too_many_errors_diagnostic,
)
from envgraph.metamodel._features import (
    Annotation,
    Attribute,
    Class,
    EnumType,
    Feature,
    Glyph,
    Reference,
    Scalar,
    accepts,
    part_span,
    type_name,
)
from envgraph.metamodel._inheritance import Inheritance, linearise


def check_classes(
    classes: Sequence[Class], enums: Sequence[EnumType], unknown: Collection[str] = ()
) -> list[Diagnostic]:
    """Return the problems of the classes and enums of one metamodel: at most one hundred, and a note if there are more.

    Args:
        classes: all known classes.
        enums: all known enums.
        unknown: names of classes and features that may be defined in text that could not be read; not reported.
    """
    found = list(islice(_all_problems(classes, enums, unknown), MAX_ERRORS + 1))
    if len(found) > MAX_ERRORS:
        found[MAX_ERRORS:] = [
            too_many_errors_diagnostic(found[MAX_ERRORS].span, "the remaining classes were not checked")
        ]
    return found


def _all_problems(
    classes: Sequence[Class], enums: Sequence[EnumType], unknown: Collection[str]
) -> Iterator[Diagnostic]:
    table = {cls.name: cls for cls in reversed(classes)}
    declared = {enum.name: enum for enum in reversed(enums)}
    above = Inheritance(classes, table, unknown)
    yield from _check_duplicates([*classes, *enums])
    yield from _check_names(classes, enums)
    for enum in enums:
        yield from _check_enum(enum)
    yield from _check_cycles(classes, above)
    for cls in classes:
        yield from _check_supertypes(cls, above)
        yield from _check_features(cls, above)
        yield from _check_types(cls, declared)
        yield from _check_key(cls, above)
        if cls.glyph is not None:
            yield from _check_glyph_parts(cls.glyph, cls.name, part_span(cls, "letter"), part_span(cls, "colour"))
        for attribute in (one for one in cls.features if isinstance(one, Attribute)):
            yield from _check_display_annotations(attribute)
            yield from _check_range(attribute)
    yield from _check_glyphs_differ(classes)


def _check_duplicates(named: Sequence[Class | EnumType | Feature], owner: str = "") -> Iterator[Diagnostic]:
    return duplicate_diagnostics(((one.name, one.span) for one in named), f"`{owner}{{}}` is defined twice")


def _check_names(classes: Sequence[Class], enums: Sequence[EnumType]) -> Iterator[Diagnostic]:
    """Yield errors for names that are not identifiers, or that are names of built-in types."""
    types: list[Class | EnumType] = [*classes, *enums]
    for type_ in types:
        if type_.name in tuple(Scalar):
            yield Diagnostic(
                "bad-name",
                f"`{type_.name}` is the name of a built-in type",
                type_.span,
                "choose another name",
            )
    named: list[Class | EnumType | Feature] = [
        *classes,
        *enums,
        *(f for cls in classes for f in cls.features),
    ]
    for item in named:
        if not item.name.isidentifier() and not (isinstance(item, Class | EnumType) and _is_qualified_name(item.name)):
            yield Diagnostic("bad-name", f"`{item.name}` is not a valid name", item.span, _name_hint(item.name))
    for enum in enums:
        for index, literal in enumerate(enum.literals):
            if not literal.isidentifier():
                span = part_span(enum, f"literal {index}")
                yield Diagnostic("bad-name", f"`{literal}` is not a valid name", span, _name_hint(literal))


def _name_hint(name: str) -> str:
    """Return a hint with a valid name that is similar to an invalid one."""
    meant = re.sub(r"\W+", "_", name).strip("_")
    meant = f"_{meant}" if meant[:1].isdigit() else meant
    return "use only letters, digits and `_`" + (f": `{meant}`" if meant.isidentifier() else "")


def _is_qualified_name(name: str) -> bool:
    """Return True if a name has the form `package::Name`."""
    return len(parts := name.split("::")) == 2 and all(part.isidentifier() for part in parts)


def _check_types(cls: Class, enums: Mapping[str, EnumType]) -> Iterator[Diagnostic]:
    for feature in cls.features:
        if isinstance(feature, Attribute) and isinstance(feature.type, EnumType):
            name = feature.type.name
            if enums.get(name) != feature.type:
                text = f"the enum `{name}` of `{feature.name}` differs from the metamodel's enum of this name"
                if name not in enums:
                    text = f"unknown enum `{name}`"
                yield Diagnostic("unknown-enum", text, part_span(feature, "type") or cls.span, name_hint(name, enums))


def _check_enum(enum: EnumType) -> Iterator[Diagnostic]:
    if not enum.literals:
        yield Diagnostic(
            "empty-enum",
            f"enum `{enum.name}` has no literals",
            enum.span,
            "add at least one literal",
        )
    literals = ((one, part_span(enum, f"literal {index}")) for index, one in enumerate(enum.literals))
    yield from duplicate_diagnostics(literals, f"literal `{{}}` of `{enum.name}` is defined twice", "leave it out")


def _check_supertypes(cls: Class, inherited: Inheritance) -> Iterator[Diagnostic]:
    table = inherited.table
    places = dict(cls.places)
    for above in cls.supertypes:
        span = places.get(f"extends {above}", cls.span)
        if above in inherited.unknown and above not in table:
            continue
        if above not in table:
            hint = name_hint(above, set(table) - {cls.name}) or f"declare it: `class {above} {{ }}`"
            yield Diagnostic("unknown-class", f"unknown class `{above}`", span, hint)
    if len(set(cls.supertypes)) != len(cls.supertypes):
        yield Diagnostic(
            "duplicate-definition", f"`{cls.name}` names a supertype twice", cls.span, "write each name once"
        )


def _check_cycles(classes: Sequence[Class], inherited: Inheritance) -> Iterator[Diagnostic]:
    """Yield one error for each inheritance cycle, at its first class."""
    cycles: dict[int, list[tuple[Class, str]]] = {}
    for cls in classes:
        for above in cls.supertypes:
            if (number := inherited.cycle_number(cls.name, above)) is not None:
                cycles.setdefault(number, []).append((cls, above))
    for (first, above), *others in cycles.values():
        notes = tuple(
            Note(f"`{cls.name}` extends `{up}` here", part_span(cls, f"extends {up}"))
            for cls, up in others[: SHOWN.notes]
        )
        message, hint = f"`{first.name}` is its own supertype", "remove one supertype of the cycle"
        span = part_span(first, f"extends {above}")
        yield Diagnostic("cyclic-inheritance", message, span, hint, notes=notes)


def _check_features(cls: Class, above: Inheritance) -> Iterator[Diagnostic]:
    yield from _check_duplicates(cls.features, f"{cls.name}.")
    yield from _check_inherited(cls, above)
    for feature in cls.features:
        yield from _check_bounds(feature, cls)
        if isinstance(feature, Attribute):
            yield from _check_default(feature, cls)
        else:
            yield from _check_reference(feature, cls, above)


def _check_bounds(feature: Feature, cls: Class) -> Iterator[Diagnostic]:
    lower, upper = feature.lower, feature.upper
    if lower < 0 or (upper is not None and (upper < 1 or upper < lower)):
        what = "values" if isinstance(feature, Attribute) else "targets"
        yield Diagnostic(
            "bad-multiplicity",
            f"`{feature.name}` cannot have {lower}..{'*' if upper is None else upper} {what}",
            part_span(feature, "multiplicity") or cls.span,
            "write the lower bound first; the upper bound must be at least 1",
        )


def _check_inherited(cls: Class, above: Inheritance) -> Iterator[Diagnostic]:
    """Yield errors for feature names that a class inherits from two classes, or that it both inherits and declares."""
    inherited: dict[str, tuple[str, Feature]] = {}
    for direct in dict.fromkeys(cls.supertypes):
        if above.cycle_number(cls.name, direct) is not None:
            continue  # Cycles are reported by `_check_cycles`.
        for owner, feature in above.shared_features(direct).values():
            known, _ = inherited.setdefault(feature.name, (owner, feature))
            if known != owner:
                yield Diagnostic(
                    "duplicate-definition",
                    f"`{cls.name}` inherits `{feature.name}` from both `{known}` and `{owner}`",
                    cls.span,
                    "rename one of them, or move it to a common supertype",
                )
    for feature in cls.features:
        if feature.name in inherited:
            owner, other = inherited[feature.name]
            yield Diagnostic(
                "duplicate-definition",
                f"`{cls.name}` already inherits `{feature.name}` from `{owner}`",
                feature.span or cls.span,
                "leave it out here, or choose another name",
                notes=(Note("inherited from here", other.span),),
            )


def _check_default(attribute: Attribute, cls: Class) -> Iterator[Diagnostic]:
    default = attribute.default
    if default is not None and attribute.many:
        yield Diagnostic(
            "bad-default",
            f"`{attribute.name}` has many values, so it cannot have a default",
            part_span(attribute, "default") or cls.span,
            "remove the default: a new object has no values",
        )
        return
    if default is None or accepts(attribute.type, default):
        return
    literals = attribute.type.literals if isinstance(attribute.type, EnumType) else ()
    hint = did_you_mean(default, literals) if isinstance(default, str) else None
    if hint is None and attribute.type is Scalar.INT and isinstance(default, float):
        hint = "write the type as `float`, or the default without a fraction"
    yield Diagnostic(
        "wrong-type",
        f"default of `{attribute.name}` is not of type `{type_name(attribute.type)}`",
        part_span(attribute, "default") or cls.span,
        hint or "write a value of that type, or no default",
    )


def _check_reference(reference: Reference, cls: Class, above: Inheritance) -> Iterator[Diagnostic]:
    table = above.table
    if reference.target not in table:
        if reference.target in above.unknown:
            return
        yield Diagnostic(
            "unknown-class",
            f"unknown class `{reference.target}`",
            part_span(reference, "target") or cls.span,
            name_hint(reference.target, table),
        )
        return
    if reference.opposite is not None:
        yield from _check_opposite(reference, cls, above)


def _check_opposite(reference: Reference, cls: Class, above: Inheritance) -> Iterator[Diagnostic]:
    span = part_span(reference, "opposite") or cls.span
    found = above.own_features(reference.target).get(reference.opposite or "")
    owner = reference.target
    there: dict[str, tuple[str, Feature]] = {}
    if not isinstance(found, Reference):
        there = {
            feature.name: (name, feature)
            for name in reversed(linearise(reference.target, above.table))
            for feature in above.table[name].features
        }
        owner, found = there.get(reference.opposite or "", ("", None))
    if not isinstance(found, Reference):
        if reference.opposite in above.unknown:
            return
        names = [name for name, (_, feature) in there.items() if isinstance(feature, Reference)]
        yield Diagnostic(
            "unknown-reference",
            f"`{reference.target}` has no reference `{reference.opposite}`",
            span,
            did_you_mean(reference.opposite or "", names)
            or f"declare `refers {cls.name}[0..1] {reference.opposite} opposite {reference.name}` "
            f"in `{reference.target}`",
        )
        return
    if owner == reference.target and _has_unknown_opposite(found, above):
        return  # That end is reported, since it is unknown which of the two ends is wrong.
    if owner != reference.target or found.target != cls.name or found.opposite != reference.name:
        yield Diagnostic(
            "opposite-mismatch",
            f"`{cls.name}.{reference.name}` and `{owner}.{found.name}` are not each other's opposites",
            span,
            f"declare `{'contains' if found.containment else 'refers'} {cls.name}[{found.multiplicity}] {found.name} "
            f"opposite {reference.name}` in `{reference.target}`",
            notes=(Note("the other reference is here", found.span),),
        )
    elif reference.containment and found.containment:
        yield Diagnostic(
            "opposite-mismatch",
            "both ends of a pair of opposites use `contains`",
            span,
            "write `refers` at one end",
        )
    elif reference.containment and found.many:
        yield Diagnostic(
            "bad-multiplicity",
            f"`{found.name}` leads to the container, so it can have at most 1 target",
            found.span or span,
            "write `[1]` or `[0..1]`",
        )


def _has_unknown_opposite(reference: Reference, above: Inheritance) -> bool:
    """Return True if a reference names an opposite that its target class, if known, neither declares nor inherits."""
    if reference.opposite is None or reference.target not in above.table:
        return False
    classes = linearise(reference.target, above.table)
    return not any(feature.name == reference.opposite for cls in classes for feature in above.table[cls].features)


def _check_key(cls: Class, above: Inheritance) -> Iterator[Diagnostic]:
    known: dict[str, Feature] = {f.name: f for f in cls.features}
    if any(name not in known for name in cls.key):
        known = {f.name: f for name in linearise(cls.name, above.table) for f in above.table[name].features}
    if len(set(cls.key)) != len(cls.key):
        twice = next(name for name in cls.key if cls.key.count(name) > 1)
        message = f"`@key` of `{cls.name}` names `{twice}` twice"
        yield Diagnostic("duplicate-definition", message, part_span(cls, f"key {twice}"), "write each name once")
    for name in cls.key:
        found = known.get(name)
        if isinstance(found, Attribute) and found.many:
            message = f"`@key` names `{name}`, which has many values"
            yield Diagnostic("many-valued", message, part_span(cls, f"key {name}"), "name an attribute with one value")
        elif not isinstance(found, Attribute) and name not in above.unknown:
            attributes = [key for key, one in known.items() if isinstance(one, Attribute) and not one.many]
            hint = "remove it: a key consists of attributes" if name in known else f"declare it: `int {name}`"
            yield Diagnostic(
                "unknown-attribute",
                f"`@key` names `{name}`, which is not an attribute of `{cls.name}`",
                part_span(cls, f"key {name}"),
                did_you_mean(name, attributes) or (f"use one of {quote_names(attributes)}" if attributes else hint),
            )


def _check_glyph_parts(glyph: Glyph, name: str, letter: Span | None, colour: Span | None) -> Iterator[Diagnostic]:
    if len(glyph.letter) != 1:
        message = f"the glyph of `{name}` is not a single letter"
        yield Diagnostic("bad-glyph", message, letter, "write one letter")
    if not re.fullmatch("#[0-9a-fA-F]{6}", glyph.colour):
        message = f"the glyph of `{name}` has the invalid colour `{glyph.colour}`"
        yield Diagnostic("bad-glyph", message, colour, "write `#rrggbb`")


def _check_display_annotations(attribute: Attribute) -> Iterator[Diagnostic]:
    """Yield errors for wrong uses of `@glyph` and `@colour` on an attribute.

    `@glyph` is for bools, enums and ints, and `@colour` for enums.
    """
    for mark in attribute.annotations:
        if mark.name in ("glyph", "colour") and attribute.many:
            message = f"`{attribute.name}` has many values, but `@{mark.name}` can show only one"
            yield Diagnostic("bad-glyph", message, mark.span, "leave it out")
        elif mark.name == "glyph" and isinstance(attribute.type, EnumType):
            yield from _check_letters(mark, attribute.type)
        elif mark.name == "glyph" and attribute.type is Scalar.INT:
            if mark.named or mark.arguments:
                message = "`@glyph` of an `int` takes no arguments: its digit is shown"
                yield Diagnostic("bad-annotation", message, mark.span, "write `@glyph`")
        elif mark.name == "glyph" and attribute.type is not Scalar.BOOL:
            message = f"`@glyph` needs a class or an attribute of type `bool`, enum or `int`, unlike `{attribute.name}`"
            yield Diagnostic("bad-glyph", message, mark.span, "leave it out")
        elif mark.name == "glyph":
            if mark.named or not 1 <= len(mark.arguments) <= 2:
                message = "`@glyph` takes a letter and a colour, both in quotes"
                yield Diagnostic("bad-annotation", message, mark.span, 'write `@glyph("o", "#868e96")`')
            else:
                glyph = Glyph(*map(str, mark.arguments))
                yield from _check_glyph_parts(glyph, attribute.name, mark.span, mark.span)
        elif mark.name == "colour" and not isinstance(attribute.type, EnumType):
            message = f"`@colour` needs an attribute of an enum type, unlike `{attribute.name}`"
            yield Diagnostic("bad-annotation", message, mark.span, "declare an enum whose literals are colours")


def _check_letters(mark: Annotation, enum: EnumType) -> Iterator[Diagnostic]:
    """Yield an error if the `@glyph` of an enum does not give one letter for each literal."""
    letters = [str(one) for one in mark.arguments if isinstance(one, str) and len(one) == 1]
    if mark.named or len(letters) != len(mark.arguments) or len(letters) != len(enum.literals):
        message = f"`@glyph` of an enum takes one letter for each literal; `{enum.name}` has {len(enum.literals)}"
        example = ", ".join(f'"{literal[:1]}"' for literal in enum.literals)
        yield Diagnostic("bad-annotation", message, mark.span, f"write `@glyph({example})`")


def _check_range(attribute: Attribute) -> Iterator[Diagnostic]:
    """Yield errors for wrong uses of `@range(lowest, highest, step = by)`, which is for numbers."""
    for mark in attribute.annotations:
        mistake = _range_problem(attribute, mark) if mark.name == "range" else None
        if mistake:
            yield Diagnostic("bad-annotation", mistake[0], mark.span, mistake[1])


def _range_problem(attribute: Attribute, mark: Annotation) -> tuple[str, str] | None:
    """Return message and hint for a wrong `@range` of an attribute; None if it is correct."""
    name, kind = attribute.name, attribute.type
    if attribute.many or kind not in (Scalar.INT, Scalar.FLOAT):
        return f"`@range` needs an `int` or `float` with one value, unlike `{name}`", "leave it out"
    hint = "write `@range(0, 10)` or `@range(0, 10, step = 2)`"
    named = dict(mark.named)
    if len(mark.arguments) != 2 or set(named) - {"step"}:
        return f"`@range` of `{name}` takes the lowest and the highest value, and optionally a step", hint
    given = (*mark.arguments, named.get("step", 1))
    numbers = [value for value in given if isinstance(value, int | float) and accepts(kind, value)]
    if len(numbers) < len(given):
        return f"the values of the range of `{name}` must be of type `{kind}`", hint
    lowest, highest, step = numbers
    if not lowest < highest:
        hint = f"write `@range({highest}, {lowest})`" if highest < lowest else hint
        return f"the range of `{name}` ends at {highest}, which is not above {lowest}", hint
    if not step > 0:
        return f"the step of `{name}` is {step}, but must be above 0", hint
    return None


def _check_glyphs_differ(classes: Sequence[Class]) -> Iterator[Diagnostic]:
    first: dict[str, Class] = {}
    for cls in classes:
        if cls.glyph is None:
            continue
        other = first.setdefault(cls.glyph.letter, cls)
        if other is not cls and other.name != cls.name:
            yield Diagnostic(
                "bad-glyph",
                f"`{cls.name}` and `{other.name}` share the glyph `{cls.glyph.letter}`",
                part_span(cls, "letter"),
                "choose another letter",
                notes=(Note("the other class is here", part_span(other, "letter")),),
            )
