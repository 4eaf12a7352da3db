"""The run store."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.search import Generation, Individual, RunStore, generate, open_family, write_family
from envgraph.search._store import FORMAT


@pytest.fixture
def store(tmp_path: Path) -> Iterator[RunStore]:
    with RunStore.create(
        tmp_path / "runs" / "a" / "run.sqlite", {"seed": 7}, {"a.query": "pattern"}
    ) as store:
        yield store


def individual(id_: int, generation: int = 0, parent: int | None = None) -> Individual:
    trace = (("p.rule", (3, "red", 0.5, True)),) if parent is not None else ()
    return Individual(id_, generation, id_ - 1, parent, trace, {"complexity": id_ / 10}, f"{id_:016x}")


def test_what_is_written_reads_back_equal(store: RunStore) -> None:
    born = [individual(0), individual(1, parent=0)]
    store.write_generation(Generation(0, (0, 1), 1.0, 2, {"slow": 2, "wet": 3}), born)
    assert list(store.individuals()) == born
    assert store.last_generation() == Generation(0, (0, 1), 1.0, 2, {"slow": 2, "wet": 3})
    assert store.history() == [(0, 1.0, 2, 5)]
    assert store.reasons() == {"slow": 2, "wet": 3}
    assert store.settings() == {"format": 2, "seed": 7}
    assert store.sources() == {"a.query": "pattern"}


def test_the_tables_are_documented(store: RunStore) -> None:
    page = Path(__file__).parents[3] / "docs" / "architecture" / "families.md"
    told = page.read_text(encoding="utf-8").split("## The run store")[1].split("\n## ")[0]
    with closing(sqlite3.connect(store.path)) as file:
        tables = [name for (name,) in file.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
        assert len(tables) == 5
        for table in tables:
            assert f"| `{table}` |" in told
            for column in file.execute(f"PRAGMA table_info({table})"):
                assert f"`{column[1]}`" in told
    assert f"which is {FORMAT};" in told


def test_members_keep_their_order(store: RunStore) -> None:
    store.write_generation(Generation(0, (2, 0, 1), 0.0, 3), [individual(k) for k in range(3)])
    assert store.generation(0).members == (2, 0, 1)


def test_lineage_leads_from_the_initial_model_to_the_individual(store: RunStore) -> None:
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    store.write_generation(Generation(1, (2,), 0.0, 2), [individual(1, 1, 0), individual(2, 1, 1)])
    assert [ancestor.id for ancestor in store.lineage(2)] == [0, 1, 2]


def test_a_generation_that_fails_half_way_leaves_nothing(store: RunStore) -> None:
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    with pytest.raises(InvalidArgument, match="cannot be written"):
        store.write_generation(Generation(1, (1,), 0.0, 1), [individual(1, 1, 0), individual(0, 1)])
    assert [one.id for one in store.individuals()] == [0]
    assert store.next_id() == 1
    last = store.last_generation()
    assert last is not None and last.number == 0


def test_models_are_added_later(store: RunStore) -> None:
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    store.write_models({0: "{}"})
    assert store.individual(0).model == "{}"


def test_a_fresh_store_has_no_generation(store: RunStore) -> None:
    assert store.last_generation() is None and store.next_id() == 0


def test_unknown_ids_and_generations_are_named(store: RunStore) -> None:
    with pytest.raises(InvalidArgument, match="no individual 9"):
        store.individual(9)
    with pytest.raises(InvalidArgument, match="no generation 3"):
        store.generation(3)


def test_an_existing_store_is_not_overwritten(store: RunStore) -> None:
    with pytest.raises(InvalidArgument, match="exists"):
        RunStore.create(store.path, {}, {})


def test_of_two_processes_that_make_one_store_the_second_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.sqlite"
    RunStore.create(path, {"seed": 1}, {}).close()
    monkeypatch.setattr(
        Path, "exists", lambda self: False
    )  # the other process was not yet done when we looked
    with pytest.raises(InvalidArgument, match="exists already"):
        RunStore.create(path, {"seed": 2}, {})
    with RunStore.open(path) as store:
        assert store.settings()["seed"] == 1
    assert [file.name for file in tmp_path.iterdir()] == ["run.sqlite"]


def test_files_that_are_no_store_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="no run store"):
        RunStore.open(tmp_path / "missing.sqlite")
    (tmp_path / "text.sqlite").write_text("this is no database, " * 100)
    with pytest.raises(InvalidArgument, match="no run store"):
        RunStore.open(tmp_path / "text.sqlite")
    sqlite3.connect(tmp_path / "empty.sqlite").close()
    with pytest.raises(InvalidArgument, match="no run store"):
        RunStore.open(tmp_path / "empty.sqlite")


def test_a_store_of_another_format_is_refused(tmp_path: Path) -> None:
    RunStore.create(tmp_path / "new.sqlite", {"format": 99}, {}).close()
    with pytest.raises(InvalidArgument, match="format 99"):
        RunStore.open(tmp_path / "new.sqlite")


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """A directory and its files cannot be written; also by root, who is nobody in the meantime."""
    for path in (*directory.iterdir(), directory):
        path.chmod(0o555 if path.is_dir() else 0o444)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        if user == 0:
            os.seteuid(0)
        directory.chmod(0o755)


@pytest.fixture
def elsewhere() -> Iterator[Path]:
    """A directory that any user can reach."""
    directory = Path(tempfile.mkdtemp())
    yield directory
    shutil.rmtree(directory)


def test_a_run_that_cannot_be_written_can_be_read(elsewhere: Path) -> None:
    path = elsewhere / "run.sqlite"
    family = generate("burning_forest", path, generations=1, population=2)
    text = write_family(family)
    with locked(elsewhere):
        assert write_family(open_family(path)) == text
        with RunStore.open(path) as store:
            assert len(store.history()) == 2
            with pytest.raises(InvalidArgument, match="cannot be written"):
                store.set("seed", 3)
    assert [file.name for file in elsewhere.iterdir()] == ["run.sqlite"]


def test_a_run_on_a_full_disk_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    text = write_family(generate("burning_forest", path, generations=1, population=2))
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, limits[1]))
        for _ in range(2):  # the first attempt may leave a file beside it
            with RunStore.open(path) as store:
                assert len(store.history()) == 2
                with pytest.raises(InvalidArgument, match="cannot be written"):
                    store.set("seed", 3)
        found = write_family(open_family(path))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert found == text and path.read_bytes() == before
    with RunStore.open(path) as store:
        store.set("seed", 3)


def test_a_run_that_was_killed_and_cannot_be_written_says_what_to_do(elsewhere: Path) -> None:
    path = elsewhere / "run.sqlite"
    with RunStore.create(elsewhere / "open.sqlite", {"seed": 1}, {}) as store:
        store.set("seed", 2)
        for ending in ("", "-wal"):  # as a kill leaves them
            shutil.copy(f"{store.path}{ending}", f"{path}{ending}")
    with locked(elsewhere), pytest.raises(InvalidArgument, match="copy its directory to where it can"):
        RunStore.open(path)
    with RunStore.open(path) as again:
        assert again.settings()["seed"] == 2


def test_a_store_that_is_overwritten_forgets_the_log_of_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    with RunStore.create(tmp_path / "open.sqlite", {"seed": 1}, {}) as store:
        store.set("seed", 2)
        for ending in ("", "-wal"):
            shutil.copy(f"{store.path}{ending}", f"{path}{ending}")
    with RunStore.create(path, {"seed": 3}, {}, overwrite=True) as again:
        assert again.settings()["seed"] == 3
    with RunStore.open(path) as again:
        assert again.settings()["seed"] == 3


def test_a_store_whose_tables_have_damaged_names_is_none(store: RunStore) -> None:
    path = store.path
    store.close()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"tableindividual", b"tableindi\xe7idual", 1))
    with pytest.raises(InvalidArgument, match="is no run store"):
        RunStore.open(path)
