"""Read texts that are at hand, each as a file of its own."""

from __future__ import annotations

from envgraph.errors import LoadError, Source
from envgraph.graph import Model
from envgraph.lang import DiskFiles, FamilySpec, Files, TextFiles, find_family, load_workspace
from envgraph.lang.family._family_reader import read_family
from envgraph.metamodel import Metamodel


def load_family(path: str, files: Files | None = None) -> FamilySpec:
    """Read a family file whose names may mean nothing; raise LoadError with all that is wrong with its text."""
    files = files or DiskFiles()
    found = read_family(find_family(path, files), files)
    if found.diagnostics:
        raise LoadError(found.diagnostics)
    return found.spec


def parse_ecore(source: Source) -> Metamodel:
    """Return the metamodel of the text of an `.ecore` file; raise LoadError with all that is wrong with it."""
    found = load_workspace([source.name], files=TextFiles({source.name: source.text}))
    found.raise_errors()
    assert found.metamodel is not None
    return found.metamodel


def parse_xmi(source: Source, metamodel: Metamodel, *, allow_unresolved: bool = False) -> Model:
    """Return the model of the text of an `.xmi` file; raise LoadError with all that is wrong with it."""
    files = TextFiles({source.name: source.text})
    found = load_workspace([source.name], files=files, metamodel=metamodel, allow_unresolved=allow_unresolved)
    return found.model()
