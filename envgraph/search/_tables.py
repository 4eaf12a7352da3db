"""Enumerated environments, kept in files: visiting the states takes seconds to minutes, reading them a moment.

A file is named after a hash of all that the states depend on: a model or a behaviour that was edited has another file,
and no file is ever out of date. Whoever reads while somebody writes sees the whole file or none.
"""

from __future__ import annotations

import logging
import os
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from envgraph import __version__
from envgraph.code import dataclass
from envgraph.env import Behaviour, Explored, KeyIndex, explore, read_explored, write_explored
from envgraph.errors import InvalidArgument
from envgraph.files import CACHE_VARIABLE, cache_directory, counting, replacing
from envgraph.graph import Model, model_to_json
from envgraph.search._store import dump_json

if TYPE_CHECKING:
    from envgraph.search._domain import Domain

FORMAT = 3
"""Raised when the same texts give another table, or another file, than before."""

MOST_BYTES = 2**30
"""Of the files of one place; the ones that nobody has used for longest make room."""


@dataclass(frozen=True, slots=True)
class Tables:
    """Where tables are kept.

    Attributes:
        places: directories; a table is looked for in all of them, and written to the first that can be written.
    """

    places: tuple[Path, ...]

    @classmethod
    def of_run(cls, store: Path) -> Tables:
        """Those of a run, beside its store; of a run that cannot be written, those of the user."""
        user = cls.of_user().places
        return cls((store.parent / "tables", *user)) if user else cls(())

    @classmethod
    def of_user(cls) -> Tables:
        """Those of families and domains that have no run: `$ENVGRAPH_CACHE`, else `envgraph` in the user's cache."""
        directory = cache_directory()
        return cls((directory,) if directory else ())

    def explored(
        self,
        domain: Domain,
        behaviour: Behaviour,
        model: Model,
        keys: KeyIndex,
        *,
        pictures: bool = False,
    ) -> Explored:
        """The table of a model, with a picture of every state where they are asked for and can be drawn.

        Standard error is told how many states there are so far. The table is not kept where expressions call functions
        of Python: no hash says what those do.

        Args:
            domain: of the model.
            behaviour: of the domain.
            model: the initial state; it is used up.
            keys: the indices of its objects over the family.
        """
        name = f"{_key(domain, behaviour, model, keys)}.npz"
        drawn = pictures and behaviour.draw is not None
        lasting = not domain.components.function
        known = self._read(name) if lasting else None
        if known is not None and (known.pictures or not drawn):
            return known
        with counting(f"states of {behaviour.name}") as progress:
            found = explore(domain.engine(model), behaviour, keys, pictures=drawn, progress=progress)
        if lasting:
            self._write(name, found)
        return found

    def _read(self, name: str) -> Explored | None:
        for place in self.places:
            path = place / name
            try:
                found = read_explored(path)
            except InvalidArgument:  # not there, or damaged: then it is made anew
                continue
            with suppress(OSError):  # of another user
                os.utime(path)
            return found
        return None

    def _write(self, name: str, explored: Explored) -> None:
        reason: OSError | None = None
        for place in self.places:
            try:
                with replacing(place / name) as draft, draft.open("wb") as file:
                    write_explored(explored, file)
                _tidy(place)
                return
            except OSError as error:
                reason = error
        if reason is not None:
            logging.getLogger("envgraph").warning(
                "a table of states could not be kept, so the states will be visited again: %s; "
                "name a directory in %s",
                reason,
                CACHE_VARIABLE,
            )


def _key(domain: Domain, behaviour: Behaviour, model: Model, keys: KeyIndex) -> str:
    """A hash of everything that a table depends on. The family file is left out: it says how to search."""
    files = sorted(domain.workspace.sources.items())
    texts = [text for name, text in files if name != domain.spec.path]
    everything = [FORMAT, __version__, behaviour.name, texts, model_to_json(model), keys.to_json()]
    return sha256(dump_json(everything).encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _tidy(place: Path) -> None:
    """Remove the files that nobody has used for longest, if there are too many."""
    files = [(file.stat(), file) for file in place.glob("*.npz")]
    total = 0
    for stat, file in sorted(files, key=lambda pair: pair[0].st_mtime, reverse=True):
        total += stat.st_size
        if total > MOST_BYTES:
            file.unlink(missing_ok=True)
