"""Read and write families as files: a JSON document with the texts of the domain and the models of the members."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from envgraph.env import KeyIndex
from envgraph.errors import Diagnostic, EnvgraphError, InvalidArgument, LoadError, Span, list_names
from envgraph.lang import (
    FORMATS,
    Bundle,
    DiskFiles,
    JsonPath,
    check_json,
    file_format,
    model_at,
    parse_json,
    read_source,
)
from envgraph.search._run_store import RunStore, dump_json
from envgraph.search.domain._components import Components
from envgraph.search.domain._domain import Domain
from envgraph.search.families._member_family import (
    Family,
    Member,
    find_run_store,
    load_stored_domain,
    load_stored_family,
    missing_measures,
)
from envgraph.search.families._table_cache import TableCache, hash_key

FAMILY_FORMAT = "envgraph-family-2"


def open_family(location: str | Path, directory: Path = Path("runs"), components: Components | None = None) -> Family:
    """Return the family of a run store or of a family file.

    Args:
        location: a run store, its directory, the name of a run below `directory`, or a family file (.json).
        directory: the directory that contains runs.
        components: the components that the family file may name; by default the built-in ones.

    Raises:
        InvalidArgument: the run or file does not exist, or the run has no family yet.
        LoadError: the file is not a family file.
    """
    if _is_family_file(location):
        return read_family(Path(location), components)
    with RunStore.open(find_run_store(location, directory)) as store:
        return load_stored_family(
            store, load_stored_domain(store.bundle(), store.overrides, str(store.path), components)
        )


def family_cache(location: str | Path) -> tuple[TableCache, str]:
    """Return the table cache of a family, and a hash of all data from which it is made. Raises as `open_family`."""
    if _is_family_file(location):
        return TableCache.of_user(), hash_key(read_source(DiskFiles(), str(location)).text)
    with RunStore.open(find_run_store(location)) as store:
        return TableCache.of_run(store.path), hash_key(store.family_hash_data())


def _is_family_file(location: str | Path) -> bool:
    """Return True for a family file and False for a run or a missing file. Raise `InvalidArgument` for other files."""
    format = file_format(DiskFiles(), str(location))
    if format not in ("family", "json", "sqlite") and Path(location).is_file():
        what = FORMATS[format] if format else "of an unknown format"
        hint = (
            f"use `domain={str(Path(location).parent)!r}` for an environment of its model" if format == "toml" else None
        )
        raise InvalidArgument(f"`{location}` is {what}, not a run (run.sqlite) or a family as JSON", hint)
    return format in ("family", "json")


def family_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of the format, which is the file `family.schema.json` in this package.

    >>> family_schema()["$defs"]["member"]["required"]
    ['name', 'initial', 'measures', 'model']
    """
    text = files("envgraph.search.families").joinpath("family.schema.json").read_text("utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def write_family(family: Family) -> str:
    """Return the text of a family file: a JSON document with the texts of the domain and the models of the members."""
    document = {
        "format": FAMILY_FORMAT,
        "name": family.name,
        "roots": list(family.bundle.roots),
        "texts": dict(family.bundle.texts),
        "overrides": list(family.overrides),
        "keys": family.keys.to_json(),
        "members": [
            {
                "name": member.name,
                "initial": member.initial,
                "measures": dict(member.measures),
                **({"certificates": dict(member.certificates)} if member.certificates else {}),
                "model": json.loads(member.model),
            }
            for member in family.members
        ],
    }
    return json.dumps(document, ensure_ascii=False, indent=1) + "\n"


def read_family(path: Path, components: Components | None = None) -> Family:
    """Read a file that `write_family` wrote. `components` are as for `open_family`.

    Raises:
        LoadError: the file is missing or not a family file; it contains all problems with their positions.
    """
    source = read_source(DiskFiles(), str(path))
    value, spans = parse_json(source)
    if not isinstance(value, dict) or value.get("format") != FAMILY_FORMAT:
        span = spans.get(("format",), spans[()])
        message = f"this is not a family file: `format` is not `{FAMILY_FORMAT}`"
        raise LoadError([Diagnostic("bad-format", message, span, _FORMAT_HINT)])
    problems = check_json(value, spans, family_schema())
    if problems:
        raise LoadError([replace(one, hint=_FORMAT_HINT) for one in problems])
    bundle = Bundle(tuple(value["roots"]), value["texts"])
    domain = load_stored_domain(bundle, value["overrides"], str(path), components)
    members = tuple(_read_members(value["members"], domain, spans, str(path)))
    family = Family(value["name"], bundle, members, domain, domain.overrides)
    try:
        keys = KeyIndex.from_json(value["keys"], domain.metamodel)
        known = keys.merge(family.keys, domain.metamodel) == keys
    except EnvgraphError as error:
        raise LoadError([Diagnostic("bad-format", str(error), spans["keys",], _FORMAT_HINT)]) from error
    if not known:
        message = "`keys` does not contain the keys of all members' objects"
        raise LoadError([Diagnostic("bad-format", message, spans["keys",], _FORMAT_HINT)])
    return replace(family, _keys=keys)  # a part of a larger family also indexes objects that only other members have


_FORMAT_HINT = "use `envgraph export RUN -o family.json` to write one, or `envgraph import` for a ga4cl file"


def _read_members(
    entries: Sequence[Mapping[str, Any]], domain: Domain, spans: Mapping[JsonPath, Span], file: str
) -> Iterator[Member]:
    problems: list[Diagnostic] = []
    known = set[str]()
    for place, entry in enumerate(entries):
        path = ("members", place)
        lacking = missing_measures(domain, entry["measures"])
        if lacking:
            message = f"`{entry['name']}` has no measure {list_names(lacking)}"
            problems.append(Diagnostic("bad-format", message, spans[*path, "measures"]))
        if entry["name"] in known:
            message = f"there are two members `{entry['name']}`"
            problems.append(Diagnostic("bad-format", message, spans[*path, "name"]))
        known.add(entry["name"])
        try:
            model_at(entry["model"], domain.metamodel, spans, (*path, "model"), file)
        except LoadError as error:
            problems += error.diagnostics
        measures = {name: float(value) for name, value in entry["measures"].items()}
        model, certificates = dump_json(entry["model"]), entry.get("certificates", {})
        yield Member(entry["name"], measures, model, initial=entry["initial"], certificates=certificates)
    if problems:
        raise LoadError(problems)
