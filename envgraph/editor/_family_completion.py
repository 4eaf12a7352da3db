"""Offer the tables, keys and values of family files, with the documentation and defaults of the data classes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from functools import cache, partial
from importlib import import_module
from typing import Any, Final

from envgraph.code import dataclass
from envgraph.editor._completed_names import OfferedName
from envgraph.editor._documents import Document
from envgraph.editor._scopes import Definitions
from envgraph.lang import COMPONENTS, MEASURE_OPTIONS, TABLES, ComponentSpec, FamilySpec, Files

_TOP_KEYS: Final = ("name", "model", "environment", "imports", "seed", "limit")
_COMPONENT_TABLES: Final = {
    "diversity": "diversity",
    "objective": "objective",
    "search.parents": "parents",
    "search.survivors": "survivors",
    "optimise.strategy": "strategy",
}
"""By table: the role of the component that it describes. All tables `measures.NAME` describe measures."""
_OTHER_OPTIONS: Final[Mapping[str, Mapping[str, str]]] = {
    "diversity": {"of": "the name of a measure", "range": "lowest and highest value", "bins": "number of bins"},
    "objective": {
        "maximise": "expressions over measures of families",
        "minimise": "expressions over measures of families",
        "subject_to": "conditions on measures of families",
    },
}
_OPTION_CLASSES: Final = {
    ("parents", "tournament"): "TournamentParents",
    ("parents", "elitist"): "ElitistParents",
    ("survivors", "simulated_annealing"): "SimulatedAnnealing",
    ("survivors", "beam"): "BeamSearch",
    ("survivors", "exact"): "ExactSelection",
    ("strategy", "simulated_annealing"): "Annealing",
    ("strategy", "hill_climbing"): "HillClimb",
    ("strategy", "beam"): "Beam",
    ("strategy", "tree_search"): "TreeSearch",
}
"""By role and kind of a component: the data class in `envgraph.search` whose fields are its options."""
_FILES: Final = {"model": ("model", "json", "xmi"), "environment": ("environment",), "imports": ("query", "vql")}
_MEASURES: Final = frozenset({"of", "order", "maximise", "minimise", "cover"})
_HEADER = re.compile(r"^[ \t]*\[{1,2}[ \t]*([\w.-]+)[ \t]*\]", re.MULTILINE)
_MEASURE = re.compile(r"^[ \t]*\[measures\.([\w-]+)\]", re.MULTILINE)
_KEY = re.compile(r"^[ \t]*([\w-]+)[ \t]*=", re.MULTILINE)
_KIND = re.compile(r"^[ \t]*(?:kind|name)[ \t]*=[ \t]*[\"'](\w+)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class _TomlPlace:
    """A place in a family file: the table, the text of the table, the line up to the place, and all of the text."""

    table: str
    table_text: str
    line: str
    text: str

    @property
    def role(self) -> str | None:
        """Return the role of the component that the table describes."""
        return "measure" if self.table.startswith("measures.") else _COMPONENT_TABLES.get(self.table)

    @property
    def kind(self) -> str:
        """Return the kind of the component, or ""."""
        found = _KIND.search(self.table_text)
        return found[1] if found else ""


def complete_family(
    document: Document, offset: int, definitions: Definitions, files: Files
) -> Iterator[tuple[int, int, OfferedName]]:
    """Yield the offers at an offset of a family file, each with the range in the text that it replaces."""
    text = document.source.text
    line = text[text.rfind("\n", 0, offset) + 1 : offset]
    if "#" in re.sub(r"\"[^\"\n]*\"?|'[^'\n]*'?", "", line):
        return
    headers = [one for one in _HEADER.finditer(text) if one.end() <= offset - len(line)]
    begin = headers[-1].end() if headers else 0
    following = _HEADER.search(text, begin)
    place = _TomlPlace(
        headers[-1][1] if headers else "", text[begin : following.start() if following else None], line, text
    )
    word = re.search(r"[\w./-]*$", line)
    start = offset - len(word.group() if word else "")
    rest = re.compile(r"[\w./-]*").match(text, offset)
    for offer in _offers(place, definitions, document.source.name, files):
        yield start, rest.end() if rest else offset, offer


def _offers(place: _TomlPlace, definitions: Definitions, file: str, files: Files) -> Iterator[OfferedName]:
    if re.fullmatch(r"[ \t]*\[{1,2}[\w.-]*", place.line):
        for table in dict.fromkeys([*TABLES, *_COMPONENT_TABLES, "measures.", "audit", "ga4cl"]):
            if f"[{table}]" not in place.text:
                yield table, "class", "table", _summary(TABLES[table]) if table in TABLES else None, "", False
    elif re.fullmatch(r"[ \t]*[\w-]*", place.line):
        written = _KEY.findall(place.table_text)
        yield from (one for one in _keys(place) if one[0] not in written)
    elif pair := re.match(r"[ \t]*([\w-]+)[ \t]*=(.*)", place.line):
        is_text = pair[2].count('"') % 2 == 1
        if not is_text and re.search(r'"[ \t]*$', pair[2]):
            return
        values = [*_values(place, pair[1], definitions), *_file_names(pair[1], file, files)]
        for label, kind, detail, doc in values:
            is_boolean = label in ("true", "false")
            if not (is_text and is_boolean):
                yield label, kind, detail, doc, label if is_text or is_boolean else f'"{label}"', False


def _keys(place: _TomlPlace) -> Iterator[OfferedName]:
    if not place.table:
        docs = _field_docs(FamilySpec)
        for name in _TOP_KEYS:
            yield name, "property", "", docs.get(name), f"{name} = ", False
    elif place.role is not None:
        kinds = ", ".join(COMPONENTS[place.role])
        named = "name" if place.table in ("search.parents", "search.survivors", "optimise.strategy") else "kind"
        yield named, "property", "", f"One of {kinds}.", f'{named} = "${{1}}"', True
        for name, (detail, doc) in _options(place.role, place.kind).items():
            yield name, "property", detail, doc, f"{name} = ", False
    elif place.table in TABLES:
        docs = _field_docs(TABLES[place.table])
        for one in fields(TABLES[place.table]):
            yield one.name, "property", _default_text(one.default), docs.get(one.name), f"{one.name} = ", False


def _options(role: str, kind: str) -> dict[str, tuple[str, str | None]]:
    """Return the default and the documentation of each option of a component, by its name."""
    if role == "measure":
        return {name: (what, None) for name, what in MEASURE_OPTIONS.get(kind, {}).items()}
    if (role, kind) in _OPTION_CLASSES:
        cls = getattr(import_module("envgraph.search"), _OPTION_CLASSES[role, kind])
        docs = _field_docs(cls)
        return {
            one.name: (_default_text(one.default), docs.get(one.name)) for one in fields(cls) if "read" in one.metadata
        }
    return {name: ("", doc) for name, doc in _OTHER_OPTIONS.get(role, {}).items()}


def _values(place: _TomlPlace, key: str, definitions: Definitions) -> Iterable[tuple[str, str, str, str | None]]:
    """Yield label, kind, detail and documentation of the values of a key, except names of files."""
    role = place.role
    if role is None and f"{place.table}.{key}" in _COMPONENT_TABLES:
        return [(one, "value", "", None) for one in COMPONENTS[_COMPONENT_TABLES[f"{place.table}.{key}"]]]
    if role is not None and key in ("kind", "name"):
        return [(one, "value", role, None) for one in COMPONENTS[role]]
    is_path = role == "measure" and MEASURE_OPTIONS.get(place.kind, {}).get(key) == "path"
    callable_ = [one for one in definitions.patterns.values() if not is_path or len(one.parameters) == 2]
    patterns = [(one.name, "function", one.label, one.doc) for one in callable_]
    if role == "measure":
        return _measure_values(MEASURE_OPTIONS.get(place.kind, {}).get(key, ""), definitions, patterns)
    if place.table == "constraints" and key in ("require", "forbid", "count"):
        return patterns
    if (place.table, key) == ("mutation", "rules"):
        return [(one.name, "function", one.label, one.doc) for one in definitions.rules.values()]
    if key in _MEASURES and (place.table in TABLES or role == "diversity"):
        return [(one, "variable", "measure", None) for one in _MEASURE.findall(place.text)]
    return [(one, "value", "", None) for one in _choices(place.table, key)]


def _measure_values(
    what: str, definitions: Definitions, patterns: list[tuple[str, str, str, str | None]]
) -> Iterator[tuple[str, str, str, str | None]]:
    """Yield the values of an option of a measure that names a class, a pattern, or the steps of a path."""
    metamodel = definitions.metamodel
    if what in ("pattern", "path"):
        yield from patterns
    for cls in metamodel.class_list if metamodel and what == "class" else ():
        yield cls.name, "class", "", cls.doc
    for name in dict.fromkeys(one.name for one in metamodel.references) if metamodel and what == "path" else ():
        yield name, "reference", "", None


def _choices(table: str, key: str) -> Iterator[str]:
    """Yield the words that a key of a table can have; `true` and `false` for a Boolean key."""
    if table not in TABLES:
        return
    for one in fields(TABLES[table]):
        if one.name == key:
            read = one.metadata.get("read")
            yield from read.keywords.get("known", ()) if isinstance(read, partial) else ()
            yield from ("true", "false") if isinstance(one.default, bool) else ()


def _file_names(key: str, file: str, files: Files) -> Iterator[tuple[str, str, str, str | None]]:
    """Yield the files beside a family file that a key can name."""
    for entry in files.entries(file.rpartition("/")[0] or "."):
        last = entry.rpartition("/")[2]
        if last.rpartition(".")[2] in _FILES.get(key, ()):
            yield last, "file", "", None


def _default_text(default: object) -> str:
    """Return the default of an option as a family file writes it; "" for none."""
    if isinstance(default, bool):
        return f"default {str(default).lower()}"
    if isinstance(default, ComponentSpec):
        return f'default "{default.kind}"'
    if isinstance(default, str):
        return f'default "{default}"'
    return f"default {default}" if isinstance(default, int | float) else ""


def _summary(cls: type[Any]) -> str:
    return (cls.__doc__ or "").partition("\n")[0]


@cache
def _field_docs(cls: type[Any]) -> dict[str, str]:
    """Return the documentation of the fields of a data class, from the part `Attributes:` of its docstring."""
    _, _, text = (cls.__doc__ or "").partition("Attributes:")
    found: dict[str, str] = {}
    names: list[str] = []
    for line in text.splitlines():
        if entry := re.match(r" {8}((?:\w+, )*\w+): (.*)", line):
            names = entry[1].split(", ")
            found.update(dict.fromkeys(names, entry[2]))
        elif line.startswith(" " * 12):
            found.update((name, f"{found[name]} {line.strip()}") for name in names)
    return found
