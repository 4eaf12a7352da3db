"""Whatever lies in the cache of machine code, programs calculate the same, and nothing in the cache runs."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from envgraph.env.compiled import has_numba, load_functions
from envgraph.env.compiled.kernels._loading import has_machine_code

numba = pytest.importorskip("numba")
CompileResult = pytest.importorskip("numba.core.compiler").CompileResult
TEXT = "def times(x):\n    return 3 * x\n"


class Canary:
    """Creates a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "programs"


def loaded(text: str = TEXT) -> bool:
    """Run a program; return True if its machine code came from the cache."""
    load_functions.cache_clear()
    times = load_functions(text, (), ("times",), native=True)["times"]
    assert times(4) == 12
    return sum(times.stats.cache_hits.values()) == 1


def test_machine_code_is_compiled_once(cache: Path) -> None:
    assert not loaded()
    assert loaded()
    assert not loaded(TEXT + "\n# another text\n")


def test_machine_code_is_known_before_it_is_loaded(cache: Path) -> None:
    def times() -> Any:
        load_functions.cache_clear()
        return load_functions(TEXT, (), ("times",), native=True)["times"]

    assert not has_machine_code(times())
    function = times()
    function(4)
    assert has_machine_code(function) and has_machine_code(times())
    (path,) = cache.iterdir()
    path.unlink()
    assert has_machine_code(function) and not has_machine_code(times())


def test_machine_code_is_not_known_without_a_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_CACHE", "off")
    load_functions.cache_clear()
    function = load_functions(TEXT, (), ("times",), native=True)["times"]
    assert not has_machine_code(function)
    function(4)
    assert has_machine_code(function)


@pytest.mark.parametrize(
    "change",
    [lambda code: b"", lambda code: code[:300], lambda code: code[:-1] + bytes([code[-1] ^ 1])],
    ids=["empty", "cut", "one bit"],
)
def test_damaged_machine_code_is_compiled_anew(cache: Path, change: Callable[[bytes], bytes]) -> None:
    loaded()
    (path,) = cache.iterdir()
    path.write_bytes(change(path.read_bytes()))
    assert not loaded()
    assert loaded()


def test_forged_machine_code_does_not_run(cache: Path, tmp_path: Path) -> None:
    loaded()
    (path,) = cache.iterdir()
    path.write_bytes(pickle.dumps(Canary(tmp_path / "canary")))
    assert not loaded()
    assert not (tmp_path / "canary").exists()


def test_machine_code_of_another_numba_is_compiled_anew(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its checksum is right, but it cannot be loaded."""
    with monkeypatch.context() as patched:
        patched.setattr(CompileResult, "_reduce", lambda _: ("of", "another", "version"))
        assert not loaded()
    assert len([*cache.iterdir()]) == 1
    assert not loaded()
    assert loaded()


def test_cache_directory_of_numba_is_used(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "numba"))
    assert not loaded()
    assert loaded()
    assert not cache.exists() and len([*(tmp_path / "numba").iterdir()]) == 1


def test_programs_run_in_python_where_numba_is_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    assert has_numba()
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert not has_numba()
    assert load_functions(TEXT, (), ("times",), native=has_numba())["times"](4) == 12
