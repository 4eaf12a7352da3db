"""How many examples hypothesis tries: few and always the same by day, 50 times as many and new ones at night."""

from __future__ import annotations

import pytest
from hypothesis import settings

NIGHTLY = settings().max_examples > 1_000


def examples(by_day: int) -> int:
    """The number for the profile that is loaded."""
    return 50 * by_day if NIGHTLY else by_day


AT_NIGHT = pytest.mark.skipif(not NIGHTLY, reason="takes long: `make nightly`")
"""Of a test that has a shorter version for the day."""
