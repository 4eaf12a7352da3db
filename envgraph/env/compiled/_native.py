"""Texts of programs, compiled with numba or run by Python."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any, Final
from zlib import crc32

import numpy as np

from envgraph import code
from envgraph.files import cache_directory, replace_file

WORD: Final = 2**64 - 1


def has_numba() -> bool:
    """Whether programs can be compiled."""
    return importlib.util.find_spec("numba") is not None


@lru_cache(maxsize=64)
def functions(
    source: str, modules: tuple[ModuleType, ...], called: tuple[str, ...], *, native: bool
) -> Mapping[str, Callable[..., Any]]:
    """The functions of a program that are called from outside; what several families share is compiled once.

    Args:
        source: text of its own.
        modules: those whose text stands before it.
        called: names of the functions.
        native: whether numba compiles them.
    """
    text = "\n\n".join([*map(inspect.getsource, modules), source])
    namespace = _native(text, called) if native else _interpreted(text)
    quiet: Any = (lambda function: function) if native else np.errstate(all="ignore")
    return {name: quiet(namespace[name]) for name in called}


def _interpreted(source: str) -> dict[str, Any]:
    """The functions of a text, run by Python."""
    namespace: dict[str, Any] = {"__name__": "program"}
    code.define_text(source, "<program of envgraph>", namespace)
    namespace.update(
        uniform=_uniform,
        hash_row=_hash_row,
        at=int,
        count_bits=lambda word: int(word).bit_count(),
        arrays_at=lambda arrays: arrays,
    )
    return namespace


def _native(source: str, called: Sequence[str]) -> dict[str, Any]:
    """The functions of a text, compiled by numba; it caches them beside a file with the text, named by its hash."""
    import numba

    from envgraph.env.compiled import _addresses

    known = numba.__version__, inspect.getsource(_addresses), source
    digest = sha256("\n".join(known).encode()).hexdigest()[:32]
    path = Path("programs") / f"program_{digest}.py"
    folder, kept = cache_directory(), False
    if folder is not None:
        path = folder / path
        with suppress(OSError):  # a directory that cannot be written keeps nothing
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                replace_file(path, source)
            kept = True
    module = ModuleType(path.stem)
    sys.modules[path.stem] = module  # numba looks there for the functions of what it has cached
    namespace = vars(module)
    code.define_text(source, str(path), namespace)
    options: Any = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
    inside: Any = {**options, "forceinline": True, "no_cpython_wrapper": True}
    inner, outer = numba.njit(**inside), numba.njit(nogil=True, cache=kept, **options)
    for name, value in list(namespace.items()):
        if inspect.isfunction(value) and value.__module__ == path.stem:
            namespace[name] = (outer if name in called else inner)(value)
    namespace["arrays_at"] = inner(_addresses.arrays_at)
    return namespace


def _uniform(states: Any, row: int) -> float:
    """NumPy's PCG64, with Python's ints."""
    lo, hi, inc_lo, inc_hi = (int(part) for part in states[row])
    state = (hi << 64 | lo) * 0x2360ED051FC65DA44385DF649FCCF645 + (inc_hi << 64 | inc_lo)
    lo, hi = state & WORD, state >> 64 & WORD
    states[row, 0], states[row, 1] = lo, hi
    mixed, turns = hi ^ lo, hi >> 58
    mixed = (mixed >> turns | mixed << (-turns & 63)) & WORD
    return (mixed >> 11) * 2.0**-53


def _hash_row(states: Any, floats: Any, row: int) -> Any:
    """A hash of a state, where whole numbers are Python's."""
    return np.uint64(crc32(states[row].tobytes() + floats[row].tobytes()))
