"""Rules that are generated from a metamodel."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

from envgraph.errors import Diagnostic, Span, did_you_mean
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation, LeftSide, Modification, Retype, Rule, TypeConstraint, Variable
from envgraph.rewrite._header import check_annotations, check_weight

DERIVATION_ANNOTATIONS = ("weight",)


def check_derivation(derivation: Derivation, metamodel: Metamodel) -> list[Diagnostic]:
    """All errors and warnings of a derivation."""
    problems = [
        *check_weight(derivation.weight, derivation.annotations, derivation.span),
        *check_annotations(derivation.annotations, DERIVATION_ANNOTATIONS),
        *_check_classes(derivation, metamodel),
    ]
    if derivation.kind == "operators":
        message = "`operators for` is not supported yet"
        hint = "write the rules, or derive retypings: `derive name = retype among { A, B };`"
        problems.append(Diagnostic("not-supported", message, derivation.span, hint))
    elif len(set(derivation.classes)) < 2:
        message = f"`{derivation.name}` needs at least two classes to retype among"
        problems.append(Diagnostic("too-few-classes", message, derivation.span))
    return problems


def _check_classes(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    seen: set[str] = set()
    for position, name in enumerate(derivation.classes):
        span = _class_span(derivation, position)
        cls = metamodel.classes.get(name)
        if cls is None:
            yield Diagnostic(
                "unknown-type", f"unknown class `{name}`", span, did_you_mean(name, metamodel.classes)
            )
        elif name in seen:
            yield Diagnostic("duplicate-definition", f"`{name}` is named twice", span)
        elif cls.abstract and derivation.kind == "retype":
            concrete = ", ".join(f"`{sub}`" for sub in metamodel.concrete(name))
            message = f"`{name}` is abstract: no object is exactly a `{name}`"
            yield Diagnostic("abstract-class", message, span, f"name one of its subclasses: {concrete}")
        seen.add(name)


def _class_span(derivation: Derivation, position: int) -> Span | None:
    return derivation.class_spans[position] if position < len(derivation.class_spans) else derivation.span


def derived_rules(derivation: Derivation) -> tuple[Rule, ...]:
    """The rules of a derivation without errors: one for each ordered pair of classes, in the order of the text.

    The left class matches exactly, without subclasses.
    """
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
