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
def test_every_public_name_is_in_dir_and_in_star_imports(package: str) -> None:
    module = import_module(package)
    copied: dict[str, object] = {}
    exec(f"from {package} import *", copied)
    assert {name: getattr(module, name) for name in module.__all__}.items() <= copied.items()
    assert [name for name in dir(module) if not name.startswith("__")] == module.__all__ and len(module.__all__) > 1


def test_using_a_name_loads_only_the_module_that_defines_the_name() -> None:
    program = (
        "import sys, envgraph.search; print('envgraph.search.evolution._survivor_selection' in sys.modules)\n"
        "from envgraph.search import ElitistParents\n"
        "print('envgraph.search.evolution._survivor_selection' in sys.modules)\n"
        "print('envgraph.search.families._member_family' in sys.modules)\n"
        "print(vars(envgraph.search)['ElitistParents'] is ElitistParents)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True", "False", "True"]


def test_an_unknown_name_raises_the_usual_import_errors() -> None:
    with pytest.raises(AttributeError, match=r"module `envgraph\.search` has no attribute `nothing`"):
        import_module("envgraph.search").nothing  # noqa: B018
    with pytest.raises(ImportError, match=r"cannot import name 'nothing' from 'envgraph\.search'"):
        exec("from envgraph.search import nothing")
