"""The command `envgraph verify`: compute properties of the environments of a family, exactly where there is a table."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from envgraph.cli._output import print_json, print_line, print_table, progress_bar
from envgraph.errors import EnvgraphError, InvalidArgument, list_names
from envgraph.files import report_progress, run_in_workers
from envgraph.search import (
    Family,
    Member,
    RunStore,
    Verification,
    differing_members,
    find_run_store,
    format_certificates,
    open_family,
    store_certificates,
    verify,
)


def verify_family(run: str, directory: Path, *, resume: bool, members: int, seed: int, workers: int) -> None:
    """Compute and print properties of at most `members` members of a family, or with `resume` print those stored.

    A run stores them, and is locked meanwhile.

    Raises:
        InvalidArgument: the run does not exist, or `resume` is given for a family file.
        EnvgraphError: a second method gives other values.
    """
    is_file = run.endswith(".json")
    with nullcontext() if is_file else RunStore.open(find_run_store(run, directory), writing=True) as store:
        family = open_family(run, directory)
        if resume and store is None:
            raise InvalidArgument(f"`{run}` stores no results to resume from", "use `--resume` only with runs")
        count = len(family.members)
        chosen = [family.members[round(place)] for place in np.linspace(0, count - 1, min(members, count))]
        known = {one.name: Verification(one, one.certificates, ()) for one in chosen if resume and one.certificates}
        try:
            wanted = [one for one in chosen if one.name not in known]
            unkept = _verify_members(family, known, wanted, store, seed=seed, workers=workers)
        except KeyboardInterrupt:
            if store:
                again = f"envgraph verify {run} --directory {directory} --members {members} --seed {seed} --resume"
                sys.stderr.write(f"{len(known)} environments are verified: `{again}` resumes\n")
            raise
    found, left_out = [known[one.name] for one in chosen], count - len(chosen)
    if not print_json(lambda: {"name": family.name, "left_out": left_out, "members": [*map(_member_data, found)]}):
        _print_certificates(family, found)
        if left_out:
            print_line(
                f"left out: {left_out:,} of {count:,} environments; those above are evenly spaced in their order; "
                f"`--members {count}` verifies all"
            )
    if unkept:
        sys.stderr.write(f"some of the results above could not be stored: {unkept}\n")
    differing = [f"{one.member.name} ({', '.join(one.differences)})" for one in found if one.differences]
    if differing:
        raise EnvgraphError(f"the second computation gave other results: {list_names(differing)}")


def _verify_members(
    family: Family,
    known: dict[str, Verification],
    members: Sequence[Member],
    store: RunStore | None,
    *,
    seed: int,
    workers: int,
) -> InvalidArgument | None:
    """Add the results of members to `known`, and store them. Return the error if they could not be stored."""
    by_name, small = {one.name: one for one in members}, family.subset(members) if members else family
    size = 1 + (len(members) // 1000 if workers == 1 else min(len(members) // (8 * workers), 15))
    tasks = [(small.subset(members[first : first + size]), seed) for first in range(0, len(members), size)]
    unsaved, unkept, count = list[Verification](), list[InvalidArgument](), 0

    def save() -> None:
        try:
            if store and unsaved and not unkept:
                store_certificates(store, unsaved)
        except InvalidArgument as error:
            unkept.append(error)
        unsaved.clear()

    try:
        with progress_bar("environments", len(members)) as advance:
            for part in run_in_workers(_verify_part, tasks, workers):
                found = [replace(one, member=by_name[one.member.name]) for one in part]
                known |= {one.member.name: one for one in found}
                unsaved += [one for one in found if not one.differences]
                count += len(found)
                if 100 * len(unsaved) > count:  # all are written each time, so more rarely if they are more
                    save()
                advance(count, found[-1].member.name)
    finally:
        save()
    return unkept[0] if unkept else None


def _verify_part(family: Family, seed: int) -> list[Verification]:
    """Return the results of all members of a small family, without their models. A worker process shows no progress."""
    fresh = family.subset(family.members)  # the task stays in memory, but not its tables
    with report_progress(lambda text: None):
        return [replace(one, member=Member(one.member.name, {}, "")) for one in verify(fresh, seed=seed)]


def _print_certificates(family: Family, found: Sequence[Verification]) -> None:
    facts = [dict(format_certificates(replace(one.member, certificates=one.certificates))) for one in found]
    names = dict.fromkeys(fact for each in facts for fact in each)
    rows = []
    for one, texts in zip(found, facts, strict=True):
        states = f"{one.states:,}" if one.states else "too many" if one.reason else ""
        again = "same" if one.states or one.reason else "same (verified earlier)"
        again = "differs" if one.differences else again if one.visited_again else "same (by the same table)"
        rows.append((one.member.name, states, *(texts.get(fact, "") for fact in names), again))
    title = f"{family.name}: within {found[0].certificates['limit']:.0f} steps"
    print_table(title, ("environment", "states", *names, "again"), rows, range(1, 2 + len(names)))
    for reason in dict.fromkeys(one.reason for one in found if one.reason):
        which = list_names(one.member.name for one in found if one.reason == reason)
        print_line(f"{which}: {reason}; sampled means have 95 % intervals")
    for measure, members in differing_members(family, found).items():
        print_line(
            f"measure `{measure}` of {list_names(members)} differs: its random walk uses only actions of the model, "
            "this one also those about objects of other members of the family, which do nothing"
        )


def _member_data(one: Verification) -> dict[str, Any]:
    data = {"name": one.member.name, "states": one.states, "certificates": {**one.certificates}}
    if one.plan is not None:
        steps = one.plan.steps if isfinite(one.plan.steps) else None
        data |= {"reason": one.reason, "plan": {**asdict(one.plan), "steps": steps, "exact": one.plan.is_exact}}
    return {**data, "differences": [*one.differences]}
