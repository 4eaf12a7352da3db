"""`envgraph verify`."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

from envgraph.cli._output import OutputFormat, print_json, print_table, progress_bar
from envgraph.errors import EnvgraphError, listed
from envgraph.search import RunStore, Verification, keep_certificates, open_family, run_file, verify


def verify_family(run: str, directory: Path, format: OutputFormat) -> None:
    """Print what is certain of the members of a family, and whether it is the same when computed again.

    A run has it from then on.

    Raises:
        EnvgraphError: something is not the same.
    """
    family = open_family(run, directory)
    found: list[Verification] = []
    with progress_bar("environments", len(family.members)) as advance:
        for one in verify(family):
            found.append(one)
            advance(len(found), one.member.name)
    if format is OutputFormat.JSON:
        print_json({"name": family.name, "members": [_data(one) for one in found]})
    else:
        limit = found[0].certificates.limit
        columns = ("environment", "states", "shortest plan", "random walk", "optimal return", "again")
        print_table(
            f"{family.name}: within {limit} steps", columns, [_row(one) for one in found], range(1, 5)
        )
    wrong = [one for one in found if one.differences]
    if wrong:
        names = listed(f"{one.member.name} ({', '.join(one.differences)})" for one in wrong)
        raise EnvgraphError(f"not the same when computed again: {names}")
    if Path(run).suffix != ".json":
        with RunStore.open(run_file(run, directory)) as store:
            keep_certificates(store, found)


def _row(one: Verification) -> tuple[str, ...]:
    known = one.certificates
    plan = f"{known.shortest_plan:.0f} steps" if isfinite(known.shortest_plan) else "none"
    same = "differs" if one.differences else "same"
    numbers = f"{known.random_success:.3g}", f"{known.optimal_return:.3f}"
    return one.member.name, f"{one.states:,}", plan, *numbers, same


def _data(one: Verification) -> dict[str, Any]:
    known = {name: value if isfinite(value) else None for name, value in asdict(one.certificates).items()}
    return {
        "name": one.member.name,
        "states": one.states,
        "certificates": known,
        "differences": [*one.differences],
    }
