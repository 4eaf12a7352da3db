"""The names in a part of a text, as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any

from envgraph.code import dataclass

Holder = tuple[Any, ...]
"""An object that has a feature, before it is looked up: ("class", name), ("classes", several holders), ("variable",
scope, name), ("member", holder, feature) or ("argument", name of a pattern, position)."""


@dataclass(slots=True, eq=False)
class Scope:
    """The variables of a definition, or of a body or clause in it.

    Attributes:
        name: the kind and the name of the definition, such as "pattern big".
        outer: the surrounding scope.
        parameters: the variables that are known in the whole definition.
        types: what is known of the classes of each variable.
    """

    name: str
    outer: Scope | None = None
    parameters: list[str] = field(default_factory=list)
    types: dict[str, list[Holder]] = field(default_factory=dict)

    def home(self, variable: str) -> Scope:
        """Return the scope that a variable belongs to: the outermost one that declares it, else this one."""
        if self.outer is not None and variable in self.outer.parameters:
            return self.outer
        return self

    def add_type(self, variable: str, holder: Holder) -> None:
        """Note something about the class of a variable."""
        self.home(variable).types.setdefault(variable, []).append(holder)


@dataclass(frozen=True, slots=True, eq=False)
class Mention:
    """A name in a part of a text.

    Attributes:
        kind: the kind of definition that it refers to: "class" (or an enum), "feature", "literal", "pattern", "rule",
            "function", "variable", "object", "metamodel", "alias", "file", "environment", "action", "model".
        text: the name, without `^`.
        start, end: its place, as offsets from the start of the part.
        is_definition: True if the name is defined here.
        scope: the scope in which it stands; None outside of definitions.
        holder: of a feature or literal: the object or enum that has it; of an object: the feature whose value it is.
        qualifier: the text before the name: a package or an alias.
        tree_end: of a definition: the end of the whole definition; `tree_start` is its start.
    """

    kind: str
    text: str
    start: int
    end: int
    is_definition: bool = False
    scope: Scope | None = None
    holder: Holder | None = None
    qualifier: str = ""
    tree_start: int = 0
    tree_end: int = 0


@dataclass(frozen=True, slots=True)
class PartNames:
    """The names in a part of a text.

    Attributes:
        all: all names, in their order.
        definitions: the names that are defined in the part, without variables.
        by_text: the names by their texts.
    """

    all: tuple[Mention, ...]
    definitions: tuple[Mention, ...]
    by_text: Mapping[str, Sequence[Mention]]

    @classmethod
    def of(cls, mentions: Iterable[Mention]) -> PartNames:
        """Return names, sorted by their places."""
        found = sorted(mentions, key=lambda one: (one.start, one.end))
        by_text: dict[str, list[Mention]] = {}
        for one in found:
            by_text.setdefault(one.text, []).append(one)
        definitions = (one for one in found if one.is_definition and one.kind != "variable")
        return cls(tuple(found), tuple(definitions), by_text)
