"""The run store."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from envgraph.errors import InvalidArgument
from envgraph.search import Generation, Individual, RunStore, generate, open_family, write_family


@pytest.fixture
def store(tmp_path: Path) -> Iterator[RunStore]:
    with RunStore.create(tmp_path / "runs" / "a" / "run.sqlite", {"seed": 7}, {"a.query": "pattern"}) as store:
        yield store


def individual(id_: int, generation: int = 0, parent: int | None = None) -> Individual:
    trace = (("p.rule", (3, "red", 0.5, True)),) if parent is not None else ()
    return Individual(id_, generation, id_ - 1, parent, trace, {"complexity": id_ / 10}, f"{id_:016x}")


def test_store_returns_the_written_generation_and_settings(store: RunStore) -> None:
    born = [individual(0), individual(1, parent=0)]
    store.write_generation(Generation(0, (0, 1), 1.0, 2, {"slow": 2, "wet": 3}), born)
    assert list(store.individuals()) == born
    assert store.last_generation() == Generation(0, (0, 1), 1.0, 2, {"slow": 2, "wet": 3})
    assert store.generation_statistics() == [(0, 1.0, 2, 5)]
    assert store.rejection_counts() == {"slow": 2, "wet": 3}
    assert store.settings() == {"format": 2, "seed": 7}
    assert store.source_texts() == {"a.query": "pattern"}


def test_the_tables_are_documented(store: RunStore) -> None:
    page = Path(__file__).parents[3] / "docs" / "architecture" / "search.md"
    told = page.read_text(encoding="utf-8").split("## The run store")[1].split("\n## ")[0]
    with closing(sqlite3.connect(store.path)) as file:
        tables = [name for (name,) in file.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
        assert len(tables) == 6
        for table in tables:
            assert f"| `{table}` |" in told
            for column in file.execute(f"PRAGMA table_info({table})"):
                assert f"`{column[1]}`" in told
    assert "which is 2;" in told


def test_members_keep_their_order(store: RunStore) -> None:
    store.write_generation(Generation(0, (2, 0, 1), 0.0, 3), [individual(k) for k in range(3)])
    assert store.generation(0).members == (2, 0, 1)


def test_lineage_leads_from_the_initial_model_to_the_individual(store: RunStore) -> None:
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    store.write_generation(Generation(1, (2,), 0.0, 2), [individual(1, 1, 0), individual(2, 1, 1)])
    assert [ancestor.id for ancestor in store.lineage(2)] == [0, 1, 2]


def test_store_opened_for_reading_refuses_writing(store: RunStore) -> None:
    with (
        RunStore.open(store.path) as reader,
        pytest.raises(InvalidArgument, match=r"was opened for reading; use .*writing=True"),
    ):
        reader.set_setting("seed", 3)


def test_generation_that_cannot_be_written_is_rolled_back(store: RunStore) -> None:
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    with pytest.raises(InvalidArgument, match="cannot be written"):
        store.write_generation(Generation(1, (1,), 0.0, 1), [individual(1, 1, 0), individual(0, 1)])
    assert [one.id for one in store.individuals()] == [0]
    assert store.next_id() == 1
    last = store.last_generation()
    assert last is not None and last.number == 0


def test_models_can_be_added_to_stored_individuals(store: RunStore) -> None:
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


def test_second_process_that_creates_the_same_store_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.sqlite"
    RunStore.create(path, {"seed": 1}, {}).close()
    monkeypatch.setattr(Path, "exists", lambda self: False)  # the other process was not yet done when we looked
    with pytest.raises(InvalidArgument, match="exists already"):
        RunStore.create(path, {"seed": 2}, {})
    with RunStore.open(path) as store:
        assert store.settings()["seed"] == 1
    assert [file.name for file in tmp_path.iterdir()] == ["run.sqlite"]


def test_files_that_are_no_store_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="run store"):
        RunStore.open(tmp_path / "missing.sqlite")
    (tmp_path / "text.sqlite").write_text("this is no database, " * 100)
    with pytest.raises(InvalidArgument, match="run store"):
        RunStore.open(tmp_path / "text.sqlite")
    sqlite3.connect(tmp_path / "empty.sqlite").close()
    with pytest.raises(InvalidArgument, match="run store"):
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


def test_read_only_run_can_be_read(elsewhere: Path) -> None:
    path = elsewhere / "run.sqlite"
    family = generate("burning_forest/paper.toml", path, generations=1, population=2)
    text = write_family(family)
    with locked(elsewhere):
        assert write_family(open_family(path)) == text
        with RunStore.open(path) as store:
            assert len(store.generation_statistics()) == 2
            with pytest.raises(InvalidArgument, match="cannot be written"):
                store.set_setting("seed", 3)
    assert [file.name for file in elsewhere.iterdir()] == ["run.sqlite"]


def test_a_run_on_a_full_disk_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    text = write_family(generate("burning_forest/paper.toml", path, generations=1, population=2))
    before = path.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, limits[1]))
        for _ in range(2):  # the first attempt may leave a file beside it
            with RunStore.open(path, writing=True) as store:
                assert len(store.generation_statistics()) == 2
                with pytest.raises(
                    InvalidArgument, match=r"run\.sqlite cannot be written: .*; make room on the full disk"
                ):
                    store.set_setting("seed", 3)
        found = write_family(open_family(path))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert found == text and path.read_bytes() == before
    with RunStore.open(path, writing=True) as store:
        store.set_setting("seed", 3)


def test_read_only_run_of_a_killed_process_is_refused_with_advice(elsewhere: Path) -> None:
    path = elsewhere / "run.sqlite"
    with RunStore.create(elsewhere / "open.sqlite", {"seed": 1}, {}) as store:
        store.set_setting("seed", 2)
        for ending in ("", "-wal"):  # as a kill leaves them
            shutil.copy(f"{store.path}{ending}", f"{path}{ending}")
    with locked(elsewhere), pytest.raises(InvalidArgument, match="copy its directory to a writable place"):
        RunStore.open(path)
    with RunStore.open(path) as again:
        assert again.settings()["seed"] == 2


def test_overwritten_store_discards_the_write_ahead_log_of_the_old_store(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    with RunStore.create(tmp_path / "open.sqlite", {"seed": 1}, {}) as store:
        store.set_setting("seed", 2)
        for ending in ("", "-wal"):
            shutil.copy(f"{store.path}{ending}", f"{path}{ending}")
    with RunStore.create(path, {"seed": 3}, {}, overwrite=True) as again:
        again.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
        assert again.settings()["seed"] == 3
    with RunStore.open(path) as again:
        assert again.settings()["seed"] == 3


def test_store_with_damaged_table_names_is_refused(store: RunStore) -> None:
    path = store.path
    store.close()
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"tableindividual", b"tableindi\xe7idual", 1))
    with pytest.raises(InvalidArgument, match="is not a run store"):
        RunStore.open(path)


@pytest.fixture
def old(store: RunStore) -> Path:
    """A run with a generation and results, which nobody has open."""
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    store.close()
    for name in ("training/100/runs.csv", "tables/a.npz", "report.html", "notes.txt"):
        (store.path.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (store.path.parent / name).write_text(name)
    return store.path


def content(path: Path) -> tuple[object, set[str]]:
    """The seed of a run, and the names of its files; opening it mends what a kill has left."""
    with RunStore.open(path) as store:
        seed = store.settings()["seed"]
    return seed, {str(file.relative_to(path.parent)) for file in path.parent.rglob("*") if file.is_file()}


OLD = (7, {"run.sqlite", "training/100/runs.csv", "tables/a.npz", "report.html", "notes.txt"})
NEW = (8, {"run.sqlite", "notes.txt"})


def test_run_is_replaced_when_the_new_run_writes_its_first_generation(old: Path) -> None:
    with RunStore.create(old, {"seed": 8}, {}, overwrite=True) as new, RunStore.open(old) as reader:
        new.set_setting("more", 1)
        assert new.settings()["seed"] == 8
        assert content(old)[0] == 7
        new.write_generation(Generation(0, (0, 1), 0.0, 2), [individual(0), individual(1)])
        assert reader.settings()["seed"] == 7 and reader.last_generation() == Generation(0, (0,), 0.0, 1)
    assert content(old) == NEW


@pytest.mark.parametrize("when", ["before", "within"])
def test_error_while_a_run_is_replaced_keeps_the_old_run(old: Path, when: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(OSError, match="full"), RunStore.create(old, {"seed": 8}, {}, overwrite=True) as new:
        if when == "within":
            monkeypatch.setattr("envgraph.search._run_store._connect", fail)
            new.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
        fail()
    monkeypatch.undo()
    assert content(old) == OLD


def fail(*_: object) -> None:
    raise OSError("full")


KILLED = """
import os, shutil, signal, sqlite3, sys
from pathlib import Path
from envgraph.search import Generation, Individual, RunStore
function, number = sys.argv[2], int(sys.argv[3])
def counted(*arguments, _usual=getattr(Path, function, None) or getattr(shutil, function), **named):
    global number
    number -= 1
    if number == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return _usual(*arguments, **named)
setattr(Path if hasattr(Path, function) else shutil, function, counted)
with RunStore.create(Path(sys.argv[1]), {"seed": 8}, {}, overwrite=True) as store:
    store.write_generation(Generation(0, (0,), 0.0, 1), [Individual(0, 0, -1, None, (), {}, "0")])
"""


@pytest.mark.parametrize(("function", "number", "left"), [("rename", 2, OLD), ("rename", 3, OLD), ("rmtree", 1, NEW)])
def test_run_killed_during_replacement_is_repaired_by_the_next_command(
    old: Path, function: str, number: int, left: object, caplog: pytest.LogCaptureFixture
) -> None:
    code = subprocess.run([sys.executable, "-c", KILLED, old, function, str(number)], check=False).returncode
    assert code == -signal.SIGKILL
    assert len([*old.parent.glob(".run.sqlite.replaced-*")]) == 1
    assert content(old) == left
    assert f"died while it wrote {old}" in caplog.text
    caplog.clear()
    RunStore.open(old, writing=True).close()
    assert not caplog.text


@pytest.mark.parametrize("again", ["create", "open"])
def test_second_writer_is_refused_with_the_process_of_the_first_writer(store: RunStore, again: str) -> None:
    store.write_generation(Generation(0, (0,), 0.0, 1), [individual(0)])
    code = (
        "import sys; from pathlib import Path; from envgraph.search import RunStore\n"
        "path = Path(sys.argv[1])\n"
        "print(RunStore.open(path).last_generation().number)\n"
        + ("RunStore.open(path, writing=True)" if again == "open" else "RunStore.create(path, {}, {}, overwrite=True)")
    )
    done = subprocess.run([sys.executable, "-c", code, store.path], check=False, capture_output=True, text=True)
    holder = f"process {os.getpid()} on host {socket.gethostname()}"
    assert done.stdout == "0\n" and f"{holder} is writing {store.path}" in done.stderr
    with pytest.raises(InvalidArgument, match=r"process \d+ on host .* is writing"):
        RunStore.open(store.path, writing=True)
    store.close()
    assert [file.name for file in store.path.parent.iterdir()] == ["run.sqlite"]
    RunStore.open(store.path, writing=True).close()


@pytest.mark.parametrize(
    "make",
    [os.mkfifo, os.mkdir, lambda path: path.symlink_to("mine"), lambda path: path.symlink_to("/dev/zero")],
)
def test_lock_path_that_is_not_a_file_is_an_error(old: Path, make: Callable[[Path], object]) -> None:
    (old.parent / "mine").write_text("mine")
    make(old.parent / ".run.sqlite.lock")
    with pytest.raises(InvalidArgument, match=r"\.run\.sqlite\.lock is not a file; remove "):
        RunStore.open(old, writing=True)
    assert (old.parent / "mine").read_text() == "mine"


LINKS = ("run.sqlite", "report.html", "tables", "training", "training/300", "training/300/runs.csv")


@pytest.mark.parametrize("name", LINKS)
def test_run_with_symbolic_links_is_refused(old: Path, tmp_path: Path, name: str) -> None:
    link = old.parent / name
    target = tmp_path / "elsewhere"
    if link.exists():
        (shutil.move if link.is_file() else shutil.copytree)(link, target)
        shutil.rmtree(link, ignore_errors=True)
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(target)
    for again in (
        lambda: RunStore.open(old),
        lambda: RunStore.open(old, writing=True),
        lambda: RunStore.create(old, {}, {}, overwrite=True),
    ):
        with pytest.raises(InvalidArgument, match=f"{name} is a symbolic link" if name != "run.sqlite" else "link"):
            again()


@pytest.mark.parametrize("kind", ["link", "file", "pipe", "directory"])
def test_repair_of_a_run_ignores_foreign_files_and_symbolic_links(old: Path, tmp_path: Path, kind: str) -> None:
    """Whoever reads a run of a stranger loses no file outside of it."""
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis").write_text("1")
    aside = old.parent / ".run.sqlite.replaced-zz"
    if kind == "link":
        aside.symlink_to(precious)
    elif kind == "file":
        aside.write_text("x")
    elif kind == "pipe":
        os.mkfifo(aside)
    else:
        shutil.copytree(precious, aside)
    before = content(old)
    assert (precious / "thesis").read_text() == "1"
    assert not (old.parent / "thesis").exists()
    assert content(old) == before


@pytest.mark.parametrize("how", ["removed", "replaced"])
def test_replacing_or_removing_an_open_store_is_reported_to_its_writer(old: Path, how: str) -> None:
    with RunStore.open(old, writing=True) as store:
        other = old.read_bytes()
        old.unlink()
        if how == "replaced":
            old.write_bytes(other)
        with pytest.raises(InvalidArgument, match="was replaced or removed while this command used it"):
            store.set_setting("seed", 9)
    assert how == "removed" or content(old)[0] == 7


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE TRIGGER evil AFTER INSERT ON generation BEGIN DELETE FROM source; END",
        "CREATE VIEW evil AS SELECT 1",
        "CREATE VIRTUAL TABLE evil USING fts5(a)",
    ],
)
def test_store_with_views_or_triggers_is_refused(old: Path, statement: str) -> None:
    with closing(sqlite3.connect(old)) as file:
        file.execute(statement)
    for writing in (False, True):
        with pytest.raises(InvalidArgument, match="is not a run store: it has a view or trigger `evil"):
            RunStore.open(old, writing=writing)


def test_damaged_store_is_refused_for_writing(old: Path) -> None:
    with closing(sqlite3.connect(old)) as file:
        size, page = file.execute("PRAGMA page_size").fetchone()[0], 0
        (page,) = file.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'generation'").fetchone()
    data = bytearray(old.read_bytes())
    data[(page - 1) * size : page * size] = b"x" * size
    old.write_bytes(data)
    RunStore.open(old).close()
    with pytest.raises(InvalidArgument, match="is damaged"):
        RunStore.open(old, writing=True)


@pytest.mark.parametrize(
    "change",
    ["trace = '[[\"p.rule\", []]]'", "measures = '{\"complexity\": 0.5}'", "model = '{}'", "child = 3"],
)
def test_an_individual_that_was_changed_is_refused(old: Path, change: str) -> None:
    with closing(sqlite3.connect(old)) as file:
        file.execute(f"UPDATE individual SET {change}")
        file.commit()
    with (
        RunStore.open(old) as store,
        pytest.raises(InvalidArgument, match="individual 0: its row does not match"),
    ):
        store.individual(0)


def test_stores_without_hashes_can_be_read_and_continued(old: Path) -> None:
    with closing(sqlite3.connect(old)) as file:
        file.execute("DROP TABLE content")
    with RunStore.open(old, writing=True) as store:
        store.write_generation(Generation(1, (1,), 0.0, 1), [individual(1, 1, 0)])
        store.write_models({1: "{}"})
    with RunStore.open(old) as store:
        assert [one.id for one in store.lineage(1)] == [0, 1]


def test_a_file_that_is_no_database_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.sqlite"
    path.write_text("a diary\n" * 500)
    with pytest.raises(InvalidArgument, match="is not a run store"):
        RunStore.create(path, {}, {}, overwrite=True)
    assert path.read_text() == "a diary\n" * 500
