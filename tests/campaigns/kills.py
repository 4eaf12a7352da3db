"""Processes killed at random moments: what was there stays, and going on leads to the same result."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from random import Random

from tests.campaigns.commands import good, run

_GENERATE = ("generate", "burning_forest", "--generations", 40, "--name", "m", "--directory", "runs")
_TRAIN = ("train", "m", "--steps", "200", "--seeds", "2", "--curricula", "full,direct")

_COUNTING = """
import os, signal, sqlite3, sys
left = int(sys.argv.pop(1))
def step():
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
class Connection(sqlite3.Connection):
    def execute(self, *arguments):
        step()
        return super().execute(*arguments)
    def executemany(self, *arguments):
        step()
        return super().executemany(*arguments)
connect = sqlite3.connect
sqlite3.connect = lambda *arguments, **named: connect(*arguments, factory=Connection, **named)
for name in ("fsync", "replace", "link"):
    def counted(*arguments, _function=getattr(os, name), **named):
        step()
        return _function(*arguments, **named)
    setattr(os, name, counted)
from envgraph.cli import main
sys.exit(main())
"""
"""Kills itself before the n-th write of the store or of a file."""


@cache
def _expected() -> dict[str, str]:
    """What comes of it without a kill."""
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        good(run(directory, *_GENERATE))
        good(run(directory, *_TRAIN))
        good(run(directory, "export", "m", "-o", "family.json"))
        return {"family.json": (directory / "family.json").read_text(), **_trained(directory)}


def _trained(directory: Path) -> dict[str, str]:
    base = directory / "runs" / "m" / "training"
    return {str(path.relative_to(directory)): path.read_text() for path in sorted(base.rglob("*.csv"))}


def prepare() -> None:
    """Run everything once without a kill."""
    _expected()


def campaign(random: Random) -> str:
    """Kill one command, at a moment or at a write, go on, and compare everything."""
    expected = _expected()
    kind = random.choice(["generate", "train", "export"])
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        if kind == "generate":
            if _killed(random, directory, *_GENERATE):
                store = directory / "runs" / "m" / "run.sqlite"
                good(
                    run(
                        directory,
                        *_GENERATE[:2],
                        *_GENERATE[4:],
                        *(["--resume"] if store.exists() else _GENERATE[2:4]),
                    )
                )
            good(run(directory, "export", "m", "-o", "family.json"))
        else:
            good(run(directory, *_GENERATE))
            (directory / "family.json").write_text("old")
        if kind == "train":
            if _killed(random, directory, *_TRAIN):
                begun = (directory / "runs" / "m" / "training" / "unfinished.jsonl").exists()
                good(run(directory, *(("train", "m", "--resume") if begun else (*_TRAIN, "--force"))))
            assert _trained(directory) == {
                key: text for key, text in expected.items() if key != "family.json"
            }
        if kind == "export":
            _killed(random, directory, "export", "m", "-o", "family.json")
            assert (directory / "family.json").read_text() in ("old", expected["family.json"])
            good(run(directory, "export", "m", "-o", "family.json"))
        if kind != "train":
            assert (directory / "family.json").read_text() == expected["family.json"]
        drafts = [str(path) for path in directory.rglob("*") if ".draft-" in path.name]
        assert not drafts, drafts
    return kind


def _killed(random: Random, directory: Path, *arguments: object) -> bool:
    """Start a command and kill it; whether it was still at it."""
    if random.random() < 0.5:
        number = random.choice([1, 2, 3, 5, random.randint(1, 60), random.randint(1, 600)])
        return run(directory, number, *arguments, python=("-c", _COUNTING)).returncode < 0
    process = subprocess.Popen(
        [sys.executable, "-m", "envgraph", *map(str, arguments)],
        cwd=directory, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    time.sleep(random.random() * 4)
    process.kill()
    return process.wait() < 0
