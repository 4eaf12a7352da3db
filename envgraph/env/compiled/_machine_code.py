"""Cache the machine code of programs. Needs numba; exported packages contain a copy of this module.

Numba's own cache unpickles any file in its directory, and fails if a file is damaged or cannot be written.
"""

from __future__ import annotations

import pickle
import sys
from hashlib import sha256
from pathlib import Path
from typing import Any

import numba
from numba.core import compiler, config, serialize
from numba.core.caching import NullCache

_Result: Any = compiler.CompileResult
_dumps: Any = serialize.dumps
_config: Any = config


def keep_machine_code(function: Any, source: str, cache: Any) -> None:
    """Make a function that numba compiles load and save its machine code, if there is a cache directory.

    Args:
        function: compiled by `numba.njit`.
        source: the whole text that the function was compiled from.
        cache: the module that reads and writes cache files. `NUMBA_CACHE_DIR` names another directory for them.
    """
    folder = cache.cache_directory()
    if folder is not None:
        folder = Path(_config.CACHE_DIR or folder / "programs")
        function._cache = _MachineCodeCache(folder, f"{function.__name__}\0{source}", cache)


class _MachineCodeCache(NullCache):
    """A cache of the machine code of one function, with a file for each signature and processor."""

    def __init__(self, folder: Path, function: str, cache: Any) -> None:
        self._folder, self._function, self._files = folder, function, cache

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached machine code for a signature, or None if it is missing or cannot be loaded."""
        target_context.refresh()
        kept = self._files.read_cached(*self._path_and_key(sig, target_context.codegen()))
        if kept is None:
            return None
        try:
            return _Result._rebuild(target_context, *pickle.loads(kept))
        except Exception:  # The cause does not matter: compile again.
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write machine code to the cache, unless numba reports that it holds addresses of this process."""
        if not data.library.has_dynamic_globals:
            self._files.write_cached(*self._path_and_key(sig, data.codegen), _dumps(data._reduce()))

    def _path_and_key(self, signature: Any, codegen: Any) -> tuple[Path, str]:
        """Return the path of the cache file, and a key of everything that the machine code depends on."""
        python = sys.implementation.cache_tag
        key = repr((self._function, str(signature), codegen.magic_tuple(), numba.__version__, python))
        return self._folder / sha256(key.encode()).hexdigest()[:32], key
