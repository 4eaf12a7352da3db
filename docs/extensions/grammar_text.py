"""Prepare the rules of the grammars for readers: plain names, loops for left recursion, and each rule as text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from grammar_files import (
    Choice,
    Literal,
    Part,
    Pattern,
    Reference,
    Repetition,
    Sequence,
    definition_of,
    read_grammar_file,
)

# The parsers read this only to explain the mistake, so diagrams leave it out.
REFUSED: dict[tuple[str, str], tuple[str, ...]] = {
    ("expressions", "disjunction"): ("WORD_OR",),
    ("expressions", "conjunction"): ("WORD_AND",),
    ("expressions", "equality"): ("ASSIGN",),
    ("expressions", "postfix"): ('postfix "as" NAME', 'postfix "instanceof" NAME'),
    ("query", "comparator"): ('"="', '"<"', '"<="', '">"', '">="'),
    ("query", "right_side"): (
        'term ("+" | "-" | "*" | "/" | "%") expression',
        'NAME "." NAME',
        "pattern_call",
    ),
    ("query", "term"): ('"eval" "unwind" "(" expression ")"',),
    ("rules", "arrow"): ('NAME closure? "->"', '"->"'),
    ("rules", "assigning"): ('"=="',),
}

_WORDS = {
    "INT": "whole number",
    "LONG": "long number",
    "FLOAT": "number with a point",
    "STRING": "string",
    "TEXT": "text of several lines",
}


def plain_name(name: str) -> str:
    """Return the name of a rule or a terminal in plain words."""
    return _WORDS.get(name, name.strip("_").replace("_", " ").lower())


def literal_text(part: Part) -> str | None:
    """Return the text of a keyword or a sign, also if the grammar gives it a name; None for other parts."""
    if isinstance(part, Reference) and part.name.isupper():
        part = definition_of(part)
    return part.text if isinstance(part, Literal) else None


def shown_rules(file: str) -> list[Reference]:
    """Return the rules and terminals that a grammar file defines, without those that only name a literal."""
    own = [Reference(file, name) for name in read_grammar_file(file).rules if name != "start"]
    return [rule for rule in own if literal_text(rule) is None]


def shown_definition(rule: Reference) -> Part:
    """Return the definition of a rule without alternatives that are always refused, and without left recursion."""
    refused = REFUSED.get((rule.file, rule.name), ())
    part = _without(definition_of(rule), refused)
    return _with_loop(rule, part)


def _without(part: Part, refused: tuple[str, ...]) -> Part:
    """Return a part without the alternatives whose text is refused."""
    if isinstance(part, Choice):
        kept = tuple(_without(one, refused) for one in part.parts if part_text(one) not in refused)
        return kept[0] if len(kept) == 1 else Choice(kept)
    if isinstance(part, Sequence):
        return Sequence(tuple(_without(one, refused) for one in part.parts))
    return replace(part, part=_without(part.part, refused)) if isinstance(part, Repetition) else part


def _with_loop(rule: Reference, part: Part) -> Part:
    """Return `a (b)*` for `rule: a | rule b`."""
    alternatives = part.parts if isinstance(part, Choice) else ()
    begins = [one for one in alternatives if not (isinstance(one, Sequence) and one.parts[0] == rule)]
    tails = [Sequence(one.parts[1:]) for one in alternatives if isinstance(one, Sequence) and one.parts[0] == rule]
    if not tails:
        return part
    begin, tail = (one[0] if len(one) == 1 else Choice(tuple(one)) for one in (begins, tails))
    return Sequence((begin, Repetition(tail, "*")))


def part_text(part: Part, name: Callable[[Reference], str] = lambda reference: reference.name) -> str:
    """Return a part in the notation of the grammar files (EBNF)."""
    match part:
        case Literal(text):
            return f'"{text}"'
        case Pattern(expression):
            return f"/{expression}/"
        case Reference():
            return name(part)
        case Sequence(parts):
            return " ".join(f"({part_text(one, name)})" if _is_choice(one) else part_text(one, name) for one in parts)
        case Choice(parts):
            return " | ".join(part_text(one, name) for one in parts)
        case Repetition(inner, mark):
            text = part_text(inner, name)
            return f"({text}){mark}" if isinstance(inner, Choice | Sequence) else f"{text}{mark}"


def _is_choice(part: Part) -> bool:
    return isinstance(part, Choice)


def rule_text(rule: Reference) -> str:
    """Return a rule in the notation of the grammar files, with one line for each alternative."""
    part = shown_definition(rule)
    named = lambda one: f'"{literal}"' if (literal := literal_text(one)) else one.name.strip("_")  # noqa: E731
    alternatives = part.parts if isinstance(part, Choice) else (part,)
    name = rule.name.strip("_")
    indent = "\n" + " " * len(name) + "| "
    return f"{name}: " + indent.join(part_text(one, named) for one in alternatives)
