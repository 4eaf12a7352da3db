"""Ask and tell: an archive of models for people who own the loop, and have a score of their own."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.search._store import RunStore
from envgraph.search.domain._domain import Domain
from envgraph.search.evolution._samples import Offered, Sampler
from envgraph.search.families._family import Family, Member, ordered
from envgraph.search.families._replayed import Derived, Held
from envgraph.search.runs._generate import stored


class Sampling:
    """Gives new models and hears what they are worth. An archive keeps the best of each bin; new ones come of these.

    Args:
        domain: has `[samples]`, which says how many the archive keeps, and the bins of which measures it covers.

    Raises:
        InvalidArgument: the domain has no `[samples]`, or they have a measure to maximise or minimise.
        LoadError: as `Domain.check_initial`.
    """

    def __init__(self, domain: Domain) -> None:
        wanted = domain.samples()
        if wanted is None or wanted.best:
            hint = 'overrides such as "samples.count=64" add it; scores take the place of `maximise`'
            raise InvalidArgument(
                f"`{domain.spec.name}` needs `[samples]` without `maximise` and `minimise`", hint
            )
        problem = domain.problem(domain.engine())
        domain.check_initial(problem)
        self._domain, self._engine = domain, problem.engine
        self._sampler = Sampler(problem, domain.settings(), wanted, domain.spec.seed)
        self._asked: list[Offered] = []

    def ask(self, count: int) -> Family:
        """New models, all valid and none that was asked for before: a step each from a member of the archive.

        Models without a score are forgotten.

        Args:
            count: how many, at least 1.

        Raises:
            EvaluationError: fewer were found in a hundred times as many attempts.
        """
        self._asked = self._sampler.candidates(count)
        if len(self._asked) < count or count < 1:
            hint = "ask for fewer, or let mutation rules and constraints allow more"
            raise EvaluationError(f"{len(self._asked)} of {count} new models were found", hint=hint)
        held = Held(self._engine, [one.version for one in self._asked if one.version is not None])
        members = tuple(
            Member(f"E{number + 1}", one.measures, Derived(f"{one.state:016x}", number, held))
            for number, one in enumerate(self._asked)
        )
        return self._family(members)

    def tell(self, scores: Sequence[float]) -> tuple[bool, ...]:
        """Say what the models that were asked for last are worth, in their order; larger is better.

        Returns:
            Whether the archive has each of them, for now.

        Raises:
            InvalidArgument: there is not one finite score for each.
        """
        if len(scores) != len(self._asked) or not all(map(isfinite, scores)):
            raise InvalidArgument(f"{len(self._asked)} models were asked for: give a finite score for each")
        asked, self._asked, rng = self._asked, [], self._sampler.generator()
        put = self._sampler.put
        return tuple(
            put(one, float(score), rng) is not None for one, score in zip(asked, scores, strict=True)
        )

    def family(self) -> Family:
        """What the archive has, in the order of the curriculum, the initial model among them."""
        members = self._sampler.members()
        held = Held(self._engine, [version for _, version in members])
        found = [
            (one.measures, Derived(one.state_hash, place, held), one.id, one.parent is None)
            for place, (one, _) in enumerate(members)
        ]
        return self._family(ordered(self._domain, found))

    def write(self, store_path: Path) -> None:
        """Keep what the archive has as a run.

        Raises:
            InvalidArgument: the store exists already.
        """
        with RunStore.create(store_path, *stored(self._domain)) as store:
            self._sampler.write(store)

    def _family(self, members: tuple[Member, ...]) -> Family:
        domain = self._domain
        return Family(domain.spec.name, domain.workspace.bundle(), members, domain, domain.overrides)
