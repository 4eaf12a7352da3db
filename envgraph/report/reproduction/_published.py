"""What the paper says: the numbers of its tables, and where its data is."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from envgraph.errors import Source

BUDGETS: Final = (10_000, 50_000, 100_000)
"""Training steps an environment: the paper's shorter, normal and longer budget."""

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
"""Table 3: success rate and mean return on E6, after 50,000 steps an environment, by what an agent was trained on."""

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
"""Table 5: success rate and mean return on E6 by budget: 30 random families, as drawn and ordered by complexity."""

TIMES: Final = {
    6: {8: 47, 9: 49, 10: 49, 11: 49, 12: 50},
    10: {8: 208, 9: 211, 10: 212, 11: 215, 12: 225},
    20: {8: 1594, 9: 1718, 10: 1617, 11: 1642, 12: 1659},
}
"""Table 4: seconds that 1,000 generations take, by size of the family and of the map."""


def published_files() -> tuple[Source, tuple[Source, ...]]:
    """The published family, and the 30 random ones in the order of their numbers."""
    folder = Path(__file__).with_name("data")
    random = sorted((folder / "random-families").glob("*.json"))
    return _source(folder / "environment-config.json"), tuple(map(_source, random))


def _source(path: Path) -> Source:
    return Source(path.name, path.read_text("utf-8"))
