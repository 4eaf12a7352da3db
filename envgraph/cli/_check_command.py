"""The command `envgraph check`: report all problems of files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from envgraph.cli._inputs import Inputs
from envgraph.cli._output import print_diagnostics, print_json, print_line, wants_json
from envgraph.errors import (
    WARNING_CODES,
    Diagnostic,
    InvalidArgument,
    LoadError,
    Severity,
    has_errors,
    name_hint,
)

if TYPE_CHECKING:
    from envgraph.lang import Workspace


def check_files(
    files: Sequence[str],
    inputs: Inputs,
    ignore: Sequence[str],
    overrides: Sequence[str],
    no_search: bool,
) -> int:
    """Print the errors and warnings of files, and their number; return exit code 1 if there are errors, otherwise 0.

    What takes long, the search of a family, is done last, and only if its files have no errors.

    Args:
        files: files that are read together with the metamodels; each directory or family is read on its own.
        ignore: codes of warnings to leave out.
        overrides: settings that replace those of family files.
        no_search: True to leave out the searches.
    """
    from envgraph.editor import find_family_problems
    from envgraph.lang import NEED_ENVIRONMENT

    for code in ignore:
        if code not in WARNING_CODES:
            raise InvalidArgument(f"there is no warning `{code}`", name_hint(code, WARNING_CODES))
    inputs.check_metamodels()
    diagnostics: dict[Diagnostic, None] = {}

    def report(problems: Iterable[Diagnostic]) -> None:
        kept = (one for one in problems if one.severity is Severity.ERROR or one.code not in ignore)
        new = {one: None for one in kept if one not in diagnostics}
        if not wants_json():
            print_diagnostics(new, first=not diagnostics)
        diagnostics.update(new)

    read = [_collect_problems(group, inputs, overrides) for group in _group_files(files)]
    if overrides and not any(workspace is None or workspace.families for _, workspace in read):
        raise InvalidArgument("`--set` needs a family file: name one, its directory or a bundled domain")
    report(one for problems, _ in read for one in problems)
    unsearched = ""
    for problems, workspace in () if no_search else read:
        for spec in workspace.families if workspace else ():
            if workspace and not has_errors(problems):
                report(find_family_problems(spec, workspace, search=True))
            elif spec.constraints.reachable or any(one.kind in NEED_ENVIRONMENT for one in spec.measures):
                unsearched += f"; the states of `{spec.name}` were not searched"
    failed = has_errors(diagnostics)
    if not print_json(lambda: {"ok": not failed, "diagnostics": [one.to_dict() for one in diagnostics]}):
        counts = _problem_counts(diagnostics) if diagnostics else f"no problems in {', '.join(files)}"
        print_line(counts + unsearched)
    return int(failed)


def _group_files(files: Sequence[str]) -> list[list[str]]:
    """Return the groups of files to read together: all single files in one, each directory or family on its own."""
    loose = [name for name in files if "." in Path(name).name and not name.endswith(".toml")]
    loose = [name for name in loose if not Path(name).is_dir()]
    return [[name] for name in files if name not in loose] + ([loose] if loose else [])


def _collect_problems(
    files: Sequence[str], inputs: Inputs, overrides: Sequence[str]
) -> tuple[list[Diagnostic], Workspace | None]:
    """Return the problems of files that are read together, but for those that a search finds, and what was read."""
    from envgraph.editor import find_problems
    from envgraph.lang import load_workspace

    try:
        named = [*inputs.metamodels, *files]
        workspace = load_workspace(named, allow_unresolved=inputs.allow_unresolved, overrides=tuple(overrides))
    except LoadError as error:
        return list(error.diagnostics), None
    return find_problems(workspace), workspace


def _problem_counts(diagnostics: Collection[Diagnostic]) -> str:
    errors = sum(diagnostic.severity == "error" for diagnostic in diagnostics)
    counts = ((errors, "error"), (len(diagnostics) - errors, "warning"))
    return ", ".join(f"{count} {word}{'s' if count > 1 else ''}" for count, word in counts if count)
