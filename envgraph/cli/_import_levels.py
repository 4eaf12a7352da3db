"""The command `envgraph import`: levels become models of a domain or a family, and a published family becomes a run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from envgraph.cli._family_actions import import_family, print_family, run_path
from envgraph.cli._new_command import domain_texts, write_files
from envgraph.cli._output import print_diagnostics, print_json, print_line
from envgraph.errors import MAX_ERRORS, InvalidArgument, LoadError, Source, has_errors
from envgraph.lang import DiskFiles, find_family, read_source
from envgraph.search import Domain, LevelModel, import_levels, level_models

DEFAULT_DOMAIN = "sokoban"
"""The default domain of levels."""

_SUFFIXES = (".xsb", ".sok", ".txt", ".des", ".tmx", ".tmj")


def import_file(
    file: Path,
    domain: str | None,
    to: str | None,
    name: str | None,
    output: Path | None,
    legend: Sequence[str],
    overrides: Sequence[str],
    force: bool,
    directory: Path,
) -> None:
    """Store levels or a published family as a run, or write levels as models, depending on `to` and the format."""
    levels = file.is_dir() or _contains_levels(file)
    if output is not None and (to == "family" or not levels):
        raise InvalidArgument("`-o` is the directory of models, but a family is written as a run", "use `--name`")
    if not levels:
        if to == "models":
            raise InvalidArgument(f"`{file}` is not a file of levels, and only levels become models")
        import_family(file, domain or "burning_forest/paper.toml", name, overrides, directory, force)
    elif to == "family":
        found = Domain.load(domain or f"{DEFAULT_DOMAIN}/levels.toml", overrides=overrides)
        _import_family(file, found, run_path(directory, name or file.resolve().stem), legend, force)
    elif overrides:
        raise InvalidArgument("`--set` changes a family file, but levels become models", "add `--to family`")
    else:
        _import_models(file, domain, output, legend)


def _contains_levels(file: Path) -> bool:
    """Return True if a file contains levels: by its suffix, or because it is JSON with layers."""
    if file.suffix != ".json" or not file.is_file():
        return file.suffix in _SUFFIXES
    return re.search(r'"tiledversion"|"layers"\s*:', file.read_text(encoding="utf-8", errors="replace")) is not None


def _read_models(file: Path, domain: Domain, legend: Sequence[str]) -> Sequence[LevelModel]:
    """Return the models of all levels of a file, or of the files of a directory, which are read in sorted order."""
    sources, above = list[tuple[str, Source]](), file if file.is_dir() else file.parent
    for one in sorted(filter(_contains_levels, file.rglob("*"))) if file.is_dir() else [file]:
        stem = re.sub(r"\W+", "_", one.relative_to(above).with_suffix("").as_posix())
        stem = stem if re.match(r"[^\W\d]", stem) else f"level_{stem}"
        sources.append((stem, read_source(DiskFiles(), str(one))))
    if not sources:
        raise InvalidArgument(f"`{file}` has no file of levels", f"levels are in files {', '.join(_SUFFIXES)}")
    return level_models(sources, domain, dict(_parse_legend(legend)))


def _import_family(file: Path, domain: Domain, path: Path, legend: Sequence[str], force: bool) -> None:
    """Store levels as a run and print their family, after a warning for each level that is left out."""
    if path.exists() and not force:
        raise InvalidArgument(f"{path} exists already", "replace it with --force, or choose another --name")
    levels = _read_models(file, domain, legend)
    family, left_out = import_levels(levels, domain, path, overwrite=force)
    print_diagnostics(left_out[:MAX_ERRORS])
    print_family(family, path)
    print_line(f"{len(family.members):,} of {len(levels):,} levels; next: envgraph verify {path.parent}")


def _import_models(file: Path, domain: str | None, output: Path | None, legend: Sequence[str]) -> None:
    """Write a model for each level into a directory; add the files of the domain if it has none.

    Raises:
        LoadError: the levels have errors; lists all of them.
        InvalidArgument: a file exists, or a legend entry is invalid.
    """
    directory = output or Path(file.resolve().stem)
    there = (directory / "family.toml").exists()
    family = find_family(str(directory) if there and domain is None else domain or DEFAULT_DOMAIN)
    levels = _read_models(file, Domain.load(family), legend)
    warnings = [one for level in levels for one in level.problems]
    if has_errors(warnings):
        raise LoadError(warnings[:MAX_ERRORS])
    written = {} if there else domain_texts(Path(family).parent, directory)
    paths = write_files({**written, **{directory / f"{one.name}.model": one.text for one in levels}})
    print_diagnostics(warnings)
    print_json(lambda: {"written": [path.as_posix() for path in paths]})
    for path in paths:
        print_line(f"wrote {path}")
    print_line(f"next: envgraph generate {directory} --set model={levels[0].name}.model")


def _parse_legend(legend: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the name in the file and the letter of the model that legend entries such as `x=#` consist of."""
    for entry in legend:
        name, equals, letter = entry[:-2], entry[-2:-1], entry[-1:]
        if not name or equals != "=":
            hint = "write the name in the file, `=`, and a letter of the domain's model: `17=#`"
            raise InvalidArgument(f"`{entry}` is not of the form NAME=LETTER", hint)
        yield name, letter
