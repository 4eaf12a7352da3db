"""Import the public names of a package lazily, on first use, so that programs which need few of them start faster."""

from __future__ import annotations

import ast
from importlib import import_module
from typing import Any


def export_lazily(names: dict[str, Any]) -> None:
    """Install `__all__`, `__dir__` and `__getattr__` in a package so that its public names are imported on first use.

    The public names are those that the package's source imports as `X as X`, most of them under `if TYPE_CHECKING`. So
    Python, type checkers and readers share one list, like the stub of `lazy_loader.attach_stub` (Scientific Python,
    SPEC 1). The source file of the package must be installed.

    Args:
        names: the globals of the package. Imported names are added to them.
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
