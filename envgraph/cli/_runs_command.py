"""The command `envgraph runs`: list or compare runs."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from typing import Any

from envgraph.cli._family_actions import TRAINING
from envgraph.cli._output import print_json, print_line, print_table
from envgraph.cli._shared_options import RUNS
from envgraph.errors import InvalidArgument
from envgraph.search import Member, RunStore, find_run_store, open_family


def show_runs(compared: Sequence[str], directory: Path) -> None:
    """Print a list of the runs in a directory or, if two runs are named, their differences."""
    if not compared:
        _list_runs(directory)
    elif len(compared) == 2:
        _compare_runs(compared[0], compared[1], directory)
    else:
        raise InvalidArgument(
            f"a comparison needs two runs, not {len(compared)}",
            "name two runs to compare them, or none to list all runs",
        )


def _list_runs(directory: Path) -> None:
    """Print the runs of a directory, by name; a run that cannot be read is listed with its problem.

    Raises:
        InvalidArgument: the directory does not exist. (The default directory may be missing: then there are no runs.)
    """
    if directory != RUNS and not directory.is_dir():
        raise InvalidArgument(f"there is no directory `{directory}`")
    runs = [_run_data(file) for file in sorted(directory.glob("*/run.sqlite"))]
    if print_json(lambda: {"directory": str(directory), "runs": runs}):
        return
    if not runs:
        print_line(f"there are no runs in {directory}; `envgraph generate` makes one")
        return
    columns = ("run", "family", "members", "generations", "diversity", "trained", "remark")
    rows = [_run_row(run) for run in runs]
    print_table(f"runs in {directory}", columns, rows, (2, 3, 4))


def _run_data(file: Path) -> dict[str, Any]:
    """Return the description of a run as JSON-ready data, with the key "problem" if the run cannot be read."""
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


def _compare_runs(first: str, second: str, directory: Path) -> None:
    """Print the differences between two runs: settings, file contents, figures, and members that only one of them has.

    Raises:
        InvalidArgument: a run does not exist, or has no family yet.
    """
    files = [find_run_store(run, directory) for run in (first, second)]
    one, other = map(_run_figures, files)
    differences = {
        name: [one.get(name), other.get(name)] for name in {**one, **other} if one.get(name) != other.get(name)
    }
    families = [open_family(file).members for file in files]
    models = [{member.model for member in members} for members in families]
    alone = [[m for m in members if m.model not in models[1 - n]] for n, members in enumerate(families)]
    only = [[{"name": m.name, **m.measures} for m in members] for members in alone]
    if print_json(lambda: {"runs": [first, second], "differences": differences, "members": only}):
        return
    rows = [(name, *map(_format_cell, values)) for name, values in differences.items()]
    rows += [("member", *map(_format_member, pair)) for pair in zip_longest(*alone)]
    if rows:
        print_table(f"{first} and {second}", ("what differs", first, second), rows)
    else:
        print_line(f"{first} and {second} do not differ")


def _run_figures(file: Path) -> dict[str, Any]:
    """Return the values by which runs are compared, JSON-ready; file contents are represented by a hash."""
    with RunStore.open(file) as store:
        last = store.last_generation()
        found: dict[str, Any] = {"family": store.name, "imported from": store.imported}
        found |= dict(override.split("=", 1) for override in store.overrides)
        for path, text in store.source_texts().items():
            found[f"text of {path}"] = sha256(text.encode()).hexdigest()[:12]
        found["generations"] = last.number if last else None
        found["diversity"] = last.diversity if last else None
        found["accepted"], found["rejected"] = store.next_id(), store.rejection_counts().total()
    return found


def _format_cell(value: object) -> str:
    return "" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)


def _format_member(member: Member | None) -> str:
    if member is None:
        return ""
    return ", ".join([member.name, *(f"{name} {value:.4g}" for name, value in member.measures.items())])


def _run_row(run: dict[str, Any]) -> tuple[str, ...]:
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
