"""Parse `family.toml` into a `FamilySpec`, and report every error with its span."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import fields, replace
from math import inf
from pathlib import Path
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, LoadError, Source, Span, did_you_mean, quote_names
from envgraph.lang.family._family_spec import (
    EXPRESSION_KIND,
    ConstraintsSpec,
    CurriculumSpec,
    EpsilonSpec,
    FamilySpec,
    MutationSpec,
    OptimiseSpec,
    SamplesSpec,
    SearchSpec,
    TrainingSpec,
)
from envgraph.lang.family._table_reader import ComponentSpec, LocatedName, TableReader, describe_toml_value
from envgraph.lang.syntax._bundled_data import bundled_domains, bundled_file, data_path
from envgraph.lang.syntax._file_formats import FORMATS
from envgraph.lang.syntax._source_files import DiskFiles, Files, file_format, read_source
from envgraph.lang.syntax._toml_parser import TomlText, apply_overrides, parse_toml

FAMILY_FILE, PROBLEM_FILE = "family.toml", "problem.toml"
"""The files that are read for a directory; the second, for `optimise`, if the first does not exist."""


@dataclass(frozen=True, slots=True)
class FamilyFile:
    """The content of a family file that could be read.

    Attributes:
        spec: the family; settings with errors have their defaults.
        diagnostics: in the order of the text.
        complete: True if all files that it names are known; otherwise its names of definitions cannot be checked.
    """

    spec: FamilySpec
    diagnostics: tuple[Diagnostic, ...]
    complete: bool


def find_family(path: str, files: Files | None = None) -> str:
    """Return the name of the family file that a path means: a file, a directory with one, or a bundled domain.

    Raises:
        LoadError: there is none, or it cannot be read.
    """
    files = files or DiskFiles()
    name = family_path(str(path), files)
    try:
        format = file_format(files, name)
        if format != "toml" and files.exists(name):
            raise LoadError([_wrong_format_error(name, format)])
        read_source(files, name)
    except LoadError as error:
        inside = files.is_directory(files.name(str(path)))
        raise LoadError(
            [one if inside else _missing_family_error(str(path), one) for one in error.diagnostics]
        ) from None
    return name


def read_family(name: str, files: Files, overrides: Iterable[str] = ()) -> FamilyFile:
    """Read a family file, and return its content with all errors in its text.

    Args:
        name: name of the file in `files`.
        files: where the file is read from.
        overrides: settings that replace those of the file, such as "search.population=10".

    Raises:
        LoadError: the file cannot be read or is not TOML, or an override is invalid.
    """
    text = parse_toml(read_source(files, name))
    apply_overrides(text, overrides)
    reader = _FamilyReader(text, files, name)
    spec = reader.read_spec()
    problems = sorted(reader.diagnostics, key=lambda one: one.span.start if one.span else 0)
    return FamilyFile(spec, tuple(problems), reader.complete)


def _wrong_format_error(name: str, format: str | None) -> Diagnostic:
    message = f"this is {FORMATS[format] if format else 'of an unknown format'}, not a family file"
    hint = f"name a `{FAMILY_FILE}`, a directory with one, or a bundled domain"
    return Diagnostic("no-family", message, Source(name, "").span_between(0, 0), hint)


def _missing_family_error(path: str, problem: Diagnostic) -> Diagnostic:
    """Return a clearer error if a missing file has a name without extension: probably a directory or bundled domain.

    Return any other problem unchanged.
    """
    if problem.code != "missing-file" or problem.hint or "." in path.rpartition("/")[2]:
        return problem
    families = [one for one in bundled_domains() if data_path("rules", one, FAMILY_FILE).is_file()]
    if path in bundled_domains():
        message = f"the bundled domain `{path}` has no `{FAMILY_FILE}`: it has only queries and rules"
    else:
        message = f"there is no directory and no bundled domain `{path}`"
    known = "use a bundled domain with a family: " + quote_names(families)
    return replace(problem, message=message, hint=did_you_mean(path, families) or known)


def family_path(path: str, files: Files) -> str:
    """Return the name of the family file for a path: a file, a directory, a bundled domain, or a file in a domain."""
    name = files.name(path)
    if files.is_directory(name):
        found = [files.name(f"{path}/{file}") for file in (FAMILY_FILE, PROBLEM_FILE)]
        return next((one for one in found if files.exists(one)), found[0])
    if isinstance(files, DiskFiles) and path in bundled_domains() and name not in files.entries("."):
        return family_path(str(data_path("rules", path)), files)
    return files.name(bundled_file(path)) if isinstance(files, DiskFiles) else name


_TOP_KEYS: Final = ("name", "model", "environment", "imports", "seed", "limit")
TABLES: Final = {
    "constraints": ConstraintsSpec,
    "mutation": MutationSpec,
    "search": SearchSpec,
    "samples": SamplesSpec,
    "optimise": OptimiseSpec,
    "curriculum": CurriculumSpec,
    "training": TrainingSpec,
    "training.epsilon": EpsilonSpec,
}
_KEYS: Final = {table: tuple(one.name for one in fields(spec)) for table, spec in TABLES.items()}
"""The keys of each table; tables such as those of measures are missing, because their keys depend on the kind."""


class _FamilyReader:
    def __init__(self, text: TomlText, files: Files, name: str) -> None:
        self.diagnostics: list[Diagnostic] = []
        self.complete = True
        self._text = text
        self._files = files
        self._name = name
        self._measure_names: list[str] = []
        """The names of the measures; empty if all of them have errors."""

    def read_spec(self) -> FamilySpec:
        top = TableReader(self._text, (), self._text.data, self.diagnostics, {"": _TOP_KEYS, **_KEYS})
        model, environment = self._resolve_path(top.string("model")), self._resolve_path(top.string("environment"))
        imports = tuple(path for one in top.names("imports") if (path := self._resolve_path(one)))
        if model is None and "model" not in top:
            top.report_missing("model", 'write `model = "name.model"` at the top')
        self.complete = not self.diagnostics
        name = top.string("name")
        if name and re.search(r"[/\\\x00-\x1f]|^\.+$", str(name)):
            hint = "remove `/` and `\\`: runs are stored in a directory of this name"
            top.error("bad-value", f"`{name}` cannot be the name of a directory", top.span("name"), hint)
        measures = self._read_measures(top.table("measures"))
        self._measure_names = list(top.table("measures").data) if measures else []
        ga4cl = top.table("ga4cl")
        rewards = ga4cl.names("rewards")
        ga4cl.finish()
        spec = FamilySpec(
            name=str(name) if name else self._directory_name(),
            model=model or LocatedName(""),
            environment=environment,
            imports=imports,
            seed=top.integer("seed", 0, 0, "seed"),
            limit=top.integer("limit", None, 1, "attempts"),
            constraints=top.table("constraints").read(ConstraintsSpec),
            measures=measures,
            diversity=self._read_diversity(top),
            objective=self._read_objective(top),
            samples=self._read_samples(top.table("samples")),
            optimise=self._read_optimise(top.table("optimise")),
            audit=table.options("audit") if (table := top.table("audit")).exists else None,
            mutation=_read_mutation(top.table("mutation")),
            search=_read_search(top.table("search")),
            curriculum=self._read_curriculum(top.table("curriculum")),
            training=_read_training(top.table("training")),
            ga4cl=rewards,
            path=self._name,
            source=self._text.source,
        )
        top.finish()
        # An unknown key at the top may be a misspelt name of a file; an unknown table cannot.
        unknown = [value for key, value in top.data.items() if key not in top.read_keys]
        self.complete = self.complete and all(isinstance(value, dict) for value in unknown)
        return spec

    def _resolve_path(self, name: LocatedName | None) -> LocatedName | None:
        return name and LocatedName(self._files.name(str(name), beside=self._name), name.span)

    def _directory_name(self) -> str:
        name = os.path.abspath(self._name) if isinstance(self._files, DiskFiles) else self._name
        return Path(name).parent.name or "family"

    def _read_measures(self, section: TableReader) -> tuple[ComponentSpec, ...]:
        found = []
        if "kind" in section and not isinstance(section.data["kind"], dict):
            hint = "write `[measures.complexity]`, or another name of your choice"
            section.error("missing-key", "the measure has no name", section.span(), hint)
            return ()
        for name in section.data:
            table = section.table(name)
            component = table.component(name, None)
            if component is not None:
                found.append(component)
        if not section.data:
            hint = 'add `[measures.complexity]` with `kind = "path_complexity"` or another kind'
            section.error("missing-key", "the family has no measure", self._text.value_span("measures"), hint)
        return tuple(found)

    def _read_diversity(self, top: TableReader) -> ComponentSpec:
        found = top.table("diversity").component("diversity", "binned_entropy")
        found, names = found or ComponentSpec("diversity", "binned_entropy"), self._measure_names
        if "of" in found.options:
            self._check_measure(top, "of", found.options["of"], found.span("of"))
            return found
        if len(names) > 1 and "optimise" not in top:
            span = found.span("") or self._text.value_span("diversity")
            hint = f'write `of = "..."` in `[diversity]`, with one of {quote_names(names)}'
            top.error("missing-key", "`[diversity]` must name one of several measures", span, hint)
        return replace(found, options={**found.options, "of": names[0] if names else ""})

    def _read_objective(self, top: TableReader) -> ComponentSpec | None:
        section = top.table("objective")
        if any(did_you_mean(key, ("maximise", "minimise")) for key in section.data):
            if "kind" in section:
                hint = "leave out `kind`, or `maximise` and `minimise`"
                message = "an objective cannot have both a kind and expressions"
                section.error("bad-objective", message, section.span("kind"), hint)
            return section.options("objective", EXPRESSION_KIND, "kind")
        if "subject_to" in section and "kind" not in section:
            section.report_missing("maximise", 'write `maximise = ["entropy(complexity)"]`, or another expression')
            return None
        return section.component("objective", None) if section.exists else None

    def _read_optimise(self, section: TableReader) -> OptimiseSpec | None:
        if not section.exists:
            return None
        spec = section.read(OptimiseSpec)
        self._check_objectives(section, spec)
        for one in spec.minimise:
            if one in spec.maximise and one.span:
                message = f"`{one}` is in both `maximise` and `minimise`"
                section.error("duplicate-name", message, one.span, "leave it out of one of the two lists")
        if not {"maximise", "minimise"} & set(section.data):
            section.report_missing("maximise", 'write `maximise = ["..."]`, or `minimise`: names of measures')
        elif spec.target is not None and len(spec.maximise + spec.minimise) > 1:
            hint = "leave it out: the search ends after `steps`"
            section.error(
                "bad-value",
                "`target` needs a single objective, but there are several",
                section.span("target"),
                hint,
            )
        return spec

    def _read_samples(self, section: TableReader) -> SamplesSpec | None:
        if not section.exists:
            return None
        spec = section.read(SamplesSpec)
        if spec.maximise and spec.minimise:
            message = "`maximise` and `minimise` cannot be combined here"
            section.error("bad-value", message, section.span("minimise"), "leave one of them out")
        self._check_objectives(section, spec)
        for covered in spec.cover:
            self._check_measure(section, "cover", covered.name, covered.key_span())
        return spec

    def _read_curriculum(self, section: TableReader) -> CurriculumSpec:
        spec = section.read(CurriculumSpec)
        if spec.order is not None:
            self._check_measure(section, "order", spec.order.text, spec.order.span)
        return spec

    def _check_objectives(self, section: TableReader, spec: OptimiseSpec | SamplesSpec) -> None:
        for key, names in (("maximise", spec.maximise), ("minimise", spec.minimise)):
            for one in names:
                self._check_measure(section, key, one.text, one.span)

    def _check_measure(self, section: TableReader, key: str, value: object, span: Span | None) -> None:
        names, where = self._measure_names, span or self._text.value_span(*section.path)
        if not isinstance(value, str):
            message = f"`{key}` must be the name of a measure, not {describe_toml_value(value)}"
            section.error("wrong-type", message, where, f"there are {quote_names(names)}" if names else None)
        elif value not in names and names:
            hint = did_you_mean(value, names) or f"there are {quote_names(names)}"
            if not value.isidentifier() and any(one in value for one in names):
                hint = f'define a measure with `kind = "expression"` and `of = "{value}"`, and write its name here'
            section.error("unknown-measure", f"unknown measure `{value}`", where, hint)


def _read_mutation(section: TableReader) -> MutationSpec:
    if section.data.get("rules", []) == []:
        hint = 'write `rules = ["..."]` in `[mutation]`: names of rules, units and derived groups'
        span = section.text.value_span("mutation")
        section.error("missing-key", "the family has no mutation rules", span, hint)
    return section.read(MutationSpec)


def _read_search(section: TableReader) -> SearchSpec:
    spec = section.read(SearchSpec)
    if (spec.generations, spec.time_limit, spec.stagnation) == (None, None, None) and spec.target in (
        None,
        inf,
    ):
        hint = "add `time_limit`, `target` or `stagnation` to `[search]`, such as `stagnation = 100`"
        section.error("missing-key", "the search has no limit", section.span("generations"), hint)
    return spec


def _read_training(section: TableReader) -> TrainingSpec:
    spec = section.read(TrainingSpec)
    if spec.n_step > 1 and "sarsa" not in spec.agent:
        message = f"`n_step` is {spec.n_step}, but must be 1 for the agent `{spec.agent}`"
        hint = "use `sarsa` or `expected_sarsa`: Q-learning cannot use the rewards of exploratory actions"
        section.error("bad-range", message, section.span("n_step"), hint)
    return spec
