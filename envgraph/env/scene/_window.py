"""Show pictures in a window of pygame (the extra `human`), for `render_mode="human"`."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray


def has_window() -> bool:
    """Return True if pygame is installed."""
    return find_spec("pygame") is not None


class Window:
    """A window that opens with the first picture.

    Args:
        title: the title of the window.
        fps: pictures per second, a rate that `show` keeps by waiting.
    """

    def __init__(self, title: str, fps: int) -> None:
        self._given = title, fps
        self._surface: Any = None
        self._clock: Any = None

    def show(self, pixels: NDArray[np.uint8]) -> None:
        """Show a picture [height, width, 3] in the window, which is opened or resized for it; wait to keep the rate."""
        import pygame

        title, fps = self._given
        height, width = pixels.shape[:2]
        if self._surface is None or self._surface.get_size() != (width, height):
            pygame.display.init()
            self._surface, self._clock = pygame.display.set_mode((width, height)), pygame.time.Clock()
            pygame.display.set_caption(title)
        self._surface.blit(pygame.surfarray.make_surface(pixels.swapaxes(0, 1)), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(fps)

    def close(self) -> None:
        """Close the window if it is open."""
        if self._surface is not None:
            import pygame

            pygame.display.quit()
            self._surface = None

    def __reduce__(self) -> tuple[type[Window], tuple[str, int]]:
        return Window, self._given
