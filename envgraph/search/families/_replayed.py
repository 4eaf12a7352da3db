"""Models that are no texts: an engine comes to them, by the rules of a run or by versions that are held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Protocol

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.graph import Version, model_to_json
from envgraph.rewrite import Engine
from envgraph.search._store import Individual, dump_json

if TYPE_CHECKING:
    from envgraph.search.domain._domain import Domain


class Models(Protocol):
    """Has models by number."""

    def engine(self, id_: int) -> Engine:
        """An engine that stands at a model until it is asked for another one; leave its model as it is."""


class Held:
    """Takes an engine to versions, which it holds; somebody else may take it elsewhere in the meantime."""

    def __init__(self, engine: Engine, versions: Sequence[Version]) -> None:
        self._engine, self._versions = engine, versions

    def engine(self, id_: int) -> Engine:
        """See `Models`."""
        self._engine.checkout(self._versions[id_], discard=True)
        return self._engine


class Replay:
    """Takes one engine to individuals of a run, one after the other.

    Args:
        domain: of the run.
        individuals: those that are asked for and those that they descend from, by id.
        file: the store, for errors.
    """

    def __init__(self, domain: Domain, individuals: Mapping[int, Individual], file: str) -> None:
        self._domain, self._individuals, self._file = domain, individuals, file
        self._versions: dict[int, Version] = {}
        self._engine: Engine | None = None

    def engine(self, id_: int) -> Engine:
        """See `Models`; the number is that of an individual.

        Raises:
            InvalidArgument: what the store says of it cannot be applied, or gives another model.
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
                message = f"individual {one.id} is not the model that was measured"
                raise InvalidArgument(f"{self._file} is damaged: {message}")
            self._versions[one.id] = engine.commit()
        return engine


@dataclass(frozen=True, slots=True)
class Derived:
    """A model that is made when it is asked for; the same as another one if their states are.

    Attributes:
        state: hash of the model.
        number: of the model in what has it.
    """

    state: str
    number: int = field(compare=False)
    _models: Models = field(compare=False, repr=False)

    def engine(self) -> Engine:
        """See `Models`."""
        return self._models.engine(self.number)

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        """Return what `copy` and `pickle` keep: the text, since the engine is that of others, too."""
        return str, (self.text(),)

    def text(self) -> str:
        """The model as JSON text."""
        return dump_json(model_to_json(self.engine().model))
