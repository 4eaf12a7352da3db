"""What the parts of the benchmark of growth yield."""

from __future__ import annotations

from collections.abc import Callable

Prepare = Callable[[int], Callable[[], object]]
"""Prepares an input of a size, and returns what is timed."""

Case = tuple[str, int, Prepare]
"""What is measured, and the smallest of its three sizes."""
