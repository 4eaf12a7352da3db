"""Rules that are generated from a metamodel."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations
from typing import Final

from envgraph.errors import RAISE_LIMIT, Diagnostic, Severity, Span, has_errors, limit, listed, with_article
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation, LeftSide, Modification, Retype, Rule, TypeConstraint, Variable
from envgraph.rewrite.check._containment import homeless
from envgraph.rewrite.check._header import check_annotations, check_weight
from envgraph.rewrite.derive._operators import Derived, check_operators, operators

MOST_RULES: Final = 10_000
"""Rules of one derivation: for each ordered pair of a hundred classes; they take 4 s and 100 MB."""

ANNOTATIONS = {"retype": ("weight",), "operators": ("cap", "weight")}


def check_derivation(derivation: Derivation, metamodel: Metamodel) -> list[Diagnostic]:
    """All errors and warnings of a derivation."""
    problems = [
        *check_weight(derivation.weight, derivation.annotations, derivation.span),
        *check_annotations(derivation.annotations, ANNOTATIONS[derivation.kind]),
        *_check_classes(derivation, metamodel),
    ]
    if derivation.kind == "operators":
        if not has_errors(problems):
            problems += check_operators(derivation, metamodel)
        return problems
    for annotation in derivation.annotations:
        if annotation.name == "weight" and annotation.named:
            message = "a group of retypings has one weight: all its rules are of one kind"
            problems.append(Diagnostic("bad-annotation", message, annotation.span, "write `@weight(2.0)`"))
    if len(derivation.classes) < 2:
        message = f"`{derivation.name}` needs at least two classes to retype among"
        problems.append(
            Diagnostic("too-few-classes", message, derivation.span, "write `retype among { A, B }`")
        )
    number = len(derivation.classes) * (len(derivation.classes) - 1)
    if number > limit(MOST_RULES):
        message = f"`{derivation.name}` stands for {number:,} rules; there may be {limit(MOST_RULES):,}"
        hint = f"divide the classes among several derivations; {RAISE_LIMIT}"
        problems.append(Diagnostic("too-many-rules", message, derivation.span, hint))
    if not has_errors(problems):
        problems += _check_containers(derivation, metamodel)
    return problems


def _check_containers(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    """Warn once of each class where a container is in the way, to it or from it."""
    for position, name in enumerate(derivation.classes):
        ways = (
            (one, two)
            for other in derivation.classes[:position]
            for one, two in ((other, name), (name, other))
        )
        for before, after in ways:
            if homeless([before], after, metamodel):
                old, new = with_article(before), with_article(after)
                message = f"what contains {old} cannot contain {new}: in a container none can be retyped"
                hint = f"leave `{name}` out, or write a rule that moves the object"
                span = _class_span(derivation, position)
                yield Diagnostic("homeless", message, span, hint, Severity.WARNING)
                break


def _check_classes(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    seen: set[str] = set()
    for position, name in enumerate(derivation.classes):
        span = _class_span(derivation, position)
        cls = metamodel.classes.get(name)
        if cls is None:
            yield Diagnostic("unknown-type", f"unknown type `{name}`", span, metamodel.likely(name))
        elif name in seen:
            yield Diagnostic("duplicate-definition", f"`{name}` is named twice", span, "leave it out")
        elif cls.abstract and derivation.kind == "retype":
            concrete = listed(metamodel.concrete(name))
            message = f"`{name}` is abstract: no object is exactly a `{name}`"
            yield Diagnostic("abstract-class", message, span, f"name one of its subclasses: {concrete}")
        elif cls.frozen and derivation.kind == "retype":
            message = f"`{name}` is `@frozen`, and yet retyped here"
            hint = "leave it out; else take `@frozen` away from the class"
            yield Diagnostic("frozen-class", message, span, hint, Severity.WARNING)
        seen.add(name)


def _class_span(derivation: Derivation, position: int) -> Span | None:
    return derivation.class_spans[position] if position < len(derivation.class_spans) else derivation.span


def derived(derivation: Derivation, metamodel: Metamodel) -> Derived:
    """Return what a derivation without errors stands for: rules, and the patterns that they call."""
    if derivation.kind == "operators":
        return operators(derivation, metamodel)
    return Derived((), _retypings(derivation))


def derived_rules(derivation: Derivation, metamodel: Metamodel) -> tuple[Rule, ...]:
    """The rules of a derivation without errors.

    For `retype among` one for each ordered pair of classes, in the order of the text, where the left class matches
    exactly, without subclasses. For `operators for` see `docs/languages/rules.md`.
    """
    return derived(derivation, metamodel).rules


def _retypings(derivation: Derivation) -> tuple[Rule, ...]:
    return tuple(
        Rule(
            f"{derivation.name}.{before}.{after}",
            left=LeftSide(constraints=(TypeConstraint(before, Variable("object"), exact=True),)),
            right=Modification((Retype(Variable("object"), after),)),
            package=derivation.package,
            weight=derivation.weight,
            doc=f"`{before}` becomes `{after}`.",
            span=derivation.span,
        )
        for before, after in permutations(derivation.classes, 2)
    )
