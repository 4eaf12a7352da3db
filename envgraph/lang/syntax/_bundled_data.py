"""Find the grammars and the bundled domains: inside the package in a wheel, beside the package in a checkout."""

from __future__ import annotations

from pathlib import Path

from envgraph.errors import check_known


def data_path(*parts: str) -> Path:
    """Return a path below the data directory, such as `data_path("grammars", "model.lark")`; it need not exist.

    >>> data_path("grammars", "common.lark").is_file()
    True
    """
    package = Path(__file__).resolve().parents[2]
    installed = package / "_data"
    return (installed if installed.is_dir() else package.parent).joinpath(*parts)


def bundled_domains() -> tuple[str, ...]:
    """Return the sorted names of the domains that are installed with envgraph.

    >>> "burning_forest" in bundled_domains()
    True
    """
    rules = data_path("rules")
    return tuple(sorted(path.name for path in rules.iterdir() if path.is_dir())) if rules.is_dir() else ()


def bundled_domain(name: str) -> Path:
    """Return the directory of a bundled domain.

    Raises:
        InvalidArgument: no bundled domain has this name.
    """
    check_known(name, bundled_domains(), f"no bundled domain `{name}`")
    return data_path("rules", name)


def bundled_file(path: str) -> str:
    """Return the location of a bundled file given as `domain/file`, or the path unchanged.

    The path is unchanged if no bundled domain has this name, or if a file or directory of this name exists here.
    """
    domain, _, file = path.partition("/")
    known = file and domain in bundled_domains() and not Path(domain).exists()
    return str(data_path("rules", domain, file)) if known else path
