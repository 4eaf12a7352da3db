"""The published numbers of the paper's tables, and its published data files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from envgraph.errors import Source

BUDGETS: Final = (10_000, 50_000, 100_000)
"""Training steps for each environment: the paper's shorter, normal and longer budget."""

SHORT, NORMAL = BUDGETS[:2]

AGENTS: Final = {
    "E1": (0.0, -1.0),
    "E2": (0.0, -1.0),
    "E3": (0.0, -1.0),
    "E4": (0.0, -1.0),
    "E5": (0.0, -1.0),
    "E6": (0.0, 0.0),
    "E1-E6": (1.0, 10.2),
    "E2-E6": (1.0, 10.2),
    "E3-E6": (1.0, 10.2),
    "E4-E6": (1.0, 10.2),
    "E5-E6": (0.0, 0.0),
}
"""Table 3: success rate and mean return on E6, by the training environments, after 50,000 steps on each."""

RANDOM: Final = {
    10_000: {
        "direct": (0.0, 0.0),
        "random": (0.10, 0.67),
        "ordered": (0.13, 0.60),
        "curriculum": (1.0, 10.2),
    },
    50_000: {
        "direct": (0.0, 0.0),
        "random": (0.47, 4.37),
        "ordered": (0.43, 3.91),
        "curriculum": (1.0, 10.2),
    },
    100_000: {
        "direct": (0.0, 0.0),
        "random": (0.63, 5.98),
        "ordered": (0.63, 6.30),
        "curriculum": (1.0, 10.2),
    },
}
"""Table 5: success rate and mean return on E6 by budget: 30 random families, as generated and ordered by complexity."""

TIMES: Final = {
    6: {8: 47, 9: 49, 10: 49, 11: 49, 12: 50},
    10: {8: 208, 9: 211, 10: 212, 11: 215, 12: 225},
    20: {8: 1594, 9: 1718, 10: 1617, 11: 1642, 12: 1659},
}
"""Table 4: seconds for 1,000 generations, by size of the family and of the map."""


def published_files() -> tuple[Source, tuple[Source, ...]]:
    """Return the published family, and the 30 random families in the order of their numbers."""
    folder = Path(__file__).with_name("data")
    random = sorted((folder / "random-families").glob("*.json"))
    return _source(folder / "environment-config.json"), tuple(map(_source, random))


def _source(path: Path) -> Source:
    return Source(path.name, path.read_text("utf-8"))
