"""Parse the annotations of rules, units and derived groups."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Span, did_you_mean
from envgraph.lang.read._reading import Reading
from envgraph.lang.syntax._parsing import annotation_of, signed, tokens, trees
from envgraph.metamodel import Annotation


@dataclass(slots=True)
class Marks:
    """The annotations of a definition, and the values of those that control rules, with their defaults."""

    annotations: tuple[Annotation, ...] = ()
    weight: float = 1.0
    priority: int = 0
    semantics: str = "dpo"
    injective: bool = True
    homomorphic: tuple[tuple[str, ...], ...] = ()
    homomorphic_spans: tuple[tuple[Span, ...], ...] = ()


def marks_of(reading: Reading, tree: Tree[Token]) -> Marks:
    """Parse the annotations of a definition; report wrong arguments, but leave unknown names to a later check."""
    parts = trees(tree.children, "annotation")
    marks = Marks(tuple(annotation_of(reading.parsed.source, part) for part in parts))
    for name in ("weight", "priority", "semantics", "match"):
        reading.only(f"`@{name}`", (part for part in parts if part.children[0] == name))
    for part in parts:
        read = _READERS.get(str(part.children[0]))
        if read is _weight and tree.data == "derivation":
            read = _weights
        if read is not None:
            read(reading, part, marks)
    return marks


def _weight(reading: Reading, tree: Tree[Token], marks: Marks) -> None:
    value = _only_value(tree, "annotation_number")
    number = signed(value) if value else None
    if value is None or number is None:
        _wrong(reading, tree, "one number above 0", "write `@weight(2.0)`")
    elif number <= 0:
        hint = "remove the rule if it must never be chosen"
        reading.error("bad-annotation", f"the weight is {number:g}, but must be above 0", value, hint)
    else:
        marks.weight = float(number)


def _weights(reading: Reading, tree: Tree[Token], marks: Marks) -> None:
    """Parse a number such as `@weight(2)` on a derivation; a later check parses named weights of operators."""
    arguments = [part for part in tree.children[1:] if isinstance(part, Tree)]
    plain = [part for part in arguments if part.data != "annotation_named"]
    if plain or not arguments:
        _weight(reading, Tree(tree.data, [tree.children[0], *plain], tree.meta), marks)


def _priority(reading: Reading, tree: Tree[Token], marks: Marks) -> None:
    value = _only_value(tree, "annotation_number")
    number = signed(value) if value else None
    if isinstance(number, int):
        marks.priority = number
    else:
        _wrong(reading, tree, "one whole number", "write `@priority(1)`; a higher priority goes first")


def _semantics(reading: Reading, tree: Tree[Token], marks: Marks) -> None:
    marks.semantics = _word(reading, tree, ("dpo", "spo"), "`@semantics(dpo)` or `@semantics(spo)`") or "dpo"


def _match(reading: Reading, tree: Tree[Token], marks: Marks) -> None:
    words = ("homomorphic", "injective")
    marks.injective = (
        _word(reading, tree, words, "`@match(homomorphic)` or `@match(injective)`") != "homomorphic"
    )


def _hom(reading: Reading, tree: Tree[Token], marks: Marks) -> None:
    values = _values(tree)
    names = [tokens(value.children)[0] for value in values if value.data == "annotation_name"]
    if len(names) != len(trees(tree.children)) or len(names) < 2:
        _wrong(reading, tree, "the names of two or more variables", "write `@hom(a, b)`")
        return
    marks.homomorphic += (tuple(str(name) for name in names),)
    marks.homomorphic_spans += (reading.spans(names),)


def _word(reading: Reading, tree: Tree[Token], words: tuple[str, ...], advice: str) -> str | None:
    """Return the argument of an annotation that takes one of `words`; report any other argument and return None."""
    value = _only_value(tree, "annotation_name")
    if value is None:
        _wrong(reading, tree, "one word", f"write {advice}")
        return None
    word = str(value.children[0])
    if word in words:
        return word
    hint = did_you_mean(word, words) or f"write {advice}"
    reading.error("bad-annotation", f"`@{tree.children[0]}` has no option `{word}`", value, hint)
    return None


def _values(tree: Tree[Token]) -> list[Tree[Token]]:
    """Return the trees of the values of an annotation's arguments, without named arguments such as `key = 2`."""
    return [value for part in trees(tree.children, "annotation_argument") for value in trees(part.children)]


def _only_value(tree: Tree[Token], kind: str) -> Tree[Token] | None:
    values = _values(tree)
    return (
        values[0] if len(trees(tree.children)) == 1 and [value.data for value in values] == [kind] else None
    )


def _wrong(reading: Reading, tree: Tree[Token], takes: str, hint: str) -> None:
    reading.error("bad-annotation", f"`@{tree.children[0]}` takes {takes}", tree, hint)


_READERS: Mapping[str, Callable[[Reading, Tree[Token], Marks], Any]] = {
    "weight": _weight,
    "priority": _priority,
    "semantics": _semantics,
    "match": _match,
    "hom": _hom,
}
