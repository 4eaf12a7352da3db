"""An ask-and-tell interface: an archive of models for users who run their own loop and compute their own scores."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from pathlib import Path

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.search._run_store import RunStore
from envgraph.search.domain._domain import Domain
from envgraph.search.evolution._model_sampler import ModelSampler, OfferedModel
from envgraph.search.families._lazy_models import LazyModel, versioned_models
from envgraph.search.families._member_family import Family, Member, order_members
from envgraph.search.runs._generate import stored_settings_and_texts


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
        if wanted is None or wanted.ranking_measures:
            hint = 'add the override "samples.count=64", or remove `maximise` and `minimise`: scores replace them'
            raise InvalidArgument(f"`{domain.spec.name}` needs `[samples]` without `maximise` and `minimise`", hint)
        problem = domain.problem(domain.engine())
        domain.check_initial(problem)
        self._domain, self._engine = domain, problem.engine
        self._sampler = ModelSampler(problem, domain.settings(), wanted, domain.spec.seed)
        self._asked_models: list[OfferedModel] = []

    def ask(self, count: int) -> Family:
        """Return new valid models that were never returned before, each one move away from a member of the archive.

        Models from an earlier call that have no score are dropped.

        Args:
            count: number of models, at least 1.

        Raises:
            EvaluationError: `100 * count` attempts did not find enough models.
        """
        self._asked_models = self._sampler.sample_candidates(count)
        if len(self._asked_models) < count or count < 1:
            hint = "ask for fewer, or use mutation rules and constraints that allow more models"
            raise EvaluationError(f"only {len(self._asked_models)} of {count} new models were found", hint=hint)
        held = versioned_models(self._engine, [one.version for one in self._asked_models if one.version is not None])
        members = tuple(
            Member(f"E{number + 1}", one.measures, LazyModel(f"{one.state:016x}", number, held))
            for number, one in enumerate(self._asked_models)
        )
        return self._make_family(members)

    def tell(self, scores: Sequence[float]) -> tuple[bool, ...]:
        """Report the scores of the models from the last `ask`, in their order. A larger score is better.

        Returns:
            For each model True if it was added to the archive; models that follow may replace it.

        Raises:
            InvalidArgument: there is not exactly one finite score for each model.
        """
        if len(scores) != len(self._asked_models) or not all(map(isfinite, scores)):
            raise InvalidArgument(
                f"`scores` must have a finite score for each of the {len(self._asked_models)} models from `ask`"
            )
        asked, self._asked_models, rng = self._asked_models, [], self._sampler.next_generator()
        put = self._sampler.offer_model
        return tuple(put(one, float(score), rng) is not None for one, score in zip(asked, scores, strict=True))

    def family(self) -> Family:
        """Return the members of the archive as a family, in the order of the curriculum, with the initial model."""
        members = self._sampler.archive_members()
        held = versioned_models(self._engine, [version for _, version in members])
        found = [
            (one.measures, LazyModel(one.state_hash, place, held), one.id, one.parent is None)
            for place, (one, _) in enumerate(members)
        ]
        return self._make_family(order_members(self._domain, found))

    def write(self, store_path: Path, *, overwrite: bool = False) -> None:
        """Write the members of the archive and their ancestors as a run. With `overwrite` an old run is replaced.

        Raises:
            InvalidArgument: the store exists already, and `overwrite` is False.
        """
        with RunStore.create(store_path, *stored_settings_and_texts(self._domain), overwrite=overwrite) as store:
            self._sampler.write_run(store)

    def _make_family(self, members: tuple[Member, ...]) -> Family:
        domain = self._domain
        return Family(domain.spec.name, domain.workspace.bundle(), members, domain, domain.overrides)
