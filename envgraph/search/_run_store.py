"""The run store: an SQLite file with every accepted individual of a run.

A generation is written in one transaction, so that a killed run can be resumed after its last complete generation. The
store contains no code: traces, measures and models are JSON.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from dataclasses import field
from glob import escape
from hashlib import blake2b
from math import isfinite
from pathlib import Path
from typing import Any, Final, Self, TypeVar, cast

from envgraph.code import dataclass
from envgraph.errors import EnvgraphError, InvalidArgument
from envgraph.files import replacement_draft, write_lock
from envgraph.lang import Bundle
from envgraph.metamodel import Value

T = TypeVar("T")

STORE_FORMAT = 2
"""Version of the SQL tables below; a store of another version is refused."""

CERTIFICATES_KEY = "certificates"
"""Key of the setting with the certificates of members, by id."""

_RESULT_NAMES = ("training", "tables", "report.html")
"""Names of files and directories with the results of a run, beside its store."""

_REPLACED_KEY = "replaced"
"""Key of the setting with the directory to which results of the old run are moved while the run is replaced."""

_SCHEMA = """
CREATE TABLE setting (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE source (path TEXT PRIMARY KEY, text TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE individual (
    id INTEGER PRIMARY KEY,
    generation INTEGER NOT NULL,
    child INTEGER NOT NULL,
    parent INTEGER REFERENCES individual (id),
    trace TEXT NOT NULL,
    measures TEXT NOT NULL,
    state_hash TEXT NOT NULL,
    model TEXT
);
CREATE TABLE generation (
    number INTEGER PRIMARY KEY,
    diversity REAL NOT NULL,
    accepted INTEGER NOT NULL,
    rejected INTEGER NOT NULL,
    reasons TEXT NOT NULL
);
CREATE TABLE member (
    generation INTEGER NOT NULL REFERENCES generation (number),
    place INTEGER NOT NULL,
    individual INTEGER NOT NULL REFERENCES individual (id),
    PRIMARY KEY (generation, place)
) WITHOUT ROWID;
CREATE TABLE content (individual INTEGER PRIMARY KEY REFERENCES individual (id), hash TEXT NOT NULL);
"""
_TABLES = [statement.strip() for statement in _SCHEMA.split(";\n") if statement.strip()]
_FOREIGN_OBJECTS_QUERY = (
    "SELECT name FROM sqlite_schema WHERE sql NOT GLOB 'CREATE TABLE *' AND sql NOT GLOB 'CREATE INDEX *'"
)
_INDIVIDUALS_QUERY = "SELECT individual.*, hash FROM individual LEFT JOIN content ON content.individual = id"
_MEMBERS_QUERY = (
    f"{_INDIVIDUALS_QUERY} JOIN member ON member.individual = id "
    "WHERE member.generation = (SELECT max(number) FROM generation) ORDER BY place"
)

Trace = tuple[tuple[str, tuple[Value, ...]], ...]
"""Rule applications in order: qualified name of the rule, and its match (objects by id)."""


@dataclass(frozen=True, slots=True)
class Individual:
    """An accepted individual of a run.

    Attributes:
        id: number from 0, in the order of acceptance; 0 is the initial model.
        generation: number of the generation; 0 is the initial population.
        child: number of the child within its generation.
        parent: id of the parent; None for the initial model and imported individuals.
        trace: the rule applications that turn the parent into the individual.
        measures: value of every measure, by name.
        state_hash: hash of the model by identity, 16 hexadecimal digits.
        model: the model as JSON text; None if it must be derived from the trace.
    """

    id: int
    generation: int
    child: int
    parent: int | None
    trace: Trace
    measures: Mapping[str, float]
    state_hash: str
    model: str | None = None


@dataclass(frozen=True, slots=True)
class Generation:
    """A generation of a run.

    Attributes:
        number: number from 0, which is the initial population.
        members: ids of its members.
        diversity: diversity of the members.
        accepted: number of accepted children.
        rejection_counts: number of rejected attempts, by the reason.
    """

    number: int
    members: tuple[int, ...]
    diversity: float
    accepted: int
    rejection_counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def rejected(self) -> int:
        """Return the number of rejected attempts."""
        return sum(self.rejection_counts.values())


class RunStore:
    """An open run store. Use `create` or `open`, and use it as a context manager.

    A store that was created, or opened for writing, is locked until it is closed. A store that was opened for reading
    shows the file at the time of opening.

    Invariant: the individuals of every stored generation, and their ancestors, are stored.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._db = sqlite3.connect(":memory:", isolation_level=None)
        self._locks = ExitStack()
        self._file_stat: os.stat_result | None = None  # None while the store is only in memory
        self._write_error: Exception | None = None  # the reason why the file cannot be written

    @classmethod
    def create(
        cls, path: Path, settings: Mapping[str, Any], sources: Mapping[str, str], *, overwrite: bool = False
    ) -> Self:
        """Create a new store. `settings` must be JSON-ready.

        An existing store is overwritten when the new store gets its first generation. Then the results of the old run
        are removed, too. Until then the new store is in memory, and the old run is unchanged.

        Raises:
            InvalidArgument: the file exists and `overwrite` is False, or another process writes it.
        """
        if path.exists() and not overwrite:
            hint = "write `overwrite=True` to replace it, call `resume` to continue its run, or choose another path"
            raise InvalidArgument(f"{path} exists already", hint)
        path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as held:
            held.enter_context(write_lock(path))
            _check_no_links(path)
            _finish_replacement(path)
            store, rows = cls(path), {"format": STORE_FORMAT, **settings}
            if path.exists():
                _connect(path)[0].close()  # raises if the file is not a database
                rows[_REPLACED_KEY] = f".{path.name}.replaced-{os.urandom(4).hex()}"
            with store._transaction() as db:
                for table in _TABLES:
                    db.execute(table)
                found = [(key, dump_json(value)) for key, value in rows.items()]
                db.executemany("INSERT INTO setting VALUES (?, ?)", found)
                db.executemany("INSERT INTO source VALUES (?, ?)", list(sources.items()))
            if _REPLACED_KEY not in rows:
                store._write_memory_to_file()
            store._locks = held.pop_all()
        return store

    def _write_memory_to_file(self) -> None:
        """Write a store that is in memory to its file, and remove the results of the run that it replaces."""
        aside = self.settings().get(_REPLACED_KEY)
        try:
            if aside:
                self.path.with_name(aside).mkdir()
                for result in filter(Path.exists, map(self.path.with_name, _RESULT_NAMES)):
                    result.rename(self.path.with_name(aside) / result.name)
            with ExitStack() as files:
                if aside:  # in one transaction, because other processes may be reading
                    file, self._write_error = _connect(self.path)
                    file.executescript("BEGIN IMMEDIATE; ROLLBACK")  # `backup` would wait for writers for ever
                else:
                    for log in _log_files(self.path):  # left from a store that was removed
                        log.unlink(missing_ok=True)
                    file = sqlite3.connect(files.enter_context(replacement_draft(self.path, overwrite=False)))
                self._db.backup(files.enter_context(closing(file)))
        except FileExistsError:
            raise InvalidArgument(f"{self.path} exists already") from None
        except sqlite3.DatabaseError as error:
            raise _unwritable_error(self.path, self._write_error or error) from error
        finally:
            _finish_replacement(self.path)
        self._db.close()
        self._db, self._write_error = _connect(self.path)
        self._file_stat = self.path.stat()

    @classmethod
    def open(cls, path: Path, *, writing: bool = False) -> Self:
        """Open an existing store. It is read-only if the file cannot be written.

        With `writing` the whole file is checked, and locked until the store is closed.

        Raises:
            InvalidArgument: the file is missing, damaged, of another format, or is being written by another process.
        """
        if not path.is_file():
            raise InvalidArgument(f"run store {path} does not exist")
        _check_no_links(path)
        _finish_replacement(path, has_lock=False)
        with ExitStack() as held:
            if writing:
                held.enter_context(write_lock(path))
            store = cls(path)
            store._db, store._write_error = _connect(path)
            store._file_stat = path.stat()
            held.callback(store._db.close)
            if not writing:
                store._db.execute("BEGIN")
            _check_is_run_store(store, store._db)
            if writing and (found := store._db.execute("PRAGMA quick_check(1)").fetchone()) != ("ok",):
                raise store.damage_error(*found)
            store._locks = held.pop_all()
        return store

    def close(self) -> None:
        """Close the file. The store cannot be used afterwards."""
        self._db.close()
        self._locks.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def settings(self) -> dict[str, Any]:
        """Return all settings by key: those given to `create`, `set_setting` and `write_generation`, and the store's
        format.
        """
        with self.damage_on_error("the settings"):
            rows = self._db.execute("SELECT key, value FROM setting")
            return {key: json.loads(value) for key, value in rows}

    @property
    def name(self) -> str:
        """Return the name of the family."""
        with self.damage_on_error("setting `name`"):
            return _checked(self.settings()["name"], str)

    @property
    def overrides(self) -> tuple[str, ...]:
        """Return the settings that replace those of the family file, such as "seed=5"."""
        with self.damage_on_error("setting `overrides`"):
            return _checked_texts(self.settings()["overrides"])

    @property
    def imported(self) -> str | None:
        """Return the file from which the family was imported; None if it was generated."""
        with self.damage_on_error("setting `imported`"):
            found = self.settings().get("imported")
            return None if found is None else _checked(found, str)

    def damage_error(self, problem: str) -> InvalidArgument:
        """Return the error to raise if the content of the store is inconsistent. `problem` says what is wrong."""
        return InvalidArgument(f"{self.path} is damaged: {problem}")

    @property
    def objective(self) -> dict[str, object]:
        """Return the results for the objective that a finished run stored; {} before the end, or without an objective.

        For a curriculum search these are "value", "learnt" and "origin" (see `CurriculumProgress`), and "exempted", the
        constraints that only the target satisfies. Otherwise "values" has the value of each term by its text. In both
        cases "lacking" has the amount of violation of each violated condition.
        """
        with self.damage_on_error("setting `objective`"):
            return dict(_checked(self.settings().get("objective", {}), dict))

    @property
    def certificates(self) -> dict[int, dict[str, float | None]]:
        """Return the stored certificates of individuals (values by name), by id; {} if none were stored."""
        with self.damage_on_error(f"setting `{CERTIFICATES_KEY}`"):
            return {
                int(key): {
                    name: None if value is None else _checked_number(value)
                    for name, value in _checked(one, dict).items()
                }
                for key, one in _checked(self.settings().get(CERTIFICATES_KEY, {}), dict).items()
            }

    def set_setting(self, key: str, value: Any) -> None:
        """Add or replace a setting. The value must be JSON-ready."""
        with self._transaction() as db:
            db.execute("INSERT OR REPLACE INTO setting VALUES (?, ?)", (key, dump_json(value)))

    def source_texts(self) -> dict[str, str]:
        """Return the texts of the files from which the run was made, by path."""
        with self.damage_on_error("the texts"):
            rows = self._db.execute("SELECT path, text FROM source ORDER BY path")
            return {_checked(path, str): _checked(text, str) for path, text in rows}

    def bundle(self) -> Bundle:
        """Return the texts of the files from which the run was made, as a bundle that can be loaded."""
        with self.damage_on_error("setting `roots`"):
            roots = _checked_texts(self.settings()["roots"])
            if not roots:
                raise ValueError("the list is empty")
        return Bundle(roots, self.source_texts())

    def family_hash_data(self) -> list[Any]:
        """Return the settings, the texts of files and the members of the last generation, as JSON-ready lists."""
        with self.damage_on_error("the members"):
            rows = self._db.execute(_MEMBERS_QUERY).fetchall()
        return [self.settings(), self.source_texts(), [*map(repr, rows)]]

    def write_generation(
        self,
        generation: Generation,
        individuals: Iterable[Individual],
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        """Write a generation, its accepted individuals and new settings, in one transaction.

        If the store is still in memory, it is then written to its file, where it replaces an old run.
        """
        with self._transaction() as db:
            texts = [(key, dump_json(value)) for key, value in (settings or {}).items()]
            db.executemany("INSERT OR REPLACE INTO setting VALUES (?, ?)", texts)
            rows = [
                (one.id, one.generation, one.child, one.parent, dump_json(one.trace), dump_json(dict(one.measures)),
                 one.state_hash, one.model) for one in individuals
            ]  # fmt: skip
            db.executemany("INSERT INTO individual VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)
            db.executemany("INSERT INTO content VALUES (?, ?)", [(row[0], _row_hash(row)) for row in rows])
            numbers = generation.number, generation.diversity, generation.accepted, generation.rejected
            reasons = dump_json(dict(generation.rejection_counts))
            db.execute("INSERT INTO generation VALUES (?, ?, ?, ?, ?)", (*numbers, reasons))
            db.executemany(
                "INSERT INTO member VALUES (?, ?, ?)",
                [(generation.number, place, member) for place, member in enumerate(generation.members)],
            )
        if self._file_stat is None:
            self._write_memory_to_file()

    def write_models(self, model_texts: Mapping[int, str]) -> None:
        """Store the models of individuals, given as JSON text by id, and update the hashes of the individuals."""
        with self._transaction() as db:
            for key, model in model_texts.items():
                db.execute("UPDATE individual SET model = ? WHERE id = ?", (model, key))
                row = db.execute("SELECT * FROM individual WHERE id = ?", (key,)).fetchone()
                db.execute("INSERT OR REPLACE INTO content VALUES (?, ?)", (key, _row_hash(row)))

    def last_generation(self) -> Generation | None:
        """Return the last complete generation; None if there is none yet."""
        with self.damage_on_error("the generations"):
            (number,) = self._db.execute("SELECT max(number) FROM generation").fetchone()
        return None if number is None else self.generation(number)

    def generation(self, number: int) -> Generation:
        """Return a generation by its number.

        Raises:
            InvalidArgument: the generation does not exist.
        """
        with self.damage_on_error(f"generation {number}"):
            row = self._db.execute("SELECT * FROM generation WHERE number = ?", (number,)).fetchone()
            if row is None:
                raise InvalidArgument(f"{self.path} has no generation {number}")
            rows = self._db.execute("SELECT individual FROM member WHERE generation = ? ORDER BY place", (number,))
            members = tuple(_checked(member, int) for (member,) in rows)
            if not members:
                raise ValueError("it has no members")
            _, diversity, accepted, _, reasons = row
            return Generation(
                number, members, _checked_number(diversity), _checked(accepted, int), _parse_reasons(reasons)
            )

    def generation_statistics(self) -> list[tuple[int, float, int, int]]:
        """Return number, diversity, accepted children and rejected attempts of every generation, in order."""
        with self.damage_on_error("the generations"):
            columns = "number, diversity, accepted, rejected"
            rows = self._db.execute(f"SELECT {columns} FROM generation ORDER BY number")
            return [
                (number, _checked_number(diversity), _checked(accepted, int), _checked(rejected, int))
                for number, diversity, accepted, rejected in rows
            ]

    def rejection_counts(self) -> Counter[str]:
        """Return the number of rejected attempts in all generations, by the reason."""
        with self.damage_on_error("the generations"):
            rows = self._db.execute("SELECT reasons FROM generation ORDER BY number")
            return sum((Counter(_parse_reasons(reasons)) for (reasons,) in rows), Counter[str]())

    def individual(self, id_: int) -> Individual:
        """Return an individual by its id.

        Raises:
            InvalidArgument: the individual does not exist.
        """
        with self.damage_on_error(f"individual {id_}"):
            row = self._db.execute(f"{_INDIVIDUALS_QUERY} WHERE id = ?", (id_,)).fetchone()
            if row is None:
                raise InvalidArgument(f"{self.path} has no individual {id_}")
            return _parse_individual(row)

    def individuals(self) -> Iterator[Individual]:
        """Yield every accepted individual, in the order of acceptance."""
        last: object = "before the first"
        rows = self._db.execute(f"{_INDIVIDUALS_QUERY} ORDER BY id")
        while True:
            with self.damage_on_error(f"the individual after {last}"):
                row = rows.fetchone()
                if row is None:
                    return
                found = _parse_individual(row)
            yield found
            last = found.id

    def lineage(self, id_: int) -> list[Individual]:
        """Return the individual and its ancestors, the oldest first."""
        line = [self.individual(id_)]
        while (parent := line[-1].parent) is not None:
            line.append(self.individual(parent))
        return line[::-1]

    def next_id(self) -> int:
        """Return the id for the next individual: the largest stored id plus 1, or 0 in an empty store."""
        with self.damage_on_error("the individuals"):
            (last,) = self._db.execute("SELECT max(id) FROM individual").fetchone()
        return 0 if last is None else last + 1

    @contextmanager
    def damage_on_error(self, content: str) -> Iterator[None]:
        """Convert exceptions raised while `content` is read, except `EnvgraphError`, to the error of a damaged
        store.
        """
        try:
            yield
        except EnvgraphError:
            raise
        except KeyError as error:
            raise self.damage_error(f"{content}: an entry is missing") from error
        except (sqlite3.Error, LookupError, TypeError, ValueError, RecursionError) as error:
            raise self.damage_error(f"{content}: {error}") from error

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        opened = self._file_stat
        if opened and not (self.path.exists() and os.path.samestat(opened, self.path.stat())):
            message = f"{self.path} was replaced or removed while this command used it"
            raise InvalidArgument(message, "run the command again; nothing was written")
        is_reading = self._db.in_transaction
        if is_reading:
            message = f"{self.path} cannot be written: it was opened for reading"
            raise InvalidArgument(message, "use `RunStore.open(path, writing=True)`")
        try:
            self._db.execute("BEGIN IMMEDIATE")
            try:
                yield self._db
            except BaseException:
                if self._db.in_transaction:  # a full disk ends the transaction
                    self._db.execute("ROLLBACK")
                raise
            self._db.execute("COMMIT")
        except (
            sqlite3.DatabaseError,
            UnicodeDecodeError,
        ) as error:  # the disk is full, another process writes, or the file is damaged
            raise _unwritable_error(self.path, self._write_error or error) from error


def _check_is_run_store(store: RunStore, db: sqlite3.Connection) -> None:
    """Raise `InvalidArgument` for files that are not run stores of this format, before any SQL in them can run.

    A store without a table of hashes gets an empty temporary one.
    """
    try:
        if strange := db.execute(_FOREIGN_OBJECTS_QUERY).fetchone():
            raise InvalidArgument(f"it has a view or trigger `{strange[0]}`, which run stores do not have")
        version = store.settings().get("format")
    except (InvalidArgument, sqlite3.DatabaseError, UnicodeDecodeError) as error:
        raise InvalidArgument(f"{store.path} is not a run store: {error.__cause__ or error}") from error
    if version != STORE_FORMAT:
        message = f"{store.path} has format {version}, but this envgraph reads format {STORE_FORMAT}: generate it again"
        raise InvalidArgument(message)
    if not db.execute("SELECT 1 FROM sqlite_schema WHERE name = 'content'").fetchone():
        db.execute(_TABLES[-1].replace("CREATE", "CREATE TEMP", 1))  # stores of older versions have no hashes


def _unwritable_error(path: Path, error: Exception) -> InvalidArgument:
    hint = "make room on the full disk; finished generations are stored" if _may_disk_be_full(error) else None
    return InvalidArgument(f"{path} cannot be written: {error}", hint)


def _check_no_links(path: Path) -> None:
    """Raise `InvalidArgument` for a run with symbolic links, because a write could change files elsewhere."""
    for place in map(path.with_name, (path.name, *_RESULT_NAMES)):
        for one in (place, *place.rglob("*")):
            if one.is_symlink():
                raise InvalidArgument(
                    f"{one} is a symbolic link, which is not allowed in runs", "replace it by the file"
                )


def _finish_replacement(path: Path, *, has_lock: bool = True) -> None:
    """Delete the results of an old run that were moved aside if the run was replaced; otherwise move them back.

    Do nothing if another process locks the run. `has_lock` is True if the caller has the lock. Errors are ignored.
    """
    for aside in sorted(path.parent.glob(f".{escape(path.name)}.replaced-*")):
        if aside.is_symlink() or not aside.is_dir():
            continue
        with suppress(InvalidArgument, OSError), nullcontext() if has_lock else write_lock(path):
            found = None
            with suppress(InvalidArgument, sqlite3.DatabaseError), closing(_connect(path)[0]) as db:
                found = db.execute("SELECT value FROM setting WHERE key = ?", (_REPLACED_KEY,)).fetchone()
            for name in _RESULT_NAMES if found != (dump_json(aside.name),) else ():
                if (aside / name).exists() and not path.with_name(name).exists():
                    (aside / name).rename(path.with_name(name))
            shutil.rmtree(aside, ignore_errors=True)


def _connect(path: Path) -> tuple[sqlite3.Connection, Exception | None]:
    """Open a store. Return the connection, and the error that makes it read-only; None if it can be written."""
    # Transactions are explicit (isolation_level None). With a write-ahead log and synchronous NORMAL no committed data
    # is lost if the process is killed. A power cut loses at most complete generations at the end.
    uri = path.absolute().as_uri()
    tried, reason = [f"{uri}?mode=rw"], cast("Exception | None", None)
    for address in tried:
        connection = sqlite3.connect(address, isolation_level=None, uri=True)
        try:
            for setting in _PRAGMAS:
                connection.execute(f"PRAGMA {setting}")
            connection.execute("SELECT count(*) FROM sqlite_schema").fetchone()
            return connection, reason
        except (
            sqlite3.DatabaseError,
            UnicodeDecodeError,
        ) as error:  # the second exception occurs if names are damaged
            connection.close()
            reason = reason or error
            if address is tried[0] and getattr(error, "sqlite_errorname", "").startswith(_WRITE_ERRORS):
                tried += _read_only_addresses(path, uri)
    if len(tried) == 2:  # a log exists, and merging it into the file needs write access
        message = f"{path} has an unmerged log, and is not writable: copy its directory to a writable place"
        raise InvalidArgument(message) from reason
    raise InvalidArgument(f"{path} is not a run store: {reason}") from reason


def _may_disk_be_full(error: Exception) -> bool:
    """Return True if SQLite reported a full disk, or an input or output error, which a full disk may cause."""
    return getattr(error, "sqlite_errorname", "").startswith(("SQLITE_FULL", "SQLITE_IOERR"))


def _read_only_addresses(path: Path, uri: str) -> list[str]:
    """Return the addresses with which to open a store read-only, in the order in which to try them."""
    log, index = _log_files(path)
    used = (log.exists() and log.stat().st_size) or (index.exists() and index.stat().st_size >= _LOG_INDEX_SIZE)
    return [f"{uri}?mode=ro", *([] if used else [f"{uri}?immutable=1"])]  # without a log the file is complete


def _log_files(path: Path) -> tuple[Path, ...]:
    """Return the paths of the files that SQLite keeps beside an open store, and which remain after a kill."""
    return tuple(path.with_name(f"{path.name}{ending}") for ending in ("-wal", "-shm"))


_PRAGMAS = ("trusted_schema = OFF", "temp_store = MEMORY", "journal_mode = WAL", "synchronous = NORMAL")
_WRITE_ERRORS = ("SQLITE_FULL", "SQLITE_IOERR", "SQLITE_READONLY", "SQLITE_CANTOPEN")
_LOG_INDEX_SIZE = 32_768
"""Size in bytes of SQLite's log index while a store is open. A smaller file is a remainder of a full disk."""
_ENCODER = json.JSONEncoder(
    ensure_ascii=False, separators=(",", ":")
)  # `json.dumps` would create an encoder for every call


def dump_json(value: Any) -> str:
    """Return compact JSON text. The keys of a dict keep their order."""
    return _ENCODER.encode(value)


def _row_hash(row: Sequence[object]) -> str:
    """Return a hash of a row of the table `individual`, which contains all stored data of an individual."""
    return blake2b(dump_json(row).encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()


def _parse_individual(row: Sequence[Any]) -> Individual:
    id_, generation, child, parent, trace, measures, state_hash, model, digest = row
    if parent is not None and _checked(parent, int) >= id_:
        raise ValueError("its id is not larger than that of its parent")
    steps = tuple((_checked(rule, str), _checked_match(values)) for rule, values in json.loads(trace))
    found = {name: _checked_number(value) for name, value in _checked(json.loads(measures), dict).items()}
    text = None if model is None else _checked(model, str)
    if digest not in (None, _row_hash(row[:-1])):
        raise ValueError("its row does not match the stored hash")
    numbers = _checked(generation, int), _checked(child, int)
    return Individual(id_, *numbers, parent, steps, found, _checked(state_hash, str), text)


# A file may have been edited or damaged, so every value that is read is checked.


_KINDS: Final = {str: "a text", int: "a whole number", list: "a list of texts", dict: "an object"}


def _checked(value: object, kind: type[T]) -> T:
    if type(value) is not kind:
        raise TypeError(f"{_KINDS[kind]} is expected, not {type(value).__name__}")
    return value


def _checked_texts(value: object) -> tuple[str, ...]:
    return tuple(_checked(one, str) for one in _checked(value, list))


def _checked_number(value: object) -> float:
    if type(value) not in (int, float) or not isfinite(value):  # type: ignore[arg-type]
        raise TypeError(f"a finite number is expected, not {type(value).__name__}")
    return float(value)  # type: ignore[arg-type]


def _parse_reasons(text: str) -> dict[str, int]:
    return {reason: _checked(count, int) for reason, count in _checked(json.loads(text), dict).items()}


def _checked_match(values: object) -> tuple[Value, ...]:
    if not isinstance(values, list) or not all(isinstance(one, bool | int | float | str) for one in values):
        raise TypeError("the values of a match are expected")
    return tuple(values)
