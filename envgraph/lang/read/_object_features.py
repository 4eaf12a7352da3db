"""Check values and links of objects against the metamodel, for `.model` and `.xmi` files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from envgraph.errors import (
    Note,
    RuleError,
    Span,
    TypeMismatch,
    count_with_noun,
    did_you_mean,
    quote_names,
    quote_with_article,
)
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Value

LazySpan = Span | Callable[[], Span]
"""A span, or a function that computes a span when it is needed."""

LocatedTargets = Iterable[tuple[int, LazySpan]]
"""Object ids, each with the span that names the object."""


class ReportError(Protocol):
    """A callback that records an error: its code, message, span, hint and notes."""

    def __call__(
        self, code: str, message: str, span: Span, hint: str | None = None, notes: tuple[Note, ...] = (), /
    ) -> None: ...


def check_values(
    attribute: Attribute,
    found: Iterable[tuple[Value, LazySpan]],
    report: ReportError,
    *,
    setting: str,
    existing: Sequence[Value] = (),
) -> list[Value]:
    """Return the values that fit into an attribute with many values; their types are not checked.

    Report and skip a repeated value if the attribute is unique. Report the first value above the upper bound, and skip
    it and all later ones.

    Args:
        found: the values with their spans, in the order of the file.
        setting: the metamodel setting that allows equal values, for the hint.
        existing: values that the attribute already has; they come first in the result.
    """
    values = list(existing)
    seen = set(values)
    for value, span in found:
        if attribute.unique and value in seen:
            message = f"`{attribute}` already has this value"
            report(
                "duplicate-value",
                message,
                _resolve_span(span),
                f"remove it, or allow equal values with {setting}",
            )
        elif len(values) == attribute.upper:
            message = f"`{attribute}` allows at most {count_with_noun(attribute.upper, 'value')}"
            report("too-many-values", message, _resolve_span(span), "remove the others")
            break
        else:
            values.append(value)
            seen.add(value)
    return values


def report_unknown_literal(type_: EnumType, word: str, names: Sequence[str], report: ReportError, span: Span) -> None:
    """Report a literal `word` that the enum does not have; `names` are the valid spellings, for the hint."""
    hint = did_you_mean(word, names) or f"its literals are {quote_names(names)}"
    report("unknown-literal", f"`{type_.name}` has no literal `{word}`", span, hint)


def check_concrete(metamodel: Metamodel, cls: str, shown: str, report: ReportError, span: Span) -> bool:
    """Return True if the class can have objects; otherwise report that the class, named `shown`, is abstract."""
    if not metamodel.classes[cls].abstract:
        return True
    kinds = metamodel.concrete_classes(cls)
    hint = f"use one of its concrete classes: {quote_names(kinds)}" if kinds else "it has no concrete subclass"
    report("abstract-class", f"`{shown}` is abstract", span, hint)
    return False


class LinkBuilder:
    """A builder of the links that a file describes; it reports invalid links.

    Args:
        model: the model; all its objects exist already.
        report: the callback that records an error.
        spans: the span of each object, by id.
        repeated: True if naming the same target twice is an error; otherwise the second one is ignored.
    """

    def __init__(self, model: Model, report: ReportError, spans: Mapping[int, Span], *, repeated: bool) -> None:
        self._model = model
        self._report = report
        self._spans = spans
        self._repeated = repeated

    def link_targets(self, node: int, reference: Reference, found: LocatedTargets, at: Span | None = None) -> list[int]:
        """Link an object to target objects; return the ids of the targets of a fitting class, within the upper bound.

        Report a target of a wrong class, the first target above the upper bound, and each link that the model refuses;
        the targets of refused links are returned too.

        Args:
            node: the object that has the reference.
            found: the ids of the targets, each with its span.
            at: the span for reporting a link that the model refuses; by default that of the target.
        """
        kept: dict[int, None] = {}
        for target, where in found:
            if target in kept:
                if self._repeated:
                    message = f"`{reference.name}` already has this object"
                    self._report("duplicate-target", message, _resolve_span(where), "leave it out")
            elif self._check_target(reference, target, where):
                if len(kept) == reference.upper:
                    message = f"`{reference}` allows at most {count_with_noun(len(kept), 'object')}"
                    self._report("too-many-targets", message, _resolve_span(where), "remove the others")
                    break
                kept[target] = None
                self._add_link(node, reference, target, at or where)
        return [*kept]

    def _check_target(self, reference: Reference, target: int, where: LazySpan) -> bool:
        cls = self._model.graph.class_of(target)
        if self._model.metamodel.is_a(cls, reference.target):
            return True
        message = f"`{reference}` takes objects of class `{reference.target}`, not {quote_with_article(cls)}"
        hint = f"name an object of class `{reference.target}`"
        self._report(
            "wrong-type",
            message,
            _resolve_span(where),
            hint,
            self._object_note("the object is here", target, where),
        )
        return False

    def _add_link(self, node: int, reference: Reference, target: int, where: LazySpan) -> None:
        model = self._model
        if model.graph.has_link(node, reference, target):  # the opposite made it
            return
        relation = model.graph.store.relations[reference.index]
        child = target if relation.containment else node if relation.is_contained else None
        held = None if child is None else model.graph.container(child)
        # The model would move the child, but two containers in one file are a contradiction.
        if child is not None and held is not None:
            inside, around = model.graph.describe(child), model.graph.describe(held[0])
            message = f"{inside} is already contained in {around}, by `{held[1].name}`"
            notes = self._object_note("the container is here", held[0], where)
            self._report(
                "two-containers",
                message,
                _resolve_span(where),
                "remove one of them: an object has at most one container",
                notes,
            )
            return
        try:
            model.graph.link(node, reference, target)
        except (RuleError, TypeMismatch) as error:
            full = isinstance(error, RuleError) and error.reason == "full"
            ends = model.graph.targets(node, reference)
            others = ends if len(ends) == reference.upper else model.graph.sources(target, reference)
            text = "the object that already has this link is here"
            notes = tuple(note for one in others if full for note in self._object_note(text, one, where))
            code = "opposites-differ" if full and reference.opposite else "impossible-link"
            self._report(code, error.message, _resolve_span(where), _link_hint(error, reference), notes)

    def _object_note(self, text: str, node: int, where: LazySpan) -> tuple[Note, ...]:
        span = self._spans.get(node)
        return (Note(text, span),) if span and span != _resolve_span(where) else ()


def _resolve_span(place: LazySpan) -> Span:
    return place() if callable(place) else place


def _link_hint(error: RuleError | TypeMismatch, reference: Reference) -> str:
    match error:
        case RuleError(reason="full"):
            return "remove one of the links; the metamodel limits their number"
        case RuleError(reason="containment"):
            return "remove one of the links: an object cannot contain itself"
    return f"name an object of class `{reference.target}`"
