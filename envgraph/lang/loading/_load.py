"""Load files as an engine or a workspace: the public functions for programs."""

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
from envgraph.lang.loading._metamodels import Metamodels, is_same_metamodel
from envgraph.lang.loading._reading_cache import ReadingCache
from envgraph.lang.loading._workspace import Workspace
from envgraph.lang.syntax._bundled_data import bundled_file
from envgraph.lang.syntax._source_files import DiskFiles, Files, file_in_directory
from envgraph.metamodel import Metamodel
from envgraph.rewrite import Engine

if TYPE_CHECKING:  # This is loaded with the first environment.
    pass

StrPath = str | PathLike[str]


def open(*paths: StrPath, seed: int = 0, allow_unresolved: bool = False) -> Engine:
    """Return an engine with everything that the files and their imports define.

    Args:
        paths: files of any language, a family file, a directory with one, or the name of a bundled domain. If neither
            they nor their imports contain a model, the engine's model is empty.
        seed: seed of the engine's random choices.
        allow_unresolved: True to drop links of EMF models to missing files and objects; otherwise these are errors.

    Raises:
        LoadError: there are errors in any of the files; lists all of them.
        InvalidArgument: no path leads to a metamodel, or several lead to a model.

    >>> engine = open("burning_forest")
    >>> engine.count("burningTile")
    20
    """
    return open_workspace(*paths, allow_unresolved=allow_unresolved).engine(seed=seed)


def open_workspace(*paths: StrPath, allow_unresolved: bool = False) -> Workspace:
    """Return the workspace from which `open` makes an engine; its `diagnostics` hold errors and warnings."""
    return load_workspace(_prefer_family_files(paths), allow_unresolved=allow_unresolved)


def load(engine: Engine, *paths: StrPath) -> None:
    """Add the patterns, rules, units and derived groups of files and their imports to an engine.

    A definition that is equal to a definition of the engine with the same name is skipped. Models and behaviours in the
    files are ignored.

    Raises:
        LoadError: there are errors in any of the files; lists all of them. The engine is unchanged.
        InvalidArgument: the files use another metamodel than the engine's model.
    """
    own = engine.model.metamodel
    workspace = load_workspace(paths, metamodel=own)
    workspace.raise_errors()
    if workspace.metamodel is not None and not is_same_metamodel(workspace.metamodel, own):
        raise InvalidArgument(
            f"the files use metamodel `{workspace.metamodel.name}`, but the engine's model uses `{own.name}`"
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
    cache: ReadingCache | None = None,
) -> Workspace:
    """Read and check files and their imports; errors are returned in `diagnostics` of the workspace.

    Args:
        paths: files of any language; family files, with their model and environment; directories, with all their files;
            names of bundled domains, or of files in them, such as `burning_forest/paper.toml`.
        files: where files are read from; None for the disk, `TextFiles` for texts in memory.
        components: the kinds of measures and selections that a family file may name, by role (see `check_family`).
        metamodel: the metamodel to use if no file is one or imports one by its path; files may import it by its URI or
            name.
        allow_unresolved: True to drop links of EMF models to missing objects with a warning.
        overrides: settings that replace those of family files, such as "search.population=10".
        cache: takes the results of reading, and gives those of an earlier call for files that have not changed.
    """
    with _garbage_collection_disabled():
        metamodels = Metamodels(metamodel, allow_unresolved)
        loader = Loader(files or DiskFiles(), components, metamodels, overrides, cache or ReadingCache())
        for path in paths:
            loader.add_root(fspath(path) if files else bundled_file(fspath(path)))
        return loader.check_all()


@contextmanager
def _garbage_collection_disabled() -> Iterator[None]:
    """Disable garbage collection in the block, because it would take 1/3 of the time and free hardly any object."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _prefer_family_files(paths: Sequence[StrPath]) -> list[str]:
    """Return the paths, where each directory or domain that has a family file is replaced by this file."""
    files = DiskFiles()
    chosen = []
    for path in (bundled_file(fspath(one)) for one in paths):
        directory = directory_of(files, path)
        family = file_in_directory(directory, FAMILY_FILE) if directory else None
        chosen.append(family if family and family in files.entries(directory or "") else path)
    return chosen
