"""Show an episode and read keys: in a terminal, as lines of a script, or in a window."""

from __future__ import annotations

import os
import select
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, Protocol

from envgraph.cli._output import print_line, print_lines
from envgraph.code import dataclass
from envgraph.draw import format_colour, ink_on, parse_colour
from envgraph.env import EMPTY, GridScene, Scene, Window, scene_rgb
from envgraph.errors import escape_unprintable

_ESCAPES: Final = {
    b"[A": "ArrowUp", b"[B": "ArrowDown", b"[C": "ArrowRight", b"[D": "ArrowLeft", b"[3~": "Delete", b"": "Escape",
}  # fmt: skip
"""The keys by the characters that a terminal sends after the escape character. Some send `O` in place of `[`."""

_CONTROLS: Final = {"\r": "Enter", "\n": "Enter", "\t": "Tab", "\x7f": "Backspace", "\b": "Backspace"}
_END_OF_INPUT: Final = "\x04"
_ESCAPE_SECONDS: Final = 0.1
"""Seconds to wait for the rest of an escape sequence. If nothing follows, the key was Escape."""


@dataclass(frozen=True, slots=True)
class PlayView:
    """The state of an episode, as people see it while they play.

    Attributes:
        scene: the picture; None if the environment has none.
        picture: the picture, or else the objects, as text.
        status: the number of steps, the last action, the rewards, and the end.
        actions: each action with its key in front, and True if it is allowed now.
        commands: the commands with their keys.
        message: an answer to the last key; "" for none.
        title: the names of the member and the family.
    """

    scene: Scene | None
    picture: str
    status: str
    actions: tuple[tuple[str, bool], ...]
    commands: str
    message: str
    title: str


class PlayScreen(Protocol):
    """An interface to a person or a script: it shows the state, and reads keys."""

    @property
    def script_line(self) -> str:
        """Return the line of the script with the last key, for errors; "" if a person can press another key instead."""

    def show(self, view: PlayView) -> None:
        """Show the state."""

    def read_key(self, seconds: float | None) -> str | None:
        """Wait for a key; return its name, "" after `seconds` without one, or None at the end of the input."""


class LineScreen:
    """Lines of standard input, each with a key, an action or a command. States are printed one below the other."""

    def __init__(self) -> None:
        self._count, self._is_script = 0, not (sys.stdin.isatty() and sys.stdout.isatty())

    @property
    def script_line(self) -> str:
        """See `PlayScreen`."""
        return f"line {self._count} of standard input" if self._is_script else ""

    def show(self, view: PlayView) -> None:
        """Print the state; the keys only the first time."""
        if not self._count:
            print_line(f"keys: {', '.join(text for text, _ in view.actions)}; {view.commands}")
        self._count += 1
        print_lines(f"\n{view.picture}\n{view.status}")
        if view.message:
            print_line(view.message)
        allowed = [text for text, can in view.actions if can]
        if 0 < len(allowed) < len(view.actions):
            print_line(f"allowed: {', '.join(allowed)}")
        sys.stdout.flush()

    def read_key(self, seconds: float | None) -> str | None:
        """Read a line. With `seconds`, only wait."""
        if seconds is not None:
            time.sleep(seconds)
            return ""
        line = sys.stdin.readline()
        return line.rstrip("\r\n") if line else None


class TerminalScreen:
    """A terminal that shows the state on its alternate screen. `open_screen` creates it and sets its modes."""

    script_line = ""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(highlight=False)
        self._input = sys.stdin.fileno()

    def show(self, view: PlayView) -> None:
        """Clear the screen, and draw the state."""
        from rich.text import Text

        sys.stdout.write("\x1b[H\x1b[J")
        self._console.print(_coloured(view), soft_wrap=True)
        self._console.print(Text(f"\n{escape_unprintable(view.status)}", "bold"))
        for line in _lines_of(view.actions, self._console.width):
            self._console.print(
                Text("   ").join(Text(text, "" if can else "dim") for text, can in line), soft_wrap=True
            )
        self._console.print(Text(view.commands, "dim"))
        self._console.print(Text(escape_unprintable(view.message or view.title), "yellow" if view.message else "dim"))
        sys.stdout.flush()

    def read_key(self, seconds: float | None) -> str | None:
        """Wait for a key of the terminal."""
        if not self._has_input(seconds):
            return ""
        first = os.read(self._input, 1)
        if first == b"\x1b":
            rest = b""
            while (not rest[-1:].isalpha() and rest[-1:] != b"~") or rest == b"O":
                if not self._has_input(_ESCAPE_SECONDS):
                    break
                rest += os.read(self._input, 1)
            return _ESCAPES.get(rest.replace(b"O", b"[", 1), f"Escape {rest.decode('latin-1')}")
        while first and len(first) < 4 and not _is_character(first):
            first += os.read(self._input, 1)
        text = first.decode("utf-8", "replace")
        return None if text in ("", _END_OF_INPUT) else _CONTROLS.get(text, text)

    def _has_input(self, seconds: float | None) -> bool:
        return bool(select.select([self._input], [], [], seconds)[0])


class WindowScreen:
    """A window of pygame that shows the picture; its title is the status."""

    script_line = ""

    def __init__(self, name: str) -> None:
        self._name, self._window = name, Window(name, 60)

    def show(self, view: PlayView) -> None:
        """Draw the picture; its state is the title of the window."""
        assert view.scene is not None, "only environments with pictures have a window"
        self._window.set_title(": ".join((self._name, view.message or view.status)))
        self._window.show(scene_rgb(view.scene, 48))

    def read_key(self, seconds: float | None) -> str | None:
        """Wait for a key that is pressed in the window."""
        return self._window.read_key(seconds)

    def close(self) -> None:
        """Close the window."""
        self._window.close()


@contextmanager
def open_screen(window_name: str | None) -> Iterator[PlayScreen]:
    """Open a window of this name; for None use the terminal, or lines if standard input or output is no terminal."""
    if window_name is not None:
        window = WindowScreen(window_name)
        try:
            yield window
        finally:
            window.close()
    elif sys.stdin.isatty() and sys.stdout.isatty() and sys.platform != "win32":
        with _terminal_modes():
            yield TerminalScreen()
    else:
        yield LineScreen()


@contextmanager
def _terminal_modes() -> Iterator[None]:
    """Make the terminal return single keys and show its alternate screen; restore its modes and screen at the end."""
    import termios
    import tty

    number = sys.stdin.fileno()
    before: list[Any] = termios.tcgetattr(number)
    try:
        tty.setcbreak(number)
        modes = termios.tcgetattr(number)
        modes[6][termios.VSUSP] = b"\0"  # Ctrl-Z would leave the terminal in these modes
        termios.tcsetattr(number, termios.TCSADRAIN, modes)
        sys.stdout.write("\x1b[?1049h\x1b[?25l")
        yield
    finally:
        sys.stdout.write("\x1b[?25h\x1b[?1049l")
        sys.stdout.flush()
        termios.tcsetattr(number, termios.TCSADRAIN, before)


def _is_character(encoded: bytes) -> bool:
    """Return True if bytes are a complete character in UTF-8."""
    try:
        encoded.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _coloured(view: PlayView) -> Any:
    """Return the picture as a text of rich, with the colours of cells and tokens."""
    from rich.text import Text

    lines, scene = [], view.scene
    for row, line in enumerate(view.picture.split("\n")):
        text = Text(escape_unprintable(line))
        if isinstance(scene, GridScene) and row < scene.height:
            text.pad_right(max(0, 3 * scene.width - len(text)))
            for column in range(scene.width):
                if colour := _cell_colour(scene, column, row):
                    ink = format_colour(ink_on(parse_colour(colour)))
                    text.stylize(f"{ink} on {colour}", 3 * column, 3 * column + 3)
        lines.append(text)
    return Text("\n").join(lines)


def _lines_of(actions: Sequence[tuple[str, bool]], width: int) -> list[list[tuple[str, bool]]]:
    """Return actions in lines of at most `width` characters, with 3 between two; a longer action has its own line."""
    lines: list[list[tuple[str, bool]]] = []
    used = width
    for text, can in actions:
        shown = escape_unprintable(text)
        used += 3 + len(shown)
        if used > width:
            lines.append([])
            used = len(shown)
        lines[-1].append((shown, can))
    return lines


def _cell_colour(scene: GridScene, column: int, row: int) -> str | None:
    """Return the colour of the last token on a cell, or else of the cell; None for a place without a cell."""
    kind = scene.cells[row * scene.width + column]
    marks = [mark.colour for mark in scene.marks if mark.place == (column, row)]
    return marks[-1] if marks else None if kind == EMPTY else scene.glyphs[kind].colour
