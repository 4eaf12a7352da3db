"""`family.toml`: text to `FamilySpec`, with the position of everything that is wrong."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, Final, TypeVar, get_args

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, LoadError, Source, Span, did_you_mean, quoted
from envgraph.lang.family._family import (
    EXPRESSIONS,
    ComponentSpec,
    ConstraintsSpec,
    CurriculumSpec,
    EpsilonSpec,
    FamilySpec,
    MutationSpec,
    Name,
    OptimiseSpec,
    SamplesSpec,
    Scheduled,
    SearchSpec,
    Sequences,
    Strength,
    TrainingSpec,
)
from envgraph.lang.family._section import Section, bounds_of, is_int, kind_of
from envgraph.lang.syntax._data import bundled_domains, bundled_file, data_path
from envgraph.lang.syntax._files import DiskFiles, Files, file_format, read_source
from envgraph.lang.syntax._formats import FORMATS
from envgraph.lang.syntax._toml import TomlText, override, parse_toml

FAMILY_FILE, PROBLEM_FILE = "family.toml", "problem.toml"
"""What stands for its directory; the second, which says what to optimise, where there is no first."""
_MOST = 100_000
"""Members of a family, and agents that are trained for each curriculum."""


def load_family(path: str, files: Files | None = None) -> FamilySpec:
    """Reads a family file.

    Args:
        path: the file, a directory that holds a `family.toml`, or the name of a bundled domain.
        files: where files are read from; the disk if None.

    Raises:
        LoadError: everything that is wrong with the text of the file. Whether the names in it mean something is
            another question: see `check_family`.
    """
    files = files or DiskFiles()
    found = read_family(find_family(path, files), files)
    if found.diagnostics:
        raise LoadError(found.diagnostics)
    return found.spec


@dataclass(frozen=True, slots=True)
class FamilyFile:
    """A family file as far as it can be read.

    Attributes:
        spec: what has mistakes is at its default.
        diagnostics: in the order of the text.
        complete: whether all the files that it names are known; else nobody can say what the names in it mean.
    """

    spec: FamilySpec
    diagnostics: tuple[Diagnostic, ...]
    complete: bool


def find_family(path: str, files: Files | None = None) -> str:
    """The name of the family file that a path means: a file, a directory that holds one, or a bundled domain.

    Raises:
        LoadError: there is none, or it cannot be read.
    """
    files = files or DiskFiles()
    name = family_path(str(path), files)
    try:
        format = file_format(files, name)
        if format != "toml" and files.exists(name):
            raise LoadError([_other_format(name, format)])
        read_source(files, name)
    except LoadError as error:
        inside = files.is_directory(files.name(str(path)))
        raise LoadError(
            [one if inside else _no_family(str(path), one) for one in error.diagnostics]
        ) from None
    return name


def read_family(name: str, files: Files, overrides: Iterable[str] = ()) -> FamilyFile:
    """Reads a family file by its name, with all that is wrong with its text.

    Args:
        name: of the file, as `files` has it.
        files: where it is read from.
        overrides: what holds instead of what the file says, such as "search.population=10".

    Raises:
        LoadError: the file cannot be read, or is no TOML; or an override is none.
    """
    text = parse_toml(read_source(files, name))
    override(text, overrides)
    reader = _Reader(text, files, name)
    spec = reader.family()
    problems = sorted(reader.diagnostics, key=lambda one: one.span.start if one.span else 0)
    return FamilyFile(spec, tuple(problems), reader.complete)


def _other_format(name: str, format: str | None) -> Diagnostic:
    message = f"this is {FORMATS[format] if format else 'of no format that is known'}, not a family file"
    hint = f"name a `{FAMILY_FILE}`, a directory with one, or a bundled domain"
    return Diagnostic("no-family", message, Source(name, "").span(0, 0), hint)


def _no_family(path: str, problem: Diagnostic) -> Diagnostic:
    """A path without an extension was meant as a directory or a bundled domain."""
    if problem.code != "missing-file" or problem.hint or "." in path.rpartition("/")[2]:
        return problem
    families = [one for one in bundled_domains() if data_path("rules", one, FAMILY_FILE).is_file()]
    if path in bundled_domains():
        message = f"the bundled domain `{path}` has no `{FAMILY_FILE}`: it is there for its queries and rules"
    else:
        message = f"there is no directory and no bundled domain `{path}`"
    known = "those with a family are " + quoted(families)
    return replace(problem, message=message, hint=did_you_mean(path, families) or known)


def family_path(path: str, files: Files) -> str:
    """The name of a family file, from its path, its directory, or the name of a bundled domain or of a file in one."""
    name = files.name(path)
    if files.is_directory(name):
        found = [files.name(f"{path}/{file}") for file in (FAMILY_FILE, PROBLEM_FILE)]
        return next((one for one in found if files.exists(one)), found[0])
    if isinstance(files, DiskFiles) and path in bundled_domains() and name not in files.entries("."):
        return family_path(str(data_path("rules", path)), files)
    return files.name(bundled_file(path)) if isinstance(files, DiskFiles) else name


class _Reader:
    def __init__(self, text: TomlText, files: Files, name: str) -> None:
        self.diagnostics: list[Diagnostic] = []
        self.complete = True
        self._text = text
        self._files = files
        self._name = name

    def family(self) -> FamilySpec:
        top = Section(self._text, (), self._text.data, self.diagnostics, {"": _TOP, **_FIELDS})
        model, environment = self._path(top.string("model")), self._path(top.string("environment"))
        imports = tuple(path for one in top.names("imports") if (path := self._path(one)))
        if model is None and "model" not in top:
            top.missing("model", 'write `model = "name.model"` at the top')
        self.complete = not self.diagnostics
        name = top.string("name")
        if name and re.search(r"[/\\\x00-\x1f]|^\.+$", str(name)):
            hint = "runs are kept in a directory of this name: leave out `/` and `\\`"
            top.error("bad-value", f"`{name}` cannot name a directory", top.span("name"), hint)
        measures = self._measures(top, top.table("measures"))
        ga4cl = top.table("ga4cl")
        rewards = ga4cl.names("rewards")
        ga4cl.finish()
        spec = FamilySpec(
            name=str(name) if name else self._directory(),
            model=model or Name(""),
            environment=environment,
            imports=imports,
            seed=top.integer("seed", 0, 0),
            limit=top.integer("limit", None, 1),
            constraints=_read(top.table("constraints"), "constraints", ConstraintsSpec()),
            measures=measures,
            diversity=self._diversity(top, measures),
            objective=self._objective(top),
            samples=self._samples(top, measures),
            optimise=self._optimise(top, measures),
            audit=self._audit(top),
            mutation=_mutation(top.table("mutation")),
            search=_search(top.table("search")),
            curriculum=self._curriculum(top.table("curriculum"), measures),
            training=_training(top.table("training")),
            ga4cl=rewards,
            path=self._name,
            source=self._text.source,
        )
        top.finish()
        # An unknown key at the top may be what was meant to name a file; no table is.
        unknown = [value for key, value in top.data.items() if key not in top.asked]
        self.complete = self.complete and all(isinstance(value, dict) for value in unknown)
        return spec

    def _path(self, name: Name | None) -> Name | None:
        return name and Name(self._files.name(str(name), beside=self._name), name.span)

    def _directory(self) -> str:
        name = os.path.abspath(self._name) if isinstance(self._files, DiskFiles) else self._name
        return Path(name).parent.name or "family"

    def _measures(self, top: Section, section: Section) -> tuple[ComponentSpec, ...]:
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
            section.error("missing-key", "the family has no measure", self._text.value("measures"), hint)
        return tuple(found)

    def _diversity(self, top: Section, measures: tuple[ComponentSpec, ...]) -> ComponentSpec:
        component = top.table("diversity").component("diversity", "binned_entropy")
        component = component or ComponentSpec("diversity", "binned_entropy")
        names = list(top.table("measures").data) if measures else []
        of = component.options.get("of")
        if of is None:
            if len(names) > 1 and "optimise" not in top:
                span = component.span("") or self._text.value("diversity")
                hint = f'write `of = "..."` in `[diversity]`: {quoted(names)}'
                top.error("missing-key", "there are several measures to choose from", span, hint)
            return ComponentSpec(
                "diversity",
                component.kind,
                {**component.options, "of": names[0] if names else ""},
                component.spans,
            )
        self._check_measure(top, "of", of, names, component.span("of"))
        return component

    def _audit(self, top: Section) -> ComponentSpec | None:
        section = top.table("audit")
        return section.options("audit") if section.there else None

    def _objective(self, top: Section) -> ComponentSpec | None:
        section = top.table("objective")
        if any(did_you_mean(key, ("maximise", "minimise")) for key in section.data):
            if "kind" in section:
                hint = "leave out `kind`, or `maximise` and `minimise`"
                message = "an objective has a kind, or expressions"
                section.error("bad-objective", message, section.span("kind"), hint)
            return section.options("objective", EXPRESSIONS, "kind")
        if "subject_to" in section and "kind" not in section:
            section.missing("maximise", 'write `maximise = ["entropy(complexity)"]`, or another expression')
            return None
        return section.component("objective", None) if section.there else None

    def _optimise(self, top: Section, measures: tuple[ComponentSpec, ...]) -> OptimiseSpec | None:
        section = top.table("optimise")
        if not section.there:
            return None
        spec, names = _read(section, "optimise", OptimiseSpec()), [one.name for one in measures]
        for key, chosen in (("maximise", spec.maximise), ("minimise", spec.minimise)):
            for one in chosen:
                self._check_measure(section, key, one.text, names, one.span)
        for one in spec.minimise:
            if one in spec.maximise and one.span:
                message = f"`{one}` is to be as large and as small as can be"
                section.error("duplicate-name", message, one.span, "leave it out of one of the two lists")
        if not {"maximise", "minimise"} & set(section.data):
            section.missing("maximise", 'write `maximise = ["..."]`, or `minimise`: names of measures')
        elif spec.target is not None and len(spec.maximise + spec.minimise) > 1:
            hint = "leave it out: the search ends after `steps`"
            section.error("bad-value", "several objectives have no target", section.span("target"), hint)
        return spec

    def _samples(self, top: Section, measures: tuple[ComponentSpec, ...]) -> SamplesSpec | None:
        section = top.table("samples")
        if not section.there:
            return None
        spec, names = _read(section, "samples", SamplesSpec()), [one.name for one in measures]
        if spec.maximise and spec.minimise:
            hint = "leave one of them out"
            section.error(
                "bad-value", "`maximise` and `minimise` exclude each other", section.span("minimise"), hint
            )
        for key, chosen in (("maximise", spec.maximise), ("minimise", spec.minimise)):
            for one in chosen:
                self._check_measure(section, key, one.text, names, one.span)
        for covered in spec.cover:
            self._check_measure(section, "cover", covered.name, names, covered.key_span(""))
        return spec

    def _curriculum(self, section: Section, measures: tuple[ComponentSpec, ...]) -> CurriculumSpec:
        spec = _read(section, "curriculum", CurriculumSpec())
        if spec.order is not None:
            names = [one.name for one in measures]
            self._check_measure(section, "order", spec.order.text, names, spec.order.span)
        return spec

    def _check_measure(
        self, section: Section, key: str, value: object, names: list[str], span: Span | None
    ) -> None:
        where = span or self._text.value(*section.path)
        if not isinstance(value, str):
            message = f"`{key}` is the name of a measure, not {kind_of(value)}"
            section.error("wrong-type", message, where, f"there are {quoted(names)}" if names else None)
        elif value not in names and names:
            hint = did_you_mean(value, names) or f"there are {quoted(names)}"
            section.error("unknown-measure", f"unknown measure `{value}`", where, hint)


Spec = TypeVar(
    "Spec",
    ConstraintsSpec,
    CurriculumSpec,
    EpsilonSpec,
    MutationSpec,
    OptimiseSpec,
    SamplesSpec,
    SearchSpec,
    TrainingSpec,
)

Field = Callable[[Section, str, Any], Any]
"""Reads a key of a table, which has a default."""


def _names(section: Section, key: str, default: tuple[Name, ...]) -> tuple[Name, ...]:
    return section.names(key)


def _integer(low: int | None = None, most: int | None = None) -> Field:
    return lambda section, key, default: section.integer(key, default, low, most)


def _number(low: float | None = None, high: float | None = None) -> Field:
    return lambda section, key, default: section.number(key, default, low, high)


def _choice(*known: str) -> Field:
    return lambda section, key, default: section.choice(key, known, default)


def _choices(what: str, *known: str) -> Field:
    def read(section: Section, key: str, default: tuple[Name, ...]) -> tuple[Name, ...]:
        found = section.names(key)
        for one in found:
            if one.text not in known and one.span:
                hint = did_you_mean(one.text, known) or f"there are {quoted(known)}"
                section.error("unknown-choice", f"`{one}` is no {what}", one.span, hint)
        return found

    return read


def _counts(section: Section) -> tuple[tuple[Name, tuple[int, int | None]], ...]:
    counts = []
    for key in section.data:
        value = section.take(key)
        bounds = bounds_of(value)
        span = section.span(key)
        if bounds is None:
            hint = 'write `"1..5"`, `"2..*"` or `3`'
            section.error("bad-range", f"`{key}` has no bounds for its number of matches", span, hint)
        elif bounds[1] is not None and bounds[1] < bounds[0]:
            section.error(
                "bad-range",
                "the upper bound is below the lower one",
                span,
                f'write `"{bounds[1]}..{bounds[0]}"`',
            )
        else:
            counts.append((Name(key, section.text.key(*section.path, key)), bounds))
    return tuple(counts)


def _cover(section: Section) -> tuple[ComponentSpec, ...]:
    """`measure = 20`, a number of bins, or `measure = { bins = 20, range = [0, 1] }`."""
    found = []
    for key, value in section.data.items():
        place = section.text.key(*section.path, key)
        if is_int(value):
            section.take(key)
            spans = {"bins": section.span(key), "": place}
            found.append(ComponentSpec(key, key, {"bins": value}, spans))
        elif not isinstance(value, dict):
            section.take(key)
            section.wrong(key, "a number of bins", hint=f"write `{key} = 10`, or `{key} = {{ bins = 10 }}`")
        else:
            options = section.table(key).options(key)
            found.append(replace(options, spans={**options.spans, "": place}))
    return tuple(found)


def _unless_false(field: Field, off: object) -> Field:
    """A key that `false` turns off."""

    def read(section: Section, key: str, default: Any) -> Any:
        return (
            field(section, key, default) if section.data.get(key) is not False else section.take(key) or off
        )

    return read


_TOP = ("name", "model", "environment", "imports", "seed", "limit")
_FIELDS: Final[Mapping[str, Mapping[str, Field]]] = {
    "constraints": {
        "require": _names,
        "forbid": _names,
        "count": lambda section, key, default: _counts(section.table(key)),
        "reachable": _choices("outcome", "success", "failure"),
    },
    "mutation": {
        "rules": _names,
        "rate": _number(0, 1),
        "initial_applications": Section.interval,
        "max_attempts": _integer(1),
        "strength": _choice(*get_args(Strength)),
    },
    "search": {
        "population": _integer(1, _MOST),
        "generations": _unless_false(_integer(0), None),
        "keep_initial": Section.boolean,
        "parents": Section.chosen,
        "survivors": Section.chosen,
        "time_limit": _number(0),
        "target": _unless_false(_number(), inf),
        "stagnation": _integer(1),
    },
    "samples": {
        "count": _integer(2, _MOST),
        "cover": lambda section, key, default: _cover(section.table(key)),
        "maximise": _names,
        "minimise": _names,
        "attempts": _integer(1),
    },
    "optimise": {
        "maximise": _names,
        "minimise": _names,
        "strategy": Section.chosen,
        "steps": _integer(1),
        "time_limit": _number(0),
        "target": _number(),
    },
    "curriculum": {
        "order": Section.string,
        "sequences": _choice(*get_args(Sequences)),
        "initial": _choice("last", "ordered"),
        "schedules": _choices("schedule", *get_args(Scheduled)),
    },
    "training": {
        "agent": _choice("q_learning", "sarsa", "expected_sarsa", "double_q_learning"),
        "learning_rate": lambda section, key, default: section.positive(key, default, 1),
        "discount": _number(0, 1),
        "epsilon": lambda section, key, default: _epsilon(section.table(key)),
        "steps_per_environment": _integer(1),
        "evaluation_episodes": _integer(1),
        "seeds": _integer(1, _MOST),
        "initial_value": _number(),
        "n_step": _integer(1),
        "ties": _choice("lowest", "random"),
    },
    "training.epsilon": {
        "start": _number(0, 1),
        "decay": _number(0, 1),
        "minimum": _number(0, 1),
        "per": _choice("episode", "step"),
        "reset": _choice("stage", "never"),
    },
}
"""What stands in the tables whose keys are known; those of measures and their like are options of what they name."""


def _read(section: Section, name: str, default: Spec) -> Spec:
    """A table whose keys are those of a data class."""
    found = {key: read(section, key, getattr(default, key)) for key, read in _FIELDS[name].items()}
    section.finish()
    return replace(default, **found)


def _mutation(section: Section) -> MutationSpec:
    if section.data.get("rules", []) == []:
        hint = 'write `rules = ["..."]` in `[mutation]`: names of rules, units and derived groups'
        span = section.text.value("mutation")
        section.error("missing-key", "the family has no mutation rules", span, hint)
    return _read(section, "mutation", MutationSpec())


def _search(section: Section) -> SearchSpec:
    spec = _read(section, "search", SearchSpec())
    if (spec.generations, spec.time_limit, spec.stagnation) == (None, None, None) and spec.target in (
        None,
        inf,
    ):
        hint = "give `time_limit`, `target` or `stagnation`"
        section.error("missing-key", "the search has no end", section.span("generations"), hint)
    return spec


def _training(section: Section) -> TrainingSpec:
    spec = _read(section, "training", TrainingSpec())
    if spec.n_step > 1 and "sarsa" not in spec.agent:
        message = f"`n_step` above 1 is for `sarsa` and `expected_sarsa`, not `{spec.agent}`"
        hint = "rewards of an agent that explores are not those of the best actions"
        section.error("bad-range", message, section.span("n_step"), hint)
    return spec


def _epsilon(section: Section) -> EpsilonSpec:
    spec = _read(section, "training.epsilon", EpsilonSpec())
    if spec.minimum > spec.start and "minimum" in section:
        message = f"`minimum` is {spec.minimum}, above `start`, which is {spec.start}"
        section.error("bad-range", message, section.span("minimum"), "the larger one is `start`")
    return replace(spec, minimum=min(spec.minimum, spec.start))
