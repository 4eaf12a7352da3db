"""Two commands that write one run at the same time, while others read it and one may be killed."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from random import Random

from tests.campaigns.commands import good, run

_GENERATE = ("generate", "burning_forest/paper.toml", "--population", 3, "--name", "m")
_LENGTHS = (4, 12, 30)
_TRAIN = ("train", "m", "--steps", "100", "--seeds", "2", "--curricula", "full,direct")
_READING = (("show", "m"), ("runs",), ("export", "m", "-o", "other.json"), ("report", "m", "-o", "page.html"))


@cache
def _families() -> dict[int, str]:
    """The family of each length of a run, made by one command alone."""
    found = {}
    with tempfile.TemporaryDirectory() as name:
        for length in _LENGTHS:
            good(run(Path(name), *_GENERATE, "--generations", length, "--force"))
            good(run(Path(name), "export", "m", "-o", "family.json"))
            found[length] = _family(Path(name))
    return found


def _family(directory: Path) -> str:
    """What was exported, but for what was verified."""
    family = json.loads((directory / "family.json").read_text())
    for member in family["members"]:
        member.pop("certificates", None)
    return json.dumps(family)


def prepare() -> None:
    """Make every family once without a second writer."""
    _families()


def campaign(random: Random) -> str:
    """Start two writers and a reader at random moments; the run is that of one of the writers, whole."""
    families = _families()
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        lengths = [random.choice(_LENGTHS)]
        good(run(directory, *_GENERATE, "--generations", lengths[0]))
        trained = random.random() < 0.5
        if trained:
            good(run(directory, *_TRAIN))
        started = []
        for _ in range(2):
            if random.random() < 0.7:
                lengths.append(random.choice(_LENGTHS))
                command: tuple[object, ...] = (*_GENERATE, "--generations", lengths[-1], "--force")
            else:
                command = random.choice([(*_TRAIN, "--force"), ("verify", "m")])
            started.append(_start(directory, *command))
            time.sleep(random.random() * 0.5)
        killed = random.random() < 0.3
        if killed:
            time.sleep(random.random() * 1.5)
            started[0].kill()
        good(run(directory, *random.choice(_READING)))
        refused = 0
        for process in started:
            said = process.communicate(timeout=60)[1].decode(errors="replace")
            assert "Traceback" not in said, said[-1500:]
            assert process.returncode in (0, 1, -9), said[-1500:]
            if process.returncode == 1:
                assert "is writing runs/m" in said, said[-1500:]
                refused += 1
        good(run(directory, "export", "m", "-o", "family.json"))
        found = _family(directory)
        if found not in families.values():  # killed after its first generation
            assert killed, "the run is that of no writer"
            last = run(directory, "generate", "burning_forest/paper.toml", "--name", "m", "--resume")
            good(last)
            good(run(directory, "export", "m", "-o", "family.json"))
            found = _family(directory)
        assert found in [families[length] for length in lengths], "the run is that of no writer"
        left = {path.name for path in (directory / "runs" / "m").iterdir()}
        assert not [one for one in left if ".replaced-" in one], left
        assert killed or not [one for one in left if one.endswith(".lock")], left
        good(run(directory, *_GENERATE, "--generations", 4, "--force"))
        left = {path.name for path in (directory / "runs" / "m").iterdir()}
        assert left == {"run.sqlite"}, left
    return "killed" if killed else "refused" if refused else "one after the other"


def _start(directory: Path, *arguments: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "envgraph", *map(str, arguments)],
        cwd=directory, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
