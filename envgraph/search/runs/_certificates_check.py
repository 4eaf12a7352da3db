"""Certificates of the members of a family, and their verification by an independent computation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields
from math import isclose, isfinite

from envgraph.code import dataclass
from envgraph.env import TooManyStates, explore
from envgraph.env.compiled import ActionPlan, NotCompiled, Plans
from envgraph.search._run_store import CERTIFICATES_KEY, RunStore
from envgraph.search.families._member_family import Family, Member
from envgraph.search.problem._individual_measures import DEFAULT_STEP_LIMIT
from envgraph.solve import Certificates, certify, recomputed

_STORED_CERTIFICATES = ("limit", "shortest_plan", "random_success", "optimal_return")
"""Fields of the certificates that are stored. The others are about a policy, here a random one."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The certificates of a member, computed in two ways.

    Attributes:
        member: the member of the family.
        number_of_states: number of its states.
        certificates: computed from the cached table, or from a table made by a compiled program.
        recomputed_certificates: computed from the states that the live engine visits, by other recurrences.
        is_state_count_equal: True if both have the same number of states.
    """

    member: Member
    number_of_states: int
    certificates: Certificates
    recomputed_certificates: Certificates
    is_state_count_equal: bool

    @property
    def differences(self) -> tuple[str, ...]:
        """Return the names of values that differ by more than rounding, also from the member's stored certificates."""
        names = [one.name for one in fields(Certificates)]
        found = [
            name
            for name in names
            if not _are_close(getattr(self.certificates, name), getattr(self.recomputed_certificates, name))
        ]
        kept = certificate_values(self.recomputed_certificates)
        said = self.member.certificates
        wrong = [f"{name} of the file" for name in said if name not in kept or not _are_close(said[name], kept[name])]
        return (*found, *wrong, *(() if self.is_state_count_equal else ("states",)))


def _are_close(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)


def certificate_values(known: Certificates) -> dict[str, float | None]:
    """Return the certificates to store, ready for JSON. An infinite value, such as of a missing plan, becomes None."""
    values = {name: getattr(known, name) for name in _STORED_CERTIFICATES}
    return {name: value if isfinite(value) else None for name, value in values.items()}


def format_certificates(member: Member, family: Sequence[Member] = ()) -> list[tuple[str, str]]:
    """Format a member's certificates as pairs of a name and a text for people.

    A member without certificates is "not verified" if other members of `family` have certificates, else the result is
    [].
    """
    said = member.certificates
    if not said:
        return [("shortest plan", "not verified")] if any(one.certificates for one in family) else []
    plan, limit, best = said["shortest_plan"], said["limit"], said["optimal_return"]
    return [
        ("shortest plan", "none" if plan is None else f"{plan:.0f}"),
        (f"random walk in the family, {limit:.0f} steps", f"{said['random_success']:.3g}"),
        ("optimal return", "not finite" if best is None else f"{best:z.3f}"),
    ]


def differing_members(family: Family, found: Iterable[Verification]) -> dict[str, list[str]]:
    """Return the names of members whose measure of kind `random_success` differs from the certificate, by measure.

    They differ because in a family all members have the union of all actions. A measure sees only one model with the
    actions of its own objects.
    """
    measures = [one.name for one in family.domain.spec.measures if one.kind == "random_success"]
    return {
        name: [
            one.member.name
            for one in found
            if not _are_close(one.member.measures[name], one.certificates.random_success)
        ]
        for name in measures
    }


@dataclass(frozen=True, slots=True)
class PlanSearchResult:
    """The result for a member that has too many states for a table.

    Attributes:
        member: the member of the family.
        reason: message about the number of states.
        plan: the plan to success that was found, or a result without a plan; None if the behaviour cannot be compiled.
    """

    member: Member
    reason: str
    plan: ActionPlan | None


def store_certificates(store: RunStore, verification: Verification) -> None:
    """Add the certificates of a verified member to its run store, or replace those stored for the member."""
    known = {str(number): said for number, said in store.certificates.items()}
    store.set_setting(
        CERTIFICATES_KEY,
        {**known, str(verification.member.individual): certificate_values(verification.certificates)},
    )


def certificates(family: Family, member: Member) -> Certificates:
    """Return the certificates of a member and of a random policy in it, within the family's step limit.

    Raises:
        InvalidArgument: the family has no environment.
        EvaluationError: the member has too many states.
    """
    return certify(family.explored(member).tabular, limit=family.limit or DEFAULT_STEP_LIMIT)


def verify(family: Family, members: Iterable[Member] | None = None) -> Iterator[Verification | PlanSearchResult]:
    """Compute the certificates of members in two ways, and yield the results.

    The second computation visits states with the live engine and uses other recurrences. The live engine computes about
    ten thousand outcomes per second, so that several random objects can take minutes. For members with too many states
    for a table only a plan is searched.

    Args:
        family: a family with an environment.
        members: members of the family; None for all.

    Raises:
        InvalidArgument, EvaluationError: as `certificates`.
    """
    limit = family.limit or DEFAULT_STEP_LIMIT
    for member in family.members if members is None else members:
        try:
            known = family.explored(member).tabular
        except TooManyStates as error:
            yield PlanSearchResult(member, error.message, _find_plan(family, member))
            continue
        engine = family.domain.engine(family.model(member))
        live = explore(engine, family.behaviour, family.keys).tabular
        yield Verification(
            member,
            live.n_states,
            certify(known, limit=limit),
            recomputed(live, limit=limit),
            known.n_states == live.n_states,
        )


def _find_plan(family: Family, member: Member) -> ActionPlan | None:
    with suppress(NotCompiled):
        return Plans(family.behaviour).plan(family.domain.engine(family.model(member)))
    return None
