"""Everything that can be wrong with patterns."""

from __future__ import annotations

from envgraph.errors import Diagnostic
from envgraph.pattern._analysis import Analysis


def check_patterns(analysis: Analysis) -> list[Diagnostic]:
    """All diagnostics of the new patterns of an analysis, in the order of their text."""
    assert analysis.entries is not None
    return []
