"""Write pictures as an animated GIF. The format is GIF89a (CompuServe, 1990), with one palette for all pictures."""

from __future__ import annotations

from collections.abc import Sequence
from struct import pack
from typing import Final

import numpy as np
from numpy.typing import NDArray

from envgraph.draw import PAPER

_COLOURS: Final = 256
_END_OF_CODES: Final = 4096
"""The number of codes of at most 12 bits. The table of codes is then cleared."""


def animated_gif(pictures: Sequence[NDArray[np.uint8]], seconds: Sequence[float]) -> bytes:
    """Return the pictures as an animated GIF, which is repeated for ever.

    Colours are rounded if there are more than 256. Of each picture only the rectangle with changes is stored.

    Args:
        pictures: one or more pictures [height, width, 3]; smaller ones are in the upper left corner.
        seconds: how long each picture is shown.
    """
    height, width = (max(one.shape[axis] for one in pictures) for axis in (0, 1))
    canvas = np.empty((len(pictures), height, width, 3), np.uint8)
    canvas[:] = PAPER
    for place, one in enumerate(pictures):
        canvas[place, : one.shape[0], : one.shape[1]] = one
    palette, numbers = _indexed_colours(canvas)
    parts = [b"GIF89a", pack("<HHBBB", width, height, 0xF7, 0, 0), palette]
    parts.append(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")
    for place, picture in enumerate(numbers):
        changed = np.argwhere(picture != numbers[place - 1]) if place else np.array([[0, 0], [height - 1, width - 1]])
        (top, left), (bottom, right) = (changed.min(0), changed.max(0)) if len(changed) else ((0, 0), (0, 0))
        area = picture[top : bottom + 1, left : right + 1]
        parts.append(pack("<BBBBHBB", 0x21, 0xF9, 4, 4, round(100 * seconds[place]), 0, 0))
        parts.append(pack("<BHHHHB", 0x2C, left, top, area.shape[1], area.shape[0], 0))
        parts.append(_compressed(area.tobytes()))
    return b"".join((*parts, b"\x3b"))


def _indexed_colours(pixels: NDArray[np.uint8]) -> tuple[bytes, NDArray[np.uint8]]:
    """Return a palette of 256 colours, three bytes each, and the number of the colour of each pixel."""
    for bits in range(8):  # clear as many of the low bits as necessary
        rounded = pixels >> bits << bits
        codes = rounded.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], np.int32)
        colours, numbers = np.unique(codes, return_inverse=True)
        if len(colours) <= _COLOURS:
            break
    found = b"".join(int(colour).to_bytes(3, "big") for colour in colours)
    return found.ljust(3 * _COLOURS, b"\0"), numbers.reshape(codes.shape).astype(np.uint8)


def _compressed(data: bytes) -> bytes:
    """Return the numbers of colours in LZW compression, in blocks of at most 255 bytes. Welch 1984, as in GIF89a."""
    clear, end = _COLOURS, _COLOURS + 1
    table, following, bits = dict[int, int](), end + 1, 9  # the code of a known sequence and one more colour
    packed, filled, found = clear, bits, bytearray()
    code = data[0]
    for colour in data[1:]:
        known = table.get(code << 8 | colour)
        if known is not None:
            code = known
            continue
        packed |= code << filled
        filled += bits
        if following < _END_OF_CODES:
            table[code << 8 | colour] = following
            bits = max(bits, following.bit_length())
            following += 1
        else:
            packed |= clear << filled
            filled += bits
            table, following, bits = {}, end + 1, 9
        code = colour
        while filled >= 8:
            found.append(packed & 255)
            packed, filled = packed >> 8, filled - 8
    packed |= code << filled
    filled += bits
    bits = max(bits, min(following, _END_OF_CODES - 1).bit_length())
    packed |= end << filled
    found += packed.to_bytes((filled + bits + 7) // 8, "little")
    blocks = (found[start : start + 255] for start in range(0, len(found), 255))
    return b"".join((b"\x08", *(bytes([len(one)]) + one for one in blocks), b"\0"))
