"""Random families without selection, to which evolved families are compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from numpy.random import SeedSequence, default_rng

from envgraph.errors import InvalidArgument
from envgraph.graph import model_to_json
from envgraph.search._run_store import RunStore, dump_json
from envgraph.search.evolution._mutation import Variation
from envgraph.search.families._member_family import Family, order_members
from envgraph.search.families._table_cache import TableCache

MemberData = tuple[Mapping[str, float], str, int | None, bool]


def lineage_lengths(family: Family, store: RunStore) -> tuple[int, ...]:
    """Return the number of rule applications from the initial model to each member but the target, in their order.

    Raises:
        InvalidArgument: members have no lineage, because the family was imported.
    """
    earlier = [member.individual for member in family.members[:-1]]
    if store.imported is not None:
        raise InvalidArgument(f"family `{family.name}` was imported: its members have no lineage")
    return tuple(sum(len(ancestor.trace) for ancestor in store.lineage(one)) for one in earlier if one is not None)


def random_families(family: Family, count: int, applications: Sequence[int], *, seed: int = 0) -> Iterator[Family]:
    """Yield families with the same target whose other members result from random walks from the initial model.

    A walk applies the family's mutations. Each is tried until the constraints hold and every measure has a value, as in
    the search, but there is no selection. The members are sorted by the same measure. A walk ends early if all attempts
    fail.

    Args:
        family: the family to compare with; its last member is the target.
        count: number of families.
        applications: number of rule applications for each member but the target, such as `lineage_lengths`. The last
            mutation of a walk may exceed it, because a mutation may apply several rules.
        seed: seed of all walks. The walks of a family do not depend on `count`.

    Raises:
        InvalidArgument: a number is negative.
    """
    if count < 0 or any(wanted < 0 for wanted in applications):
        raise InvalidArgument("`count` and `applications` must not be negative")
    domain, target = family.domain, family.members[-1]
    problem = domain.problem(domain.engine())
    settings = domain.settings()
    engine, variation = problem.engine, Variation(problem, settings.max_attempts, settings.strength)
    first = problem.compute_measures()
    origin = engine.commit()
    for number in range(count):
        found: list[MemberData] = []
        for child, left in enumerate(applications):
            rng, measures = default_rng(SeedSequence(seed, spawn_key=(number, child))), first
            engine.checkout(origin, discard=True)
            while left > 0 and (step := variation.vary_until_valid(rng, variation.mutate)):
                trace, measures = step
                left -= len(trace)
            found.append((measures, dump_json(model_to_json(engine.model)), None, False))
        last = replace(target, name=f"E{len(found) + 1}")
        yield replace(
            family,
            name=f"{family.name}, random {number + 1}",
            members=(*order_members(domain, found), last),
            tables=TableCache(()),
            _explored={},
            _keys=None,
        )
