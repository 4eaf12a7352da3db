"""Families that nothing has selected: what an evolved one is compared with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from numpy.random import SeedSequence, default_rng

from envgraph.errors import InvalidArgument
from envgraph.graph import model_to_json
from envgraph.search._store import RunStore, dump_json
from envgraph.search.evolution._variation import Variation
from envgraph.search.families._family import Family, ordered
from envgraph.search.families._tables import Tables

Found = tuple[Mapping[str, float], str, int | None, bool]


def lineage_lengths(family: Family, store: RunStore) -> tuple[int, ...]:
    """How many rule applications lie between the initial model and each member but the target, in their order.

    Raises:
        InvalidArgument: members have no lineage, as those of an imported family.
    """
    earlier = [member.individual for member in family.members[:-1]]
    if store.imported is not None:
        raise InvalidArgument(f"family `{family.name}` was imported: its members have no lineage")
    return tuple(
        sum(len(ancestor.trace) for ancestor in store.lineage(one)) for one in earlier if one is not None
    )


def random_families(
    family: Family, count: int, applications: Sequence[int], *, seed: int = 0
) -> Iterator[Family]:
    """Families with the same target, whose other members are random walks from the initial model.

    A walk takes mutations by the same rules, each tried until the constraints hold and every measure has a value, as in
    the search; but of its members none is selected for what it adds to the family. They are ordered in the same way.
    A walk that comes to where no attempt succeeds ends there.

    Args:
        family: what they are compared with; its last member is the target.
        count: how many.
        applications: of rules, how many each member but the target takes, such as `lineage_lengths`; a mutation may
            take several, and the last one more than are left.
        seed: of all walks; those of a family do not depend on how many there are.

    Raises:
        InvalidArgument: a number is negative.
    """
    if count < 0 or any(wanted < 0 for wanted in applications):
        raise InvalidArgument("`count` and `applications` must not be negative")
    domain, target = family.domain, family.members[-1]
    problem = domain.problem(domain.engine())
    settings = domain.settings()
    engine, variation = problem.engine, Variation(problem, settings.max_attempts, settings.strength)
    first = problem.measure()
    origin = engine.commit()
    for number in range(count):
        found: list[Found] = []
        for child, left in enumerate(applications):
            rng, measures = default_rng(SeedSequence(seed, spawn_key=(number, child))), first
            engine.checkout(origin, discard=True)
            while left > 0 and (step := variation.attempts(rng, variation.mutation)):
                trace, measures = step
                left -= len(trace)
            found.append((measures, dump_json(model_to_json(engine.model)), None, False))
        last = replace(target, name=f"E{len(found) + 1}")
        yield replace(
            family,
            name=f"{family.name}, random {number + 1}",
            members=(*ordered(domain, found), last),
            tables=Tables(()),
            _explored={},
            _keys=None,
        )
