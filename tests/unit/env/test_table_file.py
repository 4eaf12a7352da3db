"""Enumerated environments in files: all of it comes back, and nothing that was damaged."""

from __future__ import annotations

import io
import random
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from envgraph.env import ExploredEnvironment, explore, read_explored, write_explored
from envgraph.errors import LIMITS, InvalidArgument
from tests.unit.env import forest
from tests.unit.env.coins import loaded

GRAPH = """
action turn = 0.5: turn()
action grab(coin : Coin) = grab(hand, coin, _) reward 1
on reset apply turn()
on neg find up(_) terminate failure
observe coin.side for coin : Coin
draw graph Coin label name with hand at hand.holds
"""

AGENTS = """
agent player : Hand { action wait = nothing() reward 0.5 observe player.moves in 0..2 }
on find any(_) terminate success
"""

KINDS = {
    "grid": lambda: explore(forest.engine(forest.published_maps()[5]), forest.behaviour(), pictures=True),
    "graph": lambda: explore(*loaded(GRAPH), pictures=True),
    "agents": lambda: explore(*loaded(AGENTS, "table : Table")),
}


def written(explored: ExploredEnvironment) -> bytes:
    file = io.BytesIO()
    write_explored(explored, file)
    return file.getvalue()


def read(data: bytes, directory: Path) -> ExploredEnvironment:
    (directory / "table.npz").write_bytes(data)
    return read_explored(directory / "table.npz")


def same(one: ExploredEnvironment, other: ExploredEnvironment) -> bool:
    for field in fields(one.tabular):
        mine, theirs = getattr(one.tabular, field.name), getattr(other.tabular, field.name)
        if isinstance(mine, np.ndarray):
            if mine.dtype != theirs.dtype or not np.array_equal(mine, theirs):
                return False
        elif mine != theirs:
            return False
    return one.pictures == other.pictures


@pytest.mark.parametrize("kind", KINDS)
def test_table_file_restores_the_explored_environment(kind: str, tmp_path: Path) -> None:
    explored = KINDS[kind]()
    assert same(read(written(explored), tmp_path), explored)
    assert bool(explored.pictures) == (kind != "agents") != bool(explored.tabular.agent_names)


def test_equal_environments_give_equal_files() -> None:
    assert written(KINDS["graph"]()) == written(KINDS["graph"]())


def test_a_damaged_file_is_refused_or_reads_as_before(tmp_path: Path) -> None:
    explored, rng = KINDS["graph"](), random.Random(1)
    data = written(explored)
    refused = 0
    for _ in range(300):
        place = rng.randrange(len(data))
        spoilt = data[:place] + bytes([data[place] ^ (1 << rng.randrange(8))]) + data[place + 1 :]
        spoilt = spoilt[: rng.randrange(len(data))] if rng.random() < 0.2 else spoilt
        try:
            assert same(read(spoilt, tmp_path), explored)
        except InvalidArgument:
            refused += 1
    assert refused > 150


def test_table_file_with_pickled_objects_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "table.npz", facts=np.array([print], dtype=object))
    with pytest.raises(InvalidArgument, match="is not a readable table of states"):
        read_explored(tmp_path / "table.npz")


def test_a_file_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, "table bytes", 10_000)
    np.savez_compressed(tmp_path / "bomb.npz", reward=np.zeros(10_000))
    with pytest.raises(InvalidArgument, match="its arrays have more than 10,000 bytes"):
        read_explored(tmp_path / "bomb.npz")


def test_missing_table_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="No such file"):
        read_explored(tmp_path / "table.npz")
