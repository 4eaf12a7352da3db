"""Define the type of the cases that the parts of the benchmark `growth` yield."""

from __future__ import annotations

from collections.abc import Callable

Prepare = Callable[[int], Callable[[], object]]
"""Prepares an input of the given size, and returns the function to time."""

Case = tuple[str, int, Prepare]
"""The name of a case, the smallest of its three sizes, and its preparation."""
