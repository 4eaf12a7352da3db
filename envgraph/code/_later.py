"""Packages whose public names are loaded when they are first used: most programs need few of them, and start sooner."""

from __future__ import annotations

import ast
from importlib import import_module
from typing import Any


def later(names: dict[str, Any]) -> None:
    """Set `__all__`, `__dir__` and `__getattr__` of a package whose names are imported when they are first used.

    The public names are those that the source of the package imports as `X as X`, most of them under
    `if TYPE_CHECKING`. Python, type checkers and readers so have one list, as `lazy_loader.attach_stub` of Scientific
    Python (SPEC 1) has with a stub.

    The source file of the package has to be installed.

    Args:
        names: the globals of the package. Names that are imported are added to them.
    """
    package = names["__name__"]
    homes = {
        alias.name: str(found.module)
        for found in ast.walk(ast.parse(names["__loader__"].get_source(package)))
        if isinstance(found, ast.ImportFrom)
        for alias in found.names
        if alias.asname
    }

    def __getattr__(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module `{package}` has no attribute `{name}`")
        names[name] = getattr(import_module(homes[name]), name)
        return names[name]

    names["__all__"] = sorted(homes)
    names["__getattr__"] = __getattr__
    names["__dir__"] = lambda: sorted({*homes, *(name for name in names if name.startswith("__"))})
