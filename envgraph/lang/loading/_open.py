"""Files to an engine, to its rules and behaviours, or to all that they say: what programs call."""

from __future__ import annotations

import gc
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike, fspath
from typing import TYPE_CHECKING

from envgraph.errors import InvalidArgument
from envgraph.lang.family._family_reader import FAMILY_FILE
from envgraph.lang.loading._family_check import COMPONENTS
from envgraph.lang.loading._loader import Loader, directory_of
from envgraph.lang.loading._metamodels import Metamodels, same
from envgraph.lang.loading._workspace import Workspace
from envgraph.lang.syntax._data import bundled_file
from envgraph.lang.syntax._files import DiskFiles, Files, in_directory
from envgraph.metamodel import Metamodel
from envgraph.rewrite import Engine

if TYPE_CHECKING:  # loaded with the first environment
    pass

StrPath = str | PathLike[str]


def open(*paths: StrPath, seed: int = 0, allow_unresolved: bool = False) -> Engine:
    """An engine with everything that the files and their imports say.

    Args:
        paths: files of any language, a family file, a directory that holds one, or the name of a bundled domain.
            Without a model among them and what they import, the engine's model is empty.
        seed: of the engine's random choices.
        allow_unresolved: whether links of EMF models to files and objects that are nowhere are left out; else they are
            mistakes.

    Raises:
        LoadError: all that is wrong with all of the files, together.
        InvalidArgument: no path leads to a metamodel, or several lead to a model.

    >>> engine = open("burning_forest")
    >>> engine.count("burningTile")
    20
    """
    return open_workspace(*paths, allow_unresolved=allow_unresolved).engine(seed=seed)


def open_workspace(*paths: StrPath, allow_unresolved: bool = False) -> Workspace:
    """Return what `open` makes an engine of, and all that is wrong with it, warnings too."""
    return load_workspace(_family_first(paths), allow_unresolved=allow_unresolved)


def load(engine: Engine, *paths: StrPath) -> None:
    """Adds the patterns, rules, units and derived groups of files and their imports to an engine.

    What the engine has already is left alone: a definition that is equal to a known one of the same name is no error.
    Models and behaviours among the files are not used.

    Raises:
        LoadError: all that is wrong with all of the files, together. Nothing is added.
        InvalidArgument: the files are about another metamodel than the engine's model.
    """
    own = engine.model.metamodel
    workspace = load_workspace(paths, metamodel=own)
    workspace.raise_errors()
    if workspace.metamodel is not None and not same(workspace.metamodel, own):
        raise InvalidArgument(
            f"the files are about metamodel `{workspace.metamodel.name}`, the engine's model is of `{own.name}`"
        )
    known = {one.qualified_name: one for one in engine.definitions}
    new = [one for one in workspace.definitions if known.get(one.qualified_name) != one]
    engine.add(*new)


def load_workspace(
    paths: Iterable[StrPath],
    *,
    files: Files | None = None,
    components: Mapping[str, Collection[str]] = COMPONENTS,
    metamodel: Metamodel | None = None,
    allow_unresolved: bool = False,
    overrides: Sequence[str] = (),
) -> Workspace:
    """Reads and checks files and what they import; errors are in `diagnostics` of the result.

    Args:
        paths: files of any language; family files, whose model and environment are read too; directories, of which all
            files are read; names of bundled domains, or of files in them, `burning_forest/paper.toml`.
        files: where files are read from; the disk if None. `TextFiles` for texts at hand.
        components: the kinds of measures and selections that a family file may name, by role (see `check_family`).
        metamodel: what the files are about if none of them is a metamodel, or imports one by its path; they may
            import this one by its uri or its name.
        allow_unresolved: whether links of EMF models to what is nowhere are warnings, and left out.
        overrides: what holds instead of what family files say, such as "search.population=10".
    """
    with _without_collection():
        loader = Loader(files or DiskFiles(), components, Metamodels(metamodel, allow_unresolved), overrides)
        for path in paths:
            loader.add_root(fspath(path) if files else bundled_file(fspath(path)))
        return loader.workspace()


@contextmanager
def _without_collection() -> Iterator[None]:
    """Stops looking for garbage: nearly all that is made while reading stays, and to look takes a third of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _family_first(paths: Sequence[StrPath]) -> list[str]:
    """The paths, with the family file in place of a directory or domain that has one."""
    files = DiskFiles()
    chosen = []
    for path in (bundled_file(fspath(one)) for one in paths):
        directory = directory_of(files, path)
        family = in_directory(directory, FAMILY_FILE) if directory else None
        chosen.append(family if family and family in files.entries(directory or "") else path)
    return chosen
