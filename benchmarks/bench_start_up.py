"""How long small commands take, most of which is starting: Python, the imports, the tables of the parsers.

    python -m benchmarks start_up

CPU seconds of processes of their own, the median of seven. The tables are in the user's cache by then.
"""

from __future__ import annotations

import subprocess
import sys
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median

from envgraph.lang import bundled_domain

ENVGRAPH = "from envgraph.cli import main; raise SystemExit(main())"


def main() -> None:
    """Print the figures."""
    domain = bundled_domain("burning_forest")
    query, model = domain / "burning_forest.query", domain / "running_4x4.model"
    for name, words in {
        "Python alone": ["pass"],
        "import envgraph": ["import envgraph"],
        "import envgraph.lang": ["import envgraph.lang"],
        "envgraph --help": [ENVGRAPH, "--help"],
        "envgraph check (a model)": [ENVGRAPH, "check", model],
        "envgraph check (rules)": [ENVGRAPH, "check", domain / "burning_forest.rules"],
        "envgraph match": [ENVGRAPH, "match", model, query, "neighbour"],
        "envgraph check (a family)": [ENVGRAPH, "check", domain / "family.toml"],
    }.items():
        print(f"{name:28}{_seconds([str(word) for word in words]):8.2f} s")


def _seconds(words: list[str]) -> float:
    """CPU seconds of a program in Python; once before to have everything compiled and kept."""
    command = [sys.executable, "-c", *words]
    times = []
    for _ in range(8):
        before = getrusage(RUSAGE_CHILDREN)
        subprocess.run(command, check=True, capture_output=True)
        after = getrusage(RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return median(times[1:])
