"""The command `envgraph new`: write a small domain to begin with."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from jinja2 import PackageLoader

from envgraph.cli._output import print_line
from envgraph.errors import InvalidArgument
from envgraph.files import jinja_environment, replacement_draft
from envgraph.lang import bundled_domain

DOMAIN_FILE_KINDS: Final = ("metamodel", "model", "query", "rules", "environment")


def new_domain(name: str, directory: Path | None, domain: str | None) -> None:
    """Write a new domain, or copy the bundled one called `domain`; print the files and the next command."""
    place = directory or Path(name)
    files = write_domain(place, name) if domain is None else copy_domain(place, name, domain)
    for path in files:
        print_line(f"wrote {path}")
    commands = {"family.toml": f"generate {place}", "problem.toml": f"optimise {place}"}
    known = [commands[path.name] for path in files if path.name in commands]
    print_line(f"next: envgraph {known[0] if known else f'check {files[0]}'}, or envgraph serve {place}")


def write_domain(directory: Path, name: str) -> list[Path]:
    """Write the six files of a domain called `name`; existing files are never overwritten.

    Returns:
        The files, in the order for reading.

    Raises:
        InvalidArgument: the name is not an identifier, or one of the files exists.
    """
    _check_name(name)
    return write_files({directory / file: text for file, text in render_domain("new", name, {}).items()})


def render_domain(kind: str, name: str, values: Mapping[str, Any]) -> dict[str, str]:
    """Return the texts of the files of a domain called `name` by file name, in the order for reading.

    They are rendered from the templates of a kind of domain, which escape values as TOML does. Beside `values` the
    templates get the name, and the name of the environment.
    """
    templates = jinja_environment(PackageLoader("envgraph.cli", f"templates/{kind}"), ".toml")
    words = {"name": name, "environment": "".join(word.capitalize() for word in name.split("_")), **values}
    files = {f"{name}.{one}": f"{one}.j2" for one in DOMAIN_FILE_KINDS} | {"family.toml": "family.toml.j2"}
    return {file: templates.get_template(template).render(words) for file, template in files.items()}


def copy_domain(directory: Path, name: str, domain: str) -> list[Path]:
    """Write the files of a bundled domain under their own names; existing files are never overwritten.

    Returns:
        The files, sorted by name.

    Raises:
        InvalidArgument: `name` is not an identifier, the domain is unknown, or one of the files exists.
    """
    _check_name(name)
    return write_files(domain_texts(bundled_domain(domain), directory))


def domain_texts(source: Path, directory: Path) -> dict[Path, str]:
    """Return the texts of a domain's files, its `audit` files included, by their paths in another directory, sorted."""
    files = sorted(path for part in ("*", "audit/*") for path in source.glob(part) if path.is_file())
    return {directory / path.relative_to(source): path.read_text(encoding="utf-8") for path in files}


def _check_name(name: str) -> None:
    if not re.fullmatch("[a-z][a-z0-9_]*", name):
        raise InvalidArgument(
            f"`{name}` cannot be the name of a domain: use lower-case letters, digits and `_`, beginning with a letter"
        )


def write_files(texts: Mapping[Path, str]) -> list[Path]:
    """Write files; existing files are never overwritten.

    Raises:
        InvalidArgument: one of them exists; nothing is written.
    """
    for path in texts:
        if path.exists():
            raise InvalidArgument(f"{path} exists already; nothing was written")
    for path, text in texts.items():
        with replacement_draft(path, overwrite=False) as draft:
            draft.write_text(text, encoding="utf-8")
    return list(texts)
