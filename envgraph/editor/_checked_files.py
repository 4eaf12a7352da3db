"""Check a file together with the files that belong to it, as `envgraph check` does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, ClassVar

from envgraph.code import dataclass
from envgraph.editor._mentions import mentions_of
from envgraph.errors import Diagnostic, EnvgraphError, LoadError, Source, sort_diagnostics
from envgraph.lang import FORMATS, FamilySpec, Files, ReadingCache, Workspace, language_of, load_workspace, text_parts
from envgraph.metamodel import Metamodel

if TYPE_CHECKING:
    from envgraph.editor._match_counts import MatchCounts

_FAMILY_FILES = ("family.toml", "problem.toml")
"""The family files that are read with their directory; others, such as `paper.toml`, are read alone."""

_MAX_DIRECTORIES = 1_000
"""Directories that are searched for other files that use a name."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The files that were read together, and all their problems.

    Attributes:
        workspace: the files.
        problems: their problems, and those of their families.
        metamodel: their metamodel, or if it has errors now, that of an earlier check.
        counts: the numbers of matches, as they were last counted; None if there are errors or no model.
        cache: what the next check need not read again.
    """

    workspace: Workspace
    problems: Sequence[Diagnostic]
    metamodel: Metamodel | None = None
    counts: MatchCounts | None = None
    cache: ReadingCache = field(default_factory=ReadingCache, compare=False, repr=False)

    def depends_on(self, name: str, roots: tuple[str, ...]) -> bool:
        """Return True if a change of this file may change the result, because it was read or is in the directory."""
        return name in self.workspace.sources or (name.rpartition("/")[0] or ".") in roots or bool(self._missing())

    def _missing(self) -> list[Diagnostic]:
        return [one for one in self.problems if one.code in ("missing-file", "unreadable-file", "unknown-uri")]


@dataclass(frozen=True, slots=True)
class CheckJob:
    """A check of files that may run in another thread, because nothing that it reads is changed.

    Attributes:
        roots: the paths to read.
        files: all files, as they were when the job was made.
        open_texts: the texts of the open documents. Their names are found first, so that requests need not wait.
        last: the result of the last check of these paths.
        seconds: None, because checks always end.
    """

    seconds: ClassVar = None
    roots: tuple[str, ...]
    files: Files
    open_texts: tuple[Source, ...] = ()
    last: CheckResult | None = None

    @staticmethod
    def roots_of(files: Files, name: str, folders: Iterable[str]) -> tuple[str, ...]:
        """Return the paths to read for a file: its directory if this is in one of the folders, else the file alone."""
        directory, _, last = name.rpartition("/")
        directory = directory or "."
        suffix = last.rpartition(".")[2]
        is_read = suffix in FORMATS and (last in _FAMILY_FILES if suffix == "toml" else suffix != "json")
        if is_read and any(_is_below(directory, one) for one in folders) and name in files.entries(directory):
            return (directory,)
        return (name,)

    def run(self) -> CheckResult:
        """Return the result of the check."""
        for source in self.open_texts:
            for part in text_parts(source):
                mentions_of(part)
        cache = self.last.cache.next() if self.last else ReadingCache()
        try:
            workspace = load_workspace(self.roots, files=self.files, cache=cache)
        except LoadError as error:
            return CheckResult(Workspace(roots=self.roots), error.diagnostics)
        return CheckResult(workspace, find_problems(workspace), workspace.metamodel, cache=cache)


def all_roots(files: Files, folders: Iterable[str]) -> Iterator[tuple[str, ...]]:
    """Yield the roots of each check in folders: a directory with files in our languages, or another family file."""
    waiting, most = list(folders), _MAX_DIRECTORIES
    while waiting and most:
        most -= 1
        directory = waiting.pop()
        entries = files.entries(directory)
        if any(language_of(one) for one in entries):
            yield (directory,)
            yield from ((one,) for one in entries if _is_other_family(one))
        waiting += [one for one in entries if not _is_left_out(one) and files.is_directory(one)]


def _is_other_family(name: str) -> bool:
    return name.endswith(".toml") and name.rpartition("/")[2] not in _FAMILY_FILES


def mentions_word(files: Files, roots: tuple[str, ...], word: str) -> bool:
    """Return True if a word is in one of the files, or in a file directly in one of the directories."""
    for root in roots:
        for name in files.entries(root) if files.is_directory(root) else [root]:
            try:
                if (language_of(name) or name.endswith(".toml")) and word.encode() in files.read(name):
                    return True
            except (OSError, ValueError):
                continue
    return False


def _is_left_out(path: str) -> bool:
    last = path.rpartition("/")[2]
    return last.startswith((".", "__")) or last in ("node_modules", "build", "dist")


def _is_below(directory: str, folder: str) -> bool:
    """Return True if a directory is the folder or inside it; the names in the working directory `.` are relative."""
    return directory == folder or directory.startswith(f"{folder}/") or (folder == "." and directory[:1] != "/")


def find_problems(workspace: Workspace) -> list[Diagnostic]:
    """Return all problems of the files of a workspace, sorted, except those that only a search finds."""
    from envgraph.lang import check_start

    found = list(workspace.diagnostics)
    if not (workspace.families or workspace.errors) and len(workspace.models) == len(workspace.behaviours) == 1:
        found += check_start(workspace.behaviours[0], workspace.models[0])
    for spec in workspace.families:
        found += find_family_problems(spec, workspace, search=False)
        if spec.audit is not None and not workspace.errors:
            from envgraph.learn.audit import check_audit

            found += check_audit(spec, workspace)
    return sort_diagnostics(found)


def find_family_problems(spec: FamilySpec, workspace: Workspace, search: bool) -> Sequence[Diagnostic]:
    """Return the problems of a family, with or without a search; an exception counts as one."""
    from envgraph.search import check_component_options, check_domain

    try:
        return check_component_options(spec, workspace) if workspace.errors else check_domain(spec, workspace, search)
    except EnvgraphError as error:
        found: Sequence[Diagnostic] = getattr(error, "diagnostics", ())
        return found or [Diagnostic("invalid-argument", error.message, None, error.hint)]
