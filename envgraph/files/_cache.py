"""Where what can be computed again is kept from one process to the next."""

from __future__ import annotations

import os
from pathlib import Path

CACHE_VARIABLE = "ENVGRAPH_CACHE"
"""Environment variable: another directory than the one in the user's home, or "off" to keep nothing."""


def cache_directory() -> Path | None:
    """`$ENVGRAPH_CACHE`, else `envgraph` in the user's cache (`$XDG_CACHE_HOME`); None for "off". It need not exist."""
    named = os.environ.get(CACHE_VARIABLE, "")
    if named:
        return None if named == "off" else Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "envgraph"
