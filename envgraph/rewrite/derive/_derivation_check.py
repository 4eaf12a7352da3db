"""Checks of derivations: unknown classes, too many rules, annotations, and operators that cannot exist."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Final, cast

from envgraph.errors import (
    LIMITS,
    RAISE_LIMIT_HINT,
    Diagnostic,
    Severity,
    Span,
    did_you_mean,
    has_errors,
    list_names,
    quote_with_article,
    scaled_limit,
)
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation
from envgraph.rewrite.check._annotations import check_annotations, check_weight
from envgraph.rewrite.check._containment import loses_container
from envgraph.rewrite.derive._creation_plans import creation_plans, first_need
from envgraph.rewrite.derive._object_operators import retyping_starts
from envgraph.rewrite.derive._reference_ends import Schema

KINDS: Final = ("create", "delete", "add", "remove", "change", "swap", "move", "retype", "set")
"""The kinds of operators. All kinds have the same total weight, unless `@weight` changes it."""

ANNOTATIONS = {"retype": ("weight",), "operators": ("cap", "weight")}


def check_derivation(derivation: Derivation, metamodel: Metamodel) -> list[Diagnostic]:
    """Return all errors and warnings of a derivation."""
    # The weight 0 is allowed as the default of a group if a kind has a weight.
    kinds = [value for one in derivation.annotations if one.name == "weight" for _, value in one.named]
    is_default = derivation.weight == 0 and any(_is_weight(value) and value != 0 for value in kinds)
    problems = [
        *(check_weight(derivation.weight, derivation.annotations, derivation.span) if not is_default else ()),
        *check_annotations(derivation.annotations, ANNOTATIONS[derivation.kind]),
        *_check_classes(derivation, metamodel),
    ]
    if derivation.kind == "operators":
        if not has_errors(problems):
            problems += _check_operators(derivation, metamodel)
        return problems
    for annotation in derivation.annotations:
        if annotation.name == "weight" and annotation.named:
            message = "`@weight` of a `retype` group takes one number, not weights of kinds"
            problems.append(Diagnostic("bad-annotation", message, annotation.span, "write `@weight(2.0)`"))
    if len(derivation.classes) < 2:
        message = f"`{derivation.name}` needs at least two classes to retype among"
        problems.append(Diagnostic("too-few-classes", message, derivation.span, "write `retype among { A, B }`"))
    number = len(derivation.classes) * (len(derivation.classes) - 1)
    if number > scaled_limit("derived rules"):
        message = (
            f"`{derivation.name}` would derive {number:,} rules, but the limit is {scaled_limit('derived rules'):,}"
        )
        hint = f"divide the classes among several derivations; {RAISE_LIMIT_HINT}"
        problems.append(Diagnostic("too-many-rules", message, derivation.span, hint))
    if not has_errors(problems):
        problems += _check_containers(derivation, metamodel)
    return problems


def _check_containers(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    """Warn about each class whose objects lose their container if retyped to or from an earlier class of the list."""
    for position, name in enumerate(derivation.classes):
        ways = ((one, two) for other in derivation.classes[:position] for one, two in ((other, name), (name, other)))
        for before, after in ways:
            if loses_container([before], after, metamodel):
                old, new = quote_with_article(before), quote_with_article(after)
                message = f"no container of {old} can contain {new}, so contained objects cannot be retyped"
                hint = f"remove `{name}`, or write a rule that moves the object"
                span = _class_span(derivation, position)
                yield Diagnostic("homeless", message, span, hint, Severity.WARNING)
                break


def _check_classes(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    seen: set[str] = set()
    for position, name in enumerate(derivation.classes):
        span = _class_span(derivation, position)
        cls = metamodel.classes.get(name)
        if cls is None:
            yield Diagnostic("unknown-type", f"unknown type `{name}`", span, metamodel.suggest_class(name))
        elif name in seen:
            yield Diagnostic("duplicate-definition", f"`{name}` is named twice", span, f"name `{name}` once")
        elif cls.abstract and derivation.kind == "retype":
            concrete = list_names(metamodel.concrete_classes(name))
            message = f"`{name}` is abstract: no object is exactly a `{name}`"
            yield Diagnostic("abstract-class", message, span, f"name one of its subclasses: {concrete}")
        elif cls.frozen and derivation.kind == "retype":
            message = f"`{name}` is `@frozen`, but is retyped here"
            hint = "remove it here, or remove `@frozen` from the class"
            yield Diagnostic("frozen-class", message, span, hint, Severity.WARNING)
        seen.add(name)


def _class_span(derivation: Derivation, position: int) -> Span | None:
    return derivation.class_spans[position] if position < len(derivation.class_spans) else derivation.span


# --- operators


def _check_operators(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    """Yield the diagnostics of an `operators` derivation whose classes are known."""
    annotations = list(_check_annotations(derivation))
    yield from annotations
    schema = Schema(metamodel)
    if not annotations and _exceeds_limit(schema, derivation):
        message = f"`{derivation.name}` would derive more than {scaled_limit('derived rules'):,} rules"
        hint = (
            "write `@weight(retype = 0)` before `derive` to derive no changes of class, or name a class "
            "with fewer subclasses"
        )
        yield Diagnostic("too-many-rules", message, derivation.span, f"{hint}; {RAISE_LIMIT_HINT}")
        return
    for cls in derivation.classes:
        concrete = metamodel.concrete_classes(cls)
        touched = [sub for sub in concrete if not schema.frozen(sub)]
        if not touched:
            message = f"`{cls}` is frozen" if concrete else f"`{cls}` has no concrete subclass"
            hint = "name another class: operators never change frozen classes"
            if concrete and all(map(schema.needs_values, concrete)):
                message = f"`{cls}` requires values of a multi-valued attribute"
                hint = "name another class: operators cannot choose such values"
            if not concrete:
                hint = f"declare a class that extends `{cls}`, or remove `abstract` from its declaration"
            yield Diagnostic("nothing-derived", f"{message}: there is no operator for it", derivation.span, hint)
        elif not annotations and kind_weight(derivation, "create") > 0:
            yield from _check_creatable(schema, touched, derivation)


def _exceeds_limit(schema: Schema, derivation: Derivation) -> bool:
    """Return True if a lower bound on the number of retyping rules exceeds the limit; computed without plans."""
    ways = min(most_ways(derivation), LIMITS["creation plans"])
    starts = (start for cls in derivation.classes for _, start in retyping_starts(schema, cls))
    numbers = accumulate(ways if first_need(schema, start) else 1 for start in starts)
    return kind_weight(derivation, "retype") > 0 and any(number > scaled_limit("derived rules") for number in numbers)


def _check_creatable(schema: Schema, classes: Iterable[str], derivation: Derivation) -> Iterator[Diagnostic]:
    """Warn about classes that no operator creates.

    Parts of containers with a fixed number of parts are skipped, since they are created together with their container.
    """
    for cls in classes:
        containers = schema.containers(cls)
        comes_along = containers and not any(end.opposite_end.is_flexible for end in containers)
        if not comes_along and not creation_plans(schema, cls, 1):
            yield Diagnostic(
                "nothing-derived",
                f"no operator creates a `{cls}`: a new one needs links to objects of `@frozen` classes, or "
                "too many objects or links",
                derivation.span,
                f"write a rule that creates a `{cls}`, if new ones are needed",
                Severity.WARNING,
            )


def _check_annotations(derivation: Derivation) -> Iterator[Diagnostic]:
    for annotation in derivation.annotations:
        if annotation.name == "cap":
            given = annotation.arguments
            if len(given) > 1 or not (given or annotation.named) or not all(map(_is_cap, given)):
                hint = "write `@cap(8)` to limit the ways to create an object, or `@cap(swap = 2)` to limit a kind"
                message = "`@cap` takes one whole number above 0, or numbers for kinds of operators"
                yield Diagnostic("bad-annotation", message, annotation.span, hint)
        for kind, value in annotation.named if annotation.name in ANNOTATIONS["operators"] else ():
            place = dict(annotation.places).get(kind, annotation.span)
            if kind not in KINDS:
                hint = did_you_mean(kind, KINDS) or "the kinds are " + ", ".join(f"`{one}`" for one in KINDS)
                yield Diagnostic("bad-annotation", f"`{kind}` is not a kind of operators", place, hint)
            elif annotation.name == "cap" and not _is_cap(value):
                message = f"the cap of `{kind}` is {value}, but must be a whole number above 0"
                hint = f"write `@weight({kind} = 0)` to leave the kind out"
                yield Diagnostic("bad-annotation", message, place, hint)
            elif annotation.name == "weight" and not _is_weight(value):
                message = f"the weight of `{kind}` is {value}, but must be a number, 0 or above"
                hint = f"write `@weight({kind} = 0.5)`; with 0 the kind is left out"
                yield Diagnostic("bad-weight", message, place, hint)


def kind_weight(derivation: Derivation, kind: str) -> float:
    """Return the total weight of all operators of a kind; 0 means that the derivation leaves the kind out."""
    given = {name: value for one in derivation.annotations if one.name == "weight" for name, value in one.named}
    weight = given.get(kind, derivation.weight)
    assert isinstance(weight, int | float)
    return weight


def most_ways(derivation: Derivation) -> int:
    """Return the maximal number of operators that create one class or retype it to another: `@cap`, or `MOST_WAYS`."""
    caps = [value for one in derivation.annotations if one.name == "cap" for value in one.arguments]
    return cast("int", caps[0]) if caps else LIMITS["operators"]


def _is_cap(value: object) -> bool:
    return type(value) is int and value > 0


def _is_weight(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < float("inf")
