"""Values and links that a model cannot have, in `.model` and `.xmi` files alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from envgraph.errors import RuleError, Span, TypeMismatch, did_you_mean, plural, quoted
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Reference, Value

Place = Span | Callable[[], Span]
"""Where something stands, or how to find that out when it is needed."""


Report = Callable[[str, str, Span, str], None]
"""Notes a mistake: its code, the message, where it is, and a hint."""


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


def has_room(reference: Reference, count: int, report: Report, where: Place) -> bool:
    """Return whether a reference with so many targets can have one more; else that is reported."""
    if reference.upper is None or count < reference.upper:
        return True
    message = f"`{reference}` takes {plural(reference.upper, 'object')} at most"
    report("too-many-targets", message, _span(where), "leave the others out")
    return False


def add_link(
    model: Model, node: int, reference: Reference, target: int, report: Report, where: Place
) -> None:
    """Link two objects of fitting classes; that the model refuses it is reported."""
    try:
        model.link(node, reference, target)
    except (RuleError, TypeMismatch) as error:
        report("impossible-link", error.message, _span(where), _link_hint(error, reference))


def _span(place: Place) -> Span:
    return place() if callable(place) else place


def _link_hint(error: RuleError | TypeMismatch, reference: Reference) -> str:
    match error:
        case RuleError(reason="full"):
            return "leave one of the links out; how many there may be stands in the metamodel"
        case RuleError(reason="containment"):
            return "nothing can be inside itself: leave one of the links out"
    return f"name an object of class `{reference.target}`"
