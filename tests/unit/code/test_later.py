"""Names of packages are loaded when they are first used."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import envgraph

PACKAGES = sorted(
    ".".join(path.parent.relative_to(Path(envgraph.__file__).parents[1]).parts)
    for path in Path(envgraph.__file__).parent.rglob("__init__.py")
    if "\nlater(globals())\n" in path.read_text("utf-8")
)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_imported_listed_and_copied_by_a_star(package: str) -> None:
    module = import_module(package)
    copied: dict[str, object] = {}
    exec(f"from {package} import *", copied)
    assert {name: getattr(module, name) for name in module.__all__}.items() <= copied.items()
    assert [name for name in dir(module) if not name.startswith("__")] == module.__all__ and len(
        module.__all__
    ) > 1


def test_a_name_is_loaded_with_its_module_alone() -> None:
    program = (
        "import sys, envgraph.search; print('envgraph.search.evolution._selection' in sys.modules)\n"
        "from envgraph.search import ElitistParents\n"
        "print('envgraph.search.evolution._selection' in sys.modules)\n"
        "print('envgraph.search.families._family' in sys.modules)\n"
        "print(vars(envgraph.search)['ElitistParents'] is ElitistParents)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True", "False", "True"]


def test_an_unknown_name_is_an_error_as_in_any_module() -> None:
    with pytest.raises(AttributeError, match=r"module `envgraph\.search` has no attribute `nothing`"):
        import_module("envgraph.search").nothing  # noqa: B018
    with pytest.raises(ImportError, match=r"cannot import name 'nothing' from 'envgraph\.search'"):
        exec("from envgraph.search import nothing")
