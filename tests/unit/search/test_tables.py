"""Tables of states are kept: who enumerates, and when."""

from __future__ import annotations

import logging
import os
import shutil
import sqlite3
import threading
import time
from contextlib import closing
from pathlib import Path

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

import envgraph.env
from envgraph.cli import main
from envgraph.env import ExploredEnvironment, TooManyStates
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.lang import bundled_domain
from envgraph.search import (
    Components,
    Domain,
    Family,
    check_domain,
    generate,
    make,
    make_environment,
    make_vec,
    make_vector_environment,
    open_family,
    write_family,
)
from envgraph.search.families import _lazy_family

ID = "envgraph/BurningForest-v0"


@pytest.fixture
def visited(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """An entry for each enumeration: whether it made pictures."""
    found: list[bool] = []

    def explore(*arguments: object, pictures: bool, **options: object) -> ExploredEnvironment:
        found.append(pictures)
        return envgraph.env.explore(*arguments, pictures=pictures, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("envgraph.env.compiled.explore_fast", explore)
    return found


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, str]:
    """A run of two members, and its family file."""
    path = tmp_path_factory.mktemp("made") / "run.sqlite"
    family = generate("burning_forest/paper.toml", path, generations=1, population=2)
    return path.read_bytes(), write_family(family)


@pytest.fixture
def run(made: tuple[bytes, str], tmp_path: Path, cache: Path) -> Path:
    path = tmp_path / "runs" / "forest" / "run.sqlite"
    path.parent.mkdir(parents=True)
    path.write_bytes(made[0])
    return path


@pytest.fixture
def exported(made: tuple[bytes, str], tmp_path: Path) -> Path:
    path = tmp_path / "family.json"
    path.write_text(made[1], encoding="utf-8")
    return path


def cached_tables(place: Path) -> list[Path]:
    return sorted(place.glob("*.npz")) if place.exists() else []


def test_tables_of_members_are_cached_beside_the_run(run: Path, cache: Path, visited: list[bool]) -> None:
    for _ in range(2):
        family = open_family(run)
        sizes = [family.explored(member).tabular.n_states for member in family.members]
    assert visited == [False] * 2
    assert len(cached_tables(run.parent / "tables")) == 2 and not cached_tables(cache)
    assert sizes == [table.n_states for table in map(fresh, family.members, [family] * 2)]


def fresh(member: object, family: Family) -> envgraph.env.Tabular:
    engine = family.domain.engine(family.model(member))  # type: ignore[arg-type]
    return envgraph.env.explore(engine, family.behaviour, family.keys).tabular


def test_training_and_environments_use_the_cached_tables(
    run: Path, visited: list[bool], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    family = str(run)
    monkeypatch.setattr("sys.argv", ["envgraph", "train", "forest", "--steps", "20", "--seeds", "1"])
    assert main() == 0
    assert visited == [False] * 2
    make_environment(family=family, variant=1)
    make_vector_environment(4, family=family, variant=[1, 2])
    many = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="async", family=family, variant=2)
    many.reset(seed=0)
    many.close()
    assert visited == [False] * 2


def test_tables_of_family_files_and_domains_are_cached_in_the_user_cache(
    exported: Path, cache: Path, visited: list[bool]
) -> None:
    for _ in range(2):
        make_environment(family=exported, variant=1)
        make_environment("burning_forest")
    assert visited == [False] * 2
    assert len(cached_tables(cache)) == 2


def test_family_texts_are_read_only_for_the_first_environment(
    run: Path, exported: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = [make(stored, 1).spec.max_episode_steps for stored in (run, exported)]  # type: ignore[union-attr]
    monkeypatch.setattr("envgraph.search.families._lazy_family.open_family", None)  # what would read them
    for stored in run, exported:
        assert make(stored, "E1").spec.max_episode_steps == limits.pop(0) == 200  # type: ignore[union-attr]
        make_vec(stored, 2, variant=[1, 1]).close()
        with pytest.raises(InvalidArgument, match="no environment `E9`"):
            make(stored, "E9")


@pytest.mark.parametrize("changed", ["source SET text = text", "individual SET model = model"])
def test_changed_run_invalidates_its_cached_record(run: Path, monkeypatch: pytest.MonkeyPatch, changed: str) -> None:
    make(run)
    with closing(sqlite3.connect(run)) as store:
        store.execute(f"UPDATE {changed} || ' '")
        store.execute("DROP TABLE content")  # as in a store of an older version
        store.commit()
    monkeypatch.setattr("envgraph.search.families._lazy_family.open_family", None)
    with pytest.raises(TypeError):
        make(run)


@pytest.mark.parametrize("damage", ["", "[]", "{}", "[" * 100_000, '{"tables": {"E1": 1}}'])
def test_a_damaged_record_is_made_anew(run: Path, damage: str) -> None:
    make(run)
    (record,) = (run.parent / "tables").glob("*.record")
    good = record.read_text(encoding="utf-8")
    record.write_text(damage, encoding="utf-8")
    _lazy_family._shared_families.clear()  # as in another process
    make(run)
    assert record.read_text(encoding="utf-8") == good


def test_pictures_are_computed_only_for_environments_that_render(
    exported: Path, cache: Path, visited: list[bool]
) -> None:
    env = gymnasium.make(ID, family=exported)
    check_env(env.unwrapped)  # makes three more, of which two can be drawn
    make_environment(family=exported)
    assert visited == [False, True]
    assert len(cached_tables(cache)) == 1


def test_edited_domain_files_invalidate_cached_tables(cache: Path, visited: list[bool], tmp_path: Path) -> None:
    domain = tmp_path / "domain"
    shutil.copytree(bundled_domain("burning_forest"), domain)
    make_environment(str(domain))
    edits = [
        ("burning_forest.environment", "reward 10.0", "reward 11.0"),
        ("burning_forest.rules", "rule ", "/** Edited. */ rule "),
        ("target_8x8.model", "model ", "// Edited.\nmodel "),
    ]
    for name, old, new in edits:
        text = (domain / name).read_text(encoding="utf-8")
        assert old in text
        (domain / name).write_text(text.replace(old, new, 1), encoding="utf-8")
        assert float(make_environment(str(domain)).tabular.reward.max()) == 11.0  # type: ignore[union-attr]
    assert len(visited) == len(cached_tables(cache)) == 4
    text = (domain / "family.toml").read_text(encoding="utf-8")
    (domain / "family.toml").write_text(f"# How to search changes no state.\n{text}", encoding="utf-8")
    make_environment(str(domain))
    assert len(visited) == 4


def test_check_of_edited_rules_uses_no_cached_table(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    domain = tmp_path / "domain"
    shutil.copytree(bundled_domain("keydoor"), domain)
    rules, taken = domain / "keydoor.rules", "move key to hero.inventory;"
    text = rules.read_text(encoding="utf-8")
    assert taken in text
    monkeypatch.setattr("sys.argv", ["envgraph", "check", str(domain)])
    assert main() == 0
    rules.write_text(text.replace(taken, "set hero.at = here;"), encoding="utf-8")
    assert main() == 1
    assert "violates `reachable success`" in capsys.readouterr().err
    rules.write_text(text, encoding="utf-8")
    assert main() == 0
    assert not cached_tables(cache)  # a search of states keeps nothing


def test_a_damaged_table_is_made_anew(exported: Path, cache: Path, visited: list[bool]) -> None:
    make_environment(family=exported)
    (file,) = cached_tables(cache)
    good = file.read_bytes()
    file.write_bytes(good[:-200])
    make_environment(family=exported)
    assert visited == [False] * 2
    assert file.read_bytes() == good


def test_cached_table_owned_by_another_user_is_not_read(
    exported: Path, cache: Path, visited: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    make_environment(family=exported)
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    make_environment(family=exported)
    assert visited == [False] * 2


def test_too_many_states_are_cached_as_a_refusal(
    exported: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, visited: list[bool]
) -> None:
    family = open_family(exported)
    behaviour = family.behaviour
    words: list[tuple[object, ...]] = []

    def explore(*arguments: object, **options: object) -> ExploredEnvironment:
        visited.append(False)
        raise TooManyStates(behaviour, 7)

    monkeypatch.setattr("envgraph.env.compiled.explore_fast", explore)
    for _ in range(2):
        with pytest.raises(TooManyStates, match="more than 7 states") as refused:
            family.explored(family.members[0])
        words.append((refused.value.message, refused.value.hint, refused.value.span))
    assert len(visited) == 1 and words[0] == words[1]
    [file] = cache.glob("*.refusal")
    file.write_text("{}", encoding="utf-8")
    with pytest.raises(TooManyStates):
        family.explored(family.members[0])
    assert len(visited) == 2


def test_tables_of_behaviours_with_python_functions_are_not_cached(
    cache: Path, visited: list[bool], tmp_path: Path
) -> None:
    domain = tmp_path / "domain"
    shutil.copytree(bundled_domain("burning_forest"), domain)
    query = domain / "burning_forest.query"
    text = query.read_text(encoding="utf-8")
    package, rest = text[: (end := text.index("pattern "))], text[end:]
    query.write_text(f"{package}function fun(n : int) : int\n{rest}", encoding="utf-8")
    mine = Components().with_("function", "fun", lambda n: n + 1)
    for _ in range(2):
        family = generate(
            str(domain / "paper.toml"), tmp_path / f"{len(visited)}.sqlite", generations=0, components=mine
        )
        family.explored(family.members[0])
    assert visited == [False] * 2
    assert not cached_tables(cache) and not cached_tables(tmp_path / "tables")


def test_table_cache_can_be_switched_off(run: Path, visited: list[bool], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ENVGRAPH_CACHE", "off")
    make_environment(family=run)
    make_environment(family=run)
    assert visited == [False] * 2
    assert not cached_tables(run.parent / "tables")


def test_unwritable_cache_falls_back_to_the_user_cache_and_then_warns(
    run: Path, cache: Path, visited: list[bool], caplog: pytest.LogCaptureFixture
) -> None:
    (run.parent / "tables").touch()  # as good as a directory that may not be written, whoever runs the test
    with caplog.at_level(logging.WARNING, "envgraph"):
        make_environment(family=run)
        make_environment(family=run)
        assert len(visited) == len(cached_tables(cache)) == 1 and not caplog.messages
        shutil.rmtree(cache)
        cache.touch()
        make_environment(family=run)
    (message,) = caplog.messages
    assert "could not be cached" in message and "ENVGRAPH_CACHE" in message


def test_pipes_in_the_cache_are_neither_read_nor_written(exported: Path, cache: Path, visited: list[bool]) -> None:
    make_environment(family=exported)
    names = [path.name for path in cache.iterdir() if path.suffix in (".npz", ".record")]
    assert len(names) >= 2
    for name in names:
        (cache / name).unlink()
        os.mkfifo(cache / name)
    make_environment(family=exported)
    assert len(visited) == 2
    assert all((cache / name).is_fifo() for name in names)


def test_least_recently_used_tables_are_removed_from_the_full_cache(
    exported: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.mkdir()
    for name, age in (("old.npz", 600), ("used.npz", 0), ("notes.txt", 9000)):
        (cache / name).write_bytes(b"x" * 1_000_000)
        os.utime(cache / name, (time.time() - age,) * 2)
    monkeypatch.setitem(LIMITS, "cached bytes", 1_500_000)
    make_environment(family=exported, variant=1)
    assert [path.name for path in cached_tables(cache)][1:] == ["used.npz"]
    assert (cache / "notes.txt").exists()


def test_threads_can_read_and_write_cached_tables_concurrently(exported: Path, cache: Path) -> None:
    found: list[int] = []
    families = [open_family(exported) for _ in range(4)]

    def work(family: Family) -> None:
        found.append(family.explored(family.member(1)).tabular.n_states)

    threads = [threading.Thread(target=work, args=(family,)) for family in families]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4 and len(set(found)) == 1
    assert [path.suffix for path in cached_tables(cache)] == [".npz"]


def test_terminal_shows_the_progress_of_state_enumeration(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    make_environment("burning_forest")
    assert "\rstates of BurningForest: 48, 100 outcomes\x1b[K\r" in capsys.readouterr().err


def test_progress_names_the_member_whose_states_are_enumerated(
    exported: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    make_vec(exported, 4, variant=[2, 1]).close()
    told = capsys.readouterr().err
    assert "\renvironments: 0 of 2, E2; states of BurningForest: " in told
    assert "\renvironments: 1 of 2, E1" in told


def test_check_measure_and_make_share_the_states_of_the_initial_model(
    cache: Path, visited: list[bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envgraph.env.compiled.visiting._enumeration.explore_fast", None)  # the visit
    for _ in range(2):
        domain = Domain.load("keydoor/diverse.toml")
        assert check_domain(domain.spec, domain.workspace) == []
    assert domain.problem(domain.engine()).compute_measures()["plan"] == 9.0
    make_environment("keydoor")
    assert visited == [False] and [path.suffix for path in cached_tables(cache)] == [".npz"]
