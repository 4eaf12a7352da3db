"""The domains that only the benchmarks need: metamodels and rules in `benchmarks/data`."""

from __future__ import annotations

from pathlib import Path

from envgraph.lang import Workspace, load_workspace


def workspace(name: str) -> Workspace:
    """Everything in the files of one domain."""
    found = load_workspace([str(Path(__file__).parent / "data" / name)])
    found.raise_errors()
    return found
