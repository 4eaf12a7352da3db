"""Draw rectangles, discs, lines and letters with smooth edges on an array of pixels."""

from __future__ import annotations

from math import ceil, floor, hypot

import numpy as np
from numpy.typing import NDArray

from envgraph.draw import PAPER, Colour
from envgraph.env.scene._font import text_pixels


class Canvas:
    """An array of pixels to draw on. Coordinates are in pixels from the upper left corner, x first."""

    def __init__(self, width: int, height: int, colour: Colour = PAPER) -> None:
        self._pixels = np.empty((height, width, 3), dtype=np.float64)
        self._pixels[:] = colour

    def to_array(self) -> NDArray[np.uint8]:
        """Return the picture as uint8 [height, width, 3]."""
        return np.rint(self._pixels).astype(np.uint8)

    def fill_rectangle(self, left: int, top: int, width: int, height: int, colour: Colour) -> None:
        """Fill a rectangle."""
        self._pixels[max(top, 0) : top + height, max(left, 0) : left + width] = colour

    def fill_disc(self, x: float, y: float, radius: float, colour: Colour) -> None:
        """Fill a disc."""
        xs, ys = self._pixel_centres(x - radius, y - radius, x + radius, y + radius)
        distance = np.hypot(xs - x, ys - y)
        self._blend_pixels(xs, ys, np.clip(radius - distance + 0.5, 0.0, 1.0), colour)

    def draw_line(self, start: tuple[float, float], end: tuple[float, float], width: float, colour: Colour) -> None:
        """Draw a straight line with round ends."""
        (ax, ay), (bx, by) = start, end
        half = width / 2
        xs, ys = self._pixel_centres(min(ax, bx) - half, min(ay, by) - half, max(ax, bx) + half, max(ay, by) + half)
        length = max(hypot(bx - ax, by - ay), 1e-9)
        ux, uy = (bx - ax) / length, (by - ay) / length
        along = np.clip((xs - ax) * ux + (ys - ay) * uy, 0.0, length)
        distance = np.hypot(xs - ax - along * ux, ys - ay - along * uy)
        self._blend_pixels(xs, ys, np.clip(half - distance + 0.5, 0.0, 1.0), colour)

    def draw_text(self, x: float, y: float, text: str, scale: int, colour: Colour) -> None:
        """Draw one line of text centred at (x, y), with `scale` pixels for each pixel of the font."""
        shape = text_pixels(text, scale)
        height, width = shape.shape
        top, left = floor(y - height / 2 + 0.5), floor(x - width / 2 + 0.5)
        bottom, right = self._pixels.shape[:2]
        visible = shape[max(0, -top) : max(0, bottom - top), max(0, -left) : max(0, right - left)]
        area = self._pixels[max(0, top) : max(0, top + height), max(0, left) : max(0, left + width)]
        area[visible] = np.array(colour)

    def draw_label(self, x: float, y: float, text: str, scale: int, colour: Colour) -> None:
        """Draw one line of text centred at (x, y), on a rectangle in the colour of the paper."""
        height, width = text_pixels(text, scale).shape
        self.fill_rectangle(
            round(x - width / 2) - scale,
            round(y - height / 2) - scale,
            width + 2 * scale,
            height + 2 * scale,
            PAPER,
        )
        self.draw_text(x, y, text, scale, colour)

    def _pixel_centres(
        self, left: float, top: float, right: float, bottom: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the centres of the pixels in a box and one pixel around it: a row of x and a column of y values."""
        height, width = self._pixels.shape[:2]
        xs = np.arange(max(0, floor(left) - 1), min(width, ceil(right) + 1), dtype=np.float64) + 0.5
        ys = np.arange(max(0, floor(top) - 1), min(height, ceil(bottom) + 1), dtype=np.float64) + 0.5
        return xs[None, :], ys[:, None]

    def _blend_pixels(
        self, xs: NDArray[np.float64], ys: NDArray[np.float64], cover: NDArray[np.float64], colour: Colour
    ) -> None:
        if cover.size == 0:
            return
        top, left = int(ys[0, 0]), int(xs[0, 0])
        area = self._pixels[top : top + cover.shape[0], left : left + cover.shape[1]]
        area += cover[:, :, None] * (np.array(colour) - area)
