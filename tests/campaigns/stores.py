"""Damaged, locked and newer stores: every command says what is wrong with the file, or does its work."""

from __future__ import annotations

import sqlite3
import tempfile
from contextlib import closing
from functools import cache
from pathlib import Path
from random import Random

from envgraph.search import generate
from tests.campaigns.commands import run

_COMMANDS: tuple[tuple[object, ...], ...] = (
    ("show", "m"),
    ("show", "m", "--format", "json"),
    ("export", "m", "-o", "family.json"),
    ("export", "m", "--format", "svg", "-o", "family.svg"),
    ("report", "m", "-o", "page.html"),
    ("generate", "burning_forest/paper.toml", "--name", "m", "--resume"),
    ("train", "m", "--steps", "50", "--seeds", "1", "--curricula", "full"),
)


@cache
def _store() -> bytes:
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory, "run.sqlite")
        generate("burning_forest/paper.toml", path, generations=5)
        with closing(sqlite3.connect(path)) as connection:
            connection.execute("PRAGMA journal_mode = DELETE")
        return path.read_bytes()


def prepare() -> None:
    """Make the store that is damaged."""
    _store()


def campaign(random: Random) -> str:
    """Damage a store, and use it."""
    kind = random.choice(["flip", "flip", "flip", "cut", "zeros", "rows", "rows", "newer", "locked", "empty"])
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        path = directory / "runs" / "m" / "run.sqlite"
        path.parent.mkdir(parents=True)
        path.write_bytes(_damaged(random, kind, _store()))
        command = random.choice(_COMMANDS)
        if kind in ("rows", "newer", "locked"):
            with closing(sqlite3.connect(path, isolation_level=None)) as connection:
                _change(random, kind, connection)
                done = run(directory, *command)
        else:
            done = run(directory, *command)
        assert done.returncode in (0, 1), f"{command} ends with {done.returncode}: {done.stderr[-500:]}"
        assert not (kind == "newer" and done.returncode == 0)
    return kind


def _damaged(random: Random, kind: str, data: bytes) -> bytes:
    if kind == "flip":
        changed = bytearray(data)
        for _ in range(random.choice([1, 1, 5, 50, 500])):
            changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
        return bytes(changed)
    if kind == "cut":
        return data[: random.randrange(len(data))]
    if kind == "zeros":
        at = random.randrange(len(data))
        return data[:at] + bytes(min(4096, len(data) - at)) + data[at + 4096 :]
    return b"" if kind == "empty" else data


def _change(random: Random, kind: str, connection: sqlite3.Connection) -> None:
    if kind == "locked":
        connection.execute("BEGIN EXCLUSIVE")
        return
    if kind == "newer":
        connection.execute("UPDATE setting SET value = '99' WHERE key = 'format'")
        return
    tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY 1")]
    for _ in range(random.choice([1, 1, 3])):
        table = random.choice(tables)
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
        if not columns:
            continue
        key = columns[0]  # not all tables have row ids
        rows = [row[0] for row in connection.execute(f"SELECT {key} FROM {table}")]
        if not rows:
            continue
        value = random.choice([None, -1, 10**18, 1.5, "nan", "", "null", "[]", "{}", '{"a": NaN}', "1e999", b"\xff\0"])
        row, column = random.choice(rows), random.choice(columns)
        try:
            if random.random() < 0.3:
                connection.execute(f"DELETE FROM {table} WHERE {key} = ?", (row,))
            else:
                connection.execute(f"UPDATE {table} SET {column} = ? WHERE {key} = ?", (value, row))
        except sqlite3.Error:
            continue
