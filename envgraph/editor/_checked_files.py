"""Check a file together with the files that belong to it, as `envgraph check` does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, EnvgraphError, LoadError, sort_diagnostics
from envgraph.lang import FORMATS, FamilySpec, Files, Workspace, load_workspace

_FAMILY_FILES = ("family.toml", "problem.toml")
"""The family files that are read with their directory; others, such as `paper.toml`, are read alone."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The files that were read together, and all their problems.

    Attributes:
        workspace: the files.
        problems: their problems, and those of their families.
    """

    workspace: Workspace
    problems: Sequence[Diagnostic]

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
    """

    roots: tuple[str, ...]
    files: Files

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
        try:
            workspace = load_workspace(self.roots, files=self.files)
        except LoadError as error:
            return CheckResult(Workspace(roots=self.roots), error.diagnostics)
        return CheckResult(workspace, find_problems(workspace))


def _is_below(directory: str, folder: str) -> bool:
    """Return True if a directory is the folder or inside it; the names in the working directory `.` are relative."""
    return directory == folder or directory.startswith(f"{folder}/") or (folder == "." and directory[:1] != "/")


def find_problems(workspace: Workspace) -> list[Diagnostic]:
    """Return all problems of the files of a workspace, sorted, but for those that a search finds."""
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
