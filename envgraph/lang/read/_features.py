"""Values and links that a model cannot have, in `.model` and `.xmi` files alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

from envgraph.errors import Note, RuleError, Span, TypeMismatch, did_you_mean, plural, quoted, with_article
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Value

Place = Span | Callable[[], Span]
"""Where something stands, or how to find that out when it is needed."""

Found = Iterable[tuple[int, Place]]
"""Objects, each with the place that names it."""


class Report(Protocol):
    """Notes a mistake."""

    def __call__(
        self, code: str, message: str, span: Span, hint: str | None = None, notes: tuple[Note, ...] = (), /
    ) -> None: ...


def allowed_values(
    attribute: Attribute,
    found: Iterable[tuple[Value, Place]],
    report: Report,
    *,
    mark: str,
    kept: Sequence[Value] = (),
) -> list[Value]:
    """Those of the values, each with its place, that an attribute with many can have; the others are reported.

    Args:
        mark: what allows equal values, in the metamodel.
        kept: values that the attribute has already; they come first.
    """
    values = list(kept)
    seen = set(values)
    for value, span in found:
        if attribute.unique and value in seen:
            message = f"`{attribute}` has this value already"
            report("duplicate-value", message, _span(span), f"leave it out; {mark} would allow it")
        elif len(values) == attribute.upper:
            message = f"`{attribute}` takes {plural(attribute.upper, 'value')} at most"
            report("too-many-values", message, _span(span), "leave the others out")
            break
        else:
            values.append(value)
            seen.add(value)
    return values


def unknown_literal(type_: EnumType, word: str, names: Sequence[str], report: Report, span: Span) -> None:
    """Report a literal that an enum does not have; `names` are those that can be written."""
    hint = did_you_mean(word, names) or f"its literals are {quoted(names)}"
    report("unknown-literal", f"`{type_.name}` has no literal `{word}`", span, hint)


def is_concrete(metamodel: Metamodel, cls: str, shown: str, report: Report, span: Span) -> bool:
    """Whether a class can have objects; else that is reported of what it is called."""
    if not metamodel.classes[cls].abstract:
        return True
    kinds = metamodel.concrete(cls)
    hint = f"its concrete classes are {quoted(kinds)}" if kinds else "it has no concrete subclass"
    report("abstract-class", f"`{shown}` is abstract", span, hint)
    return False


class Links:
    """Makes the links that a file says, and reports those that there cannot be.

    Args:
        model: which has all objects.
        report: notes a mistake.
        spans: where each object stands.
        repeated: whether it is a mistake to name an object twice.
    """

    def __init__(self, model: Model, report: Report, spans: Mapping[int, Span], *, repeated: bool) -> None:
        self._model = model
        self._report = report
        self._spans = spans
        self._repeated = repeated

    def fill(self, node: int, reference: Reference, found: Found, at: Span | None = None) -> list[int]:
        """Link an object to others, and return those that it may be linked to; `at` is where links are impossible."""
        kept: dict[int, None] = {}
        for target, where in found:
            if target in kept:
                if self._repeated:
                    message = f"`{reference.name}` has this object already"
                    self._report("duplicate-target", message, _span(where), "leave it out")
            elif self._fits(reference, target, where):
                if len(kept) == reference.upper:
                    message = f"`{reference}` takes {plural(len(kept), 'object')} at most"
                    self._report("too-many-targets", message, _span(where), "leave the others out")
                    break
                kept[target] = None
                self._link(node, reference, target, at or where)
        return [*kept]

    def _fits(self, reference: Reference, target: int, where: Place) -> bool:
        cls = self._model.graph.class_of(target)
        if self._model.metamodel.is_a(cls, reference.target):
            return True
        message = f"`{reference}` takes objects of class `{reference.target}`, not {with_article(cls)}"
        hint = f"name an object of class `{reference.target}`"
        self._report("wrong-type", message, _span(where), hint, self._note("it is here", target, where))
        return False

    def _link(self, node: int, reference: Reference, target: int, where: Place) -> None:
        model = self._model
        if model.graph.has_link(node, reference, target):  # as the opposite has said
            return
        relation = model.graph.store.relations[reference.index]
        child = target if relation.containment else node if relation.contained else None
        held = None if child is None else model.graph.container(child)
        if (
            child is not None and held is not None
        ):  # the model would move it, and a file says two things at once
            inside, around = model.graph.describe(child), model.graph.describe(held[0])
            message = f"{inside} is contained in {around} already, by `{held[1].name}`"
            notes = self._note("the container is here", held[0], where)
            self._report(
                "two-containers", message, _span(where), "an object has one container at most", notes
            )
            return
        try:
            model.graph.link(node, reference, target)
        except (RuleError, TypeMismatch) as error:
            full = isinstance(error, RuleError) and error.reason == "full"
            ends = model.graph.targets(node, reference)
            others = ends if len(ends) == reference.upper else model.graph.sources(target, reference)
            text = "the object that has it is here"
            notes = tuple(note for one in others if full for note in self._note(text, one, where))
            code = "opposites-differ" if full and reference.opposite else "impossible-link"
            self._report(code, error.message, _span(where), _link_hint(error, reference), notes)

    def _note(self, text: str, node: int, where: Place) -> tuple[Note, ...]:
        span = self._spans.get(node)
        return (Note(text, span),) if span and span != _span(where) else ()


def _span(place: Place) -> Span:
    return place() if callable(place) else place


def _link_hint(error: RuleError | TypeMismatch, reference: Reference) -> str:
    match error:
        case RuleError(reason="full"):
            return "leave one of the links out; how many there may be stands in the metamodel"
        case RuleError(reason="containment"):
            return "nothing can be inside itself: leave one of the links out"
    return f"name an object of class `{reference.target}`"
