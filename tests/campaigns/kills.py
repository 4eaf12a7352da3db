"""Processes killed at random moments: what was there stays, and resuming leads to the same result.

Commands, the parents of worker processes, and worker processes.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from random import Random

from tests.campaigns.commands import SECONDS, good, run

_GENERATE = (
    "generate",
    "burning_forest/paper.toml",
    "--generations",
    40,
    "--name",
    "m",
    "--directory",
    "runs",
)
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
    def backup(self, *arguments):
        step()
        super().backup(*arguments)
        step()
connect = sqlite3.connect
sqlite3.connect = lambda *arguments, **named: connect(*arguments, factory=Connection, **named)
for name in ("fsync", "replace", "link", "rename", "rmdir"):
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
    kind = random.choice(["generate", "force", "train", "export", "parent", "worker"])
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
        elif kind == "force":
            _force(random, directory)
        else:
            good(run(directory, *_GENERATE))
            (directory / "family.json").write_text("old")
        if kind in ("train", "parent", "worker"):
            killed = _killed if kind == "train" else _killed_parent if kind == "parent" else _killed_worker
            if killed(random, directory, *_TRAIN):
                begun = (directory / "runs" / "m" / "training" / "unfinished.jsonl").exists()
                good(run(directory, *(("train", "m", "--resume") if begun else (*_TRAIN, "--force"))))
            assert _trained(directory) == {key: text for key, text in expected.items() if key != "family.json"}
        if kind == "export":
            _killed(random, directory, "export", "m", "-o", "family.json")
            assert (directory / "family.json").read_text() in ("old", expected["family.json"])
            good(run(directory, "export", "m", "-o", "family.json"))
        if kind in ("generate", "force", "export"):
            assert (directory / "family.json").read_text() == expected["family.json"]
        drafts = [str(path) for path in directory.rglob("*") if ".draft-" in path.name]
        assert not drafts, drafts
    return kind


def _force(random: Random, directory: Path) -> None:
    """Kill a command that replaces a run: the old run is there with its results, or the new one without."""
    old = (*_GENERATE[:2], "--generations", 3, *_GENERATE[4:])
    good(run(directory, *old))
    good(run(directory, *_TRAIN))
    good(run(directory, "export", "m", "-o", "family.json"))
    family, trained = (directory / "family.json").read_text(), _trained(directory)
    _killed(random, directory, *_GENERATE, "--force")
    good(run(directory, "export", "m", "-o", "family.json"))
    if (directory / "family.json").read_text() == family:
        assert _trained(directory) == trained
        good(run(directory, *_GENERATE, "--force"))
    else:
        good(run(directory, *_GENERATE[:2], *_GENERATE[4:], "--resume"))
    assert not [path for path in (directory / "runs" / "m").iterdir() if path.name != "run.sqlite"]
    good(run(directory, "export", "m", "-o", "family.json"))


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


def _killed_parent(random: Random, directory: Path, *arguments: object) -> bool:
    """Kill a command that has workers, and check that none is left; whether the command was still running."""
    process, messages = _killed_with_workers(random, directory, *arguments, kill=lambda parent, _: parent)
    assert process.returncode <= 0, messages[-1500:]
    return process.returncode < 0


def _killed_worker(random: Random, directory: Path, *arguments: object) -> bool:
    """Kill a worker of a command, and check what the command says; whether the command failed."""
    process, messages = _killed_with_workers(
        random, directory, *arguments, kill=lambda _, workers: random.choice(workers) if workers else None
    )
    assert process.returncode == 0 or "error: a worker process ended" in messages, messages[-1500:]
    assert process.returncode in (0, 1) and "Traceback" not in messages, messages[-1500:]
    return process.returncode > 0


def _killed_with_workers(
    random: Random, directory: Path, *arguments: object, kill: Callable[[int, list[int]], int | None]
) -> tuple[subprocess.Popen[str], str]:
    """Run a command with two workers and kill one of the processes at a random moment.

    The output is a pipe, which ends when the last process that holds it ends: workers that stay are a time-out.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "envgraph", *map(str, arguments), "--workers", "2"],
        cwd=directory, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    time.sleep(random.random() * 6)
    chosen = kill(process.pid, _workers(process.pid))
    if chosen is not None:
        with suppress(ProcessLookupError):
            os.kill(chosen, signal.SIGKILL)
    messages, _ = process.communicate(timeout=SECONDS)
    assert not [path.name for path in Path("/dev/shm").glob(f"*[-_]{process.pid}[-_]*")]
    return process, messages


def _workers(parent: int) -> list[int]:
    """The worker processes of a process; not loky's trackers of what is shared."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            status = (path / "stat").read_text().rpartition(")")[2].split()
            if int(status[1]) == parent and b"LokyProcess" in (path / "cmdline").read_bytes():
                found.append(int(path.name))
    return sorted(found)
