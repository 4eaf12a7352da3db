"""Compile programs with numba, and cache their machine code. Exported packages contain a copy of this module.

A program is optimised as a whole: numba itself would optimise each function together with all functions below it, and
make machine code of it. Passes that programs do not need are left out. Loops are neither unrolled nor vectorised: they
are short, and copies of them take most of the time to compile.

Numba's own cache unpickles any file in its directory, and fails if a file is damaged or cannot be written.
"""

# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import pickle
import sys
from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from inspect import isfunction
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import Linkage, create_pass_builder, create_pipeline_tuning_options
from numba.core import compiler, config, serialize, typed_passes as typed, untyped_passes as untyped
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import PassManager, register_pass

_Result: Any = compiler.CompileResult
_dumps: Any = serialize.dumps
_config: Any = config


def compile_functions(namespace: dict[str, Any], called: Sequence[str], source: str, cache: Any) -> None:
    """Replace the functions that a program's module defines by functions that numba compiles when they are called.

    Args:
        namespace: the names of the module.
        called: the functions that Python calls. Their machine code is loaded and saved, if there is a cache directory.
        source: the whole text that the functions are compiled from.
        cache: the module that reads and writes cache files. `NUMBA_CACHE_DIR` names another directory for them.
    """
    options: Any = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True, "pipeline_class": _ProgramCompiler}
    njit: Any = numba.njit
    inner, outer = njit(no_cpython_wrapper=True, **options), njit(nogil=True, **options)
    folder = cache.cache_directory()
    for name, value in list(namespace.items()):
        if isfunction(value) and value.__module__ == namespace["__name__"]:
            made = namespace[name] = (outer if name in called else inner)(value)
            if name in called and folder is not None:
                place = Path(_config.CACHE_DIR or folder / "programs")
                made._cache = _MachineCodeCache(place, f"{name}\0{source}", cache)


class _ProgramLibrary(JITCodeLibrary):
    """The code of a function that Python calls, and of all functions below it."""

    def add_linking_library(self, library: Any) -> None:
        """Add the code of a function that is called, after all code below it."""
        library._ensure_finalized()
        known = (*self._linking_libraries, *library._linking_libraries, library)
        self._linking_libraries = list(dict.fromkeys(known))

    def finalize(self) -> None:
        """Link callers first, since LLVM only adds functions that are called; then make machine code."""
        self._linking_libraries.reverse()
        super().finalize()

    def _optimize_functions(self, ll_module: Any) -> None:
        """Do not optimise a function alone."""
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Optimise everything at once. LLVM knows all calls of a function that is internal, and decides on inlining."""
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = Linkage.internal
        options = create_pipeline_tuning_options(_config.OPT)
        options.loop_unrolling = options.loop_interleaving = options.loop_vectorization = False
        builder = create_pass_builder(self._codegen._tm, options)
        builder.getModulePassManager().run(self._final_module, builder)


class _InnerLibrary(_ProgramLibrary):
    """The code of a function that only other functions of the program call. No machine code is made of it alone."""

    codegen = property(lambda self: self)

    def finalize(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: Python cannot call the function."""
        return 0

    def set_env(self, name: str, environment: object) -> None:
        """Do nothing: the function has no machine code that could use its environment."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _ProgramLowering(typed.NativeLowering):
    """Lowering of functions into the libraries of this module."""

    _name = "program_lowering"

    def run_pass(self, state: Any) -> bool:
        library = _InnerLibrary if state.flags.no_cpython_wrapper else _ProgramLibrary
        state.library = library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


class _ProgramCompiler(compiler.CompilerBase):
    """A compiler with the passes that programs need."""

    def define_pipelines(self) -> list[Any]:
        manager: Any = PassManager("program")
        before = (
            untyped.TranslateByteCode,
            untyped.FixupArgs,
            untyped.IRProcessing,
            untyped.GenericRewrites,
            untyped.ReconstructSSA,
        )
        after = (typed.NopythonTypeInference, typed.PreLowerStripPhis, _ProgramLowering, typed.NoPythonBackend)
        for step in (*before, *after):
            manager.add_pass(step, step.__name__)
        manager.finalize()
        return [manager]


class _MachineCodeCache(NullCache):
    """A cache of the machine code of one function, with a file for each signature and processor."""

    def __init__(self, folder: Path, function: str, cache: Any) -> None:
        self._folder, self._function, self._files = folder, function, cache
        self._start = sha256(function.encode()).hexdigest()[:16]
        self.files = partial(folder.glob, f"{self._start}*")  # for all signatures and processors

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
        return self._folder / f"{self._start}{sha256(key.encode()).hexdigest()[:16]}", key
