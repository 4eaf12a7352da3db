"""Directives for the reference of family files: tables from the dataclasses and their docstrings.

```{family-table} search
```

writes a table of the keys of `[search]`, `top` one of the keys at the top. The second directive writes a table of the
components of a role, with their options:

```{family-components} survivors
```
"""

from __future__ import annotations

import re
from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import getdoc
from typing import Any

from codes import make_table, parse_inline
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from envgraph.errors import LIMITS
from envgraph.lang import FamilySpec
from envgraph.lang.family._family_reader import TABLES
from envgraph.learn.audit._audit_settings import AuditSettings
from envgraph.search import Components

TYPES = {
    **{"string": "a name", "choice": "a word", "choices": "words", "integer": "a whole number", "number": "a number"},
    **{"positive": "a number", "boolean": "true or false", "names": "names", "interval": "two whole numbers"},
    **{"named_component": "a name, or a table with `name`", "read_match_counts": "a table", "read_cover": "a table"},
    **{"_read_epsilon": "a table"},
}
"""The types of the methods that read a key."""

_KEYS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "top": (FamilySpec, ("name", "model", "environment", "imports", "seed", "limit")),
    "audit": (AuditSettings, tuple(one.name for one in fields(AuditSettings) if one.name != "policy")),
}
"""The keys of tables that are not read as a whole dataclass."""


class FamilyTable(SphinxDirective):
    """The directive; its argument is the name of a table."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table of the keys."""
        name = self.arguments[0]
        if name in _KEYS:
            spec, keys = _KEYS[name]
            found = read_attributes(spec)
            return [
                make_table(["key", "means"], [[[nodes.literal("", key)], parse_inline(found[key])] for key in keys])
            ]
        if name not in TABLES:
            raise self.error(f"unknown table of family files: {name}")
        spec = TABLES[name]
        meanings = read_attributes(spec)
        rows = [_row(one, meanings[one.name]) for one in fields(spec)]
        return [make_table(["key", "value", "default", "means"], rows)]


class FamilyComponents(SphinxDirective):
    """The directive; its argument is a role of components: parents, survivors or strategy."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the table of the components."""
        rows = []
        for name, factory in getattr(Components(), self.arguments[0]).items():
            made: Any = factory.__closure__[0].cell_contents if factory.__closure__ else type(factory(None, None))
            does = " ".join((getdoc(made) or "").partition("\n\n")[0].split())
            meanings = read_attributes(made)
            options = [_option_text(one, meanings[one.name]) for one in (fields(made) if is_dataclass(made) else ())]
            rows.append([[nodes.literal("", name)], parse_inline(does), parse_inline(" ".join(options) or "none")])
        return [make_table(["name", "does", "options"], rows)]


def _option_text(one: Field[Any], meaning: str) -> str:
    default = "" if one.default is None else f" ({one.default:g})"
    return f"`{one.name}`{default}: {meaning}"


def read_attributes(spec: type) -> dict[str, str]:
    """Return the meanings of the attributes of a class by name, from its docstring."""
    _, _, text = (getdoc(spec) or "").partition("Attributes:\n")
    found: dict[str, str] = {}
    for names, meaning in re.findall(r"^    (\w[\w, ]*): ((?:.*\n?)(?:     +.*\n?)*)", text, re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), " ".join(meaning.split()))
    return found


def _row(one: Field[Any], meaning: str) -> list[list[nodes.Node]]:
    read, given = one.metadata["read"], dict(one.metadata["read"].keywords)
    value = parse_inline(_value_text(read.func.__name__, given))
    default = "" if one.default is MISSING else _default_text(one.default)
    return [[nodes.literal("", one.name)], value, parse_inline(default), parse_inline(meaning)]


def _value_text(reader: str, given: dict[str, Any]) -> str:
    if reader == "unless_false":
        inner = {key: value for key, value in given.items() if key not in ("read", "false_value")}
        return f"{_value_text(given['read'].__name__, inner)}, or `false`"
    if "known" in given:
        many = reader == "choices"
        return ("some of " if many else "") + ", ".join(f'`"{word}"`' for word in given["known"])
    low, high = given.get("low"), given.get("high", LIMITS[given["most"]] if "most" in given else None)
    if reader == "positive":
        return f"{TYPES[reader]} above 0" + ("" if high is None else f", up to {high:,}")
    if low is None and high is None:
        return TYPES[reader]
    if high is None:
        return f"{TYPES[reader]} from {low}"
    return f"{TYPES[reader]} up to {high:,}" if low is None else f"{TYPES[reader]} from {low} to {high:,}"


def _default_text(value: Any) -> str:
    if value is None or value == ():
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if hasattr(value, "kind"):
        return f'`"{value.kind}"`'
    if isinstance(value, tuple):
        return f"`{list(value)}`"
    return f'`"{value}"`' if isinstance(value, str) else f"{value:,}" if isinstance(value, int | float) else "see below"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("family-table", FamilyTable)
    app.add_directive("family-components", FamilyComponents)
    return {"parallel_read_safe": True}
