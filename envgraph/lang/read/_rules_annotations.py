"""Parse the annotations of rules, units and derived groups."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Span, did_you_mean
from envgraph.lang.read._file_reading import FileReading
from envgraph.lang.syntax._parser import annotation_of, select_tokens, select_trees, signed_number_of
from envgraph.metamodel import Annotation


@dataclass(slots=True)
class RuleMarks:
    """The annotations of a definition, and the values of those that control rules, with their defaults."""

    annotations: tuple[Annotation, ...] = ()
    weight: float = 1.0
    priority: int = 0
    semantics: str = "dpo"
    injective: bool = True
    homomorphic: tuple[tuple[str, ...], ...] = ()
    homomorphic_spans: tuple[tuple[Span, ...], ...] = ()


def parse_marks(reading: FileReading, tree: Tree[Token]) -> RuleMarks:
    """Parse the annotations of a definition; report wrong arguments, but leave unknown names to a later check."""
    parts = select_trees(tree.children, "annotation")
    marks = RuleMarks(tuple(annotation_of(reading.parsed.source, part) for part in parts))
    for name in ("weight", "priority", "semantics", "match"):
        reading.first_or_report(f"`@{name}`", (part for part in parts if part.children[0] == name))
    for part in parts:
        read = _PARSERS.get(str(part.children[0]))
        if read is _parse_weight and tree.data == "derivation":
            read = _parse_derivation_weight
        if read is not None:
            read(reading, part, marks)
    return marks


def _parse_weight(reading: FileReading, tree: Tree[Token], marks: RuleMarks, may_be_zero: bool = False) -> None:
    value = _single_value(tree, "annotation_number")
    number = signed_number_of(value) if value else None
    if value is None or number is None:
        _report_wrong_arguments(reading, tree, "one number above 0", "write `@weight(2.0)`")
    elif number < 0 or (number == 0 and not may_be_zero):
        hint = "remove the rule if it must never be chosen"
        reading.error("bad-annotation", f"the weight is {number:g}, but must be above 0", value, hint)
    else:
        marks.weight = float(number)


def _parse_derivation_weight(reading: FileReading, tree: Tree[Token], marks: RuleMarks) -> None:
    """Parse a number such as `@weight(2)` on a derivation; a later check parses named weights of operators."""
    arguments = [part for part in tree.children[1:] if isinstance(part, Tree)]
    unnamed = [part for part in arguments if part.data != "annotation_named"]
    if unnamed or not arguments:
        _parse_weight(reading, Tree(tree.data, [tree.children[0], *unnamed], tree.meta), marks, len(arguments) > 1)


def _parse_priority(reading: FileReading, tree: Tree[Token], marks: RuleMarks) -> None:
    value = _single_value(tree, "annotation_number")
    number = signed_number_of(value) if value else None
    if isinstance(number, int):
        marks.priority = number
    else:
        _report_wrong_arguments(reading, tree, "one whole number", "write `@priority(1)`; a higher priority goes first")


def _parse_semantics(reading: FileReading, tree: Tree[Token], marks: RuleMarks) -> None:
    marks.semantics = _parse_word(reading, tree, ("dpo", "spo"), "`@semantics(dpo)` or `@semantics(spo)`") or "dpo"


def _parse_match(reading: FileReading, tree: Tree[Token], marks: RuleMarks) -> None:
    words = ("homomorphic", "injective")
    marks.injective = _parse_word(reading, tree, words, "`@match(homomorphic)` or `@match(injective)`") != "homomorphic"


def _parse_hom(reading: FileReading, tree: Tree[Token], marks: RuleMarks) -> None:
    values = _positional_values(tree)
    names = [select_tokens(value.children)[0] for value in values if value.data == "annotation_name"]
    if len(names) != len(select_trees(tree.children)) or len(names) < 2:
        _report_wrong_arguments(reading, tree, "the names of two or more variables", "write `@hom(a, b)`")
        return
    marks.homomorphic += (tuple(str(name) for name in names),)
    marks.homomorphic_spans += (reading.spans(names),)


def _parse_word(reading: FileReading, tree: Tree[Token], words: tuple[str, ...], advice: str) -> str | None:
    """Return the argument of an annotation that takes one of `words`; report any other argument and return None."""
    value = _single_value(tree, "annotation_name")
    if value is None:
        _report_wrong_arguments(reading, tree, "one word", f"write {advice}")
        return None
    word = str(value.children[0])
    if word in words:
        return word
    hint = did_you_mean(word, words) or f"write {advice}"
    reading.error("bad-annotation", f"`@{tree.children[0]}` has no option `{word}`", value, hint)
    return None


def _positional_values(tree: Tree[Token]) -> list[Tree[Token]]:
    """Return the trees of the values of an annotation's arguments, without named arguments such as `key = 2`."""
    return [
        value for part in select_trees(tree.children, "annotation_argument") for value in select_trees(part.children)
    ]


def _single_value(tree: Tree[Token], kind: str) -> Tree[Token] | None:
    values = _positional_values(tree)
    return values[0] if len(select_trees(tree.children)) == 1 and [value.data for value in values] == [kind] else None


def _report_wrong_arguments(reading: FileReading, tree: Tree[Token], takes: str, hint: str) -> None:
    reading.error("bad-annotation", f"`@{tree.children[0]}` takes {takes}", tree, hint)


_PARSERS: Mapping[str, Callable[[FileReading, Tree[Token], RuleMarks], Any]] = {
    "weight": _parse_weight,
    "priority": _parse_priority,
    "semantics": _parse_semantics,
    "match": _parse_match,
    "hom": _parse_hom,
}
