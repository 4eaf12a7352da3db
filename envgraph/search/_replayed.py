"""Models of individuals that a run does not store: rules lead to them from the initial model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.graph import Version, model_to_json
from envgraph.rewrite import Engine
from envgraph.search._store import Individual, dump_json

if TYPE_CHECKING:
    from envgraph.search._domain import Domain


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
        """An engine that stands at an individual until it is asked for another one; leave its model as it is.

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
        individual: its id in the run.
    """

    state: str
    individual: int = field(compare=False)
    _replay: Replay = field(compare=False, repr=False)

    def engine(self) -> Engine:
        """See `Replay.engine`."""
        return self._replay.engine(self.individual)

    def text(self) -> str:
        """The model as JSON text."""
        return dump_json(model_to_json(self.engine().model))
