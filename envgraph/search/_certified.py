"""What is certain of the members of a family, and a check of it by other means."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from math import isclose

from envgraph.code import dataclass
from envgraph.env import explore
from envgraph.search._family import Family, Member
from envgraph.solve import Certificates, certify, recomputed

LIMIT = 200
"""Steps of an episode where neither family nor environment have a limit."""


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
        """Names of what is not the same, up to rounding."""
        names = [one.name for one in fields(Certificates)]
        pairs = ((name, getattr(self.certificates, name), getattr(self.again, name)) for name in names)
        found = [name for name, one, other in pairs if not isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)]
        return (*found, *(() if self.same_states else ("states",)))


def certificates(family: Family, member: Member) -> Certificates:
    """What is certain of a member and of a random walk in it, within the family's limit of steps.

    Raises:
        InvalidArgument: the family has no environment.
        EvaluationError: the member has too many states.
    """
    return certify(family.explored(member).tabular, limit=family.limit or LIMIT)


def verify(family: Family) -> Iterator[Verification]:
    """Compute the certificates of each member again: states by the live engine, numbers by other recurrences.

    Raises:
        InvalidArgument, EvaluationError: as `certificates`.
    """
    limit = family.limit or LIMIT
    for member in family.members:
        known = family.explored(member).tabular
        engine = family.domain.engine(family.model(member))
        live = explore(engine, family.behaviour, family.keys).tabular
        yield Verification(
            member,
            live.n_states,
            certify(known, limit=limit),
            recomputed(live, limit=limit),
            known.n_states == live.n_states,
        )
