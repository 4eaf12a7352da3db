"""What is certain of the members of a family, and a check of it by other means."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields
from math import isclose, isfinite

from envgraph.code import dataclass
from envgraph.env import TooManyStates, explore
from envgraph.env.compiled import NotCompiled, Plan, Plans
from envgraph.search._store import CERTIFICATES, RunStore
from envgraph.search.families._family import Family, Member
from envgraph.search.problem._measures import LIMIT
from envgraph.solve import Certificates, certify, recomputed

_KEPT = ("limit", "shortest_plan", "random_success", "optimal_return")
"""What is kept of the certificates of a member; the rest is of a policy, here that of a random walk."""


@dataclass(frozen=True, slots=True)
class Verification:
    """What is certain of a member, computed twice.

    Attributes:
        member: of the family.
        states: how many it has.
        certificates: from the table that is kept, or that a compiled program made.
        again: from states that the live engine visits, by other recurrences.
    """

    member: Member
    states: int
    certificates: Certificates
    again: Certificates
    same_states: bool

    @property
    def differences(self) -> tuple[str, ...]:
        """Names of what is not the same, up to rounding; also where it is not what the member says."""
        names = [one.name for one in fields(Certificates)]
        found = [
            name for name in names if not _same(getattr(self.certificates, name), getattr(self.again, name))
        ]
        kept = facts(self.again)
        said = self.member.certificates
        wrong = [
            f"{name} of the file" for name in said if name not in kept or not _same(said[name], kept[name])
        ]
        return (*found, *wrong, *(() if self.same_states else ("states",)))


def _same(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)


def facts(known: Certificates) -> dict[str, float | None]:
    """What is kept of certificates, ready for JSON: None is a shortest plan where there is none."""
    values = {name: getattr(known, name) for name in _KEPT}
    return {name: value if isfinite(value) else None for name, value in values.items()}


def certificate_texts(member: Member, family: Sequence[Member] = ()) -> list[tuple[str, str]]:
    """The certificates that a member has, as people read them; that it has none where others of its family do."""
    said = member.certificates
    if not said:
        return [("shortest plan", "not verified")] if any(one.certificates for one in family) else []
    plan, limit, best = said["shortest_plan"], said["limit"], said["optimal_return"]
    return [
        ("shortest plan", "none" if plan is None else f"{plan:.0f}"),
        (f"random walk in the family, {limit:.0f} steps", f"{said['random_success']:.3g}"),
        ("optimal return", "not finite" if best is None else f"{best:z.3f}"),
    ]


def apart(family: Family, found: Iterable[Verification]) -> dict[str, list[str]]:
    """Members of which a measure `random_success` says something else than the certificate, by the measure.

    In a family all members have the actions of all; measured is a model alone, with those of its own objects.
    """
    measures = [one.name for one in family.domain.spec.measures if one.kind == "random_success"]
    return {
        name: [
            one.member.name
            for one in found
            if not _same(one.member.measures[name], one.certificates.random_success)
        ]
        for name in measures
    }


@dataclass(frozen=True, slots=True)
class Searched:
    """What is known of a member that has too many states for a table.

    Attributes:
        member: of the family.
        reason: what there is too much of.
        plan: what a search for a way to success has found; None where the behaviour is not compiled.
    """

    member: Member
    reason: str
    plan: Plan | None


def keep_certificates(store: RunStore, one: Verification) -> None:
    """Add what was verified of a member to a run: it has that from then on."""
    known = {str(number): said for number, said in store.certificates.items()}
    store.set(CERTIFICATES, {**known, str(one.member.individual): facts(one.certificates)})


def certificates(family: Family, member: Member) -> Certificates:
    """What is certain of a member and of a random walk in it, within the family's limit of steps.

    Raises:
        InvalidArgument: the family has no environment.
        EvaluationError: the member has too many states.
    """
    return certify(family.explored(member).tabular, limit=family.limit or LIMIT)


def verify(family: Family, members: Iterable[Member] | None = None) -> Iterator[Verification | Searched]:
    """Compute the certificates of members again: states by the live engine, numbers by other recurrences.

    The live engine makes some ten thousand outcomes a second, so a chance for each of several objects makes this
    take minutes. Of members with too many states for a table a plan is searched for, and nothing is computed again.

    Args:
        family: with an environment.
        members: of the family; all if None.

    Raises:
        InvalidArgument, EvaluationError: as `certificates`.
    """
    limit = family.limit or LIMIT
    for member in family.members if members is None else members:
        try:
            known = family.explored(member).tabular
        except TooManyStates as error:
            yield Searched(member, error.message, _plan(family, member))
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


def _plan(family: Family, member: Member) -> Plan | None:
    with suppress(NotCompiled):
        return Plans(family.behaviour).plan(family.domain.engine(family.model(member)))
    return None
