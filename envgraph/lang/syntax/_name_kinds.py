"""Find the kind of each name in a syntax tree, such as "type" or "variable", as far as the syntax shows it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from lark import Token, Tree

from envgraph.code import dataclass

TOKEN_TYPES: Final = (
    "namespace", "type", "parameter", "variable", "property", "enumMember", "function", "decorator", "keyword",
    "comment", "string", "number",
)  # fmt: skip
"""The kinds of tokens for editors, as the Language Server Protocol calls them."""

_PATH = ("variable", "property")
_KINDS: dict[str, tuple[str, ...]] = {
    "header": ("namespace!",),
    "package": ("namespace",),
    "enum": ("type!",),
    "literal": ("enumMember!",),
    "class": ("type!",),
    "extends": ("type",),
    "attribute": ("type", "property!"),
    "reference": ("type", "property!", "property"),
    "enum_literal": ("type", "enumMember"),
    "aliased_literal": ("namespace", "type", "enumMember"),
    "annotation": ("decorator",),
    "annotation_named": ("parameter",),
    "annotation_name": ("variable",),
    "import_file": ("namespace",),
    "pattern": ("function!",),
    "declaration": ("function!",),
    "parameter": ("parameter!",),
    "type": ("namespace", "type"),
    "path": ("property",),
    "qualified_name": ("function",),
    "variable": ("variable",),
    "hash": ("variable",),
    "bare_arithmetic": _PATH,
    "navigation": ("property",),
    "method": ("function",),
    "function": ("function",),
    "static_method": ("type", "function"),
    "cast": ("type",),
    "instance_test": ("type",),
    "rule": ("function!",),
    "unit": ("function!",),
    "derivation": ("function!",),
    "asked": ("function",),
    "vertex": ("variable",),
    "assignment": ("property",),
    "forward": ("property",),
    "backward": ("property",),
    "half_arrow": ("property",),
    "set": _PATH,
    "retype": ("variable",),
    "move": ("variable", "variable", "property"),
    "merge": ("variable",),
    "redirect": ("variable",),
    "environment": ("type!",),
    "action": ("function!",),
    "domain": ("parameter!",),
    "chain": _PATH,
    "each_name": ("variable!",),
    "around": ("variable",),
    "agent": ("variable!",),
    "draw_grid": ("property",),
    "drawn": ("property",),
    "token": ("variable",),
    "model": ("namespace!", "namespace"),
    "entry": ("variable!", "type"),
    "object": ("variable!", "type"),
    "name": ("variable",),
    "cell": ("variable",),
    "unnamed": ("type",),
    "grid": ("variable!",),
    "column": ("property",),
    "row": ("property",),
    "legend_none": ("string!",),
    "legend_class": ("string!", "type"),
    "table": ("type", "property"),
    "line": ("variable!",),
}
"""By rule of a grammar: the kind of each name in it, one of `TOKEN_TYPES`; `!` marks a definition.

The last kind stands for all further names.
"""
_OPTIONAL_FIRST = frozenset({"type", "enum_literal", "entry", "legend_class"})
"""Rules whose first name can be missing, so that their names are counted from the end."""

_DEFINED_BY_TYPE = frozenset({"vertex", "token"})
"""Rules whose name is defined where its type is written."""


@dataclass(frozen=True, slots=True)
class KnownName:
    """A name in a text, with its range as offsets, its kind, and whether this place defines the name."""

    name: str
    start: int
    end: int
    kind: str
    is_definition: bool


def known_names(tree: Tree[Token]) -> Iterator[KnownName]:
    """Yield the names in a syntax tree; uses of the parameters of a definition are parameters, not variables."""
    for definition in tree.children:
        if isinstance(definition, Tree):
            yield from _names_with_parameters(definition, frozenset())


def _names_with_parameters(tree: Tree[Token], outer: frozenset[str]) -> Iterator[KnownName]:
    """Yield the names of a definition or clause; `outer` are the parameters of the definition around it."""
    clauses = [one for one in tree.children if isinstance(one, Tree) and one.data == "clauses"]
    found = [*_names_in(tree)]
    parameters = outer.union(one.name for one in found if one.kind == "parameter" and one.is_definition)
    for one in found:
        is_use = one.kind == "variable" and not one.is_definition and one.name in parameters
        yield replace(one, kind="parameter") if is_use else one
    for clause in (clause for each in clauses for clause in each.children):
        if isinstance(clause, Tree):
            yield from _names_with_parameters(clause, parameters)


def _names_in(root: Tree[Token]) -> Iterator[KnownName]:
    """Yield the names in a tree, except the names in clauses of an environment."""
    waiting = [(root, False)]
    while waiting:
        tree, is_package = waiting.pop()
        rule = str(tree.data)
        kinds = ("namespace",) if is_package else _KINDS.get(rule, ())
        names = [one for one in tree.children if isinstance(one, Token) and one.type == "NAME"] if kinds else []
        first = max(0, len(kinds) - len(names)) if rule in _OPTIONAL_FIRST else 0
        below = [one for one in tree.children if isinstance(one, Tree)]
        has_type = rule in _DEFINED_BY_TYPE and any(one.data == "type" for one in below)
        for place, token in enumerate(names, start=first):
            kind = kinds[min(place, len(kinds) - 1)]
            start, end = token.start_pos or 0, token.end_pos or 0
            yield KnownName(str(token), start, end, kind.rstrip("!"), kind.endswith("!") or has_type)
        waiting += [(one, rule == "package") for one in below if one.data != "clauses"]
