"""`envgraph runs`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from envgraph.cli._family import TRAINING
from envgraph.cli._options import RUNS
from envgraph.cli._output import OutputFormat, print_json, print_line, print_table
from envgraph.errors import InvalidArgument
from envgraph.search import RunStore


def list_runs(directory: Path, format: OutputFormat) -> None:
    """Print the runs of a directory, by name; one that cannot be read with what is wrong with it.

    Raises:
        InvalidArgument: there is no such directory; that for runs as a rule comes with the first one.
    """
    if directory != RUNS and not directory.is_dir():
        raise InvalidArgument(f"there is no directory `{directory}`")
    runs = [_run(file) for file in sorted(directory.glob("*/run.sqlite"))]
    if format is OutputFormat.JSON:
        print_json({"directory": str(directory), "runs": runs})
        return
    if not runs:
        print_line(f"there are no runs in {directory}; `envgraph generate` makes one")
        return
    columns = ("run", "family", "members", "generations", "diversity", "trained", "remark")
    rows = [_row(run) for run in runs]
    print_table(f"runs in {directory}", columns, rows, (2, 3, 4))


def _run(file: Path) -> dict[str, Any]:
    """A run as JSON-ready data."""
    found: dict[str, Any] = {"run": file.parent.name}
    try:
        with RunStore.open(file) as store:
            last = store.last_generation()
            found["family"] = store.name
            found["imported"] = store.imported
            found["overrides"] = list(store.overrides)
            found["generations"] = last.number if last else None
            found["members"] = len(last.members) if last else 0
            found["diversity"] = last.diversity if last else None
    except InvalidArgument as error:
        return {**found, "problem": str(error)}
    results = (file.parent / TRAINING).glob("*")
    return {**found, "trained": sorted(int(one.name) for one in results if one.name.isdecimal())}


def _row(run: dict[str, Any]) -> tuple[str, ...]:
    if "problem" in run:
        return (run["run"], "", "", "", "", "", run["problem"])
    diversity = run["diversity"]
    return (
        run["run"],
        run["family"],
        str(run["members"]),
        "" if run["generations"] is None else str(run["generations"]),
        "" if diversity is None else f"{diversity:.3f}",
        ", ".join(f"{steps} steps" for steps in run["trained"]),
        f"imported from {run['imported']}" if run["imported"] else " ".join(run["overrides"]),
    )
