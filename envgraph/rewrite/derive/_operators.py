"""`derive name = operators for Class;`: what a metamodel allows, as rules.

The scheme is that of Burdusel, Zschaler and John, "Automatic generation of atomic multiplicity-preserving search
operators for search-based model engineering" (Software and Systems Modeling 20, 2021): for a reference `n..m` whose
opposite is `k..l`, every operator asks for what it needs so that a valid model stays valid. Beyond it, objects that
cannot be without each other are created and deleted together, contained objects go with their container, and numbers,
truth values and enums change.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Severity, Span, did_you_mean
from envgraph.metamodel import Annotation, Metamodel
from envgraph.pattern import Derivation, Pattern, Rule
from envgraph.rewrite.derive._links import Operator, container_operators, link_operators
from envgraph.rewrite.derive._objects import creating_and_deleting, retypings
from envgraph.rewrite.derive._plans import creation_plans
from envgraph.rewrite.derive._schema import Schema
from envgraph.rewrite.derive._values import value_operators

KINDS: Final = ("create", "delete", "add", "remove", "change", "swap", "move", "retype", "set")
"""The kinds of operators; each is drawn as often as any other unless `@weight` says otherwise."""

MOST_WAYS: Final = 8
"""In how many ways an object is created or retyped, unless `@cap` says otherwise."""


@dataclass(frozen=True, slots=True)
class Derived:
    """What a derivation stands for.

    Attributes:
        patterns: what the rules call.
        rules: in the order of `KINDS`.
    """

    patterns: tuple[Pattern, ...]
    rules: tuple[Rule, ...]


def operators(derivation: Derivation, metamodel: Metamodel) -> Derived:
    """The operators of a derivation without errors."""
    schema, group = Schema(metamodel), derivation.qualified_name
    most = _cap(derivation)
    patterns: dict[str, Pattern] = {}
    found: dict[str, tuple[str, Rule]] = {}
    for cls in derivation.classes:
        for kind, name, builder, doc, spo in _all(schema, group, cls, most):
            rule = builder.rule(name, doc, spo=spo)
            rule = replace(rule, name=_free(rule.name, rule, found), span=derivation.span)
            found.setdefault(rule.name, (kind, rule))
            patterns.update(builder.patterns)
    weights, caps = _weights(derivation), _caps(derivation)
    rules: list[Rule] = []
    for wanted in KINDS:
        family = _first([rule for kind, rule in found.values() if kind == wanted], caps.get(wanted))
        if weights[wanted] > 0:
            rules += [replace(rule, weight=weights[wanted] / len(family)) for rule in family]
    return Derived(tuple(patterns.values()), tuple(rules))


def _all(schema: Schema, group: str, cls: str, most: int) -> Iterator[Operator]:
    for concrete in schema.metamodel.concrete(cls):
        if not schema.frozen(concrete):
            yield from creating_and_deleting(schema, group, concrete, most)
    yield from link_operators(schema, group, cls)
    yield from container_operators(schema, group, cls)
    yield from retypings(schema, group, cls, most)
    yield from value_operators(schema, group, cls)


def _free(name: str, rule: Rule, found: dict[str, tuple[str, Rule]]) -> str:
    """The name, or one with a number if another rule has it; a rule that is there already keeps its name."""
    number, free = 1, name
    while free in found and replace(found[free][1], name=name, span=rule.span) != rule:
        number += 1
        free = f"{name}.{number}"
    return free


def _first(rules: Sequence[Rule], most: int | None) -> list[Rule]:
    """So many of the rules, in their order: the first of each class, then the second of each, and so on."""
    if most is None or len(rules) <= most:
        return list(rules)
    before: Counter[str] = Counter()
    ranks: list[tuple[int, int]] = []
    for number, rule in enumerate(rules):
        cls = rule.name.split(".")[2]  # group.kind.Class...
        ranks.append((before[cls], number))
        before[cls] += 1
    return [rules[number] for number in sorted(number for _, number in sorted(ranks)[:most])]


# --- annotations


def _cap(derivation: Derivation) -> int:
    """In how many ways an object is created or retyped."""
    caps = [value for a in derivation.annotations if a.name == "cap" for value in a.arguments]
    most = caps[0] if caps else MOST_WAYS
    assert isinstance(most, int)
    return most


def _caps(derivation: Derivation) -> dict[str, int]:
    """Return how many rules of a kind there may be."""
    named = chain.from_iterable(a.named for a in derivation.annotations if a.name == "cap")
    return {str(kind): value for kind, value in named if isinstance(value, int)}


def _weights(derivation: Derivation) -> dict[str, float]:
    """The weight of each kind."""
    named = chain.from_iterable(a.named for a in derivation.annotations if a.name == "weight")
    own = {str(kind): float(value) for kind, value in named}
    return {kind: derivation.weight * own.get(kind, 1.0) for kind in KINDS}


def check_operators(derivation: Derivation, metamodel: Metamodel) -> Iterator[Diagnostic]:
    """Return what is wrong with a derivation of operators whose classes are known."""
    annotations = list(_check_annotations(derivation))
    yield from annotations
    schema = Schema(metamodel)
    for cls in derivation.classes:
        concrete = metamodel.concrete(cls)
        touched = [sub for sub in concrete if not schema.frozen(sub)]
        if not touched:
            message = f"`{cls}` is frozen" if concrete else f"`{cls}` has no concrete subclass"
            hint = "operators leave frozen classes alone"
            if concrete and all(map(schema.needs_values, concrete)):
                message = f"`{cls}` needs values of an attribute with many"
                hint = "operators cannot choose them, and leave its objects alone"
            if not concrete:
                hint = f"declare a class that extends `{cls}`, or leave `abstract` out there"
            yield Diagnostic(
                "nothing-derived", f"{message}: there is no operator for it", derivation.span, hint
            )
        elif not annotations:
            yield from _without_creation(schema, touched, derivation)


def _without_creation(schema: Schema, classes: Iterable[str], derivation: Derivation) -> Iterator[Diagnostic]:
    """Warnings of objects that nothing creates; parts of which each whole has a fixed number come with it."""
    for cls in classes:
        containers = schema.containers(cls)
        comes_along = containers and not any(end.other.flexible for end in containers)
        if not comes_along and not creation_plans(schema, cls, 1):
            yield Diagnostic(
                "nothing-derived",
                f"no operator creates a `{cls}`: what it needs is frozen, or too much at once",
                derivation.span,
                f"write a rule that creates a `{cls}`, if there shall be new ones",
                Severity.WARNING,
            )


def _check_annotations(derivation: Derivation) -> Iterator[Diagnostic]:
    for annotation in derivation.annotations:
        if annotation.name == "cap":
            yield from _check_cap(annotation)
        for kind, value in annotation.named if annotation.name == "weight" else ():
            if kind not in KINDS:
                yield _no_kind(annotation, kind)
            elif not _is_weight(value):
                message = f"the weight of a kind is a number, 0 or above, not {value}"
                hint = f"write `@weight({kind} = 0.5)`; with 0 the kind is left out"
                yield Diagnostic("bad-weight", message, _place(annotation, kind), hint)


def _check_cap(annotation: Annotation) -> Iterator[Diagnostic]:
    given = annotation.arguments
    if len(given) > 1 or not (given or annotation.named) or not all(map(_is_cap, given)):
        hint = "write `@cap(8)`, in how many ways an object is created at most, or `@cap(swap = 2)`"
        message = "`@cap` takes one number above 0, and numbers of kinds"
        yield Diagnostic("bad-annotation", message, annotation.span, hint)
    for kind, value in annotation.named:
        if kind not in KINDS:
            yield _no_kind(annotation, kind)
        elif not _is_cap(value):
            message = f"of a kind there is a whole number of rules above 0, not {value}"
            hint = f"`@weight({kind} = 0)` leaves a kind out"
            yield Diagnostic("bad-annotation", message, _place(annotation, kind), hint)


def _no_kind(annotation: Annotation, kind: str) -> Diagnostic:
    hint = did_you_mean(kind, KINDS) or "the kinds are " + ", ".join(f"`{one}`" for one in KINDS)
    return Diagnostic("bad-annotation", f"`{kind}` is no kind of operators", _place(annotation, kind), hint)


def _place(annotation: Annotation, kind: str) -> Span | None:
    return dict(annotation.places).get(kind, annotation.span)


def _is_cap(value: object) -> bool:
    return type(value) is int and value > 0


def _is_weight(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < float("inf")
