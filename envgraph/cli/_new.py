"""`envgraph new`: a small domain to start from."""

from __future__ import annotations

import re
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from envgraph.errors import InvalidArgument

_KINDS = ("metamodel", "model", "query", "rules", "environment")


def write_domain(directory: Path, name: str) -> list[Path]:
    """Write the six files of a domain called `name`; nothing is overwritten.

    Returns:
        The files, in the order in which they are best read.

    Raises:
        InvalidArgument: the name is no identifier, or one of the files exists.
    """
    if not re.fullmatch("[a-z][a-z0-9_]*", name):
        raise InvalidArgument(
            f"`{name}` cannot name a domain: use small letters, digits and `_`, a letter first"
        )
    templates = Environment(
        loader=PackageLoader("envgraph.cli", "templates/new"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,
    )
    files = {directory / f"{name}.{kind}": f"{kind}.j2" for kind in _KINDS}
    files[directory / "family.toml"] = "family.toml.j2"
    for path in files:
        if path.exists():
            raise InvalidArgument(f"{path} exists already; nothing was written")
    directory.mkdir(parents=True, exist_ok=True)
    words = {"name": name, "environment": "".join(word.capitalize() for word in name.split("_"))}
    for path, template in files.items():
        path.write_text(templates.get_template(template).render(words), encoding="utf-8")
    return list(files)
