"""The commands `envgraph export` and `envgraph templates`: write families and templates for other programs."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

from envgraph.cli._output import escape_json, print_line
from envgraph.errors import EvaluationError, InvalidArgument, check_known, escape_unprintable
from envgraph.files import replace_file
from envgraph.search import Family, export_ga4cl, family_svg, open_family, write_family
from envgraph.search.export import (
    MINIGRID_TEMPLATES,
    copy_templates,
    write_frozen_lake,
    write_package,
    write_tables,
)

_TEXT_EXPORTERS: dict[str, Callable[[Family], str]] = {
    "family": write_family,
    "ga4cl": export_ga4cl,
    "svg": family_svg,
    "frozenlake": write_frozen_lake,
}
_FOLDER_FORMATS = ("python", "compiled", "minigrid")
_MINIGRID_CLASSES = ("Level", "Wall", "Lava", "Tile", "Goal", "Door", "Thing", "Hero")
_EXPORT_FORMATS = (*_TEXT_EXPORTERS, "npz", *_FOLDER_FORMATS)


def export_family(run: str, directory: Path, format: str, output: Path | None, templates: Path | None = None) -> None:
    """Write a family in another format to a file or a folder; without `output`, print a format that is text."""
    check_known(format, _EXPORT_FORMATS, f"unknown format `{format}`")
    if templates is not None and format != "python":
        raise InvalidArgument(f"`--templates` is not allowed with format `{format}`", "use `--format python`")
    if format in ("family", "ga4cl", "frozenlake") and output is not None and output.suffix == ".svg":
        raise InvalidArgument(f"`{output}` would contain JSON", "write `--format svg` for a picture")
    if output is None and format not in _TEXT_EXPORTERS:
        what = "a folder" if format in _FOLDER_FORMATS else "a file of arrays"
        hint = "add `-o FOLDER`" if format in _FOLDER_FORMATS else "add `-o FILE`"
        raise InvalidArgument(f"format `{format}` writes {what}", hint)
    family = open_family(run, directory)
    if output is None or format in _TEXT_EXPORTERS:
        _export_text(family, format, output)
    elif format == "python":
        _export_package(family, output, templates)
    elif format == "minigrid":
        _export_levels(family, output)
    elif format == "compiled":
        _export_program(family, output)
    else:
        tables = {one.name: family.explored(one).tabular for one in family.members}
        replace_file(output, write_tables(tables))
        print_line(f"wrote {output}")


def _export_text(family: Family, format: str, output: Path | None) -> None:
    text = _TEXT_EXPORTERS[format](family)
    if output is None:
        sys.stdout.write(text if format == "svg" else escape_json(text))
        return
    replace_file(output, text)
    print_line(f"wrote {output}")
    if format == "family" and family.domain.behaviour is not None:
        target = family.members[-1].name
        print_line(f"env = envgraph.make({str(output)!r}, variant={target!r})")
        print_line(f"envs = envgraph.make_vec({str(output)!r}, num_envs=8, variant={target!r})")


def _export_package(family: Family, output: Path, templates: Path | None) -> None:
    """Write the package that the templates generate from a family, and print how to install it."""
    files = write_package(family, output, templates)
    print_line(f"wrote {len(files)} files in {output}")
    if templates is None:
        print_line(f"pip install {output}")
        print_line(f"import {output.name}")
        print_line(f"env = {output.name}.make({family.members[-1].name!r})")


def _export_levels(family: Family, output: Path) -> None:
    """Write the levels of a family as a module for MiniGrid.

    Raises:
        InvalidArgument: the metamodel lacks MiniGrid's classes, or a name is not valid in an id of Gymnasium.
    """
    lacking = [name for name in _MINIGRID_CLASSES if name not in family.domain.metamodel.classes]
    if lacking:
        message = f"format `minigrid` needs the classes of MiniGrid, but the metamodel has no class `{lacking[0]}`"
        raise InvalidArgument(message, "use a domain that `envgraph adopt MiniGrid-..` wrote")
    for name in (family.name, *(one.name for one in family.members)):
        if not re.fullmatch(r"[\w.:-]+", name):
            hint = "change it in the family file: letters, digits, `_`, `.`, `:` and `-`"
            raise InvalidArgument(f"`{escape_unprintable(name)}` is not valid in an id of Gymnasium", hint)
    for path in write_package(family, output, MINIGRID_TEMPLATES):
        print_line(f"wrote {path}")
    print_line(f'gymnasium.make("levels:{family.name}-{family.members[-1].name}-v0")')


def _export_program(family: Family, output: Path) -> None:
    """Write the compiled program of a family as a package; raise EvaluationError if it cannot be compiled."""
    from envgraph.env.compiled import NotCompiled, export_package

    try:
        program = family.program(family.members)
    except NotCompiled as error:
        message = f"environment `{family.behaviour.name}` cannot be compiled: {error}"
        raise EvaluationError(message, error.span) from None
    names = [member.name for member in family.members]
    export_package(program, output, name=family.behaviour.name, members=names, limit=family.limit)
    print_line(f"wrote {output}")
    print_line(f"from {output.name} import Environments")
    print_line("environments = Environments(num_envs=8)")
    print_line("observations, infos = environments.reset(seed=0)")


def write_templates(folder: Path) -> None:
    """Copy envgraph's export templates into a folder."""
    files = copy_templates(folder)
    print_line(f"wrote {len(files)} files in {folder}")
    print_line(f"next: envgraph export RUN --format python --templates {folder} -o FOLDER")
