"""The command `envgraph import` for levels: each level becomes a model of a domain."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from envgraph.behaviour import unbound_names
from envgraph.cli._family_actions import import_family
from envgraph.cli._new_command import domain_texts, write_files
from envgraph.cli._output import print_diagnostics, print_json, print_line
from envgraph.errors import MAX_ERRORS, Diagnostic, InvalidArgument, LoadError, Severity, Span, has_errors
from envgraph.lang import (
    DiskFiles,
    Level,
    LevelTemplate,
    TextFiles,
    conformance_warnings,
    find_family,
    load_workspace,
    read_levels,
    read_source,
)
from envgraph.search import Domain

DEFAULT_DOMAIN = "sokoban"
"""The default domain of levels."""

_SUFFIXES = (".xsb", ".sok", ".txt", ".des", ".tmx", ".tmj")


def import_file(
    file: Path,
    domain: str | None,
    name: str | None,
    output: Path | None,
    legend: Sequence[str],
    overrides: Sequence[str],
    force: bool,
    directory: Path,
) -> None:
    """Store a published family as a run, or write levels as models, depending on the format of the file."""
    if not _contains_levels(file):
        import_family(file, domain or "burning_forest/paper.toml", name, overrides, directory, force)
    elif overrides:
        raise InvalidArgument("`--set` changes a family file, but levels become models: leave it out")
    else:
        _import_levels(file, domain, output, legend)


def _contains_levels(file: Path) -> bool:
    """Return True if a file contains levels: by its suffix, or because it is JSON with layers."""
    if file.suffix != ".json" or not file.is_file():
        return file.suffix in _SUFFIXES
    return re.search(r'"tiledversion"|"layers"\s*:', file.read_text(encoding="utf-8", errors="replace")) is not None


def _import_levels(file: Path, domain: str | None, output: Path | None, legend: Sequence[str]) -> None:
    """Write a model for each level of a file into a directory; add the files of the domain if it has none.

    Raises:
        LoadError: the levels have errors; lists all of them.
        InvalidArgument: a file exists, or a legend entry is invalid.
    """
    directory = output or Path(file.stem)
    there = (directory / "family.toml").exists()
    family = find_family(str(directory) if there and domain is None else domain or DEFAULT_DOMAIN)
    found = Domain.load(family)
    template = LevelTemplate.of(found.model_text.span.source, found.metamodel)
    texts = dict(_level_models(file, template, _parse_legend(legend)))
    warnings = _check_models(found, template, texts)
    written = {} if there else domain_texts(Path(family).parent, directory)
    paths = write_files({**written, **{directory / name: text for name, (text, _) in texts.items()}})
    print_diagnostics(warnings)
    print_json(lambda: {"written": [path.as_posix() for path in paths]})
    for path in paths:
        print_line(f"wrote {path}")
    print_line(f"next: envgraph generate {directory} --set model={next(iter(texts))}")


def _parse_legend(legend: Iterable[str]) -> dict[str, str]:
    """Parse legend entries such as `x=#` into a mapping from names in the file to letters of the model."""
    given = {}
    for entry in legend:
        name, equals, letter = entry[:-2], entry[-2:-1], entry[-1:]
        if not name or equals != "=":
            hint = "write the name in the file, `=`, and a letter of the domain's model: `17=#`"
            raise InvalidArgument(f"`{entry}` is not of the form NAME=LETTER", hint)
        given[name] = letter
    return given


def _level_models(
    file: Path, template: LevelTemplate, given: Mapping[str, str]
) -> Iterator[tuple[str, tuple[str, Level]]]:
    """Yield the text of each level as a model, by file name; after all levels, raise their errors together."""
    levels = read_levels(read_source(DiskFiles(), str(file)), {**template.letters, **given})
    stem = re.sub(r"\W+", "_", file.stem)
    stem = stem if re.match(r"[^\W\d]", stem) else f"level_{stem}"
    problems: list[Diagnostic] = []
    for number, level in enumerate(levels, 1):
        name = f"{stem}_{number}" if len(levels) > 1 else stem
        try:
            yield f"{name}.model", (template.model_text(level, name, given), level)
        except LoadError as error:
            problems.extend(error.diagnostics)
    if problems:
        raise LoadError(problems[:MAX_ERRORS])


def _check_models(domain: Domain, template: LevelTemplate, texts: Mapping[str, tuple[str, Level]]) -> list[Diagnostic]:
    """Check the models of levels together with the other files of their domain; return the warnings.

    Raises:
        LoadError: there are errors, or a model lacks objects that the environment needs; spans are in the level file.
    """
    bundle = domain.workspace.bundle()
    beside = Path(bundle.roots[0]).parent
    models = {(beside / name).as_posix(): level for name, level in texts.items()}
    files = TextFiles({**bundle.texts, **{name: text for name, (text, _) in models.items()}})
    workspace = load_workspace([*bundle.roots, *models], files=files)
    found = [one for one in workspace.diagnostics if one.severity is Severity.ERROR]
    for text in workspace.models:
        if text.span.source.name in models and text.model is not None and domain.behaviour is not None:
            for one in unbound_names(domain.behaviour, text.model, text.spans):
                last = one.notes[-1].span if one.notes else text.span
                found.append(replace(one, span=last, notes=one.notes[:-1]))
            found += conformance_warnings(text)

    def span_in_level(span: Span | None) -> Span | None:
        if span is None or span.source.name not in models:
            return span
        text, level = models[span.source.name]
        return template.level_span(level, text, span)

    found = [
        replace(
            one,
            span=span_in_level(one.span),
            notes=tuple(replace(note, span=span_in_level(note.span)) for note in one.notes),
        )
        for one in found
    ]
    if has_errors(found):
        raise LoadError(found[:MAX_ERRORS])
    return found
