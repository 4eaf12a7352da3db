"""Read the Lark files in `grammars/` as they are written, before Lark rewrites them into plain rules."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from lark import Lark

GRAMMARS = Path(__file__).parents[2] / "grammars"
LANGUAGES = ("metamodel", "model", "query", "rules", "environment")


@dataclass(frozen=True, slots=True)
class Literal:
    """A keyword or a sign, written in quotes."""

    text: str


@dataclass(frozen=True, slots=True)
class Pattern:
    """A regular expression, written between slashes."""

    expression: str


@dataclass(frozen=True, slots=True)
class Reference:
    """The name of a rule or of a terminal, and the grammar file in which the name is defined."""

    file: str
    name: str


@dataclass(frozen=True, slots=True)
class Sequence:
    """Parts that follow each other; without parts, the empty text."""

    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """Alternatives."""

    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class Repetition:
    """A part that occurs once or not at all (`?`), any number of times (`*`), or at least once (`+`)."""

    part: Part
    mark: str

    @property
    def is_optional(self) -> bool:
        """Return True if the part may be absent."""
        return self.mark in "?*"


Part = Literal | Pattern | Reference | Sequence | Choice | Repetition


@dataclass(slots=True)
class GrammarFile:
    """A grammar file.

    Attributes:
        name: the name of the file, without its suffix.
        rules: the definitions of rules and terminals, by name, in the order of the file.
        priorities: the priorities of the terminals that have one.
        imports: for each imported name, the grammar file that it comes from.
        ignored: the names of the terminals that may occur anywhere.
    """

    name: str
    rules: dict[str, Part] = field(default_factory=dict)
    priorities: dict[str, int] = field(default_factory=dict)
    imports: dict[str, str] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)

    def resolve(self, name: str) -> Reference:
        """Return where a name is defined: in this file, or in a file that this file imports the name from."""
        if name in self.rules:
            return Reference(self.name, name)
        return read_grammar_file(self.imports[name]).resolve(name)


@cache
def _parser() -> Lark:
    return Lark.open_from_package("lark", "lark.lark", ["grammars"], parser="lalr")


@cache
def read_grammar_file(name: str) -> GrammarFile:
    """Return a file of `grammars/`, given by its name without a suffix."""
    tree: Any = _parser().parse((GRAMMARS / f"{name}.lark").read_text(encoding="utf-8"))
    found = GrammarFile(name)
    definitions: dict[str, Any] = {}
    for item in tree.children:
        if item.data == "ignore":
            found.ignored += [str(one) for one in item.scan_values(lambda token: True) if one]
        elif item.data == "multi_import":
            path, names = item.children
            found.imports |= {str(one.children[0]): str(path.children[-1].children[0]) for one in names.children}
        else:
            definitions[item.children[0].lstrip("!?")] = item
    # Names are resolved when all definitions are known.
    found.rules = dict.fromkeys(definitions, Sequence(()))
    for defined, item in definitions.items():
        found.rules[defined] = _read_part(found, item.children[-1])
        if item.children[2] is not None and item.children[2].data == "priority":
            found.priorities[defined] = int(item.children[2].children[0])
    return found


def _read_part(file: GrammarFile, tree: Any) -> Part:
    parts = tree.children
    match tree.data:
        case "literal" if parts[0].startswith("/"):
            return Pattern(parts[0][1:-1])
        case "literal":
            return Literal(ast.literal_eval(parts[0]))
        case "name":
            return file.resolve(str(parts[0]))
        case "maybe":
            return Repetition(_read_part(file, parts[0]), "?")
        case "expr" if parts[1] is not None:
            return Repetition(_read_part(file, parts[0]), str(parts[1]))
        case "expr" | "alias":
            return _read_part(file, parts[0])
        case "expansion" | "expansions":
            read = tuple(_read_part(file, one) for one in parts)
            return read[0] if len(read) == 1 else Sequence(read) if tree.data == "expansion" else Choice(read)
    raise ValueError(f"{file.name}.lark: `{tree.data}` is not supported here; extend `_read_part`")


def definition_of(reference: Reference) -> Part:
    """Return the definition of a rule or a terminal."""
    return read_grammar_file(reference.file).rules[reference.name]


def parts_of(part: Part) -> Iterator[Part]:
    """Yield a part and all parts inside it, without following references."""
    yield part
    inner = part.parts if isinstance(part, Sequence | Choice) else (part.part,) if isinstance(part, Repetition) else ()
    for one in inner:
        yield from parts_of(one)


def reachable_rules(file: str, start: str = "start") -> list[Reference]:
    """Return all rules and terminals that a grammar uses, beginning with its start rule."""
    found = {read_grammar_file(file).resolve(start): None}
    waiting = list(found)
    while waiting:
        for part in parts_of(definition_of(waiting.pop(0))):
            if isinstance(part, Reference) and part not in found:
                found[part] = None
                waiting.append(part)
    return list(found)
