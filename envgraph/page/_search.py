"""Search for a family in a thread, and notify the page of its progress."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from itertools import count
from math import isfinite
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from envgraph.editor import StoppedError
from envgraph.errors import InvalidArgument
from envgraph.files import report_progress
from envgraph.lang import load_workspace
from envgraph.page._answers import error_object
from envgraph.page._work import JsonObject, Params

if TYPE_CHECKING:
    from envgraph.page._page_session import PageSession
    from envgraph.search import Domain, Generation
    from envgraph.search.curricula import CurriculumProgress

_PAUSE: Final = 0.5
"""Least number of seconds between two notifications."""

_MEMBERS: Final = 12
"""Members that are drawn while a search runs."""


class RunningSearch:
    """A search that runs in a thread of its own; its result is stored as a run.

    Args:
        session: gets the notifications.
        domain: the family that is searched for.
        path: the run store that the search creates.

    Attributes:
        stopped: after this is set, the search ends with the next candidate generation.
    """

    def __init__(self, session: PageSession, domain: Domain, path: Path) -> None:
        self.stopped = Event()
        self.run_name = path.parent.name
        self._session, self._domain, self._path = session, domain, path
        self._begun, self._last_notice = monotonic(), 0.0
        self._thread = Thread(target=self._run, name="envgraph search", daemon=True)

    def begin(self) -> None:
        """Start the thread."""
        self._thread.start()

    @property
    def is_running(self) -> bool:
        """Return True if the search has not ended."""
        return self._thread.is_alive()

    def join(self, seconds: float) -> None:
        """Wait until the search has ended, but at most for a number of seconds."""
        self._thread.join(seconds)

    def _run(self) -> None:
        from envgraph.search import generate_from_domain

        try:
            with report_progress(lambda text: None):  # the page shows it, and the terminal keeps the address
                family = generate_from_domain(
                    self._domain,
                    self._path,
                    progress=self._show_generation,
                    climbing=self._show_climbing,
                    drawing=lambda found: self._show(int(100 * found.share), None, found.attempts, {}),
                )
            self._finish({"members": self._draw(family), "bins": _count_bins(family)})
        except StoppedError:
            self._finish({"stopped": True})
        except Exception as error:  # The page shows what went wrong.
            self._finish({"error": error_object(error, self._session.locate)})

    def _show_generation(self, generation: Generation) -> None:
        more: JsonObject = {}
        if monotonic() - self._last_notice >= _PAUSE:
            from envgraph.search import open_family

            family = open_family(self._path)
            more = {"members": self._draw(family), "bins": _count_bins(family)}
        self._show(generation.number, generation.diversity, generation.accepted + generation.rejected, more)

    def _show_climbing(self, found: CurriculumProgress) -> None:
        best = found.value if isfinite(found.value) else None
        self._show(int(100 * found.effort_share), best, found.families_judged, {})

    def _show(self, number: int, best: float | None, evaluations: int, more: JsonObject) -> None:
        """Notify the page, unless it was notified shortly before; raise StoppedError if the search is to stop."""
        if self.stopped.is_set():
            raise StoppedError("the search was stopped")
        if monotonic() - self._last_notice >= _PAUSE:
            self._last_notice = monotonic()
            self._notify({"generation": number, "best": best, "evaluations": evaluations, "done": False, **more})

    def _finish(self, more: JsonObject) -> None:
        with suppress(OSError):  # there is a run in it
            self._path.parent.rmdir()
        self._notify({"done": True, "run": self.run_name if self._has_family() else None, **more})

    def _has_family(self) -> bool:
        """Return True if the run has a generation; a search that ends early has none."""
        from envgraph.search import RunStore

        if not self._path.exists():
            return False
        with RunStore.open(self._path) as store:
            return store.last_generation() is not None

    def _notify(self, found: JsonObject) -> None:
        seconds = round(monotonic() - self._begun, 1)
        self._session.notify("page/search/progress", {"seconds": seconds, **found})

    def _draw(self, family: Any) -> list[JsonObject]:
        from envgraph.page._opened_run import OpenedRun

        opened = OpenedRun(self.run_name, family, self._path)
        return [opened.describe_member(one) for one in family.members[-_MEMBERS:]]


def _count_bins(family: Any) -> list[JsonObject]:
    from envgraph.search import Outcome

    return [{"label": str(one), "count": count} for one, count in sorted(Counter(Outcome.of(family).bins).items())]


def start(session: PageSession, params: Params) -> JsonObject:
    """Start a search for the family of a file, from the texts as they are edited; return the name of its run.

    Raises:
        InvalidArgument: a search runs already, there is no such file, or no place for runs.
        LoadError: the texts have errors.
    """
    try:
        from envgraph.search import Domain
    except ImportError as error:
        raise InvalidArgument("a search needs NumPy and Gymnasium, which are not available here") from error
    if session.search is not None and session.search.is_running:
        raise InvalidArgument("another search is running", "stop it, or wait until it has ended")
    if session.runs is None:
        raise InvalidArgument("a search needs a folder on the disk for its run", "use `envgraph serve`")
    name = _family_file(session, params.get("family"))
    overrides = [
        f"{key}={params[given]}"
        for given, key in (("seed", "seed"), ("generations", "search.generations"))
        if params.get(given) is not None
    ]
    workspace = load_workspace([name], files=session.service.edited_files())
    workspace.raise_errors()
    domain = Domain.from_bundle(workspace.bundle(), None, overrides)
    path = _free_path(session.runs, domain.spec.name)
    session.search = RunningSearch(session, domain, path)
    session.search.begin()
    return {"run": path.parent.name, "generations": domain.spec.search.generations}


def stop(session: PageSession, params: Params) -> JsonObject:
    """Stop the search that runs; the generations so far stay in its run, which `envgraph generate --resume` resumes."""
    if session.search is None or not session.search.is_running:
        raise InvalidArgument("no search is running")
    session.search.stopped.set()
    return {"run": session.search.run_name}


def _family_file(session: PageSession, uri: Any) -> str:
    """Return the name of the family file with this URI; without one, that of the folder."""
    if uri is None:
        if not session.workspace.families:
            raise InvalidArgument("the folder has no `family.toml`", "write it, or choose another family file")
        return session.workspace.families[0].path
    name = session.service.name_of(str(uri))
    if not name.endswith(".toml") or name not in session.service.edited_files().entries(session.folder):
        raise InvalidArgument(f"`{uri}` is not a family file of this folder", "choose a `.toml` file")
    return name


def _free_path(runs: Path, name: str) -> Path:
    """Return the path of a new run: the name of the family, with a number if there is a run of this name.

    Its directory is created, so that another page that begins a search meanwhile chooses another name.
    """
    for number in count(1):
        path = runs / (name if number == 1 else f"{name}-{number}")
        with suppress(FileExistsError):
            path.mkdir(parents=True)
            break
    return path / "run.sqlite"
