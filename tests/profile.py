"""How many examples hypothesis tries: few and always the same by day, 100 times as many, new ones, at night."""

from __future__ import annotations

import pytest
from hypothesis import settings

NIGHTLY = settings().max_examples > 1_000


def examples(wanted: int) -> int:
    """The number for the profile that is loaded: half by day, which is what there is time for."""
    return 50 * wanted if NIGHTLY else (wanted + 1) // 2


AT_NIGHT = pytest.mark.skipif(not NIGHTLY, reason="takes long: `make nightly`")
"""Of a test that has a shorter version for the day."""
