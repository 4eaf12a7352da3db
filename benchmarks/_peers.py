"""Packages that the benchmarks compare with; a package that is not installed is left out."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

PACKAGES = {"clips": "clipspy"}
"""What to install for a module, where the name differs from the module's."""


def peer(module: str) -> Any:
    """Import a module, or return None if it is not installed."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:  # it is installed, but something that it needs is not
            raise
        return None


def left_out(modules: Sequence[str]) -> str:
    """Return a line that names the modules that are not installed, "" if all are."""
    names = [PACKAGES.get(module, module) for module in modules if peer(module) is None]
    return f"not installed, so left out: {', '.join(names)} (pip install {' '.join(names)})" if names else ""
