"""Find the folder, bundled domain or run that `envgraph serve` shows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.editor import LanguageService
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.lang import FORMATS, DiskFiles, Files, TextFiles, bundled_domain, bundled_domains
from envgraph.page._page_session import PageSession
from envgraph.page._work import Notify

if TYPE_CHECKING:
    from envgraph.page._opened_run import OpenedRun


@dataclass(frozen=True, slots=True)
class Target:
    """The files that a page shows: those of a folder, of a bundled domain, or of a run.

    Attributes:
        title: the name of the folder, domain or run.
        files: the files.
        folder: the name of the folder with the texts, for `files`.
        writable: True if texts may be saved.
        runs: the directory of all runs; None if there are none here.
        run: the run that is open from the beginning; None for none.
    """

    title: str
    files: Files
    folder: str
    writable: bool = False
    runs: Path | None = None
    run: OpenedRun | None = None

    def open_session(self, service: LanguageService, notify: Notify) -> PageSession:
        """Return a new session that shows the files."""
        session = PageSession(service, self.folder, notify, title=self.title, writable=self.writable, runs=self.runs)
        session.run = self.run
        return session


def find_target(location: str | None, runs: Path) -> Target:
    """Return the files at a location: a folder, the name of a bundled domain, a run, or a family file (.json).

    Args:
        location: None for the working directory.
        runs: the directory of all runs.

    Raises:
        InvalidArgument: there is no such folder, domain or run.
        LoadError: the texts that are stored with a run have errors.
    """
    path = Path(location or ".")
    if path.is_dir() and not (path / "run.sqlite").is_file():
        return Target(path.resolve().name, DiskFiles(), str(path), True, runs)
    if location in bundled_domains():
        assert location is not None
        return Target(location, DiskFiles(), str(bundled_domain(location)), False, runs)
    if path.is_file() and path.suffix[1:] in FORMATS and path.suffix not in (".json", ".sqlite", ".family"):
        raise InvalidArgument(f"`{location}` is a file", f"name its folder: `envgraph serve {path.parent}`")
    if not path.exists() and not (runs / path).exists():
        known = bundled_domains()
        hint = did_you_mean(str(location), known) or "the bundled domains are " + ", ".join(known)
        raise InvalidArgument(f"there is no folder, no run and no domain `{location}`", hint)
    from envgraph.page._run_requests import load_run

    run = load_run(str(location), runs)
    bundle = run.family.bundle
    folder = bundle.roots[0].rpartition("/")[0] or "."
    beside = runs if run.path is None else run.path.parent.parent
    return Target(run.name, TextFiles(bundle.texts), folder, False, beside, run)
