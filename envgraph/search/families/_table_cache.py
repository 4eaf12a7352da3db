"""A file cache of transition tables, since visiting all states takes seconds to minutes, and reading a file a moment.

The name of a file is a hash of everything on which the states depend. If a model or behaviour is edited, its table has
another name, so that no file is ever outdated. Files are replaced as a whole. The cache also has a record per family
with the other data needed to make its environments, so that the texts of a family are read only once; and the arrays of
many members, which programs do not check: they are mapped only from files of this user, with the right checksum.
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import file_digest, sha256
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from envgraph import __version__
from envgraph.code import dataclass
from envgraph.env import Behaviour, ExploredEnvironment, KeyIndex, TooManyStates, read_explored, write_explored
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.files import (
    CACHE_VARIABLE,
    cache_directory,
    is_private_file,
    replace_file,
    replacement_draft,
    report_counting,
)
from envgraph.graph import Model, model_to_json
from envgraph.search._run_store import dump_json

if TYPE_CHECKING:
    from envgraph.search.domain._domain import Domain

CACHE_FORMAT = 6
"""Version of tables and files; increased if the same texts give another table or file than before."""


@dataclass(frozen=True, slots=True)
class FamilyRecord:
    """The data needed besides tables to make the environments of a family.

    Attributes:
        family: name of the family.
        behaviour: name of its environment.
        limit: steps after which an episode is truncated, or None.
        drawn: True if the behaviour has a `draw` clause.
        action_keys: the keys that `@key` gives to actions, by name; None if agents act together.
        tables: file name of each member's table, by member name; "" if its model is made only when needed.
        certificates: verified values of each member, by member name.
    """

    family: str
    behaviour: str
    limit: int | None
    drawn: bool
    action_keys: Mapping[str, Sequence[str]] | None
    tables: Mapping[str, str]
    certificates: Mapping[str, Mapping[str, float | None]]


@dataclass(frozen=True, slots=True)
class TableCache:
    """A cache of transition tables in files.

    Attributes:
        directories: directories. A table is searched in all of them, and written to the first that is writable.
    """

    directories: tuple[Path, ...]

    @classmethod
    def of_run(cls, store: Path) -> TableCache:
        """Return the cache of a run: `tables` beside its store, or the user's cache if `tables` is not writable."""
        user = cls.of_user().directories
        return cls((store.parent / "tables", *user)) if user else cls(())

    @classmethod
    def of_user(cls) -> TableCache:
        """Return the user's cache, for families without a run: `$ENVGRAPH_CACHE`, or `envgraph` in `~/.cache`."""
        directory = cache_directory()
        return cls((directory,) if directory else ())

    def load_or_explore(
        self,
        domain: Domain,
        behaviour: Behaviour,
        model: Model,
        keys: KeyIndex,
        *,
        pictures: bool = False,
        outcomes: int = LIMITS["all outcomes"],
    ) -> ExploredEnvironment:
        """Return the transition table of a model, from the cache or by visiting all states.

        The number of states so far is shown on standard error. The table is not cached if expressions call Python
        functions, because no hash identifies their code.

        Args:
            domain: domain of the model.
            behaviour: behaviour of the domain.
            model: the initial state; it is changed and must not be used afterwards.
            keys: the indices of its objects over the family.
            pictures: True if a picture of every state is needed. It is only made if the behaviour has a `draw` clause.
            outcomes: as for `explore_fast`.

        Raises:
            TooManyStates: there are too many states for a table; this result is cached as well.
        """
        from envgraph.env.compiled import explore_fast, has_numba

        name = table_file_name(domain, behaviour, model, keys)
        drawn = pictures and behaviour.draw is not None
        lasting = not domain.components.function
        known = self.read_table(name, needs_pictures=drawn) if lasting else None
        if known is not None:
            return known
        within = name if outcomes == LIMITS["all outcomes"] else f"{outcomes}-{drawn:d}{has_numba():d}-{name}"
        refused = (self._read_refusal(name) or self._read_refusal(within)) if lasting else None
        if refused is not None:
            raise TooManyStates.from_message(behaviour, *refused)
        try:
            with report_counting(f"states of {behaviour.name}") as progress:
                engine = domain.engine(model)
                found = explore_fast(engine, behaviour, keys, outcomes=outcomes, pictures=drawn, progress=progress)
        except TooManyStates as error:
            if lasting:
                self.write_json(within.replace(".npz", ".refusal"), {"message": error.message, "hint": error.hint})
            raise
        if lasting:
            self._write_table(name, found)
        return found

    def _paths(self, name: str) -> list[Path]:
        """Return the path of a file in each directory, except pipes and other users' files in the user's cache."""
        return [path for place in self.directories if _is_trusted(path := place / name)]

    def read_table(self, name: str, *, needs_pictures: bool) -> ExploredEnvironment | None:
        """Read a table from the cache. Return None if it is missing or damaged, or lacks pictures although
        `needs_pictures`.
        """
        for path in self._paths(name):
            try:
                found = read_explored(path)
            except InvalidArgument:  # missing or damaged: it is computed again
                continue
            with suppress(OSError):  # the file may belong to another user
                os.utime(path)
            return found if found.pictures or not needs_pictures else None
        return None

    def _read_refusal(self, name: str) -> tuple[str, str | None] | None:
        """Return the cached message that there are too many states, and its hint or None; None if nothing is cached."""
        match self.read_json(name.replace(".npz", ".refusal")):
            case {"message": str(message), "hint": str() | None as hint}:
                return message, hint
        return None

    def read_json(self, name: str) -> Any:
        """Return the JSON data in a file of the cache, or None if it is missing or damaged."""
        for path in self._paths(name):
            with suppress(OSError, ValueError, RecursionError):
                return json.loads(path.read_text("utf-8"))
        return None

    def write_json(self, name: str, data: object) -> None:
        """Write JSON data to the first writable directory; do nothing if no directory is writable."""
        for path in self._paths(name):
            with suppress(OSError):
                replace_file(path, json.dumps(data))
                return

    def read_record(self, key: str) -> FamilyRecord | None:
        """Return the cached record of a family, or None. `key` is a hash of all data from which the family is made."""
        match self.read_json(f"{key}.record"):
            case {
                "family": str(family),
                "behaviour": str(behaviour),
                "limit": int() | None as limit,
                "drawn": bool(drawn),
                "action_keys": dict() | None as keys,
                "tables": dict(tables),
                "certificates": dict(certificates),
            } if all(isinstance(table, str) for table in tables.values()):
                return FamilyRecord(family, behaviour, limit, drawn, keys, tables, certificates)
        return None

    def map_arrays(self, names: Sequence[str]) -> list[NDArray[Any]]:
        """Return the arrays in files, mapped into memory that processes share; [] if one is missing or damaged."""
        found = []
        for path in (path for name in names for path in self._paths(f"{name}.npy")):
            with suppress(OSError), path.open("rb") as file:
                if file_digest(file, "sha256").hexdigest() == path.stem:
                    os.utime(path)
                    found.append(np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)))
        return found if len(found) == len(names) else []

    def write_arrays(self, arrays: Sequence[NDArray[Any]]) -> list[str]:
        """Write arrays to files, unless that is impossible. Return their names, which are checksums."""
        names = []
        for array in arrays:
            np.save(content := BytesIO(), array, allow_pickle=False)
            names.append(sha256(content.getbuffer()).hexdigest())
            for path in self._paths(f"{names[-1]}.npy"):
                with suppress(OSError):
                    with replacement_draft(path) as draft:
                        draft.chmod(0o600)
                        draft.write_bytes(content.getbuffer())
                    _remove_old_files(path.parent)
        return names

    def _write_table(self, name: str, explored: ExploredEnvironment) -> None:
        reason: OSError | None = None
        for path in self._paths(name):
            try:
                with replacement_draft(path) as draft, draft.open("wb") as file:
                    write_explored(explored, file)
                _remove_old_files(path.parent)
                return
            except OSError as error:
                reason = error
        if reason is not None:
            logging.getLogger("envgraph").warning(
                "a transition table could not be cached, so that it will be computed again: %s; "
                "set %s to a writable directory",
                reason,
                CACHE_VARIABLE,
            )


def _is_trusted(path: Path) -> bool:
    with suppress(OSError):  # it is missing, or another process has just removed it
        return is_private_file(path.stat()) if path.parent == cache_directory() else path.is_file() or not path.exists()
    return True


def table_file_name(domain: Domain, behaviour: Behaviour, model: Model, keys: KeyIndex) -> str:
    """Return the file name of a table, a hash of everything on which it depends.

    The family file does not count, because it only configures the search.
    """
    files = sorted(domain.workspace.sources.items())
    texts = [text for name, text in files if name != domain.spec.path]
    return f"{hash_key(behaviour.name, texts, model_to_json(model), keys.to_json())}.npz"


def hash_key(*parts: object) -> str:
    """Return a hash of JSON-ready values, of the table format and of envgraph's version."""
    text = dump_json([CACHE_FORMAT, __version__, *parts])
    return sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _remove_old_files(place: Path) -> None:
    """Remove the least recently used files of a cache directory until their total size is within the limit."""
    endings = "npz", "record", "refusal", "npy", "program", "keys"
    files = [(file.stat(), file) for ending in endings for file in place.glob(f"*.{ending}")]
    total = 0
    for stat, file in sorted(files, key=lambda pair: pair[0].st_mtime, reverse=True):
        total += stat.st_size
        if total > LIMITS["cached bytes"]:
            file.unlink(missing_ok=True)
