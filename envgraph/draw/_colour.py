"""Parse, mix and compare colours, and choose text colours that are readable on a background."""

from __future__ import annotations

Colour = tuple[float, float, float]
"""Red, green and blue, 0 to 255."""

INK: Colour = (33.0, 37.0, 41.0)
PAPER: Colour = (255.0, 255.0, 255.0)
_BLACK: Colour = (0.0, 0.0, 0.0)

LEAST_CONTRAST = 4.5
"""Minimum contrast of text and background: WCAG 2.2, success criterion 1.4.3."""


def parse_colour(text: str) -> Colour:
    """Parse a colour "#rrggbb".

    >>> parse_colour("#0080ff")
    (0.0, 128.0, 255.0)
    """
    return float(int(text[1:3], 16)), float(int(text[3:5], 16)), float(int(text[5:7], 16))


def format_colour(colour: Colour) -> str:
    """Format a colour as "#rrggbb".

    >>> format_colour((0.0, 128.0, 255.0))
    '#0080ff'
    """
    return "#" + "".join(f"{round(part):02x}" for part in colour)


def blend(first: Colour, second: Colour, share: float) -> Colour:
    """Return a mixture of two colours with the given share (0 to 1) of the second one."""
    red, green, blue = ((1.0 - share) * a + share * b for a, b in zip(first, second, strict=True))
    return red, green, blue


def contrast(first: Colour, second: Colour) -> float:
    """Return the contrast ratio of two colours, from 1 to 21 (WCAG 2.2, "contrast ratio").

    >>> round(contrast(PAPER, (0.0, 0.0, 0.0)), 3)
    21.0
    """
    low, high = sorted((_luminance(first), _luminance(second)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: Colour) -> float:
    parts = (part / 255.0 for part in colour)
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def ink_on(background: Colour, strength: float = 1.0) -> Colour:
    """Return a text colour that is readable on the background, with a contrast of at least 4.5.

    Args:
        background: the colour behind the text.
        strength: 1 for pure ink (dark, white or black); below 1, this share of ink is mixed with the background. The
            share is raised until the text is readable.
    """
    ink = max((INK, PAPER), key=lambda colour: contrast(background, colour))
    if contrast(background, ink) < LEAST_CONTRAST:  # only black is readable on medium colours
        ink = _BLACK
    while strength < 1.0:
        faint = blend(background, ink, strength)
        if contrast(background, parse_colour(format_colour(faint))) >= LEAST_CONTRAST:
            return faint
        strength += 0.05
    return ink
