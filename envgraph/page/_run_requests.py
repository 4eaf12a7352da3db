"""Answer requests about runs: list them, and open one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from envgraph.errors import InvalidArgument
from envgraph.page._work import JsonObject, Params, Work

if TYPE_CHECKING:
    from envgraph.page._opened_run import OpenedRun
    from envgraph.page._page_session import PageSession


def list_runs(session: PageSession, params: Params) -> JsonObject:
    """Return the names of the runs, the newest first, with the number of members of each, and the run that is open."""
    runs = [] if session.runs is None else list(_describe_runs(session.runs))
    opened = session.run
    if opened is not None and opened.name not in (one["name"] for one in runs):  # a family file
        members = len(opened.family.members)
        runs.insert(0, {"name": opened.name, "family": opened.family.name, "members": members, "problem": None})
    return {"runs": runs, "open": None if opened is None else opened.name}


def _describe_runs(directory: Path) -> Iterator[JsonObject]:
    from envgraph.search import RunStore

    files = [file for file in directory.glob("*/run.sqlite") if file.is_file()]
    for file in sorted(files, key=lambda one: (-one.stat().st_mtime_ns, one)):
        found: JsonObject = {"name": file.parent.name, "family": None, "members": 0, "problem": None}
        try:
            with RunStore.open(file) as store:
                last = store.last_generation()
                yield {**found, "family": store.name, "members": len(last.members) if last else 0}
        except InvalidArgument as error:
            yield {**found, "problem": str(error)}


def open_run(session: PageSession, params: Params) -> Work:
    """Open a run by its name, and return its members; without a name, return those of the run that is open.

    Raises:
        InvalidArgument: there is no such run, or it has no family yet.
    """
    name, opened = params.get("name"), session.run
    if name is None or (opened is not None and opened.name == name):
        if opened is None:
            raise InvalidArgument("no run is open", "give the `name` of a run")
        return Work(opened.describe)
    directory = session.runs
    if directory is None:
        raise InvalidArgument("there are no runs here", "start `envgraph serve` in the folder that contains `runs`")
    if Path(str(name)).name != name:
        raise InvalidArgument(f"`{name}` is not the name of a run", "leave out `/`")

    def run() -> tuple[OpenedRun, JsonObject]:
        found = load_run(str(name), directory)
        return found, found.describe()

    def finish(found: tuple[OpenedRun, JsonObject]) -> JsonObject:
        session.run, described = found
        if session.member is not None:  # of another run
            session.member, session.shown = None, None
            session.load()
        return described

    return Work(run, finish)


def load_run(location: str, directory: Path) -> OpenedRun:
    """Return a run, given its name below a directory, its directory or store; or a family file (.json)."""
    from envgraph.page._opened_run import OpenedRun
    from envgraph.search import find_run_store, open_family

    if location.endswith(".json"):
        return OpenedRun(Path(location).stem, open_family(location), None)
    path = find_run_store(location, directory)
    return OpenedRun(path.parent.resolve().name, open_family(path), path)
