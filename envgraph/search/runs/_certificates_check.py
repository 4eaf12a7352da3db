"""Certificates of the members of a family, and their verification by an independent computation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from math import inf, isclose, isfinite

import numpy as np
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.draw import html_table
from envgraph.env import Simulator, TooManyStates, explore
from envgraph.env.compiled import ActionPlan, CompiledProgram, NotCompiled, Plans, has_numba
from envgraph.files import report_counting
from envgraph.rewrite import Engine
from envgraph.search._run_store import CERTIFICATES_KEY, RunStore
from envgraph.search.families._certificate_texts import format_certificates
from envgraph.search.families._lazy_family import OUTCOMES_FOR_A_TABLE
from envgraph.search.families._member_family import Family, Member
from envgraph.search.problem._individual_measures import DEFAULT_STEP_LIMIT
from envgraph.solve import Certificates, bootstrap_interval, certify, recomputed, sample_walks, wilson_interval

_CHECKED_EPISODES, _PLAN_OUTCOMES = 10, 300_000
"""Numbers of sampled episodes that the live engine repeats, which takes a second, and of outcomes of a search for a
plan with numba, which takes two seconds."""

_MOST_VISITED_AGAIN = 500_000
"""Entries of the largest table whose states the live engine visits again, in about a minute."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The certificates of a member, computed in two ways.

    Attributes:
        member: the member of the family.
        certificates: see `Member.certificates`; of the cached table, or of a table made by a compiled program.
        differences: the names of values that the second computation, or the member's stored certificates, have
            otherwise; "episodes" if the live engine does not repeat the first sampled episodes.
        states: number of states, None if there are too many for a table.
        reason: message about the number of states, if there are too many.
        plan: the best plan that was found without a table.
        visited_again: False if the second computation uses the same table, because it is large.
    """

    member: Member
    certificates: Mapping[str, float | None]
    differences: tuple[str, ...]
    states: int | None = None
    reason: str = ""
    plan: ActionPlan | None = None
    visited_again: bool = True

    def _repr_html_(self) -> str:
        known = format_certificates(replace(self.member, certificates=self.certificates))
        rows = [("states", self.states or self.reason), *known, ("differences", ", ".join(self.differences) or "none")]
        return html_table(rows, caption=self.member.name)


def _differences(known: Certificates, again: Certificates, said: Mapping[str, float | None]) -> Iterator[str]:
    """Yield the names of values that differ between two computations, or from the stored certificates of a member."""
    for field in fields(Certificates):
        if not _are_close(getattr(known, field.name), getattr(again, field.name)):
            yield field.name
    kept = again.values()
    for name, value in {} if "sampled_episodes" in said else said.items():
        if name not in kept or not _are_close(value, kept[name]):
            yield f"{name} of the file"


def _are_close(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)


def differing_members(family: Family, found: Iterable[Verification]) -> dict[str, list[str]]:
    """Return the names of members whose measure of kind `random_success` differs from the certificate, by measure.

    They differ because in a family all members have the union of all actions. A measure sees only one model with the
    actions of its own objects.
    """
    measures = [one.name for one in family.domain.spec.measures if one.kind == "random_success"]
    pairs = [(one.member, one.certificates["random_success"]) for one in found if one.states]
    names = {name: [one.name for one, exact in pairs if not _are_close(one.measures[name], exact)] for name in measures}
    return {name: members for name, members in names.items() if members}


def store_certificates(store: RunStore, found: Iterable[Verification]) -> None:
    """Add the certificates of verified members to their run store, or replace those stored for the members."""
    known = store.certificates | {one.member.individual or 0: dict(one.certificates) for one in found}
    store.set_setting(CERTIFICATES_KEY, {str(number): known[number] for number in sorted(known)})


def certificates(family: Family, member: Member) -> Certificates:
    """Return the certificates of a member and of a random policy in it, within the family's step limit.

    Raises:
        InvalidArgument: the family has no environment.
        EvaluationError: the member has too many states.
    """
    return certify(family.explored(member).tabular, limit=family.limit or DEFAULT_STEP_LIMIT)


def verify(family: Family, members: Iterable[Member] | None = None, *, seed: int = 0) -> Iterator[Verification]:
    """Compute the certificates of members in two ways, and yield the results.

    The second computation visits states with the live engine, unless there are many, and uses other recurrences. For
    members with too many states for a table, random walks are sampled and a plan is searched.

    Args:
        family: a family with an environment.
        members: members of the family; None for all.
        seed: of the random walks.

    Raises:
        InvalidArgument, EvaluationError: as `certificates`.
    """
    measure = next((one for one in family.domain.spec.measures if one.kind == "shortest_plan"), None)
    limit, guide = family.limit or DEFAULT_STEP_LIMIT, None if measure is None else measure.options.get("guide")
    plans = Plans(family.behaviour, guide=None if guide is None else str(guide))
    plans.max_outcomes = _PLAN_OUTCOMES if has_numba() else _PLAN_OUTCOMES // 6
    for member in family.members if members is None else members:
        engine = family.domain.engine(family.model(member))
        try:
            known = family.explored(member, outcomes=OUTCOMES_FOR_A_TABLE).tabular
        except TooManyStates as error:
            estimate = _estimate(family, member, engine, plans, seed)
            values = {**estimate.certificates}
            measured = inf if measure is None or "otherwise" in measure.options else member.measures[measure.name]
            if measured < (values["plan_found"] or inf):  # by a longer search
                values |= {"plan_found": measured, "plan_return": None}
            yield replace(estimate, certificates=values, reason=error.message)
            continue
        live, again = known, known.next_state.size <= _MOST_VISITED_AGAIN
        if again:
            with report_counting(f"states of {family.behaviour.name} again") as progress:
                live = explore(engine, family.behaviour, family.keys, progress=progress).tabular
        found = certify(known, limit=limit)
        differing = [*_differences(found, recomputed(live, limit=limit), member.certificates)]
        differing += ["states"] * (known.n_states != live.n_states)
        values = found.values()
        yield Verification(member, values, tuple(differing), live.n_states, visited_again=again)


def _estimate(family: Family, member: Member, engine: Engine, plans: Plans, seed: int) -> Verification:
    """Return what can be found without a table; `engine` is at the model of the member."""
    limit, name, plan = family.limit or DEFAULT_STEP_LIMIT, family.behaviour.name, ActionPlan(inf, (), 0, 0, 0)
    with suppress(NotCompiled, TooManyStates), report_counting(f"plan of {name}: states") as progress:
        plan = plans.plan(engine, progress)
    simulator = Simulator(engine, family.behaviour, family.keys)
    walked: CompiledProgram | Simulator = simulator
    with suppress(NotCompiled):
        walked = family.program([member]) if has_numba() else simulator
    with report_counting(f"sampled episodes of {name}") as progress:
        walks = sample_walks(walked, limit, seed=seed, progress=progress)
    same = np.array_equal(walks[:_CHECKED_EPISODES], sample_walks(simulator, limit, _CHECKED_EPISODES, seed=seed))
    lengths = np.where(walks[:, 0] > 0.0, walks[:, 2], inf)
    best, steps = int(lengths.argmin()), float(lengths.min())
    if steps < plan.steps:
        numbers = np.random.default_rng([seed, best]).integers(len(simulator.action_names), size=limit)[: int(steps)]
        actions = tuple(simulator.action_names[number] for number in numbers)
        plan = replace(plan, steps=steps, actions=actions, total_reward=float(walks[best, 1]))
    shortest = plan.steps if isfinite(plan.steps) else None
    values: dict[str, float | None] = {
        "limit": limit,
        "shortest_plan": shortest if plan.is_exact else None,
        "random_success": None,
        "optimal_return": None,
        "plan_found": shortest,
        "plan_return": None if shortest is None else plan.total_reward,
        "sampled_episodes": float(len(walks)),
        **_sampled_means("sampled", walks),
    }
    if walked is not simulator:  # masks of the live engine take long
        legal = sample_walks(walked, limit, seed=seed, legal=True)
        same &= np.array_equal(legal[:2], sample_walks(simulator, limit, 2, seed=seed, legal=True))
        values |= _sampled_means("sampled_legal", legal)
    return Verification(member, values, () if same else ("episodes",), plan=plan)


def _sampled_means(kind: str, walks: NDArray[np.float64]) -> dict[str, float]:
    """Return the share of successes and the mean return of walks, with the ends of their 95 % intervals, by name."""
    success, total, _ = walks.mean(axis=0).tolist()
    intervals = wilson_interval(success, len(walks)), bootstrap_interval(walks[:, 1].tolist()) or (-inf, inf)
    found = {f"{kind}_success": success, f"{kind}_return": total}
    for mean, (low, high) in zip([*found], intervals, strict=True):
        found |= {f"{mean}_low": low, f"{mean}_high": high}
    return found
