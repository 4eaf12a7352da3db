"""Enumerated environments, kept in files: visiting the states takes seconds to minutes, reading them a moment.

A file is named after a hash of all that the states depend on: a model or a behaviour that was edited has another file,
and no file is ever out of date. Whoever reads while somebody writes sees the whole file or none. Beside them is what
making an environment of a family takes besides the tables, so that the texts of a family are read once.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from envgraph import __version__
from envgraph.code import dataclass
from envgraph.env import Behaviour, Explored, KeyIndex, TooManyStates, read_explored, write_explored
from envgraph.errors import InvalidArgument
from envgraph.files import CACHE_VARIABLE, cache_directory, counting, is_own, replace_file, replacing
from envgraph.graph import Model, model_to_json
from envgraph.search._store import dump_json

if TYPE_CHECKING:
    from envgraph.search.domain._domain import Domain

FORMAT = 5
"""Raised when the same texts give another table, or another file, than before."""

MOST_BYTES = 2**30
"""Of the files of one place; the ones that nobody has used for longest make room."""


@dataclass(frozen=True, slots=True)
class Record:
    """What making environments of a family takes.

    Attributes:
        family: its name.
        behaviour: the name of its environment.
        limit: steps after which an episode is truncated, or None.
        drawn: whether the behaviour says how to draw.
        tables: the file of each member, by its name; "" where that takes longer to say than to make its model.
        certificates: what was verified of each member, by its name.
    """

    family: str
    behaviour: str
    limit: int | None
    drawn: bool
    tables: Mapping[str, str]
    certificates: Mapping[str, Mapping[str, float | None]]


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

        Standard error says how many states there are so far. The table is not kept where expressions call functions
        of Python: no hash says what those do.

        Args:
            domain: of the model.
            behaviour: of the domain.
            model: the initial state; it is used up.
            keys: the indices of its objects over the family.

        Raises:
            TooManyStates: there are too many for a table; that is kept as well, and found out once.
        """
        from envgraph.env.compiled import explored

        name = table_name(domain, behaviour, model, keys)
        drawn = pictures and behaviour.draw is not None
        lasting = not domain.components.function
        known = self.read(name, drawn=drawn) if lasting else None
        if known is not None:
            return known
        if lasting and (refused := self._refusal(name)):
            raise TooManyStates.again(behaviour, *refused)
        try:
            with counting(f"states of {behaviour.name}") as progress:
                found = explored(domain.engine(model), behaviour, keys, pictures=drawn, progress=progress)
        except TooManyStates as error:
            if lasting:
                self._refuse(name, error)
            raise
        if lasting:
            self._write(name, found)
        return found

    def _paths(self, name: str) -> list[Path]:
        """Return the file in each place; skip pipes, which would block, and files of others in the user's cache."""
        paths = [place / name for place in self.places]
        return [path for path in paths if not os.path.exists(path) or _is_trusted(path)]

    def read(self, name: str, *, drawn: bool) -> Explored | None:
        """The table of a file, if it is there, and has a picture of every state where it is to be drawn."""
        for path in self._paths(name):
            try:
                found = read_explored(path)
            except InvalidArgument:  # not there, or damaged: then it is made anew
                continue
            with suppress(OSError):  # of another user
                os.utime(path)
            return found if found.pictures or not drawn else None
        return None

    def _refusal(self, name: str) -> tuple[str, str | None] | None:
        """Why there is no table, and what helps."""
        for path in self._paths(name.replace(".npz", ".refusal")):
            with suppress(OSError, ValueError, RecursionError):  # not there, or damaged
                match json.loads(path.read_text("utf-8")):
                    case {"message": str(message), "hint": str() | None as hint}:
                        return message, hint
        return None

    def _refuse(self, name: str, error: TooManyStates) -> None:
        content = json.dumps({"message": error.message, "hint": error.hint})
        for path in self._paths(name.replace(".npz", ".refusal")):
            with suppress(OSError):
                replace_file(path, content)
                return

    def record(self, key: str) -> Record | None:
        """What was kept of a family, by a hash of all that it is made from."""
        for path in self._paths(f"{key}.record"):
            with suppress(OSError, ValueError, RecursionError):  # not there, or damaged
                match json.loads(path.read_text("utf-8")):
                    case {
                        "family": str(family),
                        "behaviour": str(behaviour),
                        "limit": int() | None as limit,
                        "drawn": bool(drawn),
                        "tables": dict(tables),
                        "certificates": dict(certificates),
                    } if all(isinstance(table, str) for table in tables.values()):
                        return Record(family, behaviour, limit, drawn, tables, certificates)
        return None

    def keep(self, key: str, record: Record) -> None:
        """Keep a record where that can be written."""
        for path in self._paths(f"{key}.record"):
            with suppress(OSError):
                replace_file(path, json.dumps(asdict(record)))
                return

    def _write(self, name: str, explored: Explored) -> None:
        reason: OSError | None = None
        for path in self._paths(name):
            try:
                with replacing(path) as draft, draft.open("wb") as file:
                    write_explored(explored, file)
                _tidy(path.parent)
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


def _is_trusted(path: Path) -> bool:
    if path.parent == cache_directory():
        return is_own(path.stat())
    return path.is_file()


def table_name(domain: Domain, behaviour: Behaviour, model: Model, keys: KeyIndex) -> str:
    """The file of a table: a hash of all that it depends on. The family file is left out: it says how to search."""
    files = sorted(domain.workspace.sources.items())
    texts = [text for name, text in files if name != domain.spec.path]
    return f"{key_of(behaviour.name, texts, model_to_json(model), keys.to_json())}.npz"


def key_of(*parts: object) -> str:
    """A hash of values that are ready for JSON, and of the version that makes something of them."""
    text = dump_json([FORMAT, __version__, *parts])
    return sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _tidy(place: Path) -> None:
    """Remove the files that nobody has used for longest, if there are too many."""
    files = [
        (file.stat(), file) for ending in ("npz", "record", "refusal") for file in place.glob(f"*.{ending}")
    ]
    total = 0
    for stat, file in sorted(files, key=lambda pair: pair[0].st_mtime, reverse=True):
        total += stat.st_size
        if total > MOST_BYTES:
            file.unlink(missing_ok=True)
