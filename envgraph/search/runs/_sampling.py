"""An ask-and-tell interface: an archive of models for users who run their own loop and compute their own scores."""

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
    """An ask-and-tell sampler: `ask` returns new models, and `tell` receives their scores.

    An archive stores the best models of each bin. New models are mutations of models in the archive.

    Args:
        domain: a domain with `[samples]`, which sets the size of the archive and the measures whose bins it covers.

    Raises:
        InvalidArgument: the domain has no `[samples]`, or `[samples]` has a measure to maximise or minimise.
        LoadError: as `Domain.check_initial`.
    """

    def __init__(self, domain: Domain) -> None:
        wanted = domain.samples()
        if wanted is None or wanted.best:
            hint = 'add the override "samples.count=64", or remove `maximise` and `minimise`: scores replace them'
            raise InvalidArgument(
                f"`{domain.spec.name}` needs `[samples]` without `maximise` and `minimise`", hint
            )
        problem = domain.problem(domain.engine())
        domain.check_initial(problem)
        self._domain, self._engine = domain, problem.engine
        self._sampler = Sampler(problem, domain.settings(), wanted, domain.spec.seed)
        self._asked: list[Offered] = []

    def ask(self, count: int) -> Family:
        """Return new valid models that were never returned before, each one move away from a member of the archive.

        Models from an earlier call that have no score are dropped.

        Args:
            count: number of models, at least 1.

        Raises:
            EvaluationError: `100 * count` attempts did not find enough models.
        """
        self._asked = self._sampler.candidates(count)
        if len(self._asked) < count or count < 1:
            hint = "ask for fewer, or use mutation rules and constraints that allow more models"
            raise EvaluationError(f"only {len(self._asked)} of {count} new models were found", hint=hint)
        held = Held(self._engine, [one.version for one in self._asked if one.version is not None])
        members = tuple(
            Member(f"E{number + 1}", one.measures, Derived(f"{one.state:016x}", number, held))
            for number, one in enumerate(self._asked)
        )
        return self._family(members)

    def tell(self, scores: Sequence[float]) -> tuple[bool, ...]:
        """Report the scores of the models from the last `ask`, in their order. A larger score is better.

        Returns:
            For each model True if it was added to the archive; models that follow may replace it.

        Raises:
            InvalidArgument: there is not exactly one finite score for each model.
        """
        if len(scores) != len(self._asked) or not all(map(isfinite, scores)):
            raise InvalidArgument(
                f"`scores` must have a finite score for each of the {len(self._asked)} models from `ask`"
            )
        asked, self._asked, rng = self._asked, [], self._sampler.generator()
        put = self._sampler.put
        return tuple(
            put(one, float(score), rng) is not None for one, score in zip(asked, scores, strict=True)
        )

    def family(self) -> Family:
        """Return the members of the archive as a family, in the order of the curriculum, with the initial model."""
        members = self._sampler.members()
        held = Held(self._engine, [version for _, version in members])
        found = [
            (one.measures, Derived(one.state_hash, place, held), one.id, one.parent is None)
            for place, (one, _) in enumerate(members)
        ]
        return self._family(ordered(self._domain, found))

    def write(self, store_path: Path) -> None:
        """Write the members of the archive and their ancestors as a run.

        Raises:
            InvalidArgument: the store exists already.
        """
        with RunStore.create(store_path, *stored(self._domain)) as store:
            self._sampler.write(store)

    def _family(self, members: tuple[Member, ...]) -> Family:
        domain = self._domain
        return Family(domain.spec.name, domain.workspace.bundle(), members, domain, domain.overrides)
