"""Run small commands, whose time is mostly that of starting: imports and tables of the parsers.

    python -m benchmarks start_up

CPU seconds of processes of their own, medians. The tables are in the user's cache by then.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from tempfile import TemporaryDirectory
from typing import NamedTuple

from envgraph.lang import bundled_domain
from envgraph.search import generate

ENVGRAPH = "from envgraph.cli import main; raise SystemExit(main())"
MAKE = "import sys, envgraph; envgraph.make(sys.argv[1], 'E1')"


class Sizes(NamedTuple):
    """How much is run.

    Attributes:
        commands: how many of the commands, None for all.
        runs: of a command. The first compiles and fills caches, and counts only if there is no other.
    """

    commands: int | None
    runs: int


FULL = Sizes(None, 8)
QUICK = Sizes(5, 1)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    domain = bundled_domain("burning_forest")
    query, model = domain / "burning_forest.query", domain / "running_4x4.model"
    commands = {
        "Python alone": ["pass"],
        "import envgraph": ["import envgraph"],
        "import envgraph.lang": ["import envgraph.lang"],
        "envgraph --help": [ENVGRAPH, "--help"],
        "envgraph check (a model)": [ENVGRAPH, "check", model],
        "envgraph check (rules)": [ENVGRAPH, "check", domain / "burning_forest.rules"],
        "envgraph match": [ENVGRAPH, "match", model, query, "neighbour"],
        "envgraph check (a family)": [ENVGRAPH, "check", domain / "paper.toml"],
        "envgraph check burning_forest": [ENVGRAPH, "check", "burning_forest"],
        "make a stored member": [MAKE],
    }
    with TemporaryDirectory() as home:
        for name, words in list(commands.items())[: sizes.commands]:
            if words == [MAKE]:
                generate(str(domain / "paper.toml"), Path(home) / "run.sqlite", generations=0, population=2)
                words += [home]
            print(f"{name:32}{_seconds([str(word) for word in words], sizes.runs):8.2f} s")


def _seconds(words: list[str], runs: int) -> float:
    """Return the median CPU seconds of a program in Python."""
    command = [sys.executable, "-c", *words]
    times = []
    for _ in range(runs):
        before = getrusage(RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        after = getrusage(RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return median(times[1:] or times)
