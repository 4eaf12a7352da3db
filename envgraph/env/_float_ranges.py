"""The sizes of components that observe floats, and the rank of a float among all float32 values."""

# The text of this module is part of exported packages.

from __future__ import annotations

from struct import pack, unpack
from typing import Any, Final, Self

LARGEST_FLOAT32: Final = (2.0 - 2.0**-23) * 2.0**127


class FloatRange(int):
    """The size of a component that observes a float: the number of float32 values in a range.

    The component is the rank of the float, cut to the range, among these values. Engines thus observe only ints.

    Attributes:
        limits: the range, and True if the component has one more value, the last, which means "not visible".
    """

    limits: tuple[float, float, bool]

    def __new__(cls, *limits: Any) -> Self:
        """Return the size of a component for `limits`."""
        low, high, may_hide = limits
        found = super().__new__(cls, float_rank(high) - float_rank(low) + 1 + may_hide)
        found.limits = low, high, may_hide
        return found

    def __getnewargs__(self) -> tuple[Any, ...]:
        """Return the arguments of the constructor, for copies."""
        return self.limits


def float_rank(value: float) -> int:
    """Return the rank of a number, rounded to float32, among all float32 values; that of 0.0 is 0."""
    bits: int = unpack("<i", pack("<f", value))[0]
    return bits if bits >= 0 else -(2**31) - bits
