"""Show pictures in a window of pygame (the extra `human`), for `render_mode="human"`."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from envgraph.behaviour import NAMED_KEYS

_KEY_NAMES: Final = {code: name for name, code in {**NAMED_KEYS, "Escape": 27}.items()}


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

    def set_title(self, title: str) -> None:
        """Change the title of the window, also of one that opens later."""
        self._given = title, self._given[1]
        if self._surface is not None:
            import pygame

            pygame.display.set_caption(title)

    def read_key(self, seconds: float | None = None) -> str | None:
        """Wait for a key that is pressed in the open window; return its name as in `@key`.

        Return "" if none was pressed for `seconds`, and None if the window is to be closed.
        """
        import pygame

        ends = None if seconds is None else pygame.time.get_ticks() + 1000 * seconds
        while ends is None or pygame.time.get_ticks() < ends:
            event = pygame.event.wait(50)  # so that Ctrl-C in the terminal is noticed
            if event.type == pygame.QUIT:
                return None
            if event.type == pygame.KEYDOWN:
                name = _KEY_NAMES.get(event.key) or event.unicode or (chr(event.key) if event.key < 128 else "")
                if name:
                    return str(name)
        return ""

    def close(self) -> None:
        """Close the window if it is open."""
        if self._surface is not None:
            import pygame

            pygame.display.quit()
            self._surface = None

    def __reduce__(self) -> tuple[type[Window], tuple[str, int]]:
        return Window, self._given
