"""Load the source text of programs, compiled with numba or run as ordinary Python."""

from __future__ import annotations

import importlib.util
import inspect
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from envgraph import code
from envgraph.env.compiled.kernels import _python_kernels
from envgraph.files import _cache


def has_numba() -> bool:
    """Return True if programs can be compiled: numba is installed, and `NUMBA_DISABLE_JIT` does not switch it off."""
    wanted = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
    return wanted and importlib.util.find_spec("numba") is not None


@lru_cache(maxsize=64)
def load_functions(
    source: str, modules: tuple[ModuleType, ...], called: tuple[str, ...], *, native: bool
) -> Mapping[str, Callable[..., Any]]:
    """Return the functions of a program that Python calls, by name; programs with equal text are compiled once.

    Args:
        source: the program's own text.
        modules: fixed modules whose source precedes `source`.
        called: names of the functions to return.
        native: compile the functions with numba.
    """
    text = "\n\n".join([*map(inspect.getsource, modules), source])
    namespace = _load_native(text, called) if native else _load_interpreted(text)
    quiet: Any = (lambda function: function) if native else np.errstate(all="ignore")
    return {name: quiet(namespace[name]) for name in called}


def has_machine_code(function: Any) -> bool:
    """Return True if a function of a native program has machine code, in memory or in a cache file."""
    return bool(function.overloads) or any(getattr(function._cache, "files", tuple)())


def _load_interpreted(source: str) -> dict[str, Any]:
    """Return the namespace of a program's text that Python runs without numba."""
    namespace: dict[str, Any] = {"__name__": "program"}
    code.execute_text(source, "<program of envgraph>", namespace)
    namespace.update({name: getattr(_python_kernels, name) for name in _python_kernels.__all__})
    return namespace


def _load_native(source: str, called: Sequence[str]) -> dict[str, Any]:
    """Return the namespace of a program's text compiled by numba; the machine code of `called` is cached on disk."""
    from envgraph.env.compiled.kernels import _arrays, _machine_code

    text = "\n".join([inspect.getsource(_arrays), source])
    path = Path("programs") / f"program_{sha256(text.encode()).hexdigest()[:32]}.py"
    module = ModuleType(path.stem)
    sys.modules[path.stem] = module  # numba finds the functions of cached code there
    namespace = vars(module)
    namespace.update({name: getattr(_arrays, name) for name in _python_kernels.__all__ if hasattr(_arrays, name)})
    code.execute_text(source, str(path), namespace)
    _machine_code.compile_functions(namespace, called, text, _cache)
    return namespace
