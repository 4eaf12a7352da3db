"""The command `envgraph verify`: compute exact properties of the environments of a family."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

from envgraph.cli._output import print_json, print_line, print_table, progress_bar
from envgraph.env.compiled import ActionPlan
from envgraph.errors import EnvgraphError, InvalidArgument, list_names
from envgraph.search import (
    Family,
    Member,
    PlanSearchResult,
    RunStore,
    Verification,
    differing_members,
    find_run_store,
    open_family,
    store_certificates,
    verify,
)


def verify_family(run: str, directory: Path, resume: bool) -> None:
    """Compute and print exact properties of the members of a family; a run stores them, and is locked meanwhile."""
    is_file = run.endswith(".json")
    with nullcontext() if is_file else RunStore.open(find_run_store(run, directory), writing=True) as store:
        _verify_family(run, directory, store, resume)


def _verify_family(run: str, directory: Path, store: RunStore | None, resume: bool) -> None:
    """Print the exact properties of the members of a family, and whether a second method computes the same values.

    The store of a run records them, member by member; with `resume`, recorded members are skipped.

    Raises:
        InvalidArgument: the run does not exist, or `resume` is given for a family file.
        EnvgraphError: the two methods differ.
    """
    family, unkept = open_family(run, directory), None
    if resume and store is None:
        raise InvalidArgument(f"`{run}` stores no results to resume from", "use `--resume` only with runs")
    kept = [one for one in family.members if resume and one.certificates]
    found: list[Verification | PlanSearchResult] = []
    wanted = [one for one in family.members if one not in kept]
    try:
        with progress_bar("environments", len(wanted)) as advance:
            for one in verify(family, wanted):
                found.append(one)
                if store and not unkept and isinstance(one, Verification) and not one.differences:
                    try:
                        store_certificates(store, one)
                    except InvalidArgument as error:
                        unkept = error
                advance(len(found), one.member.name)
    except KeyboardInterrupt:
        if store:
            again = f"envgraph verify {run} --directory {directory} --resume"
            sys.stderr.write(f"{len(kept) + len(found)} environments are verified: `{again}` resumes\n")
        raise
    if not print_json(lambda: {"name": family.name, "members": [*map(_stored_data, kept), *map(_member_data, found)]}):
        _print_certificates(family.name, kept, found)
        _print_random_walk_note(family, [one for one in found if isinstance(one, Verification)])
    if unkept:
        sys.stderr.write(f"some of the results above could not be stored: {unkept}\n")
    differing = [one for one in found if isinstance(one, Verification) and one.differences]
    if differing:
        names = list_names(f"{one.member.name} ({', '.join(one.differences)})" for one in differing)
        raise EnvgraphError(f"the second computation gave other results: {names}")


def _print_certificates(name: str, kept: Sequence[Member], found: Sequence[Verification | PlanSearchResult]) -> None:
    limits = [one.certificates.limit for one in found if isinstance(one, Verification)]
    limits += [int(one.certificates["limit"] or 0) for one in kept]
    title = f"{name}: within {limits[0]} steps" if limits else name
    columns = ("environment", "states", "shortest plan", "random walk", "optimal return", "again")
    print_table(title, columns, [*map(_stored_row, kept), *map(_member_row, found)], range(1, 5))
    for reason in dict.fromkeys(one.reason for one in found if isinstance(one, PlanSearchResult)):
        names = list_names(
            one.member.name for one in found if isinstance(one, PlanSearchResult) and one.reason == reason
        )
        print_line(f"{names}: {reason}; values that need a table are not computed")


def _print_random_walk_note(family: Family, found: Sequence[Verification]) -> None:
    for measure, names in differing_members(family, found).items():
        if names:
            print_line(
                f"measure `{measure}` of {list_names(names)} differs: its random walk uses only actions of the model, "
                "this one also those about objects of other members of the family, which do nothing"
            )


def _member_row(one: Verification | PlanSearchResult) -> tuple[str, ...]:
    if isinstance(one, PlanSearchResult):
        return one.member.name, "too many", _format_plan(one.plan), "not computed", "not computed", ""
    known = one.certificates
    same = "differs" if one.differences else "same"
    numbers = f"{known.random_success:.3g}", f"{known.optimal_return:.3f}"
    return one.member.name, f"{one.number_of_states:,}", _format_steps(known.shortest_plan), *numbers, same


def _stored_row(member: Member) -> tuple[str, ...]:
    said = member.certificates
    plan, best = said["shortest_plan"], said["optimal_return"]
    numbers = f"{said['random_success']:.3g}", "not finite" if best is None else f"{best:.3f}"
    return (
        member.name,
        "",
        "none" if plan is None else _format_steps(plan),
        *numbers,
        "same (verified earlier)",
    )


def _format_steps(plan: float) -> str:
    return f"{plan:.0f} steps" if isfinite(plan) else "none"


def _format_plan(plan: ActionPlan | None) -> str:
    if plan is None:
        return "not computed"
    if not isfinite(plan.steps):
        return "none" if plan.is_exact else "none found"
    return _format_steps(plan.steps) if plan.is_exact else f"at most {_format_steps(plan.steps)}"


def _member_data(one: Verification | PlanSearchResult) -> dict[str, Any]:
    if isinstance(one, PlanSearchResult):
        plan = None if one.plan is None else {**_finite_values(asdict(one.plan)), "exact": one.plan.is_exact}
        return {"name": one.member.name, "certificates": None, "reason": one.reason, "plan": plan}
    return {
        "name": one.member.name,
        "states": one.number_of_states,
        "certificates": _finite_values(asdict(one.certificates)),
        "differences": [*one.differences],
    }


def _stored_data(member: Member) -> dict[str, Any]:
    return {"name": member.name, "certificates": dict(member.certificates), "differences": []}


def _finite_values(values: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of the values for JSON, in which infinity and NaN are replaced by None."""
    return {name: None if isinstance(value, float) and not isfinite(value) else value for name, value in values.items()}
