"""Models that are not stored as texts: an engine restores them by replaying rules or checking out versions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.graph import Version, model_to_json
from envgraph.rewrite import Engine
from envgraph.search._run_store import Individual, dump_json

if TYPE_CHECKING:
    from envgraph.search.domain._domain import Domain


ModelProvider = Callable[[int], Engine]
"""Returns an engine at the model with a number, until another one is requested. Do not change its model."""


def versioned_models(engine: Engine, versions: Sequence[Version]) -> ModelProvider:
    """Return a provider of versions of one engine. Other code may check out other versions in the meantime."""

    def check_out(number: int) -> Engine:
        engine.checkout(versions[number], discard=True)
        return engine

    return check_out


class ReplayedModels:
    """A provider of the models of a run, which replays the individuals' traces on one engine.

    Args:
        domain: the domain of the run.
        individuals: the individuals and all their ancestors, by id.
        file: path of the store, for error messages.
    """

    def __init__(self, domain: Domain, individuals: Mapping[int, Individual], file: str) -> None:
        self._domain, self._individuals, self._file = domain, individuals, file
        self._versions: dict[int, Version] = {}
        self._engine: Engine | None = None

    def __call__(self, id_: int) -> Engine:
        """Return the engine at the model of an individual, until another model is requested.

        Raises:
            InvalidArgument: a stored trace cannot be applied, or leads to another model than was stored.
        """
        if self._engine is None:
            self._engine = self._domain.engine()
        engine, line = self._engine, []
        while id_ not in self._versions:
            one = self._individuals[id_]
            line.append(one)
            if one.parent is None:
                break
            id_ = one.parent
        if id_ in self._versions:
            engine.checkout(self._versions[id_], discard=True)
        for one in reversed(line):
            engine.replay(one.trace)
            if f"{engine.model.state_hash():016x}" != one.state_hash:
                message = f"the model of individual {one.id} does not have the stored hash"
                raise InvalidArgument(f"{self._file} is damaged: {message}")
            self._versions[one.id] = engine.commit()
        return engine


@dataclass(frozen=True, slots=True)
class LazyModel:
    """A model that is made when it is needed. Two instances are equal if their state hashes are equal.

    Attributes:
        state_hash: hash of the model.
        model_number: number of the model in its provider.
    """

    state_hash: str
    model_number: int = field(compare=False)
    _models: ModelProvider = field(compare=False, repr=False)

    def engine(self) -> Engine:
        """Return an engine whose current model is this model, until another model is requested from the provider."""
        return self._models(self.model_number)

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        """Return data so that copying and pickling give the JSON text. The engine is shared and cannot be copied."""
        return str, (self.text(),)

    def text(self) -> str:
        """Return the model as JSON text."""
        return dump_json(model_to_json(self.engine().model))
